//! Drive models of the arena's gripper, and triggers of its closing.

use serde::{Deserialize, Serialize};

/// Drive model of the gripper.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum GripperDriveKind {
    /// Drive as strong as the real gripper, but without limit of speed beyond the fingers' own inertia and
    /// without latency: about 5 ms from wide open to a tennis ball. The paper's gripper, less its 1000 N.
    #[default]
    Ideal,
    /// A real one: the limits of speed, acceleration and force in the gripper's file hold, and commands and
    /// states take time, as its table `drive` says.
    Real,
    /// One controller for each finger, which jumps to the commanded width whatever speed and force the
    /// command has: the paper's.
    Position,
}

/// Trigger that makes the fingers close.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum GripperTrigger {
    /// The brain's commands.
    #[default]
    Command,
    /// A sensor in the gripper that sees where the object truly is, as in the paper's simulator; commands are
    /// ignored. Fingers that have closed stay so.
    Proximity,
}
