//! Measurements of depth cameras: the exact images, with the errors of [`DepthConfig`] added to them.

use catch_body::Pose;
use catch_cell::{CameraModel, DepthFrame, PixelWindow, camera::among_neighbours};
use nalgebra::{Point3, UnitQuaternion, Vector3};

use crate::{
    depth_noise::{DepthConfig, DepthModel, EDGE_JUMP_PX, StereoNoise},
    person::{Person, Thrower},
};

use super::{
    Readout, Renderer, Scene,
    counter_generator::{self, Key},
    render::{Channels, Image},
};

/// The cameras of one scene: where they truly stand, and the random streams of their images.
///
/// What a pixel shows is a pure function of the scene, its seed and index, the camera, the number of the
/// exposure and the pixel: which other pixels, cameras or exposures are read out changes nothing.
#[derive(Debug, Clone)]
pub struct DepthCameras {
    cameras: Vec<CameraModel>,
    config: DepthConfig,
    holes: Option<Holes>,
    /// A person who walks through the images.
    pub(crate) person: Option<Person>,
    /// The person who threw the object, and when.
    pub(crate) thrower: Option<(Thrower, f64)>,
    key: Key,
}

/// The purpose of a random stream. One for each camera, and one for each of its exposures.
#[derive(Debug, Clone, Copy)]
enum Purpose {
    Calibration,
    Exposures,
    Phase,
}

/// The part of a scene's random numbers that belongs to its object, beside the parts of its cameras.
const OBJECT: u64 = u64::MAX;

/// Places in the sequence of an exposure's key, before those of its pixels.
#[derive(Debug, Clone, Copy)]
enum Place {
    Loss,
    Common,
    Pixels,
    Edges,
    Latency,
}

impl DepthCameras {
    /// The cameras of the scene (`seed`, `index`), which the brain believes to stand as `calibrated`.
    pub fn new(calibrated: &[CameraModel], config: &DepthConfig, seed: u64, index: u64) -> Self {
        let key = Key::of_scene(seed, index);
        let true_camera = |(number, camera): (u64, &CameraModel)| {
            let mut camera = config.shifted(camera);
            if config.calibration_sd_m > 0.0 || config.calibration_sd_rad > 0.0 {
                let key = key.part(number).part(Purpose::Calibration as u64);
                let normal = |first: u64| Vector3::from_fn(|axis, _| key.normal(first + axis as u64));
                let p_CT = normal(0) * config.calibration_sd_m;
                let R_CT = UnitQuaternion::from_scaled_axis(normal(3) * config.calibration_sd_rad);
                // The true camera T stands so in the frame C of the calibrated one.
                camera.X_WC *= Pose::from_parts(p_CT.into(), R_CT);
            }
            camera
        };
        Self {
            cameras: (0..).zip(calibrated).map(true_camera).collect(),
            config: config.clone(),
            holes: Holes::new(config, key.part(OBJECT)),
            person: None,
            thrower: None,
            key,
        }
    }

    /// The cameras where they truly stand.
    pub fn cameras(&self) -> &[CameraModel] {
        &self.cameras
    }

    /// Exchanges the images of two cameras.
    pub(crate) fn swap(&mut self, one: usize, other: usize) {
        if one.max(other) < self.cameras.len() {
            self.cameras.swap(one, other);
        }
    }

    /// A camera is displaced, by metres in W.
    pub(crate) fn push(&mut self, camera: usize, by_W: Vector3<f64>) {
        if let Some(camera) = self.cameras.get_mut(camera) {
            camera.X_WC.translation.vector += by_W;
        }
    }

    /// Fraction of the object's surface that gives no depth.
    pub(crate) fn hole_fraction(&self) -> f64 {
        self.holes.as_ref().map_or(0.0, |holes| holes.fraction)
    }

