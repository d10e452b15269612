//! Between the project's linear algebra and the engine's.

use catch_body::Pose;
use nalgebra::{Isometry3, Quaternion, Translation3, UnitQuaternion, Vector3};
use rapier3d_f64::math;

pub fn to_vector(vector: &Vector3<f64>) -> math::Vector {
    math::Vector::new(vector.x, vector.y, vector.z)
}

pub fn from_vector(vector: math::Vector) -> Vector3<f64> {
    Vector3::new(vector.x, vector.y, vector.z)
}

pub fn to_rotation(rotation: &UnitQuaternion<f64>) -> math::Rotation {
    math::Rotation::from_xyzw(rotation.i, rotation.j, rotation.k, rotation.w)
}

pub fn to_pose(pose: &Pose) -> math::Pose {
    math::Pose::from_parts(to_vector(&pose.translation.vector), to_rotation(&pose.rotation))
}

pub fn from_pose(pose: &math::Pose) -> Pose {
    let q = pose.rotation;
    Isometry3::from_parts(
        Translation3::from(from_vector(pose.translation)),
        UnitQuaternion::new_normalize(Quaternion::new(q.w, q.x, q.y, q.z)),
    )
}
