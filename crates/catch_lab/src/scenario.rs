//! Scenarios: everything that a set of trials shares, in one file.

use catch_body::InputError;
use catch_sim::ArenaConfig;
use serde::{Deserialize, Serialize};

use crate::assets::Kind;

/// What it costs to compute a command.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Clock {
    /// Nothing, as in the paper: a command arrives at the instant of what it answers.
    #[default]
    Free,
    /// A constant time in milliseconds.
    FixedMs(f64),
    /// The wall time of the brain's tick on this machine. The only clock with which a trial is not the same every time.
    Charged,
}

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
    /// How long commands take to compute: `"free"`, `{ fixed_ms = 10 }` or `"charged"`. The brain is told what to expect in its own
    /// table, `[brain.control]`, as `expected_latency_s`.
    #[serde(default)]
    pub clock: Clock,
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
        scenario.faults(file).into_iter().next().map_or(Ok(scenario), Err)
    }

    /// Every value out of range.
    pub fn faults(&self, file: &str) -> Vec<InputError> {
        let mut faults = self.arena.faults(file, "arena");
        if let Clock::FixedMs(delay_ms) = self.clock
            && !(delay_ms.is_finite() && delay_ms >= 0.0)
        {
            faults.push(InputError::new(file, "clock.fixed_ms", delay_ms, "zero or more"));
        }
        faults
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
