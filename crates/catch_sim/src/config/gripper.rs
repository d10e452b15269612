//! How the gripper of the arena is driven, and what makes it close.

use catch_body::quantity;
use serde::{Deserialize, Serialize};

/// How the gripper is driven.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "snake_case", deny_unknown_fields)]
pub enum GripperDriveKind {
    /// As strong as the real gripper, but without limit of speed beyond the fingers' own inertia and without latency: about
    /// 5 ms from wide open to a tennis ball. The paper's gripper, less its 1000 N.
    Ideal {},
    /// A real one: the limits of speed, acceleration and force in the gripper's file hold, and commands and states take time, as
    /// its table `drive` says.
    Real(RealDrive),
    /// The same, as files call it that are older than the table `drive`.
    Wsg50(RealDrive),
    /// One controller for each finger, which jumps to the commanded width whatever speed and force the command has: the paper's.
    Position(PositionDrive),
}

impl GripperDriveKind {
    /// What a real drive has beyond the gripper's file; `None` for one without limits.
    pub fn real(&self) -> Option<&RealDrive> {
        match self {
            Self::Real(drive) | Self::Wsg50(drive) => Some(drive),
            Self::Ideal {} | Self::Position(_) => None,
        }
    }
}

impl Default for GripperDriveKind {
    fn default() -> Self {
        Self::Ideal {}
    }
}

/// Fingers without limit of speed, each with a proportional-derivative controller. Figures of the authors' code by default.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct PositionDrive {
    /// Force of a finger per metre from where it should be, in N/m.
    #[serde(deserialize_with = "quantity::stiffness_npm")]
    pub stiffness_npm: f64,
    /// Force per speed, in N·s/m.
    #[serde(deserialize_with = "quantity::damping_nspm")]
    pub damping_nspm: f64,
    /// The most that a finger presses with, in N: half of what the controller gives both.
    #[serde(deserialize_with = "quantity::force_n")]
    pub max_force_n: f64,
    /// The width that open fingers are commanded: beyond their stops.
    #[serde(deserialize_with = "quantity::size_m")]
    pub open_width_m: f64,
    /// The controller's cycle in seconds, by which it takes the rate of the commanded width: a jump is pushed after with all the force
    /// there is, one cycle later. Zero: it damps the fingers' own speed only.
    #[serde(deserialize_with = "quantity::controller_time_s")]
    pub cycle_s: f64,
}

impl Default for PositionDrive {
    fn default() -> Self {
        Self { stiffness_npm: 2500.0, damping_nspm: 20.0, max_force_n: 500.0, open_width_m: 1.0, cycle_s: 1e-3 }
    }
}

/// What makes the fingers close.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "snake_case", deny_unknown_fields)]
pub enum GripperTrigger {
    /// The brain's commands.
    Command {},
    /// A sensor in the gripper, as in the paper's simulator; commands are ignored. Fingers that have closed stay so.
    Proximity(ProximitySensor),
}

impl Default for GripperTrigger {
    fn default() -> Self {
        Self::Command {}
    }
}

/// A sensor that sees where the object truly is. It does not look at how far aside that is.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct ProximitySensor {
    /// The object's origin is this near the gripper's, in metres.
    #[serde(deserialize_with = "quantity::distance_m")]
    pub distance_m: f64,
    /// And this near along z of the gripper, the direction in which it passes.
    #[serde(deserialize_with = "quantity::distance_m")]
    pub along_z_m: f64,
}

impl Default for ProximitySensor {
    /// The figures of the authors' code.
    fn default() -> Self {
        Self { distance_m: 0.25, along_z_m: 0.01 }
    }
}

/// What a gripper's own file leaves open of its connection and its drive, or has otherwise.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct RealDrive {
    /// Time from a command until the fingers begin to move. It is drawn uniformly within one cycle around this, for the
    /// gripper takes commands in a cycle of its own; zero is none at all. The gripper's own if it is not set.
    #[serde(deserialize_with = "quantity::latency_s")]
    pub latency_s: Option<f64>,
    /// Rate of the gripper's cycle, in which it takes commands and refreshes its state. The gripper's own if it is not set.
    #[serde(deserialize_with = "quantity::rate_hz")]
    pub state_rate_hz: Option<f64>,
    /// The reported width and speed are rounded to this, in metres and m/s. Default 0.01 mm, the unit of the command set
    /// (Schunk, WSG series, PROFIBUS interface, register WIDTH); zero rounds nothing.
    #[serde(deserialize_with = "quantity::error_m")]
    pub width_step_m: f64,
    /// Inertia of motor and gear, reflected to each finger. Chosen, as no figure is published: it lets the fingers keep to their
    /// speed when something slips out from between them.
    #[serde(deserialize_with = "quantity::added_mass_kg")]
    pub drive_mass_kg: f64,
}

impl Default for RealDrive {
    fn default() -> Self {
        Self { latency_s: None, state_rate_hz: None, width_step_m: 1e-5, drive_mass_kg: 0.5 }
    }
}
