//! Visibility of the arm in a camera, on which the camera is calibrated.

use std::f64::consts::PI;

use catch_body::{JointVector, Robot};
use catch_cell::CameraModel;
use nalgebra::Point3;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;

/// Random postures that are looked at.
const POSTURES: usize = 200;

/// Samples joint positions in W over random postures, without those below the floor.
pub(super) fn joint_places(robot: &Robot, seed: u64) -> Vec<Point3<f64>> {
    let mut random = Pcg64::seed_from_u64(seed);
    let mut places = Vec::with_capacity(POSTURES * (robot.dof() + 1));
    for _ in 0..POSTURES {
        let at = JointVector::from_fn(|_, _| random.random_range(0.0..=1.0));
        let lower = robot.per_joint(|it| it.limits.lower.max(-PI));
        let range = robot.per_joint(|it| it.limits.upper.min(PI) - it.limits.lower.max(-PI));
        let X_WL = robot.link_poses(&(lower + range.component_mul(&at)));
        let origins = X_WL[..=robot.dof()].iter().map(|it| Point3::from(it.translation.vector));
        places.extend(origins.filter(|p| p.z >= 0.0));
    }
    places
}

/// Fraction of places that are within a camera's image.
pub(super) fn shown(camera: &CameraModel, places: &[Point3<f64>]) -> f64 {
    let is_within = |p_W: &Point3<f64>| {
        let uv = camera.project(&camera.X_WC.inverse_transform_point(p_W));
        let inside = |at: f64, size: u32| (0.0..=f64::from(size)).contains(&at);
        uv.is_some_and(|uv| inside(uv.x, camera.width_px) && inside(uv.y, camera.height_px))
    };
    places.iter().filter(|it| is_within(it)).count() as f64 / places.len().max(1) as f64
}
