//! What motion is wanted, and what was found.

use catch_body::{JointVector, Robot, robot::JointLimits};
use catch_cell::{BSpline, arm::Setpoint};
use nalgebra::Point3;

use super::Waypoint;

/// A motion that is wanted.
#[derive(Debug, Clone)]
pub struct Problem<'a> {
    /// The arm.
    pub robot: &'a Robot,
    /// The point of the gripper whose position and velocity count, in G.
    pub p_GP: Point3<f64>,
    /// Knots of the motion, the first and the last four times.
    pub knots_s: Vec<f64>,
    /// Where it starts.
    pub start: Setpoint,
    /// Whether the acceleration at the start counts.
    pub start_acceleration: bool,
    /// What each joint may do.
    pub limits: Vec<JointLimits>,
    /// Where the gripper is to be, and when.
    pub waypoints: Vec<Waypoint>,
    /// Least and highest fraction of the object's velocity.
    pub speed_fraction: [f64; 2],
    /// The comfortable pose q₀.
    pub comfortable_q: JointVector,
    /// On the distance from it, w.
    pub comfort_weight: f64,
    /// On the fraction of the object's velocity, κ.
    pub speed_weight: f64,
    /// Whether any motion that meets the waypoints within their tolerances is as good as another.
    pub first_will_do: bool,
}

/// A motion that was found.
#[derive(Debug, Clone, PartialEq)]
pub struct Solution {
    /// The motion.
    pub spline: BSpline,
    /// Fraction of the object's velocity.
    pub speed_fraction: f64,
    /// By how much the worst error exceeds its tolerance: m, rad or m/s.
    pub excess: f64,
    /// Quadratic programs that were solved.
    pub iterations: usize,
    /// Whether it came to rest before as many of them as there may be.
    pub converged: bool,
}
