//! The scan of an object before it is ever thrown (paper, III-A: the reference point cloud).

use catch_body::{Pose, TriangleMesh, ray_cast::RayCaster};

use crate::{
    CameraModel, DepthFrame, ReferenceScan,
    sight::{DepthBuffer, Sight},
};

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
    let sight = Sight::new(camera, &Pose::identity(), object);
    let window = sight.window().widened(1, &camera.full_window());
    let seen = DepthBuffer::new(window, [sight]);
    let depth_m: Vec<f32> = seen.pixels().map(|seen| seen.map_or(f32::NAN, |(_, hit)| hit.t as f32)).collect();
    let mask = Some(depth_m.iter().map(|depth| depth.is_finite()).collect());
    DepthFrame { camera: index, capture_s: 0.0, window, depth_m, mask }
}
