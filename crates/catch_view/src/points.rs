//! Points of the depth cameras' images, in W.

use catch_cell::{CameraModel, DepthFrame};
use nalgebra::Point3;

/// The points that a set of images shows: those that a mask says are the object's, all where there is no
/// mask.
pub fn points_of(frames: &[DepthFrame], cameras: &[CameraModel]) -> Vec<Point3<f64>> {
    let mut points = Vec::new();
    for frame in frames {
        let Some(camera) = cameras.get(frame.camera) else { continue };
        for (pixel, depth_m) in frame.depth_m.iter().enumerate() {
            let wanted = frame.mask.as_ref().is_none_or(|mask| mask.get(pixel).copied().unwrap_or(false));
            if wanted && depth_m.is_finite() && *depth_m > 0.0 {
                let p_C = camera.back_project(&frame.window.pixel_centre(pixel), f64::from(*depth_m));
                points.push(camera.X_WC * p_C);
            }
        }
    }
    points
}
