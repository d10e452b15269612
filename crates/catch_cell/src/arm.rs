//! The arm's state and the trajectories it is sent.

use std::fmt;

use catch_body::{JointVector, quantity};
use serde::{Deserialize, Serialize};

use crate::{BSpline, rejection::Rejection};

pub use crate::spline::Setpoint;

/// Identifier of a trajectory, higher than those of all trajectories that were sent before it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
pub struct TrajectoryId(pub u64);

impl fmt::Display for TrajectoryId {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        write!(f, "{}", self.0)
    }
}

/// The arm as its robot controller reports it.
#[quantity::checked]
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ArmState {
    /// Time of the sample in seconds, on the cell's clock as well as the controller knows it.
    pub time_s: quantity::clock_s,
    /// Positions in radians as the encoders give them.
    pub q: quantity::joint_rad<JointVector>,
    /// Velocities in rad/s as the encoders give them.
    pub dq: quantity::joint_radps<JointVector>,
    /// Set-point that the controller commands to the joints at this instant, free of the encoders' noise.
    pub commanded: Setpoint,
    /// The trajectory that is being executed, or that ended last and is held; `None` before the first one.
    pub executing: Option<TrajectoryId>,
    /// The trajectories that were rejected since the last observation, in the order in which they arrived.
    pub rejected: Vec<RejectedTrajectory>,
}

impl ArmState {
    /// Set-point that the controller will command at `time_s` if its acceleration stays as it is.
    pub fn extrapolated(&self, time_s: f64) -> Setpoint {
        let Setpoint { q, dq, ddq } = self.commanded;
        let ahead_s = time_s - self.time_s;
        Setpoint { q: q + (dq + ddq * (ahead_s / 2.0)) * ahead_s, dq: dq + ddq * ahead_s, ddq }
    }
}

/// A trajectory that was not taken.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct RejectedTrajectory {
    /// Identifier of the trajectory.
    pub id: TrajectoryId,
    /// Reason for the rejection.
    pub reason: Rejection,
}

/// A motion of the arm, sampled by the robot controller at its own rate by absolute time.
///
/// The trajectory is twice continuously differentiable (C²). At its start it must equal the trajectory that
/// is executing then, in position, velocity and acceleration; it must end at rest and stays there. One that
/// arrives after its start is rejected as late and the old one goes on.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ArmTrajectory {
    /// Identifier by which the controller reports what became of the trajectory.
    pub id: TrajectoryId,
    /// Joint positions over absolute time; the first knot is the start.
    pub spline: BSpline,
}

impl ArmTrajectory {
    /// Time in seconds at which the trajectory takes over.
    pub fn start_s(&self) -> f64 {
        self.spline.start_s()
    }

    /// Time in seconds at which the trajectory comes to rest.
    pub fn end_s(&self) -> f64 {
        self.spline.end_s()
    }

    /// Set-point at `time_s`: the first point before the start, the last point, at rest, after the end.
    pub fn setpoint(&self, time_s: f64) -> Setpoint {
        self.spline.setpoint(time_s)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_moving_arm_is_extrapolated_at_constant_acceleration() {
        let [q, dq, ddq] = [1.0, 2.0, 4.0].map(JointVector::repeat);
        let state =
            ArmState { time_s: 0.5, q, dq, commanded: Setpoint { q, dq, ddq }, executing: None, rejected: Vec::new() };
        let ahead = state.extrapolated(0.6);
        assert!((ahead.q - JointVector::repeat(1.22)).amax() < 1e-12);
        assert!((ahead.dq - JointVector::repeat(2.4)).amax() < 1e-12);
        assert_eq!(ahead.ddq, ddq);
        assert_eq!(state.extrapolated(0.5), state.commanded);
    }
}
