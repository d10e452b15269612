//! What depth cameras measure: the exact images, with the errors of [`DepthConfig`] added to them.

use catch_body::Pose;
use catch_cell::{CameraModel, DepthFrame, PixelWindow};
use nalgebra::{UnitQuaternion, Vector3};

use super::{
    Readout, Renderer, Scene,
    chance::{self, Key},
    depth_noise::{DepthConfig, DepthModel, EDGE_JUMP_PX, StereoNoise},
    render::{Image, widened},
};

/// The cameras of one scene: where they truly stand, and all that chance does to their images.
///
/// What a pixel shows is a pure function of the scene, its seed and index, the camera, the number of the exposure and the
/// pixel: which other pixels, cameras or exposures are read out changes nothing.
#[derive(Debug, Clone)]
pub struct DepthCameras {
    cameras: Vec<CameraModel>,
    config: DepthConfig,
    key: Key,
}

/// What chance is asked for. One for each camera, and one for each of its exposures.
#[derive(Debug, Clone, Copy)]
enum Purpose {
    Calibration,
    Exposures,
}

/// Places in the sequence of an exposure's key, before those of its pixels.
#[derive(Debug, Clone, Copy)]
enum Place {
    Loss,
    Common,
    Pixels,
    FlyingPixels,
}

impl DepthCameras {
    /// The cameras of the scene (`seed`, `index`), which the brain believes to stand as `calibrated`.
    pub fn new(calibrated: &[CameraModel], config: &DepthConfig, seed: u64, index: u64) -> Self {
        let key = Key::of_scene(seed, index);
        let true_camera = |(number, camera): (u64, &CameraModel)| {
            let mut camera = camera.clone();
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
        Self { cameras: (0..).zip(calibrated).map(true_camera).collect(), config: config.clone(), key }
    }

    /// The cameras where they truly stand.
    pub fn cameras(&self) -> &[CameraModel] {
        &self.cameras
    }

    /// The images of exposure number `exposure` that are not lost; with `labelled` also which pixels truly show the object.
    pub fn capture(
        &self,
        renderer: &Renderer,
        scene: &Scene,
        exposure: u64,
        readout: Readout,
        labelled: bool,
    ) -> Vec<DepthFrame> {
        let view = renderer.view(scene);
        let stereo = self.config.model.stereo();
        let edge_px = stereo.as_ref().map_or(0, StereoNoise::edge_reach_px);
        let facing = stereo.as_ref().is_some_and(|stereo| stereo.grazing_rad.is_some());
        let frame_of = |(index, camera): (usize, &CameraModel)| {
            let key = self.key.part(index as u64).part(Purpose::Exposures as u64).part(exposure);
            let lost = key.part(Place::Loss as u64).unit(0) < self.config.lost_frame_share;
            (!lost).then(|| {
                let window = view.window(index, camera, readout, edge_px);
                // What a pixel shows depends on its neighbours too.
                let image = view.image(camera, widened(camera, &window, edge_px), facing);
                match (&self.config.model, &stereo) {
                    (_, Some(stereo)) => {
                        let image = stereo.measured(image, &window, key);
                        image.frame(index, scene.capture_s, labelled)
                    }
                    (DepthModel::Perfect, _) => image.frame(index, scene.capture_s, labelled),
                    (model, _) => {
                        let mut image = image;
                        let pixels = key.part(Place::Pixels as u64);
                        image.change_pixels(|pixel, z| {
                            let normal = chance::normal((pixels.bits(pixel) >> 32) as u32);
                            z + model.sd_m(z, camera.focal_px) * normal
                        });
                        image.frame(index, scene.capture_s, labelled)
                    }
                }
            })
        };
        self.cameras.iter().enumerate().filter_map(frame_of).collect()
    }
}

impl Image<'_> {
    /// Replaces each depth that was met by what `change` makes of the pixel's number in the full image and of that depth.
    fn change_pixels(&mut self, change: impl Fn(u64, f64) -> f64) {
        let (window, columns) = (self.window, u64::from(self.camera.width_px));
        for (row, depths) in (u64::from(window.top)..).zip(self.nearest.chunks_mut((window.width as usize).max(1))) {
            for (pixel, depth) in (row * columns + u64::from(window.left)..).zip(depths) {
                if *depth < f64::INFINITY {
                    *depth = change(pixel, *depth);
                }
            }
        }
    }
}

impl StereoNoise {
    /// How far around a pixel its measurement depends on other pixels.
    fn edge_reach_px(&self) -> u32 {
        if self.bleed_share + self.flying_share > 0.0 { self.edge_px } else { 0 }
    }

