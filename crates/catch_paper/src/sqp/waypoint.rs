//! Waypoints: pose and velocity of the gripper at an instant of a motion, and the errors from them.

use std::f64::consts::PI;

use catch_body::{JointVector, MAX_JOINTS, Pose, Robot};
use nalgebra::{Matrix3, Point3, Rotation3, SMatrix, SVector, Vector3};

/// Position (m), orientation (rad) and velocity (m/s), three numbers each, in W.
pub const ERRORS: usize = 9;

/// Tolerances of a motion: position and velocity along each axis, orientation by the angle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Tolerance {
    /// Tolerance of the position in metres.
    pub position_m: f64,
    /// Tolerance of the orientation in radians.
    pub rotation_error_rad: f64,
    /// Tolerance of the velocity in m/s.
    pub velocity_mps: f64,
}

impl Tolerance {
    /// No tolerance at all.
    pub const NONE: Self = Self { position_m: 0.0, rotation_error_rad: 0.0, velocity_mps: 0.0 };

    /// Tolerance of one of the errors. Beyond half a turn any orientation will do.
    pub fn of(&self, error: usize) -> f64 {
        let rotation_error_rad = if self.rotation_error_rad < PI { self.rotation_error_rad } else { f64::INFINITY };
        [self.position_m, rotation_error_rad, self.velocity_mps][error / 3]
    }

    /// All of them `by` times as large.
    pub fn scaled(&self, by: f64) -> Self {
        let [position_m, rotation_error_rad, velocity_mps] =
            [self.position_m, self.rotation_error_rad, self.velocity_mps].map(|it| it * by);
        Self { position_m, rotation_error_rad, velocity_mps }
    }
}

/// Required pose and velocity of the gripper at one instant.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Waypoint {
    /// Time of the waypoint, in seconds.
    pub time_s: f64,
    /// Pose of the gripper.
    pub X_WG: Pose,
    /// The point of the gripper whose position and velocity count, in G.
    pub p_GP: Point3<f64>,
    /// Velocity of the object, a fraction of which is wanted.
    pub v_WO: Vector3<f64>,
    /// Required fraction of the object's velocity, if it is given; else the motion's.
    pub fraction: Option<f64>,
    /// Tolerance of the errors.
    pub tolerance: Tolerance,
}

/// Errors at a waypoint, and how they change.
#[derive(Debug, Clone, PartialEq)]
pub struct Linearized {
    /// e: position, orientation as a rotation vector, velocity.
    pub error: SVector<f64, ERRORS>,
    /// ∂e/∂q.
    pub by_q: SMatrix<f64, ERRORS, MAX_JOINTS>,
    /// ∂e/∂q̇.
    pub by_dq: SMatrix<f64, ERRORS, MAX_JOINTS>,
    /// ∂e/∂s, s being the fraction of the object's velocity.
    pub by_fraction: SVector<f64, ERRORS>,
}

impl Linearized {
    /// Rotates the orientation error into axes of which the first is that of the remaining rotation. A bound
    /// of its first component is then a bound of the angle, as in Drake.
    pub fn aligned(mut self) -> Self {
        let turn: Vector3<f64> = self.error.fixed_rows::<3>(3).into();
        let axes = Rotation3::rotation_between(&turn, &Vector3::x()).unwrap_or_default();
        self.error.fixed_rows_mut::<3>(3).copy_from(&(axes * turn));
        let by_q = axes * self.by_q.fixed_rows::<3>(3);
        self.by_q.fixed_rows_mut::<3>(3).copy_from(&by_q);
        self
    }
}

impl Waypoint {
    /// Excess of the worst error over its tolerance, zero if there is none.
    pub fn excess(&self, at: &Linearized) -> f64 {
        let part = |from: usize| at.error.fixed_rows::<3>(from);
        let worst = [part(0).amax(), part(3).norm(), part(6).amax()];
        (0..3).map(|i| worst[i] - self.tolerance.of(3 * i)).fold(0.0, f64::max)
    }

    /// The errors of an arm at `q`, `dq`, the gripper's point being to move at `fraction`·v_WO unless the
    /// waypoint gives the fraction.
    ///
    /// With zᵢ the axis of joint i through oᵢ and cᵢ = zᵢ × (p − oᵢ), the velocity is v = Σ cᵢ·q̇ᵢ. As
    /// ∂cᵢ/∂q_j is z_j × cᵢ for j ≤ i and zᵢ × c_j beyond (Siciliano et al., Robotics, section 3.2,
    /// differentiated), ∂v/∂q_j = z_j × Σ_{i ≥ j} cᵢ·q̇ᵢ + (Σ_{i < j} zᵢ·q̇ᵢ) × c_j.
    pub fn linearize(&self, robot: &Robot, q: &JointVector, dq: &JointVector, fraction: f64) -> Linearized {
        let X_WL = robot.link_poses(q);
        let X_now = robot.gripper_in(&X_WL);
        let p_WP = X_now * self.p_GP;
        let wanted = self.fraction.unwrap_or(fraction);
        let J = robot.jacobian(&X_WL, &p_WP);
        let angular = J.fixed_rows::<3>(0).into_owned();
        let linear = J.fixed_rows::<3>(3).into_owned();
        let turn = (X_now.rotation * self.X_WG.rotation.inverse()).scaled_axis();

        let mut error = SVector::<f64, ERRORS>::zeros();
        error.fixed_rows_mut::<3>(0).copy_from(&(p_WP - self.X_WG * self.p_GP));
        error.fixed_rows_mut::<3>(3).copy_from(&turn);
        error.fixed_rows_mut::<3>(6).copy_from(&(linear * dq - self.v_WO * wanted));

        let mut by_q = SMatrix::<f64, ERRORS, MAX_JOINTS>::zeros();
        by_q.fixed_rows_mut::<3>(0).copy_from(&linear);
        by_q.fixed_rows_mut::<3>(3).copy_from(&(rate_of_rotation_vector(&turn) * angular));
        let mut w_before = Vector3::zeros();
        let mut v_beyond = linear * dq;
        for j in 0..robot.dof() {
            let (z, c): (Vector3<f64>, Vector3<f64>) = (angular.column(j).into(), linear.column(j).into());
            by_q.fixed_view_mut::<3, 1>(6, j).copy_from(&(z.cross(&v_beyond) + w_before.cross(&c)));
            w_before += z * dq[j];
            v_beyond -= c * dq[j];
        }
        let mut by_dq = SMatrix::<f64, ERRORS, MAX_JOINTS>::zeros();
        by_dq.fixed_rows_mut::<3>(6).copy_from(&linear);
        let mut by_fraction = SVector::<f64, ERRORS>::zeros();
        if self.fraction.is_none() {
            by_fraction.fixed_rows_mut::<3>(6).copy_from(&-self.v_WO);
        }
        Linearized { error, by_q, by_dq, by_fraction }
    }
}

