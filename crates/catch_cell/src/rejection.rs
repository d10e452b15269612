//! Why a trajectory is not taken, and the limits that one may break.

use serde::{Deserialize, Serialize};
use thiserror::Error;

/// Why a robot controller does not take a trajectory. The one that is executing goes on.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, Error)]
#[serde(rename_all = "snake_case")]
pub enum Rejection {
    /// Not a clamped spline of finite numbers whose knots and control points fit together, or one that is
    /// empty or endless.
    #[error("malformed: not a clamped cubic B-spline of finite numbers, of at most 100 s and 1000 knots")]
    Malformed,
    /// It moves a joint that the arm does not have.
    #[error("joint {joint} does not exist: the arm has {dof}")]
    UnknownJoint {
        /// Which joint, from zero.
        joint: usize,
        /// Number of joints of the arm.
        dof: usize,
    },
    /// Its identifier is not higher than those of all trajectories before it.
    #[error("its identifier has been used, or a higher one")]
    RepeatedId,
    /// It arrived after its start.
    #[error("late by {by_s:.6} s")]
    Late {
        /// Time from its start to its arrival, in seconds.
        by_s: f64,
    },
    /// Position, velocity or acceleration jump: at its start from what is executing then, or at a repeated
    /// knot.
    #[error("joint {joint} jumps at {time_s} s: {size} rad, rad/s or rad/s²")]
    Discontinuous {
        /// Which joint, from zero.
        joint: usize,
        /// When, on the cell's clock.
        time_s: f64,
        /// The largest of the jumps in position, velocity and acceleration.
        size: f64,
    },
    /// It ends with a velocity or an acceleration.
    #[error("joint {joint} does not end at rest")]
    NotAtRest {
        /// Which joint, from zero.
        joint: usize,
    },
    /// It breaks a limit of the arm.
    #[error("joint {} breaks its {:?} limit {}-fold at {} s", .0.joint, .0.kind, .0.ratio, .0.time_s)]
    Limit(LimitViolation),
    /// For a reason of the controller's own.
    #[error("declined by the robot controller")]
    Declined,
}

/// What a limit bounds.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum LimitKind {
    /// Joint position; the ratio is of the distance from the middle of the range to half the range.
    Position,
    /// Joint velocity.
    Velocity,
    /// Joint acceleration.
    Acceleration,
    /// Torque by inverse dynamics.
    Torque,
    /// Joint jerk, where the robot states a limit.
    Jerk,
    /// Speed of the hand, where the robot states a limit; said of the last joint.
    HandSpeed,
}

/// A limit that was broken.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct LimitViolation {
    /// Which joint, from zero.
    pub joint: usize,
    /// Which limit.
    pub kind: LimitKind,
    /// The value over its limit.
    pub ratio: f64,
    /// When: for a command, the instant of its trajectory; for a motion, when it began.
    pub time_s: f64,
}
