//! Ray-cast, shaded images of arm, hand and object, where no browser draws them.

use base64::{Engine, prelude::BASE64_STANDARD};
use catch_body::{Gripper, Pose, Robot, TriangleMesh, ray_cast::RayCaster};
use catch_cell::{CameraModel, PixelWindow, sight::Sight};
use nalgebra::{Matrix3, Point2, Point3, Vector3};
use png::{ColorType, Compression, Encoder};

use crate::{
    playback::{MotionSample, Playback},
    surfaces::{
        Part, Surface, finger_poses,
        paint::{Colour, grey},
        surfaces,
    },
    viewpoint::{CatchScene, between},
};

const SKY: f64 = 0.93;
const FLOOR: f64 = 0.89;
const GRID: f64 = 0.80;
/// Brightness of a shadow over that of the floor around it.
const SHADOW: f64 = 0.80;
/// Opacity of a link before hand or object.
const VEIL: f64 = 0.2;
/// Opacity of the surroundings.
const FADED: f64 = 0.25;
/// Rays per pixel and direction where bodies meet.
const FINE: usize = 3;
/// Width and height of a picture of a catch.
const PICTURE_PX: u32 = 150;

/// A line through the scene.
#[derive(Debug, Clone)]
pub struct Line {
    /// Points of the line in W.
    pub path: Vec<Point3<f64>>,
    /// Colour of the line.
    pub colour: Colour,
    /// Width of the line in pixels.
    pub width_px: f64,
}

/// Parts of the scene that are the same in all images of a throw.
#[derive(Debug)]
pub struct Shader {
    surfaces: Vec<(RayCaster, Surface)>,
    sun: Vector3<f64>,
    robot: Robot,
    gripper: Gripper,
}

/// Bodies before a camera at an instant.
struct Shot<'a> {
    camera: &'a CameraModel,
    sun: Vector3<f64>,
    bodies: Vec<Body<'a>>,
}

/// A body at an instant.
struct Body<'a> {
    X_WB: Pose,
    R_BW: Matrix3<f64>,
    /// Centre of a ball that holds the body; its radius is the caster's.
    centre_W: Point3<f64>,
    caster: &'a RayCaster,
    sight: Sight<'a>,
    colour: Colour,
    /// Opacity before everything, and before hand and object, which have none: they are never hidden.
    opacity: Option<[f64; 2]>,
}

/// Surface that a pixel shows.
#[derive(Clone, Copy)]
struct Seen {
    colour: Colour,
    /// Along the ray, in multiples of its direction, which is the depth; infinite for floor and sky.
    depth_m: f64,
    /// Index of the body; `usize::MAX` for none.
    body: usize,
}

impl Shader {
    /// Prepares the surfaces; the object's where it is known.
    pub fn new(robot: &Robot, gripper: &Gripper, object: Option<&TriangleMesh>) -> Self {
        let surfaces = surfaces(robot, gripper, object);
        Self {
            surfaces: surfaces.into_iter().map(|it| (RayCaster::new(&it.mesh), it)).collect(),
            sun: Vector3::new(0.35, -0.35, 0.87).normalize(),
            robot: robot.clone(),
            gripper: gripper.clone(),
        }
    }

    /// One image of a camera, row by row.
    pub fn image(&self, camera: &CameraModel, sample: &MotionSample, lines: &[Line]) -> Vec<Colour> {
        let X_WL = self.robot.link_poses(&sample.q);
        let mut bodies: Vec<Body> = Vec::new();
        for (caster, surface) in &self.surfaces {
            let mut add = |X_WB, opacity| bodies.push(Body::new(camera, X_WB, caster, (surface.colour, opacity)));
            match surface.of {
                Part::Link => add(X_WL[surface.link], Some([1.0, VEIL])),
                Part::Housing => add(sample.X_WG, None),
                Part::Finger => {
                    for X_GF in finger_poses(&self.gripper, sample.width_m) {
                        add(sample.X_WG * X_GF, None);
                    }
                }
                Part::Object => sample.X_WO.into_iter().for_each(|X_WO| add(X_WO, None)),
                Part::Obstacle => add(Pose::identity(), Some([FADED; 2])),
            }
        }
        Shot { camera, sun: self.sun, bodies }.image(lines)
    }
}

/// Hand and object at the catch, as a PNG file in base64; empty for a recording without motion.
pub fn picture_of_catch(playback: &Playback) -> String {
    let at = playback.motion_at(playback.flight_end_s());
    let Some((sample, scene)) = at.zip(CatchScene::new(playback)) else { return String::new() };
    let object = playback.ground_truth().map(|it| it.surface.mesh());
    let view = scene.close_up();
    let (target, radius_m) = between(playback, &sample, view.radius_m);
    let camera = view.around(&target, radius_m, [PICTURE_PX; 2]);
    let shader = Shader::new(&playback.robot, &playback.gripper, object.as_ref());
    BASE64_STANDARD.encode(png(&shader.image(&camera, &sample, &[]), PICTURE_PX))
}

