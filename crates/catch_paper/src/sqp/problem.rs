//! Problem and solution of a motion's program.

use catch_body::{JointVector, Robot, robot::JointLimits};
use catch_cell::{BSpline, arm::Setpoint};

use super::Waypoint;

/// A motion that is wanted.
#[derive(Debug, Clone)]
pub struct Problem<'a> {
    /// The arm.
    pub robot: &'a Robot,
    /// Knots of the motion, the first and the last four times.
    pub knots_s: Vec<f64>,
    /// State at the start.
    pub start: Setpoint,
    /// True if the motion keeps it; else waypoints say what is wanted there.
    pub keeps_start: bool,
    /// Bounds of the factor by which the motion's duration may differ from that of the knots. Waypoints are
    /// met at their knots' times stretched as much.
    pub stretch: [f64; 2],
    /// Stretch of the guess.
    pub stretch_guess: f64,
    /// Limits of each joint; an acceleration may be without limit.
    pub limits: Vec<JointLimits>,
    /// Poses that the gripper must pass, and their times.
    pub waypoints: Vec<Waypoint>,
    /// Fraction of the object's velocity.
    pub speed_fraction: f64,
    /// The comfortable pose q₀; without one each program stays near the last one's motion.
    pub comfortable_q: Option<JointVector>,
}

/// A motion that was found.
#[derive(Debug, Clone, PartialEq)]
pub struct Solution {
    /// The motion.
    pub spline: BSpline,
    /// Excess of the worst error over its tolerance: m, rad or m/s.
    pub excess: f64,
}