    /// The phase of a camera that runs freely, as a fraction of its period.
    pub(crate) fn phase(&self, camera: usize) -> f64 {
        self.key.part(camera as u64).part(Purpose::Phase as u64).unit(0)
    }

    /// Latency of a camera's image, between the least (0) and the most (1).
    pub(crate) fn lateness(&self, camera: usize, exposure: u64) -> f64 {
        self.exposure_key(camera, exposure).part(Place::Latency as u64).unit(0)
    }

    fn exposure_key(&self, camera: usize, exposure: u64) -> Key {
        self.key.part(camera as u64).part(Purpose::Exposures as u64).part(exposure)
    }

    /// The images of some cameras, each with the number of its exposure, that are not lost; with `labelled`
    /// also which pixels truly show the object.
    pub fn capture(
        &self,
        renderer: &Renderer,
        scene: &Scene,
        exposures: impl IntoIterator<Item = (usize, u64)>,
        readout: Readout,
        labelled: bool,
    ) -> Vec<DepthFrame> {
        let walking = self.person.iter().flat_map(|person| person.parts(scene.capture_s));
        let thrower = self.thrower.iter().flat_map(|(thrower, at_s)| thrower.parts(scene.capture_s - at_s));
        let view = renderer.view(scene, walking.chain(thrower));
        let stereo = self.config.model.stereo();
        let edge_px = stereo.map_or(0, StereoNoise::edge_reach_px);
        let channels = Channels {
            shows_object: labelled || self.holes.is_some(),
            facing: stereo.is_some_and(|stereo| stereo.grazing_rad.is_some()),
        };
        let frame_of = |(index, exposure): (usize, u64)| {
            let camera = &self.cameras[index];
            let key = self.exposure_key(index, exposure);
            if self.is_lost(index, exposure) {
                return None;
            }
            let window = view.window(index, camera, readout, edge_px);
            // A pixel's measurement depends on its neighbours too.
            let around = |part: PixelWindow| part.widened(edge_px, &camera.full_window());
            let bodies = view.bodies(camera);
            let covered = around(view.covered(camera, &bodies)).intersection(&window);
            let exact = view.image(camera, &bodies, around(covered), channels);
            let hidden = self.holes.as_ref().map(|holes| holes.pixels(&exact.within(covered), &scene.X_WO));
            let pixels = key.part(Place::Pixels as u64);
            let mut image = match &self.config.model {
                DepthModel::Perfect => exact,
                DepthModel::Gaussian(noise) => exact.changed(|pixel, _, z| {
                    let normal = counter_generator::normal((pixels.bits(pixel) >> 32) as u32);
                    (z + noise.sd_m * normal) as f32
                }),
                DepthModel::Stereo(noise) => noise.measured(exact, covered, key),
            };
            if self.config.step_m > 0.0 {
                let step_m = self.config.step_m;
                image = image.changed(|_, _, z| ((z / step_m).round() * step_m) as f32);
            }
            for pixel in hidden.into_iter().flatten() {
                image.depth_m[pixel] = f32::NAN;
            }
            image.shows_object = image.shows_object.filter(|_| labelled);
            let image = if image.window == window { image } else { image.within(window) };
            Some(image.frame(index, scene.capture_s))
        };
        exposures.into_iter().filter_map(frame_of).collect()
    }

    /// Returns whether an image never arrives: that is drawn anew, or as it was for the image before.
    fn is_lost(&self, camera: usize, exposure: u64) -> bool {
        let draw = |exposure: u64, n: u64| self.exposure_key(camera, exposure).part(Place::Loss as u64).unit(n);
        let is_drawn_anew = |exposure: &u64| *exposure == 0 || draw(*exposure, 1) >= self.config.lost_frame_persistence;
        let drawn = (0..=exposure).rev().find(is_drawn_anew).unwrap_or(0);
        draw(drawn, 0) < self.config.lost_frame_fraction
    }
}

/// Edge length of a patch without depth, in metres.
const HOLE_SIZE_M: f64 = 0.01;

