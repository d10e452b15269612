//! Scenarios: everything that a set of trials shares, in one file.

use catch_body::InputError;
use catch_sim::ArenaConfig;
use serde::{Deserialize, Serialize};

use crate::assets::Kind;

/// A scenario's file: a composition of each module's own settings. What it does not say is the module's default.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Scenario {
    /// Name, by which results call it.
    pub name: String,
    /// What it is, in a sentence.
    pub description: String,
    /// The arm: a built-in robot, or the path of a `robot.toml` with a `robot.urdf` beside it.
    pub robot: String,
    /// The gripper on it.
    pub gripper: String,
    /// What is thrown unless somebody asks for something else.
    pub object: String,
    /// How it is thrown unless somebody asks for something else.
    pub throw: String,
    /// Joint positions in radians where the arm waits; the robot's own ready pose if left out.
    #[serde(default)]
    pub ready_rad: Option<Vec<f64>>,
    /// The cameras that watch the flight.
    pub flight_rig: String,
    /// The cameras that scan the object beforehand, around the object's frame.
    pub reference_rig: String,
    /// The physics, the sensors and the drives.
    #[serde(default)]
    pub arena: ArenaConfig,
    /// The brain.
    #[serde(default)]
    pub brain: catch_bot::Config,
}

impl Scenario {
    /// Reads a scenario's TOML file; `file` names it in errors.
    ///
    /// # Errors
    /// A field that is missing, misspelt or of the wrong kind, or a value out of range.
    pub fn from_toml(file: &str, text: &str) -> Result<Self, InputError> {
        let scenario: Self = InputError::parse_toml(file, text)?;
        scenario.arena.check(file, "arena")?;
        Ok(scenario)
    }

    /// The files that it names: what kind, in which field, by which name.
    pub fn parts(&self) -> [(Kind, &'static str, &str); 6] {
        [
            (Kind::Robot, "robot", &self.robot),
            (Kind::Gripper, "gripper", &self.gripper),
            (Kind::Object, "object", &self.object),
            (Kind::Throw, "throw", &self.throw),
            (Kind::Rig, "flight_rig", &self.flight_rig),
            (Kind::Rig, "reference_rig", &self.reference_rig),
        ]
    }
}