    /// What is measured in `window`, a part of an exact image.
    fn measured<'a>(&self, exact: Image<'a>, window: &PixelWindow, key: Key) -> Image<'a> {
        let mut image = if self.edge_reach_px() > 0 { self.with_edges(&exact, window, key) } else { exact };
        // 1/z in units of the disparity: an error of s pixels is one of s/(f·b) in 1/z.
        let sd = self.inverse_depth_sd_per_m(image.camera.focal_px);
        let common = sd * self.common_share.sqrt() * key.part(Place::Common as u64).normal(0);
        let own_sd = sd * (1.0 - self.common_share).sqrt();
        let pixels = key.part(Place::Pixels as u64);
        let [nearest_m, farthest_m] = self.range_m.unwrap_or([0.0, f64::INFINITY]);
        let facing = image.facing.take();
        let (corner, wide, columns) = (image.window, image.window.width as u64, u64::from(image.camera.width_px));
        let first = u64::from(corner.top) * columns + u64::from(corner.left);
        image.change_pixels(|pixel, z| {
            let bits = pixels.bits(pixel);
            let missing = match (&facing, self.grazing_rad) {
                (Some(facing), Some([from, to])) => {
                    let at = pixel - first;
                    let cosine = facing[(at / columns * wide + at % columns) as usize];
                    let rise = ((f64::from(cosine).acos() - from) / (to - from)).clamp(0.0, 1.0);
                    self.dropout_share + (1.0 - self.dropout_share) * rise
                }
                _ => self.dropout_share,
            };
            if chance::unit(bits as u32) < missing {
                return f64::INFINITY;
            }
            let measured = 1.0 / (1.0 / z + common + own_sd * chance::normal((bits >> 32) as u32));
            if measured >= nearest_m && measured <= farthest_m { measured } else { f64::INFINITY }
        });
        image
    }

    /// The part `window` of an image as matching sees it along depth edges, before noise.
    ///
    /// A pixel from which a nearer surface begins within `edge_px` may show that surface, or a disparity anywhere between both; one from
    /// which a farther surface begins only the latter.
    fn with_edges<'a>(&self, exact: &Image<'a>, window: &PixelWindow, key: Key) -> Image<'a> {
        let mut image = Image::empty(exact.camera, *window, exact.facing.is_some());
        let key = key.part(Place::FlyingPixels as u64);
        let jump = EDGE_JUMP_PX / (exact.camera.focal_px * self.baseline_m);
        let (wide, high) = (exact.window.width as usize, exact.window.height as usize);
        let reach = self.edge_px as usize;
        for i in 0..window.area() {
            let (column, row) = (i % window.width as usize, i / window.width as usize);
            let (x, y) =
                (column + (window.left - exact.window.left) as usize, row + (window.top - exact.window.top) as usize);
            let at = y * wide + x;
            image.shows_object[i] = exact.shows_object[at];
            let z = exact.nearest[at];
            let (mut nearest, mut nearest_at, mut farthest) = (z, at, z);
            for line in y.saturating_sub(reach)..(y + reach + 1).min(high) {
                for near in line * wide + x.saturating_sub(reach)..line * wide + (x + reach + 1).min(wide) {
                    let depth = exact.nearest[near];
                    if depth < nearest {
                        (nearest, nearest_at) = (depth, near);
                    }
                    farthest = farthest.max(depth);
                }
            }
            let (mut shown, mut shown_at) = (z, at);
            // Without any surface 1/z is zero.
            let other = if 1.0 / nearest - 1.0 / z > jump {
                Some(nearest)
            } else if 1.0 / z - 1.0 / farthest > jump {
                Some(farthest)
            } else {
                None
            };
            if let Some(other) = other {
                let pixel = u64::from(window.top + row as u32) * u64::from(exact.camera.width_px)
                    + u64::from(window.left + column as u32);
                let bits = key.bits(pixel);
                let draw = chance::unit(bits as u32);
                if draw < self.flying_share {
                    let between = chance::unit((bits >> 32) as u32);
                    shown = 1.0 / ((1.0 - between) / z + between / other);
                } else if other < z && draw < self.flying_share + self.bleed_share {
                    (shown, shown_at) = (nearest, nearest_at);
                }
            }
            image.nearest[i] = shown;
            if let (Some(facing), Some(exact)) = (&mut image.facing, &exact.facing) {
                facing[i] = exact[shown_at];
            }
        }
        image
    }
}