/// Patches of the object's surface of which there are no depths: cubes of a lattice in O.
#[derive(Debug, Clone)]
struct Holes {
    fraction: f64,
    key: Key,
}

impl Holes {
    /// Holes of a throw; `None` without holes.
    fn new(config: &DepthConfig, key: Key) -> Option<Self> {
        let fraction = config.hole_fraction.at(key.unit(0));
        (fraction > 0.0).then_some(Self { fraction, key })
    }

    /// The pixels of an exact image that show such a patch.
    fn pixels(&self, exact: &Image, X_WO: &Pose) -> Vec<usize> {
        let X_OC = X_WO.inv_mul(&exact.camera.X_WC);
        let is_hole = |pixel: &usize| {
            let p_C = exact.camera.back_project(&exact.window.pixel_centre(*pixel), f64::from(exact.depth_m[*pixel]));
            self.includes(&(X_OC * p_C))
        };
        let shown = exact.shows_object.iter().flatten().enumerate().filter(|(_, shown)| **shown);
        shown.map(|(pixel, _)| pixel).filter(is_hole).collect()
    }

    fn includes(&self, p_O: &Point3<f64>) -> bool {
        // The lattice lies differently in every throw.
        let cell = |axis: usize| (p_O[axis] / HOLE_SIZE_M + self.key.unit(1 + axis as u64)).floor() as i64 as u64;
        self.key.part(cell(0)).part(cell(1)).part(cell(2)).unit(0) < self.fraction
    }
}

impl Image<'_> {
    /// What it shows in another window: nothing beyond its own.
    fn within(&self, window: PixelWindow) -> Self {
        Self {
            camera: self.camera,
            window,
            depth_m: in_window(&self.depth_m, f32::NAN, &self.window, &window),
            shows_object: self.shows_object.as_ref().map(|it| in_window(it, false, &self.window, &window)),
            facing: self.facing.as_ref().map(|it| in_window(it, 0.0, &self.window, &window)),
        }
    }

    /// Replaces each depth that was met by what `change` makes of the pixel's number in the full image, its
    /// place in this one and that depth.
    fn changed(mut self, change: impl Fn(u64, usize, f64) -> f32) -> Self {
        let (window, columns) = (self.window, u64::from(self.camera.width_px));
        let mut at = 0;
        for row in window.top..window.top + window.height {
            let first = u64::from(row) * columns + u64::from(window.left);
            for pixel in first..first + u64::from(window.width) {
                let depth = &mut self.depth_m[at];
                if !depth.is_nan() {
                    *depth = change(pixel, at, f64::from(*depth));
                }
                at += 1;
            }
        }
        self
    }
}

/// Values of the pixels of one window in another; `nothing` beyond it.
fn in_window<T: Copy>(values: &[T], nothing: T, from: &PixelWindow, to: &PixelWindow) -> Vec<T> {
    let mut all = vec![nothing; to.area()];
    let shared = to.intersection(from);
    let pixels = |of: &PixelWindow, row: u32| {
        let first = ((row - of.top) * of.width + shared.left - of.left) as usize;
        first..first + shared.width as usize
    };
    for row in shared.rows() {
        all[pixels(to, row)].copy_from_slice(&values[pixels(from, row)]);
    }
    all
}

