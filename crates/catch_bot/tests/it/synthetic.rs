//! Synthetic depth images of shapes given by formulas, for tests and benches: rays are marched through signed
//! distances, so nothing here shares code with what is tested.

#![allow(dead_code, missing_docs, reason = "shared by tests and benches, of which each uses a part")]

use catch_body::{Pose, pose::look_at};
use catch_cell::{CameraModel, DepthFrame, ReferenceScan};
use nalgebra::{Point3, UnitQuaternion, Vector3};
use rand::{RngExt, SeedableRng};
use rand_distr::StandardNormal;
use rand_pcg::Pcg64Mcg;

/// A solid in its own frame, its centre of mass not at the origin.
#[derive(Debug, Clone, PartialEq)]
pub enum Shape {
    Sphere {
        radius: f64,
    },
    /// A bent tube: balls along an arc, thinner at the ends.
    Banana {
        balls: Vec<(Point3<f64>, f64)>,
    },
    /// A cylinder with a narrower cap on it.
    Bottle,
}

impl Shape {
    pub fn ball() -> Self {
        Self::Sphere { radius: 0.0336 }
    }

    /// Banana of about 0.176 × 0.062 × 0.030 m.
    pub fn banana() -> Self {
        Self::bent(0.1)
    }

    /// A bent tube, one of whose ends is thinner by twice this fraction.
    pub fn bent(uneven: f64) -> Self {
        let balls = (0..=16)
            .map(|i| {
                let along = f64::from(i) / 8.0 - 1.0;
                let angle = along * 0.85;
                let radius = 0.0155 * (1.0 - 0.55 * along.powi(4) - uneven * along);
                (Point3::new(0.1 * libm::sin(angle) + 0.01, 0.1 * libm::cos(angle) - 0.09, 0.005), radius)
            })
            .collect();
        Self::Banana { balls }
    }

    pub fn all() -> [(&'static str, Self); 3] {
        [("ball", Self::ball()), ("banana", Self::banana()), ("bottle", Self::Bottle)]
    }

    pub fn distance(&self, p: &Point3<f64>) -> f64 {
        let cylinder = |low: f64, high: f64, radius: f64| {
            let d = [libm::hypot(p.x, p.y) - radius, (p.z - f64::midpoint(low, high)).abs() - (high - low) / 2.0];
            d[0].max(d[1]).min(0.0) + libm::hypot(d[0].max(0.0), d[1].max(0.0))
        };
        match self {
            Self::Sphere { radius } => (p - Point3::new(0.003, -0.002, 0.001)).norm() - radius,
            Self::Banana { balls } => balls
                .windows(2)
                .map(|pair| {
                    let [(a, ra), (b, rb)] = [pair[0], pair[1]];
                    let along = b - a;
                    let fraction = ((p - a).dot(&along) / along.norm_squared()).clamp(0.0, 1.0);
                    (p - (a + along * fraction)).norm() - (ra + (rb - ra) * fraction)
                })
                .fold(f64::INFINITY, f64::min),
            Self::Bottle => cylinder(0.0, 0.06, 0.0254).min(cylinder(0.06, 0.0786, 0.022)),
        }
    }

    /// A ball around the frame's origin that holds the solid.
    pub fn reach(&self) -> f64 {
        match self {
            Self::Sphere { radius } => radius + 0.004,
            Self::Banana { .. } => 0.105,
            Self::Bottle => 0.084,
        }
    }
}

/// Standard normal numbers.
#[derive(Debug)]
pub struct Normal(pub Pcg64Mcg);

impl Normal {
    pub fn new(seed: u64) -> Self {
        Self(Pcg64Mcg::seed_from_u64(seed))
    }

    pub fn draw(&mut self) -> f64 {
        self.0.sample(StandardNormal)
    }

    pub fn vector(&mut self) -> Vector3<f64> {
        Vector3::new(self.draw(), self.draw(), self.draw())
    }

    pub fn rotation(&mut self) -> UnitQuaternion<f64> {
        let [a, b, c, d] = [self.draw(), self.draw(), self.draw(), self.draw()];
        UnitQuaternion::new_normalize(nalgebra::Quaternion::new(a, b, c, d))
    }

    pub fn uniform(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.0.random::<f64>()
    }
}

/// Depth noise by name: clean, a constant σ, or stereo at 7 m with f = 362 px, baseline 95 mm and subpixel
/// 0.08.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Noise {
    Clean,
    Constant(f64),
    Stereo7,
}

impl Noise {
    pub fn sd(self, z: f64) -> f64 {
        match self {
            Self::Clean => 0.0,
            Self::Constant(sd) => sd,
            Self::Stereo7 => z * z * 0.08 / (362.0 * 0.095),
        }
    }
}

