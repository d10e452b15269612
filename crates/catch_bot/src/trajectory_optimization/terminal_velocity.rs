//! The joint velocities at the catch.
//!
//! In the paper (III-D) the grasp centre moves along with the object at a fraction s of its velocity, up to
//! 30 %. Direction is hard, speed and the gripper's own turning are soft:
//!
//! ```text
//!     min   a·(s − s_max)² + b·|J_ω q̇|² + ε·|q̇|²
//!     s.t.  J_v q̇ = s·v_O,   low ≤ q̇ ≤ high,   0 ≤ s ≤ s_max
//! ```
//! s = 0 is always consistent with J_v q̇ = 0. What moves across the gripper is held badly. So here the hand
//! follows the object across its approach (x and z of G) as fast as it can, and along it (y) at s_max. All of
//! it is soft, with a weight W_i each ([`FOLLOWING`]):
//!
//! ```text
//!     min   Σ W_i·(R_GW J_v q̇ − (v_x, s_max·v_y, v_z))_i² + b·|J_ω q̇|² + ε·|q̇|²,   low ≤ q̇ ≤ high
//! ```
//! The bounds on q̇ are what each joint can have on arrival ([`super::reachability`]).

use catch_body::{
    JointVector, MAX_JOINTS,
    quadratic_program::{Hessian, ProgramFailure, Row, Square, Variables},
    robot::Jacobian,
};
use nalgebra::{Matrix3, Rotation3, Vector3};

use super::{MAX_SPEED_FRACTION, reachability::Interval};

/// Keeps the program strictly convex along the redundancy, ε.
pub const DAMPING: f64 = 1e-3;

/// Weights of the choice among the joint velocities that keep the direction.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Weights {
    /// Weight of the speed fraction's distance from its best, a.
    pub speed: f64,
    /// Weight of the square of the gripper's angular velocity, b; a gripper that rotates at 3 rad/s is 33 mm
    /// off the flight line 60 ms before the catch.
    pub spin: f64,
}

impl Weights {
    /// Speed and spin in balance.
    pub const BALANCED: Self = Self { speed: 20.0, spin: 0.1 };
    /// A gripper that does not turn before all: what flies in straight then finds it open.
    pub const STEADY: Self = Self { speed: 20.0, spin: 20.0 };
    /// Speed before all.
    pub const FASTEST: Self = Self { speed: 1e6, spin: 0.01 };
}

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
/// `jacobian` is that of the grasp centre in W, `v_WO` the object's velocity in W in m/s, and `bounds` are
/// those of each joint's velocity in rad/s. The hand follows with the gripper's orientation in W.
///
/// # Errors
/// If there are none, or not even the direction can be kept where it is hard; or if the program fails
/// numerically.
pub fn terminal_velocity(
    jacobian: &Jacobian,
    v_WO: &Vector3<f64>,
    bounds: &[Interval; MAX_JOINTS],
    weights: &Weights,
    following: Option<&(Rotation3<f64>, Vector3<f64>)>,
) -> Result<TerminalVelocity, ProgramFailure> {
    const S: usize = MAX_JOINTS;
    let angular = jacobian.fixed_rows::<3>(0);
    let linear = jacobian.fixed_rows::<3>(3);
    let mut H = Square::identity();
    H.fixed_view_mut::<MAX_JOINTS, MAX_JOINTS>(0, 0).copy_from(&(angular.transpose() * angular * weights.spin));
    for i in 0..MAX_JOINTS {
        H[(i, i)] += DAMPING;
    }
    H[(S, S)] = weights.speed;
    let mut gradient = Variables::zeros();
    gradient[S] = -weights.speed * MAX_SPEED_FRACTION;
    if let Some((R_WG, weights)) = following {
        let wanted = R_WG.inverse() * v_WO;
        let wanted = Vector3::new(wanted.x, wanted.y * MAX_SPEED_FRACTION, wanted.z);
        let axes = R_WG.matrix().transpose() * linear;
        let weighted = axes.transpose() * Matrix3::from_diagonal(weights);
        let mut joints = H.fixed_view_mut::<MAX_JOINTS, MAX_JOINTS>(0, 0);
        joints += weighted * axes;
        gradient.fixed_rows_mut::<MAX_JOINTS>(0).copy_from(&(weighted * -wanted));
    }

    let hard = if following.is_some() { 0 } else { 3 };
    let mut rows = [Row::new(Variables::zeros()); 3 + MAX_JOINTS + 1];
    let mut limits = [[0.0; 2]; 3 + MAX_JOINTS + 1];
    for (axis, row) in rows[..3].iter_mut().enumerate() {
        let mut a = Variables::zeros();
        a.fixed_rows_mut::<MAX_JOINTS>(0).copy_from(&linear.row(axis).transpose());
        a[S] = -v_WO[axis];
        *row = Row::new(a);
    }
    for (joint, interval) in bounds.iter().enumerate() {
        if interval.is_empty() {
            return Err(ProgramFailure::Infeasible);
        }
        rows[3 + joint] = Row::new(Variables::ith(joint, 1.0));
        limits[3 + joint] = [interval.low, interval.high];
    }
    rows[3 + S] = Row::new(Variables::ith(S, 1.0));
    limits[3 + S] = [0.0, MAX_SPEED_FRACTION];
    let hessian = Hessian::new(&H).ok_or(ProgramFailure::Numerical)?;
    let x = hessian.minimize(&gradient, &rows[3 - hard..], &limits[3 - hard..], hard)?;
    let dq: JointVector = x.fixed_rows::<MAX_JOINTS>(0).into_owned();
    let v_WG = linear * dq;
    let along = || v_WG.dot(v_WO) / v_WO.norm_squared().max(f64::MIN_POSITIVE);
    let speed_fraction = if following.is_some() { along() } else { x[S].max(0.0) };
    Ok(TerminalVelocity { dq, v_WG, speed_fraction, w_WG: angular * dq })
}