/// Maps an angular velocity to the rate of the rotation vector φ, the inverse of the left Jacobian of SO(3):
/// 1 − ½[φ] + (1/θ² − (1 + cos θ)/(2θ sin θ))·[φ]² (Barfoot, State Estimation for Robotics, eq. 7.77).
fn rate_of_rotation_vector(turn: &Vector3<f64>) -> Matrix3<f64> {
    let angle = turn.norm();
    let K = turn.cross_matrix();
    // The series' first term near 0; near π the sine would vanish, and no motion is sought from there.
    let second = if angle < 1e-3 {
        1.0 / 12.0
    } else {
        1.0 / (angle * angle) - (1.0 + libm::cos(angle)) / (2.0 * angle * libm::sin(angle).max(1e-3))
    };
    Matrix3::identity() - K * 0.5 + K * K * second
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sqp::tests::iiwa;
    use nalgebra::UnitQuaternion;
    use proptest::prelude::*;

    /// Two rotations of 0.08 rad are one of 0.11 rad, and only its own axis counts after alignment.
    #[test]
    fn a_tolerance_of_orientation_is_one_of_the_angle() {
        let robot = iiwa();
        let q = robot.joint_vector(&[0.3, 0.5, -0.2, -1.2, 0.4, 0.8, 0.1]).unwrap();
        let turn = UnitQuaternion::from_scaled_axis(Vector3::new(0.08, 0.08, 0.0));
        let mut X_WG = robot.gripper_pose(&q);
        X_WG.rotation = turn.inverse() * X_WG.rotation;
        let tolerance = Tolerance { position_m: 0.1, rotation_error_rad: 0.1, velocity_mps: 1.0 };
        let (p_GP, v_WO) = (Point3::origin(), Vector3::zeros());
        let waypoint = Waypoint { time_s: 0.0, X_WG, p_GP, v_WO, fraction: None, tolerance };
        let at = waypoint.linearize(&robot, &q, &JointVector::zeros(), 0.0);
        let angle = 0.08 * 2f64.sqrt();
        assert!((waypoint.excess(&at) - (angle - 0.1)).abs() < 1e-9, "{}", waypoint.excess(&at));
        let aligned = at.clone().aligned();
        assert!((aligned.error.fixed_rows::<3>(3) - Vector3::new(angle, 0.0, 0.0)).norm() < 1e-9, "{}", aligned.error);
        // The rate of the angle is that of the turn about its axis.
        let about = Vector3::new(1.0, 1.0, 0.0).normalize().transpose() * at.by_q.fixed_rows::<3>(3);
        assert!((aligned.by_q.fixed_rows::<1>(3) - about).norm() < 1e-9);
    }

    proptest! {
        /// Every derivative against central differences.
        #[test]
        fn derivatives_match_finite_differences(
            q in prop::array::uniform7(-2.0f64..2.0),
            dq in prop::array::uniform7(-2.0f64..2.0),
            goal in prop::array::uniform7(-2.0f64..2.0),
            fraction in 0.0f64..0.3,
        ) {
            let robot = iiwa();
            let [q, dq, goal] = [q, dq, goal].map(|values| robot.joint_vector(&values).unwrap());
            let (v_WO, time_s) = (Vector3::new(-1.0, -2.5, -3.0), 0.6);
            let waypoint = Waypoint {
                time_s,
                X_WG: robot.gripper_pose(&goal),
                p_GP: Point3::new(0.0, 0.0833, 0.0),
                v_WO,
                fraction: None,
                tolerance: Tolerance::NONE,
            };
            let at = |q: &JointVector, dq: &JointVector, fraction: f64| {
                waypoint.linearize(&robot, q, dq, fraction)
            };
            let here = at(&q, &dq, fraction);
            // The rotation vector jumps at half a turn.
            prop_assume!(here.error.fixed_rows::<3>(3).norm() < 2.8);
            let step = 1e-6;
            for i in 0..robot.dof() {
                let by = JointVector::ith(i, step);
                let change = (at(&(q + by), &dq, fraction).error - at(&(q - by), &dq, fraction).error) / (2.0 * step);
                prop_assert!((change - here.by_q.column(i)).amax() < 1e-6, "q{i}: {change} {}", here.by_q.column(i));
                let change = (at(&q, &(dq + by), fraction).error - at(&q, &(dq - by), fraction).error) / (2.0 * step);
                prop_assert!((change - here.by_dq.column(i)).amax() < 1e-6);
            }
            let change = (at(&q, &dq, fraction + step).error - at(&q, &dq, fraction - step).error) / (2.0 * step);
            prop_assert!((change - here.by_fraction).amax() < 1e-6);
        }
    }
}
