//! The scan of an object before it is ever thrown (paper, III-A: the reference point cloud).

use catch_body::{Pose, TriangleMesh, ray_cast::RayCaster};
use catch_cell::{CameraModel, ReferenceScan};

use super::render::{Channels, Image, Sight};

/// Exact depth images of `object` standing still at the origin of R, its frame O aligned with R, from the cameras of `rig`,
/// whose poses are in R. Each frame is the window around the object, masked.
pub fn reference_scan(object: &TriangleMesh, rig: &[CameraModel]) -> ReferenceScan {
    let caster = RayCaster::new(object);
    let frame_of = |(index, camera): (usize, &CameraModel)| {
        let body = Sight::new(camera, &(Pose::identity(), &caster));
        let mut image = Image::empty(camera, body.window, Channels { shows_object: true, facing: false });
        image.add_body(&body, true);
        image.frame(index, 0.0)
    };
    ReferenceScan { cameras: rig.to_vec(), frames: rig.iter().enumerate().map(frame_of).collect() }
}
