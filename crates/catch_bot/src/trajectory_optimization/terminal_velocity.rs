//! The joint velocities at the catch.
//!
//! In the paper (III-D) the grasp centre moves along with the object at a fraction s of its velocity, up to
//! 30 %, in exactly its direction. What moves across the gripper is held badly. So here the hand follows the
//! object across its approach (x and z of G) as fast as it can, and along it (y) at s_max = 30 %. All of it
//! is soft, with a weight W_i each ([`FOLLOWING`]):
//!
//! ```text
//!     min   Σ W_i·(R_GW J_v q̇ − (v_x, s_max·v_y, v_z))_i² + b·|J_ω q̇|² + ε·|q̇|²,   low ≤ q̇ ≤ high
//! ```
//! The bounds on q̇ are what each joint can have on arrival ([`super::reachability`]).

use catch_body::{JointVector, MAX_JOINTS, robot::Jacobian};
use nalgebra::{Matrix3, Rotation3, Vector3};

use super::{
    MAX_SPEED_FRACTION,
    quadratic_program::{Hessian, ProgramFailure, Row, Square, Variables},
    reachability::Interval,
};

/// Keeps the program strictly convex along the redundancy, ε.
pub const DAMPING: f64 = 1e-3;

/// Weight of the square of the gripper's angular velocity, b: a gripper that rotates at 3 rad/s is 33 mm off
/// the flight line 60 ms before the catch.
pub const BALANCED: f64 = 0.1;
/// The weight for a gripper that does not turn before all: what flies in straight then finds it open.
pub const STEADY: f64 = 20.0;

/// Weights with which the hand follows the object: on the square of the remaining relative velocity along
/// each axis of G, per (m/s)²: closing, approach, and across the gap. A velocity toward a finger counts most.
/// Chosen on 600 throws of `honest`.
pub const FOLLOWING: Vector3<f64> = Vector3::new(8.0, 0.8, 0.8);

/// Joint velocities at the catch and what they do to the gripper.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TerminalVelocity {
    /// Joint velocities in rad/s.
    pub dq: JointVector,
    /// Velocity of the grasp centre in W, in m/s.
    pub v_WG: Vector3<f64>,
    /// Part of that velocity along the object's, as a fraction of the object's velocity.
    pub speed_fraction: f64,
    /// Angular velocity of the gripper in rad/s.
    pub w_WG: Vector3<f64>,
}

impl TerminalVelocity {
    /// Scales the motion to another speed.
    pub fn scaled(&self, by: f64) -> Self {
        let Self { dq, v_WG, speed_fraction, w_WG } = self;
        Self { dq: dq * by, v_WG: v_WG * by, speed_fraction: speed_fraction * by, w_WG: w_WG * by }
    }
}

/// The best joint velocities within `bounds`.
///
/// `jacobian` is that of the grasp centre in W, `v_WO` the object's velocity in W in m/s, `bounds` are those
/// of each joint's velocity in rad/s, and `R_WG` is the gripper's orientation.
///
/// # Errors
/// If there are none, or if the program fails numerically.
pub fn terminal_velocity(
    jacobian: &Jacobian,
    v_WO: &Vector3<f64>,
    bounds: &[Interval; MAX_JOINTS],
    spin_weight: f64,
    R_WG: &Rotation3<f64>,
) -> Result<TerminalVelocity, ProgramFailure> {
    let angular = jacobian.fixed_rows::<3>(0);
    let linear = jacobian.fixed_rows::<3>(3);
    let wanted = R_WG.inverse() * v_WO;
    let wanted = Vector3::new(wanted.x, wanted.y * MAX_SPEED_FRACTION, wanted.z);
    let axes = R_WG.matrix().transpose() * linear;
    let weighted = axes.transpose() * Matrix3::from_diagonal(&FOLLOWING);
    let mut H = Square::identity();
    let mut joints = H.fixed_view_mut::<MAX_JOINTS, MAX_JOINTS>(0, 0);
    joints.copy_from(&(angular.transpose() * angular * spin_weight));
    for i in 0..MAX_JOINTS {
        joints[(i, i)] += DAMPING;
    }
    joints += weighted * axes;
    let mut gradient = Variables::zeros();
    gradient.fixed_rows_mut::<MAX_JOINTS>(0).copy_from(&(weighted * -wanted));

    if bounds.iter().any(Interval::is_empty) {
        return Err(ProgramFailure::Infeasible);
    }
    let rows: [Row; MAX_JOINTS] = std::array::from_fn(|joint| Row::new(Variables::ith(joint, 1.0)));
    let limits = bounds.map(|it| [it.low, it.high]);
    let x = Hessian::new(&H).ok_or(ProgramFailure::Numerical)?.minimize(&gradient, &rows, &limits)?;
    let dq: JointVector = x.fixed_rows::<MAX_JOINTS>(0).into_owned();
    let v_WG = linear * dq;
    let speed_fraction = v_WG.dot(v_WO) / v_WO.norm_squared().max(f64::MIN_POSITIVE);
    Ok(TerminalVelocity { dq, v_WG, speed_fraction, w_WG: angular * dq })
}
