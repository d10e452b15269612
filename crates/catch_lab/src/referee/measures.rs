//! Measures of a trial besides its outcome.

use serde::{Deserialize, Serialize};

use crate::trial::StateSnapshot;

/// Times before the catch at which predictions are compared with the truth, in seconds.
pub const LEADS_S: [f64; 5] = [0.5, 0.4, 0.3, 0.2, 0.1];

/// Figures of a trial that explain its outcome.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct Measures {
    /// Error of the object's position at the catch in the last prediction before it.
    pub prediction_error_m: Option<f64>,
    /// Error of the object's orientation at the catch in the last prediction before it, modulo rotations
    /// under which the object looks the same.
    pub prediction_rotation_error_rad: Option<f64>,
    /// Errors of the position predicted [`LEADS_S`] before the catch, where there was a prediction by then.
    #[serde(default)]
    pub prediction_errors_m: [Option<f64>; LEADS_S.len()],
    /// Distance of the gripper from its planned position at the catch.
    pub tracking_error_m: Option<f64>,
    /// Distance of the undisturbed object at the catch from its planned position in the gripper.
    pub grasp_offset_m: Option<f64>,
    /// Rotation of the undisturbed object at the catch from its planned orientation in the gripper, modulo
    /// rotations under which the object looks the same.
    pub grasp_rotation_error_rad: Option<f64>,
    /// Time from the undisturbed object's closest approach to the grasp centre to the instant midway between
    /// the first contacts of the two fingers.
    pub contact_delay_s: Option<f64>,
    /// Speed of the object relative to the gripper at the catch.
    pub relative_speed_mps: Option<f64>,
    /// Fraction of that speed that points at a finger, along x of G.
    pub sideways_fraction: Option<f64>,
    /// Fraction of it that points at the palm, along −y of G.
    pub palm_fraction: Option<f64>,
    /// Width of the object between the fingers in the planned grasp.
    pub grasp_width_m: Option<f64>,
    /// Distance of the object's centre beyond the grasp centre, away from the palm, in the planned grasp.
    pub grasp_overhang_m: Option<f64>,
    /// "Strength" of the planned grasp: the centre's distance from the gripper's y axis.
    pub grasp_strength_m: Option<f64>,
    /// Set if the object enters the open gripper on the planned approach without contact.
    pub approach_is_free: Option<bool>,
    /// Sum over the joints of how far each moved from the ready pose to the catch.
    pub joint_travel_rad: Option<f64>,
    /// The largest impulse of a contact in one step of the physics, 1 ms, while the gripper touched the
    /// object, in N·s.
    #[serde(default)]
    pub peak_contact_impulse_ns: f64,
    /// The object's impulse on the gripper in the first 20 ms after the first contact, in N·s.
    pub catch_impulse_ns: Option<f64>,
    /// Largest joint impulse Jᵀ·(impulse of the catch and its moment), of any joint, in N·m·s.
    pub catch_joint_impulse_nms: Option<f64>,
    /// Largest ratio of the impact, averaged over 5 ms, to the contact at which the maker's controller stops:
    /// at a joint or at the hand. Above 1 it would have stopped.
    pub contact_stop_ratio: Option<f64>,
    /// Joint of that ratio, from 1 on; none if it is the ratio at the hand.
    pub contact_stop_joint: Option<usize>,
    /// Highest velocity of a joint over its limit, impacts included.
    pub peak_velocity_ratio: f64,
    /// Highest acceleration of a joint over its limit, impacts included.
    pub peak_acceleration_ratio: f64,
    /// Highest torque asked of a motor over its limit, impacts included.
    pub peak_torque_ratio: f64,
    /// Highest velocity of a joint over its limit before anything touched the gripper.
    #[serde(default)]
    pub flight_velocity_ratio: f64,
    /// Highest torque asked of a motor over its limit by then.
    #[serde(default)]
    pub flight_torque_ratio: f64,
    /// Duration for which a motor's torque was clamped.
    pub torque_clamped_s: f64,
    /// Trajectories that came too late.
    pub late_trajectories: u32,
    /// Trajectories rejected for other reasons.
    pub rejected_trajectories: u32,
    /// Rejected trajectories that were discontinuous.
    #[serde(default)]
    pub discontinuous_trajectories: u32,
    /// Programs and factorizations of the brain that failed though nothing was infeasible.
    #[serde(default)]
    pub numerical_failures: u32,
    /// Smallest distance of the arm from itself.
    pub min_self_clearance_m: Option<f64>,
    /// Smallest distance of the arm's moving parts from the floor or an obstacle, in metres.
    pub min_floor_clearance_m: Option<f64>,
    /// Cameras whose images have no depths, as the brain says.
    #[serde(default)]
    pub blinded_cameras: u32,
    /// Cameras that repeat an image, as the brain says.
    #[serde(default)]
    pub frozen_cameras: u32,
    /// Cameras that give no images, as the brain says.
    #[serde(default)]
    pub silent_cameras: u32,
    /// Cameras that do not stand as they are believed to, as the brain says.
    #[serde(default)]
    pub displaced_cameras: u32,
    /// Cameras that give the images of others, as the brain says.
    #[serde(default)]
    pub swapped_cameras: u32,
    /// Cameras that are left out, since their calibration did not converge.
    #[serde(default)]
    pub uncalibrated_cameras: u32,
}

/// Returns the brain's count of numerical failures in the throw up to its last tick.
pub(super) fn numerical_failures(snapshots: &[StateSnapshot]) -> u32 {
    let last = snapshots.iter().rev().find_map(|it| it.report.as_ref());
    last.map_or(0, |report| report.numerical_failures.prediction + report.numerical_failures.planning)
}
