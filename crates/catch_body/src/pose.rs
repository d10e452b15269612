//! Rigid transforms and spatial velocities.

use nalgebra::{Isometry3, Matrix3, Point3, Translation3, UnitQuaternion, Vector3};
use serde::{Deserialize, Serialize};

use crate::quantity;

/// The pose of one frame in another: rotation and translation in metres.
pub type Pose = Isometry3<f64>;

/// Spatial velocity of a frame: angular velocity and the velocity of the frame's origin, both measured and
/// expressed in W.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct Twist {
    /// Angular velocity in rad/s.
    pub angular: Vector3<f64>,
    /// Velocity of the origin in m/s.
    pub linear: Vector3<f64>,
}

impl Twist {
    /// Velocity of a point that moves with the frame, the point given relative to the frame's origin, in W.
    pub fn velocity_at(&self, offset_W: &Vector3<f64>) -> Vector3<f64> {
        self.linear + self.angular.cross(offset_W)
    }
}

/// A pose as files write it: position in metres and roll-pitch-yaw (fixed axes x, y, z, as in URDF) in
/// radians.
#[quantity::checked(deny_unknown_fields)]
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct PoseFields {
    /// Position in metres.
    pub position_m: quantity::place_m<[f64; 3]>,
    /// Roll, pitch and yaw in radians.
    pub rpy_rad: quantity::angle_rad<[f64; 3]>,
}

impl PoseFields {
    /// The pose that the fields describe.
    pub fn pose(&self) -> Pose {
        let [roll, pitch, yaw] = self.rpy_rad;
        Pose::from_parts(Translation3::from(self.position_m), UnitQuaternion::from_euler_angles(roll, pitch, yaw))
    }
}

/// J(φ) = ∫₀¹ exp(sφ) ds = 1 + (1 − cos φ)/φ²·\[φ\]ₓ + (φ − sin φ)/φ³·\[φ\]ₓ², by which a small change of φ
/// turns exp(φ) in the fixed frame; J(−φ) is that in the turned frame.
pub fn left_jacobian(phi: &Vector3<f64>) -> Matrix3<f64> {
    let (angle, cross) = (phi.norm(), phi.cross_matrix());
    let (first, second) = if angle > 1e-3 {
        ((1.0 - libm::cos(angle)) / (angle * angle), (angle - libm::sin(angle)) / angle.powi(3))
    } else {
        (0.5, 1.0 / 6.0)
    };
    Matrix3::identity() + cross * first + cross * cross * second
}

/// A unit vector across a direction.
pub fn across(direction: &Vector3<f64>) -> Vector3<f64> {
    direction.cross(&if direction.x.abs() < 0.7 { Vector3::x() } else { Vector3::y() }).normalize()
}

/// The pose of a frame at `eye` whose z axis points at `target` and whose y axis points down as far as it
/// can: the convention of cameras.
pub fn look_at(eye: &Point3<f64>, target: &Point3<f64>) -> Pose {
    let forward = (target - eye).normalize();
    let up = if forward.z.abs() > 0.999 { Vector3::y() } else { Vector3::z() };
    let right = forward.cross(&up).normalize();
    let down = forward.cross(&right);
    let R = nalgebra::Rotation3::from_basis_unchecked(&[right, down, forward]);
    Pose::from_parts(Translation3::from(eye.coords), UnitQuaternion::from_rotation_matrix(&R))
}
