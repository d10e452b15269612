//! Conversion between the project's linear algebra and that of the collision library.

use catch_body::Pose;
use nalgebra::{Point3, Vector3};
use parry3d_f64::math;

pub fn to_vector(vector: &Vector3<f64>) -> math::Vector {
    math::Vector::new(vector.x, vector.y, vector.z)
}

pub fn to_vectors(points: &[Point3<f64>]) -> Vec<math::Vector> {
    points.iter().map(|point| to_vector(&point.coords)).collect()
}

pub fn from_vector(vector: math::Vector) -> Vector3<f64> {
    Vector3::new(vector.x, vector.y, vector.z)
}

pub fn to_pose(pose: &Pose) -> math::Pose {
    let q = &pose.rotation;
    math::Pose::from_parts(to_vector(&pose.translation.vector), math::Rotation::from_xyzw(q.i, q.j, q.k, q.w))
}
