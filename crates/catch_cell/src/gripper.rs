//! The gripper's state and the moves it is sent.

use catch_body::quantity;
use serde::{Deserialize, Serialize};

/// A gripper as it reports itself.
#[quantity::checked]
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct GripperState {
    /// Distance between the fingers' inner faces in metres.
    pub width_m: quantity::drive_m,
    /// Rate of change of the width in m/s, negative while closing.
    pub speed_mps: quantity::drive_mps,
    /// Force of each finger in N, positive while squeezing.
    pub force_n: quantity::drive_n,
    /// State of the grasp according to the drive.
    pub grasp: GraspState,
}

/// State of a grasp as the gripper knows it from its own fingers alone: the states of the Schunk WSG-50
/// (assembly and operating manual, 7.5.2) but for those of faults.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum GraspState {
    /// The fingers stand where they were commanded to.
    #[default]
    Idle,
    /// The fingers open.
    Positioning,
    /// The fingers close.
    Grasping,
    /// The fingers are kept from closing by something between them, and press with the force of the move.
    Holding,
    /// The fingers closed as far as commanded and met nothing.
    NoPart,
    /// The fingers held something and then closed further.
    PartLost,
}

/// A move of the fingers.
#[quantity::checked]
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct GripperMove {
    /// Time at which the move begins, in seconds on the cell's clock.
    pub start_s: quantity::clock_s,
    /// Width at which the move ends: the distance between the inner faces in metres. A width below the
    /// object's squeezes it.
    pub width_m: quantity::drive_m,
    /// Highest speed of the fingers relative to each other in m/s, twice that of one finger.
    pub speed_mps: quantity::drive_mps,
    /// Highest force of each finger in N.
    pub force_n: quantity::drive_n,
}
