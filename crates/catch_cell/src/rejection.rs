//! Reasons for which a trajectory is rejected, and the limits that one may break.

use serde::{Deserialize, Serialize};
use thiserror::Error;

/// Reason for which a robot controller rejects a trajectory. The one that is executing goes on.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, Error)]
#[serde(rename_all = "snake_case")]
pub enum Rejection {
    /// The trajectory is not a clamped spline of finite numbers whose knots and control points fit together,
    /// or it is empty or endless.
    #[error("malformed: not a clamped cubic B-spline of finite numbers, of at most 100 s and 1000 knots")]
    Malformed,
    /// The trajectory moves a joint that the arm does not have.
    #[error("joint {joint} does not exist: the arm has {dof}")]
    UnknownJoint {
        /// Index of the joint, from zero.
        joint: usize,
        /// Number of joints of the arm.
        dof: usize,
    },
    /// The identifier is not higher than those of all trajectories before it.
    #[error("its identifier has been used, or a higher one")]
    RepeatedId,
    /// The trajectory arrived after its start.
    #[error("late by {by_s:.6} s")]
    Late {
        /// Time from the trajectory's start to its arrival, in seconds.
        by_s: f64,
    },
    /// Position, velocity or acceleration jump: at its start from what is executing then, or at a repeated
    /// knot.
    #[error("joint {joint} jumps at {time_s} s: {size} rad, rad/s or rad/s²")]
    Discontinuous {
        /// Index of the joint, from zero.
        joint: usize,
        /// Time of the jump in seconds, on the cell's clock.
        time_s: f64,
        /// The largest of the jumps in position, velocity and acceleration.
        size: f64,
    },
    /// The trajectory ends with a velocity or an acceleration.
    #[error("joint {joint} does not end at rest")]
    NotAtRest {
        /// Index of the joint, from zero.
        joint: usize,
    },
    /// The trajectory breaks a limit of the arm.
    #[error("joint {} breaks its {:?} limit {}-fold at {} s", .0.joint, .0.kind, .0.ratio, .0.time_s)]
    Limit(LimitViolation),
    /// The robot controller declined for a reason of its own.
    #[error("declined by the robot controller")]
    Declined,
}

/// Quantity that a limit bounds.
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
    /// Index of the joint, from zero.
    pub joint: usize,
    /// Limit that is broken.
    pub kind: LimitKind,
    /// The value over its limit.
    pub ratio: f64,
    /// Time in seconds: for a command, the instant of its trajectory; for a motion, its beginning.
    pub time_s: f64,
}
