//! Silhouettes: the rays that must touch the object.
//!
//! Where a pixel shows the object and its neighbour does not, the ray between the two grazes the object's surface. That holds
//! however bad the depths are: with stereo noise at seven metres the outline carries the information.

use catch_body::Pose;
use catch_cell::{CameraModel, DepthFrame, PixelWindow};
use nalgebra::{Point2, Point3, Vector3};

use super::ReferenceModel;

/// A ray along the object's outline.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct OutlineRay {
    /// Where it starts: the camera.
    pub p_WC: Point3<f64>,
    /// Its direction, a unit vector.
    pub direction_W: Vector3<f64>,
    /// How its direction changes from one of the two pixels to the other, in W, per unit of its length.
    pub pixel_W: Vector3<f64>,
    /// How far along it the object was touched last.
    pub(super) along_m: f64,
}

/// Step of the search around a known touching point: two nodes of the distance field.
const REFINE_STEP_M: f64 = 0.004;
/// Samples along a ray among which the nearest to the surface is sought.
const SAMPLES: usize = 7;

impl OutlineRay {
    /// The point where the ray comes nearest to the surface (or goes deepest below it), in W: the distance there is what the
    /// ray is off by. Moving the object by a little changes it as if that point were fixed to the ray (envelope theorem).
    ///
    /// With `refine` the point is sought near the last one only.
    pub(super) fn touch(&mut self, reference: &ReferenceModel, X_WO: &Pose, refine: bool) -> Point3<f64> {
        let p_OC = X_WO.inverse_transform_point(&self.p_WC);
        let direction_O = X_WO.inverse_transform_vector(&self.direction_W);
        let distance = |along: f64| reference.distance.value_at(&(p_OC + direction_O * along));
        let (mut best, mut step, rounds);
        let mut least;
        if refine {
            (best, step, rounds) = (self.along_m, REFINE_STEP_M, 1);
            least = distance(best);
        } else {
            // The stretch of the ray within the sphere that holds the object, sampled.
            let middle = -p_OC.coords.dot(&direction_O);
            let passes_m2 = (p_OC + direction_O * middle).coords.norm_squared();
            let half = (reference.radius_m.powi(2) - passes_m2).max(0.0).sqrt();
            step = (2.0 * half / (SAMPLES - 1) as f64).max(REFINE_STEP_M);
            (best, least, rounds) = (middle, distance(middle), 2);
            for i in (0..SAMPLES).filter(|&i| i != SAMPLES / 2) {
                let along = middle + step * (i as f64 - (SAMPLES / 2) as f64);
                let value = distance(along);
                if value < least {
                    (best, least) = (along, value);
                }
            }
        }
        // Parabolas through three points.
        for _ in 0..rounds {
            let (before, after) = (distance(best - step), distance(best + step));
            let bend = before - 2.0 * least + after;
            let shift = if bend > 1e-12 { (0.5 * (before - after) / bend).clamp(-1.0, 1.0) * step } else { 0.0 };
            let value = distance(best + shift);
            if value < least {
                (best, least) = (best + shift, value);
            }
            step *= 0.3;
        }
        self.along_m = best;
        self.p_WC + self.direction_W * best
    }
}

/// Appends the outline of a mask within a part of a frame.
///
/// `nearest_m` is a depth nearer than which a neighbouring pixel shows something in front of the object, whose edge says
/// nothing.
pub(super) fn outline(
    rays: &mut Vec<OutlineRay>,
    frame: &DepthFrame,
    mask: &[bool],
    camera: &CameraModel,
    part: &PixelWindow,
    nearest_m: f64,
) {
    let columns = frame.window.width as usize;
    let rows = frame.window.height as usize;
    let left = (part.left - frame.window.left) as usize;
    let top = (part.top - frame.window.top) as usize;
    let p_WC = Point3::from(camera.X_WC.translation.vector);
    let mut pair = |i: usize, j: usize, between: [f64; 2], apart_C: Vector3<f64>| {
        if mask[i] == mask[j] {
            return;
        }
        let outside = if mask[i] { j } else { i };
        if f64::from(frame.depth_m[outside]) < nearest_m {
            return;
        }
        let uv = Point2::new(f64::from(frame.window.left) + between[0], f64::from(frame.window.top) + between[1]);
        let ray_C = camera.back_project(&uv, 1.0).coords;
        let length = ray_C.norm();
        let direction_W = camera.X_WC.rotation * (ray_C / length);
        let pixel_W = camera.X_WC.rotation * (apart_C / (camera.focal_px * length));
        rays.push(OutlineRay { p_WC, direction_W, pixel_W, along_m: 0.0 });
    };
    for row in top..top + part.height as usize {
        for column in left..left + part.width as usize {
            let i = row * columns + column;
            let (x, y) = (column as f64, row as f64);
            if column + 1 < columns {
                pair(i, i + 1, [x + 1.0, y + 0.5], Vector3::x());
            }
            if row + 1 < rows {
                pair(i, i + columns, [x + 0.5, y + 1.0], Vector3::y());
            }
        }
    }
}
