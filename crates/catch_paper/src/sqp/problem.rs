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
    /// Part of the start state that the motion keeps.
    pub keeps_start: StartState,
    /// Bounds of the factor by which the motion's duration may differ from that of the knots. Waypoints are
    /// met at their knots' times stretched as much.
    pub stretch: [f64; 2],
    /// Stretch of the guess.
    pub stretch_guess: f64,
    /// Limits of each joint; an acceleration may be without limit.
    pub limits: Vec<JointLimits>,
    /// Poses that the gripper must pass, and their times.
    pub waypoints: Vec<Waypoint>,
    /// Least and highest fraction of the object's velocity.
    pub speed_fraction: [f64; 2],
    /// The comfortable pose q₀; without one each program stays near the last one's motion.
    pub comfortable_q: Option<JointVector>,
    /// Weight of the distance from it, w.
    pub comfort_weight: f64,
    /// Weight of the fraction of the object's velocity, κ.
    pub speed_weight: f64,
    /// True if any motion that meets the waypoints within their tolerances is as good as another.
    pub first_will_do: bool,
}

/// Part of its start state that a motion keeps.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum StartState {
    /// Nothing: waypoints say what is wanted there.
    Nothing,
    /// Position and velocity.
    Velocity,
    /// Position, velocity and acceleration.
    Acceleration,
}

/// A motion that was found.
#[derive(Debug, Clone, PartialEq)]
pub struct Solution {
    /// The motion.
    pub spline: BSpline,
    /// Fraction of the object's velocity.
    pub speed_fraction: f64,
    /// Excess of the worst error over its tolerance: m, rad or m/s.
    pub excess: f64,
    /// Quadratic programs that were solved.
    pub iterations: usize,
    /// True if the iteration converged before the largest number of programs.
    pub converged: bool,
}