/// Noise figures of a data sheet: (constant part in m, quadratic part in 1/m).
pub fn data_sheet(noise: Noise) -> (f64, f64) {
    match noise {
        Noise::Clean => (0.0, 0.0),
        Noise::Constant(sd) => (sd, 0.0),
        Noise::Stereo7 => (0.0, 0.08 / (362.0 * 0.095)),
    }
}

pub fn uv_sphere(around: &[f64], elevations: &[f64], radius: f64, size: [u32; 2]) -> Vec<CameraModel> {
    let mut cameras = Vec::new();
    for elevation in elevations.iter().map(|degrees| degrees.to_radians()) {
        for azimuth in around.iter().map(|degrees| degrees.to_radians()) {
            let (sin, cos) = libm::sincos(azimuth);
            let eye =
                Point3::new(cos * libm::cos(elevation), sin * libm::cos(elevation), libm::sin(elevation)) * radius;
            let X_WC = look_at(&eye, &Point3::origin());
            cameras.push(CameraModel::with_field_of_view(X_WC, size[0], size[1], 45.0_f64.to_radians()));
        }
    }
    cameras
}

/// Twenty cameras, 7 m around the world's origin.
pub fn flight_rig() -> Vec<CameraModel> {
    uv_sphere(&[0.0, 90.0, 180.0, 270.0], &[60.0, 30.0, 0.0, -30.0, -60.0], 7.0, [400, 300])
}

/// Image of a shape at `X_WS` in one camera, within the window that the shape may cover and a margin.
pub fn depth_frame(camera: usize, model: &CameraModel, shape: &Shape, X_WS: &Pose, margin_m: f64) -> DepthFrame {
    let X_SC = X_WS.inverse() * model.X_WC;
    let centre_C = X_SC.inverse() * Point3::origin();
    let window = model.window_around(&centre_C, shape.reach() + margin_m);
    let mut frame = DepthFrame { camera, capture_s: 0.0, window, depth_m: Vec::new(), mask: Some(Vec::new()) };
    for i in 0..window.area() {
        let ray_C = model.back_project(&window.pixel_centre(i), 1.0).coords;
        let length = ray_C.norm();
        let mut along = (centre_C.coords.norm() - shape.reach()).max(0.0);
        let mut depth = f32::NAN;
        for _ in 0..200 {
            let distance = shape.distance(&(X_SC * Point3::from(ray_C * (along / length))));
            along += distance * 0.98;
            if distance < 1e-7 {
                depth = (along / length) as f32;
                break;
            }
            if along > centre_C.coords.norm() + shape.reach() {
                break;
            }
        }
        frame.depth_m.push(depth);
        if let Some(mask) = &mut frame.mask {
            mask.push(depth.is_finite());
        }
    }
    frame
}

/// Images of all cameras.
pub fn depth_frames(
    cameras: &[CameraModel],
    shape: &Shape,
    X_WS: &Pose,
    noise: Noise,
    normal: &mut Normal,
) -> Vec<DepthFrame> {
    let frames = cameras.iter().enumerate().map(|(i, camera)| depth_frame(i, camera, shape, X_WS, 0.03));
    let mut frames: Vec<DepthFrame> = frames.collect();
    add_noise(&mut frames, noise, normal);
    frames
}

/// Adds noise to clean images.
pub fn add_noise(frames: &mut [DepthFrame], noise: Noise, normal: &mut Normal) {
    for depth in frames.iter_mut().flat_map(|frame| &mut frame.depth_m).filter(|depth| depth.is_finite()) {
        let z = f64::from(*depth);
        *depth = (z + noise.sd(z) * normal.draw()) as f32;
    }
}

/// The scan of a shape by 32 cameras 1 m around it, `width` pixels wide.
pub fn scan(shape: &Shape, width: u32) -> ReferenceScan {
    let around: Vec<f64> = (0..8).map(|i| 45.0 * f64::from(i)).collect();
    let cameras = uv_sphere(&around, &[54.0, 18.0, -18.0, -54.0], 1.0, [width, width * 3 / 4]);
    let frames =
        cameras.iter().enumerate().map(|(i, camera)| depth_frame(i, camera, shape, &Pose::identity(), 0.0)).collect();
    ReferenceScan { cameras, frames }
}

#[cfg(test)]
pub(crate) fn reference(shape: &Shape, width: u32) -> super::ReferenceModel {
    super::ReferenceModel::from_scan(&scan(shape, width))
}

/// Poses of O (the reference's centre of mass) on the way of a throw, any orientation.
pub fn pose_in_flight(normal: &mut Normal) -> Pose {
    let along = normal.uniform(0.0, 1.0);
    let p_WO = Point3::new(2.0 - 1.4 * along, 1.9 - 2.0 * along, 0.4 + 2.0 * along * (1.0 - along));
    Pose::from_parts(p_WO.coords.into(), normal.rotation())
}
