//! The arm's state and the trajectories it is sent.

use catch_body::JointVector;
use serde::{Deserialize, Serialize};

use crate::BSpline;

/// The arm as its drive cabinet reports it.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct ArmState {
    /// Positions in radians as the encoders give them.
    pub q: JointVector,
    /// Velocities in rad/s as the encoders give them.
    pub dq: JointVector,
    /// Where the cabinet wants the joints to be at this instant, in radians: free of noise, and what a new trajectory has to
    /// continue.
    pub setpoint_q: JointVector,
}

/// Position, velocity and acceleration that a trajectory asks for at one instant.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Setpoint {
    /// Positions in radians.
    pub q: JointVector,
    /// Velocities in rad/s.
    pub dq: JointVector,
    /// Accelerations in rad/s².
    pub ddq: JointVector,
}

impl Setpoint {
    /// Standing still at `q`.
    pub fn at_rest(q: JointVector) -> Self {
        Self { q, dq: JointVector::zeros(), ddq: JointVector::zeros() }
    }
}

/// A motion of the arm, sampled by the cell's servo at its own rate by absolute time.
///
/// At its start it must equal the trajectory that is executing then, in position, velocity and acceleration; it must end at
/// rest and stays there. One that arrives after its start is refused as late and the old one goes on.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ArmTrajectory {
    /// Joint positions over absolute time; the first knot is the start.
    pub spline: BSpline,
}

impl ArmTrajectory {
    /// A trajectory that stays at `q` from `start_s` on.
    pub fn at_rest(start_s: f64, q: JointVector) -> Self {
        let knots_s = [[start_s; 4], [start_s + 1.0; 4]].concat();
        Self { spline: BSpline { knots_s, control_points: vec![q; 4] } }
    }

    /// When it takes over.
    pub fn start_s(&self) -> f64 {
        self.spline.start_s()
    }

    /// When it comes to rest.
    pub fn end_s(&self) -> f64 {
        self.spline.end_s()
    }

    /// What it asks for at `time_s`: its first point before the start, its last, at rest, after the end.
    pub fn setpoint(&self, time_s: f64) -> Setpoint {
        if time_s >= self.end_s() {
            return Setpoint::at_rest(self.spline.control_points.last().copied().unwrap_or_default());
        }
        let [q, dq, ddq] = self.spline.evaluate(time_s.max(self.start_s()));
        Setpoint { q, dq, ddq }
    }
}