/// A square picture as a PNG file.
fn png(colours: &[Colour], size_px: u32) -> Vec<u8> {
    let byte = |value: &f64| (value.clamp(0.0, 1.0) * 255.0).round() as u8;
    let pixels: Vec<u8> = colours.iter().flatten().map(byte).collect();
    let mut file = Vec::new();
    let mut encoder = Encoder::new(&mut file, size_px, size_px);
    encoder.set_color(ColorType::Rgb);
    encoder.set_compression(Compression::High);
    // Writing to memory cannot fail.
    let _ = encoder.write_header().and_then(|mut writer| writer.write_image_data(&pixels));
    file
}

impl<'a> Body<'a> {
    fn new(camera: &'a CameraModel, X_WB: Pose, caster: &'a RayCaster, looks: (Colour, Option<[f64; 2]>)) -> Self {
        Self {
            X_WB,
            R_BW: X_WB.rotation.inverse().to_rotation_matrix().into_inner(),
            centre_W: X_WB * caster.centre,
            caster,
            sight: Sight::new(camera, &X_WB, caster),
            colour: looks.0,
            opacity: looks.1,
        }
    }
}

impl Shot<'_> {
    fn image(&self, lines: &[Line]) -> Vec<Colour> {
        let window = self.camera.full_window();
        let (width, count) = (window.width as usize, window.area());
        let centres: Vec<Seen> = (0..count).map(|pixel| self.look(&window.pixel_centre(pixel))).collect();
        let mut colours: Vec<Colour> = (0..count)
            .map(|pixel| {
                let neighbours = [pixel.wrapping_sub(1), pixel + 1, pixel.wrapping_sub(width), pixel + width];
                let meets = |&at: &usize| centres.get(at).is_some_and(|it| it.body != centres[pixel].body);
                if neighbours.iter().any(meets) { self.finely(pixel) } else { centres[pixel].colour }
            })
            .collect();
        for line in lines {
            self.draw(line, &centres, &mut colours);
        }
        colours
    }

    /// A pixel's mean colour.
    fn finely(&self, pixel: usize) -> Colour {
        let centre = self.camera.full_window().pixel_centre(pixel);
        let offset = |i: usize| (i as f64 + 0.5) / FINE as f64 - 0.5;
        let mut sum = [0.0; 3];
        for i in 0..FINE * FINE {
            let uv = Point2::new(centre.x + offset(i % FINE), centre.y + offset(i / FINE));
            let colour = self.look(&uv).colour;
            sum = [0, 1, 2].map(|c| sum[c] + colour[c] / (FINE * FINE) as f64);
        }
        sum
    }

    /// Casts a ray through a point of the image: the nearest surface that is not seen through, and over it
    /// those before it that are.
    fn look(&self, uv: &Point2<f64>) -> Seen {
        let origin = Point3::from(self.camera.X_WC.translation.vector);
        let direction = self.camera.X_WC.rotation * self.camera.back_project(uv, 1.0).coords;
        let mut hits: Vec<(f64, usize, usize)> = Vec::new();
        for (i, body) in self.bodies.iter().enumerate().filter(|(_, body)| contains(&body.sight.window(), uv)) {
            hits.extend(body.sight.at(uv, f64::INFINITY).map(|hit| (hit.t, i, hit.triangle)));
        }
        hits.sort_by(|a, b| a.0.total_cmp(&b.0));
        let shows_catch = hits.iter().any(|(_, i, _)| self.bodies[*i].opacity.is_none());
        let opacity = |i: usize| self.bodies[i].opacity.map_or(1.0, |it| it[usize::from(shows_catch)]);
        let colour = |&(_, i, triangle): &(f64, usize, usize)| {
            let normal = self.camera.X_WC.rotation * self.bodies[i].sight.normal_C(triangle);
            self.lit(&self.bodies[i], &normal, &direction.normalize())
        };
        let solid = hits.iter().position(|(_, i, _)| opacity(*i) == 1.0);
        let behind = match solid {
            Some(at) => Seen { colour: colour(&hits[at]), depth_m: hits[at].0, body: hits[at].1 },
            None => Seen { colour: self.background(&origin, &direction), depth_m: f64::INFINITY, body: usize::MAX },
        };
        let before = hits[..solid.unwrap_or(hits.len())].iter().rev();
        before.fold(behind, |seen, hit| Seen { colour: mixed(&seen.colour, &colour(hit), opacity(hit.1)), ..seen })
    }

    /// A surface in the light of sky and sun, and a little from the camera.
    fn lit(&self, body: &Body, normal: &Vector3<f64>, direction: &Vector3<f64>) -> Colour {
        let half = (self.sun - direction).normalize();
        let light =
            0.46 + 0.16 * normal.z + 0.95 * normal.dot(&self.sun).max(0.0) - 0.16 * normal.dot(direction).min(0.0);
        let shine = 0.1 * normal.dot(&half).max(0.0).powi(60);
        // The light of the surface, on a curve as of film: as the page has it.
        let lit = body.colour.map(|value| value * value * light + shine);
        let most = lit.iter().copied().fold(0.0, f64::max);
        let film = (2.2 * most + 0.1) / (most * (2.1 * most + 0.55) + 0.12);
        lit.map(|value| (value * film).sqrt().min(1.0))
    }

    /// Floor with its grid and the shadows on it, or sky.
    fn background(&self, origin: &Point3<f64>, direction: &Vector3<f64>) -> Colour {
        let t = -origin.z / direction.z;
        if !(t > 0.0 && t.is_finite()) {
            return grey(SKY);
        }
        let p_W = origin + direction * t;
        let away_m = libm::hypot(p_W.x, p_W.y);
        let fade = 1.0 - ((away_m - 1.5) / 4.0).clamp(0.0, 1.0);
        // Lines 12 mm wide every half metre, as far as they cover a pixel's part of the floor.
        let pixel_m = t / self.camera.focal_px * (direction.norm() / direction.z.abs()).sqrt();
        let from_line = |value: f64| ((value * 2.0).round() / 2.0 - value).abs();
        let cover =
            |value: f64| ((0.006 + pixel_m / 2.0 - from_line(value)) / pixel_m).clamp(0.0, (0.012 / pixel_m).min(1.0));
        let floor = FLOOR + (GRID - FLOOR) * cover(p_W.x).max(cover(p_W.y));
        let blocked = |body: &Body| {
            let offset = body.centre_W - p_W;
            let miss = offset - self.sun * offset.dot(&self.sun);
            miss.norm_squared() <= body.caster.radius.powi(2)
                && body.caster.cast(&body.X_WB.inverse_transform_point(&p_W), &(body.R_BW * self.sun)).is_some()
        };
        let shadow =
            if self.bodies.iter().filter(|it| it.opacity != Some([FADED; 2])).any(blocked) { SHADOW } else { 1.0 };
        grey(SKY + (floor * shadow - SKY) * fade.max(if shadow < 1.0 { 0.4 } else { 0.0 }))
    }

    /// Draws a line where nothing is before it.
    fn draw(&self, line: &Line, seen: &[Seen], colours: &mut [Colour]) {
        let project = |p_W: &Point3<f64>| {
            let p_C = self.camera.X_WC.inverse_transform_point(p_W);
            self.camera.project(&p_C).map(|uv| (uv, p_C.z))
        };
        let window = self.camera.full_window();
        let mut cover = vec![0.0_f64; seen.len()];
        for pair in line.path.windows(2) {
            let (Some((a, depth)), Some((b, _))) = (project(&pair[0]), project(&pair[1])) else { continue };
            let reach = line.width_px / 2.0 + 1.0;
            let cut = |value: f64, most: u32| value.clamp(0.0, f64::from(most)) as usize;
            let rows = cut(a.y.min(b.y) - reach, window.height)..cut(a.y.max(b.y) + reach + 1.0, window.height);
            for row in rows {
                for column in cut(a.x.min(b.x) - reach, window.width)..cut(a.x.max(b.x) + reach + 1.0, window.width) {
                    let pixel = row * window.width as usize + column;
                    let fraction = (reach - 0.5 - distance(&window.pixel_centre(pixel), &a, &b)).clamp(0.0, 1.0);
                    if seen[pixel].depth_m > depth {
                        cover[pixel] = cover[pixel].max(fraction);
                    }
                }
            }
        }
        for (colour, fraction) in colours.iter_mut().zip(cover) {
            *colour = mixed(colour, &line.colour, fraction);
        }
    }
}

/// A colour under another of some opacity.
fn mixed(under: &Colour, over: &Colour, opacity: f64) -> Colour {
    [0, 1, 2].map(|c| under[c] + (over[c] - under[c]) * opacity)
}

/// Returns whether a window holds a point of the image, within a pixel.
fn contains(window: &PixelWindow, uv: &Point2<f64>) -> bool {
    let within =
        |value: f64, first: u32, count: u32| (f64::from(first) - 1.0..=f64::from(first + count) + 1.0).contains(&value);
    window.area() > 0 && within(uv.x, window.left, window.width) && within(uv.y, window.top, window.height)
}

/// Distance of a point from a piece of a line.
fn distance(point: &Point2<f64>, a: &Point2<f64>, b: &Point2<f64>) -> f64 {
    let along = b - a;
    let s = ((point - a).dot(&along) / along.norm_squared().max(f64::MIN_POSITIVE)).clamp(0.0, 1.0);
    (point - (a + along * s)).norm()
}
