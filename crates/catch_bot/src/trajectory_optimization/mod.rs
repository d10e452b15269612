//! Trajectory optimization (paper, III-D).
pub mod joint_spline;
pub mod quadratic_program;
pub mod reachability;

use catch_body::{Gripper, JointVector, Pose, Robot};
use catch_cell::ArmTrajectory;
use serde::{Deserialize, Serialize};

/// Settings of trajectory optimization.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Config {}

/// A catch: when, where and how the arm gets there.
#[derive(Debug, Clone, PartialEq)]
pub struct CatchPlan {
    /// When the object is at the grasp centre.
    pub catch_s: f64,
    /// Pose of the gripper at that time.
    pub X_WG: Pose,
    /// Joint positions at that time.
    pub q: JointVector,
    /// Share of the object's velocity at which the gripper moves along with it.
    pub speed_fraction: f64,
    /// Opening before the catch.
    pub open_width_m: f64,
    /// Width of the object between the fingers.
    pub object_width_m: f64,
    /// The motion.
    pub trajectory: ArmTrajectory,
}

/// Planner.
#[derive(Debug)]
pub struct Planner;
impl Planner {
    /// New.
    pub fn new(_: Robot, _: Gripper, _: Config) -> Self {
        Self
    }
}
