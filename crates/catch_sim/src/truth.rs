//! Ground truth of a trial: for the referee, recordings and pictures, never for the brain.

use catch_body::{JointVector, Pose, Twist, quantity};
use catch_cell::LimitViolation;
use serde::{Deserialize, Serialize};

use crate::throw_conditions::ThrowConditions;

/// Everything that happened in a scene so far.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct Truth {
    /// One sample per step of the physics, the first at t = 0; recordings keep at most 2000 per second.
    pub samples: Vec<TruthSample>,
    /// Report of the robot controller.
    pub servo: ServoReport,
    /// Time at which the physics diverged, if it did: a state was not finite or beyond the range of sensors,
    /// and the last good one has stood still from there on.
    pub diverged_s: Option<f64>,
    /// Time at which the disturbance of the world began.
    pub disturbed_since_s: Option<f64>,
    /// Drawn conditions of the throw; older recordings have none.
    pub conditions: Option<ThrowConditions>,
    /// Largest ratios to the arm's limits before anything touched the gripper; later ones include the impact.
    pub before_contact: Option<PeakRatios>,
}

/// Highest values over their limits, of any joint.
#[quantity::checked]
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct PeakRatios {
    /// Ratio of the measured velocity.
    pub velocity: quantity::true_value,
    /// Ratio of the torque that the controller asked for, before clamping.
    pub torque: quantity::true_value,
}

impl From<&ServoReport> for PeakRatios {
    fn from(report: &ServoReport) -> Self {
        Self { velocity: report.peak_velocity_ratio, torque: report.peak_torque_ratio }
    }
}

/// The state at one instant, and the forces of the step that led to it.
#[quantity::checked]
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct TruthSample {
    /// Time of the sample, in seconds on the cell's clock; in a trial that begins at the release.
    pub time_s: quantity::clock_s,
    /// Joint positions in radians.
    pub q: quantity::true_value<JointVector>,
    /// Joint velocities in rad/s.
    pub dq: quantity::true_value<JointVector>,
    /// Torques of the motors in N·m.
    pub torque: quantity::true_value<JointVector>,
    /// Pose of the gripper.
    pub X_WG: quantity::true_pose<Pose>,
    /// Spatial velocity of the gripper, the linear part at the origin of G.
    pub V_WG: Twist,
    /// Distance between the fingers' inner faces in metres.
    pub width_m: quantity::true_value,
    /// The width that the gripper is commanded to have; below the true one it closes, or squeezes what is
    /// between its fingers.
    #[serde(default)]
    pub commanded_width_m: quantity::true_value,
    /// Normal force between left and right finger and the object in N, rebounds included, averaged over the
    /// step.
    pub finger_force_n: quantity::true_value<[f64; 2]>,
    /// Pose of the object.
    pub X_WO: quantity::true_pose<Pose>,
    /// Spatial velocity of the object, the linear part at the origin of O. That is the centre of mass but for
    /// bodies as published: [`ThrownObject::com_O`](crate::ThrownObject::com_O).
    pub V_WO: Twist,
    /// Parts that touched the object.
    pub contact: Contact,
}

/// Parts that touched the object during a step.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct Contact {
    /// The finger at negative x of G.
    pub left_finger: bool,
    /// The finger at positive x of G.
    pub right_finger: bool,
    /// The gripper's housing.
    pub palm: bool,
    /// A link of the arm.
    pub arm: bool,
    /// The floor.
    pub floor: bool,
    /// An obstacle of the workcell.
    #[serde(default)]
    pub obstacle: bool,
    /// The largest normal impulse of one of these during the step, in N·s. An impact is over within a step.
    #[serde(default)]
    pub peak_impulse_ns: f64,
}

impl Contact {
    /// Returns whether anything touched the object.
    pub fn any(&self) -> bool {
        self.gripper() || self.arm || self.floor || self.obstacle
    }

    /// Returns whether fingers or palm touched the object.
    pub fn gripper(&self) -> bool {
        self.left_finger || self.right_finger || self.palm
    }
}

/// Events noticed by the robot controller.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct ServoReport {
    /// Trajectories that were taken.
    pub accepted_trajectories: u32,
    /// Trajectories refused because their start had passed.
    pub late_trajectories: u32,
    /// Trajectories rejected for any other reason: invalid, not ending at rest, discontinuous, declined by
    /// the controller.
    pub rejected_trajectories: u32,
    /// Rejected trajectories that did not continue the one being executed, or were not continuous themselves.
    pub discontinuous_trajectories: u32,
    /// Gripper moves refused because a number was not finite, or speed or force not above zero.
    pub rejected_gripper_moves: u32,
    /// Limits broken by accepted trajectories: the worst value per trajectory, joint and kind.
    pub command_violations: Vec<LimitViolation>,
    /// Limits broken in motion, one entry per excursion with its worst value: positions out of range,
    /// velocities beyond 1.01.
    pub motion_violations: Vec<LimitViolation>,
    /// Time for which the torque was clamped, in seconds.
    pub torque_clamped_s: f64,
    /// Highest measured velocity over its limit, of any joint.
    pub peak_velocity_ratio: f64,
    /// Highest measured acceleration over its limit. An impact alone exceeds it; it is reported, never
    /// counted.
    pub peak_acceleration_ratio: f64,
    /// Highest torque that the controller asked for over its limit, before clamping.
    pub peak_torque_ratio: f64,
    /// Smallest distance between parts of the arm that are compared, in metres; `None` before the first
    /// sample.
    pub min_self_clearance_m: Option<f64>,
    /// Smallest distance between moving parts and the floor or an obstacle, in metres; `None` before the
    /// first sample.
    pub min_floor_clearance_m: Option<f64>,
}
