//! From pixels to points in W that belong to the object.

use catch_body::Pose;
use catch_cell::{CameraModel, DepthFrame, PixelWindow};
use nalgebra::{Point3, Vector3};
use serde::{Deserialize, Serialize};

use super::{
    Config, ReferenceModel,
    silhouette::{OutlineRay, outline},
};

/// Standard deviation of a measured depth: σ(z) = c + q·z², in metres.
///
/// The quadratic part is that of stereo: σ = z²·subpixel/(f·baseline).
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct DepthNoise {
    /// c in metres.
    pub constant_m: f64,
    /// q in 1/m.
    pub quadratic_per_m: f64,
}

impl DepthNoise {
    /// σ at depth `z_m`.
    pub fn sd_m(&self, z_m: f64) -> f64 {
        self.constant_m + self.quadratic_per_m * z_m * z_m
    }
}

/// A point of the scene.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ScenePoint {
    /// Where it is.
    pub p_W: Point3<f64>,
    /// How it moves per metre of depth: along its pixel's ray.
    pub per_depth_W: Vector3<f64>,
    /// Standard deviation of its depth in metres.
    pub depth_sd_m: f64,
}

/// What the images show of the object.
#[derive(Debug, Clone, Default)]
pub struct SceneCloud {
    /// Points on its surface.
    pub points: Vec<ScenePoint>,
    /// Rays along its outline; only where masks tell it.
    pub outline: Vec<OutlineRay>,
}

impl SceneCloud {
    /// Collects the object's points from all images, in place of those collected before.
    ///
    /// A pixel is the object's if the image's mask says so. Without a mask, if it lies near the predicted pose, which then
    /// must be given.
    pub fn collect(
        &mut self,
        frames: &[DepthFrame],
        cameras: &[CameraModel],
        reference: &ReferenceModel,
        prior: Option<&Pose>,
        config: &Config,
    ) {
        self.points.clear();
        self.outline.clear();
        for frame in frames {
            let Some(camera) = cameras.get(frame.camera) else { continue };
            if frame.depth_m.len() < frame.window.area() || !frame.capture_s.is_finite() {
                continue;
            }
            let near = prior.map(|X_WO| Near::new(X_WO, camera, reference.radius_m + config.gate_m));
            match (&frame.mask, near) {
                (Some(mask), near) if mask.len() >= frame.window.area() => {
                    let part = near.map_or(frame.window, |near| intersection(&frame.window, &near.window));
                    let before = self.points.len();
                    self.collect_where(frame, camera, part, config, |i, _| mask[i]);
                    let depth_m = self.mean_depth(before, camera);
                    let nearest_m = depth_m - reference.radius_m - 3.0 * config.depth_noise.sd_m(depth_m);
                    outline(&mut self.outline, frame, mask, camera, &part, nearest_m);
                }
                (None, Some(near)) => {
                    let part = intersection(&frame.window, &near.window);
                    self.collect_where(frame, camera, part, config, |_, depth_m| {
                        (depth_m - near.depth_m).abs() < near.reach_m + 3.0 * config.depth_noise.sd_m(depth_m)
                    });
                }
                _ => {}
            }
        }
    }

    /// Mean depth in a camera of the points from number `first` on.
    fn mean_depth(&self, first: usize, camera: &CameraModel) -> f64 {
        let points = &self.points[first..];
        let sum: f64 = points.iter().map(|point| camera.X_WC.inverse_transform_point(&point.p_W).z).sum();
        if points.is_empty() { 0.0 } else { sum / points.len() as f64 }
    }

    /// Collects the pixels of a part of a frame for which `wanted(index, depth)` holds.
    fn collect_where(
        &mut self,
        frame: &DepthFrame,
        camera: &CameraModel,
        part: PixelWindow,
        config: &Config,
        wanted: impl Fn(usize, f64) -> bool,
    ) {
        let columns = frame.window.width as usize;
        let left = (part.left - frame.window.left.min(part.left)) as usize;
        let top = (part.top - frame.window.top.min(part.top)) as usize;
        for row in top..top + part.height as usize {
            for i in row * columns + left..row * columns + left + part.width as usize {
                let depth_m = f64::from(frame.depth_m[i]);
                if !(depth_m > 0.0 && depth_m.is_finite() && wanted(i, depth_m)) {
                    continue;
                }
                let ray_C = camera.back_project(&frame.window.pixel_centre(i), 1.0).coords;
                self.points.push(ScenePoint {
                    p_W: camera.X_WC * Point3::from(ray_C * depth_m),
                    per_depth_W: camera.X_WC.rotation * ray_C,
                    depth_sd_m: config.depth_noise.sd_m(depth_m),
                });
            }
        }
    }

    /// Mean of the points.
    pub fn centroid(&self) -> Point3<f64> {
        let sum: Vector3<f64> = self.points.iter().map(|point| point.p_W.coords).sum();
        Point3::from(sum / self.points.len().max(1) as f64)
    }

    /// Takes over at most about `most` of another cloud's points, evenly.
    pub(super) fn thin_from(&mut self, other: &Self, most: usize) {
        self.points.clear();
        self.outline.clear();
        let step = |count: usize| count.div_ceil(most.max(1)).max(1);
        self.points.extend(other.points.iter().step_by(step(other.points.len())));
        self.outline.extend(other.outline.iter().step_by(step(other.outline.len())));
    }
}

/// Where in a camera's image the object is expected.
#[derive(Debug, Clone, Copy)]
struct Near {
    window: PixelWindow,
    depth_m: f64,
    reach_m: f64,
}

impl Near {
    fn new(X_WO: &Pose, camera: &CameraModel, reach_m: f64) -> Self {
        let centre_C = camera.X_WC.inverse_transform_point(&X_WO.translation.vector.into());
        Self { window: camera.window_around(&centre_C, reach_m), depth_m: centre_C.z, reach_m }
    }
}

/// The pixels that two windows share.
fn intersection(a: &PixelWindow, b: &PixelWindow) -> PixelWindow {
    let (left, top) = (a.left.max(b.left), a.top.max(b.top));
    let right = (a.left + a.width).min(b.left + b.width);
    let bottom = (a.top + a.height).min(b.top + b.height);
    if right <= left || bottom <= top {
        // Empty, and still inside the first window so that indices into it stay valid.
        return PixelWindow { left: a.left, top: a.top, width: 0, height: 0 };
    }
    PixelWindow { left, top, width: right - left, height: bottom - top }
}