impl StereoNoise {
    /// Measured image in `window`, a part of an exact image.
    fn measured<'a>(&self, exact: Image<'a>, window: PixelWindow, key: Key) -> Image<'a> {
        let mut image = if self.edge_reach_px() > 0 { self.with_edges(&exact, window, key) } else { exact };
        // An error of s pixels in the disparity is one of s/(f·b) in 1/z.
        let sd = self.inverse_depth_sd_per_m(image.camera.focal_px);
        let common = sd * self.common_fraction.sqrt() * key.part(Place::Common as u64).normal(0);
        let own_sd = sd * (1.0 - self.common_fraction).sqrt();
        let pixels = key.part(Place::Pixels as u64);
        let [nearest_m, farthest_m] = self.range_m.unwrap_or([0.0, f64::MAX]);
        let facing = image.facing.take();
        let grazing = self.grazing_rad.map(|[from, to]| (libm::cos(from), from, to));
        image.changed(|pixel, at, z| {
            let bits = pixels.bits(pixel);
            let missing = match (&facing, grazing) {
                (Some(facing), Some((cosine, from, to))) if f64::from(facing[at]) < cosine => {
                    let rise = ((libm::acos(f64::from(facing[at])) - from) / (to - from)).min(1.0);
                    self.dropout_fraction + (1.0 - self.dropout_fraction) * rise
                }
                _ => self.dropout_fraction,
            };
            if counter_generator::unit(bits as u32) < missing {
                return f32::NAN;
            }
            let measured = 1.0 / (1.0 / z + common + own_sd * counter_generator::normal((bits >> 32) as u32));
            // An error that leaves no disparity gives a depth that is infinite or behind the camera.
            if measured >= nearest_m && measured <= farthest_m { measured as f32 } else { f32::NAN }
        })
    }

    /// The part `window` of an image as matching sees it along depth edges, before noise.
    ///
    /// A pixel around which a nearer surface is within `edge_px` may show that surface, or a disparity
    /// anywhere between both; one around which there is only a farther one, the latter.
    fn with_edges<'a>(&self, exact: &Image<'a>, window: PixelWindow, key: Key) -> Image<'a> {
        let key = key.part(Place::Edges as u64);
        let jump = (EDGE_JUMP_PX / (exact.camera.focal_px * self.baseline_m)) as f32;
        let (wide, reach) = (exact.window.width as usize, self.edge_px as usize);
        // Without any surface 1/z is zero.
        let inverse: Vec<f32> = exact.depth_m.iter().map(|&z| if z.is_nan() { 0.0 } else { 1.0 / z }).collect();
        let nearest = among_neighbours(&inverse, wide, reach, |a, b| if b > a { b } else { a });
        let farthest = among_neighbours(&inverse, wide, reach, |a, b| if b < a { b } else { a });

        let mut image = exact.within(window);
        let columns = exact.camera.width_px as usize;
        for row in window.top as usize..(window.top + window.height) as usize {
            let line = (row - exact.window.top as usize) * wide;
            for column in window.left as usize..(window.left + window.width) as usize {
                let at = line + column - exact.window.left as usize;
                if nearest[at] - farthest[at] <= jump {
                    continue;
                }
                let is_behind = nearest[at] - inverse[at] > jump;
                if !is_behind && inverse[at] - farthest[at] <= jump {
                    continue;
                }
                let to = (row - window.top as usize) * window.width as usize + column - window.left as usize;
                let bits = key.bits((row * columns + column) as u64);
                let draw = counter_generator::unit(bits as u32);
                if draw < self.flying_fraction {
                    let other = if is_behind { nearest[at] } else { farthest[at] };
                    let between = counter_generator::unit((bits >> 32) as u32) as f32;
                    image.depth_m[to] = 1.0 / (inverse[at] + (other - inverse[at]) * between);
                } else if is_behind && draw < self.flying_fraction + self.bleed_fraction {
                    let (x, y) = (at - line, line / wide);
                    let rows = y.saturating_sub(reach)..(y + reach + 1).min(inverse.len() / wide);
                    let mut around =
                        rows.flat_map(|y| y * wide + x.saturating_sub(reach)..y * wide + (x + reach + 1).min(wide));
                    let shown = around.find(|&near| inverse[near] == nearest[at]).unwrap_or(at);
                    image.depth_m[to] = exact.depth_m[shown];
                    if let (Some(facing), Some(exact)) = (&mut image.facing, &exact.facing) {
                        facing[to] = exact[shown];
                    }
                }
            }
        }
        image
    }
}
