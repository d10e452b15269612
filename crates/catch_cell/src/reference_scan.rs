//! The scan of an object before it is ever thrown (paper, III-A: the reference point cloud).

use catch_body::{Pose, TriangleMesh, ray_cast::RayCaster};
use nalgebra::Point3;

use crate::{CameraModel, DepthFrame, ReferenceScan};

/// Exact depth images of `object` standing still at the origin of R, its frame O aligned with R, from the
/// cameras of `rig`, whose poses are in R. Each frame is a window around the object, masked.
///
/// The scan stands for the images of a real scanner wherever the object's surface is known as a mesh.
pub fn reference_scan(object: &TriangleMesh, rig: &[CameraModel]) -> ReferenceScan {
    let caster = RayCaster::new(object);
    let frames = rig.iter().enumerate().map(|(index, camera)| image(index, camera, &caster));
    ReferenceScan { cameras: rig.to_vec(), frames: frames.collect() }
}

fn image(index: usize, camera: &CameraModel, object: &RayCaster) -> DepthFrame {
    let X_RC: Pose = camera.X_WC;
    let centre_C = X_RC.inverse_transform_point(&object.centre());
    let radius_m = object.radius();
    let window = if centre_C.z + radius_m > 0.0 && centre_C.z - radius_m <= 1e-3 {
        // The camera's plane cuts the ball around the object, whose image is then unbounded.
        camera.full_window()
    } else {
        camera.window_around(&centre_C, radius_m)
    };
    let (R_RC, origin) = (X_RC.rotation.to_rotation_matrix(), Point3::from(X_RC.translation.vector));
    // A direction in C whose third component is one makes the ray's parameter the depth.
    let depth_of = |pixel: usize| {
        let direction = R_RC * camera.back_project(&window.pixel_centre(pixel), 1.0).coords;
        object.cast(&origin, &direction).map_or(f32::NAN, |depth| depth as f32)
    };
    let depth_m: Vec<f32> = (0..window.area()).map(depth_of).collect();
    let mask = Some(depth_m.iter().map(|depth| depth.is_finite()).collect());
    DepthFrame { camera: index, capture_s: 0.0, window, depth_m, mask }
}
