//! The `[arena]` table of a scenario.

use catch_body::InputError;
use serde::{Deserialize, Serialize};

use crate::cameras::depth_noise::DepthConfig;

/// What the arena is like. The defaults are the paper's where the paper says something.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct ArenaConfig {
    /// How the gripper is driven.
    pub gripper: GripperDriveKind,
    /// Coulomb friction coefficient of all contacts. Default 0.667, to which the paper's simulator combines its materials;
    /// there is no sourced value for rubber on felt.
    pub friction: f64,
    /// Multiplies the object's own restitution.
    pub restitution_scale: f64,
    /// Whether the air brakes the object. Off by default, as in the paper.
    pub drag: bool,
    /// Whether the cameras tell which pixels show the object. On by default: the paper segments by the renderer's labels.
    pub labels: bool,
    /// Whether the cameras see the floor, which always collides. Off by default: the paper has none, and its lower cameras look
    /// through where it would be.
    pub floor_visible: bool,
    /// What the depth images are off by. Nothing by default, as in the paper.
    pub depth: DepthConfig,
    /// Images per second of each camera. Default 100 Hz (paper, IV).
    pub frame_rate_hz: f64,
    /// How long an image takes to arrive.
    pub latency_s: f64,
    /// Time step of the physics and period of the servo. Default 1 ms.
    pub step_s: f64,
    /// Solver substeps per step. At 4 the outcome of catches agrees with two other engines in 60 of 63 cases.
    pub substeps: usize,
    /// Substeps while the object is far from everything, when only the arm's tracking and the object's spin depend on them.
    /// Default 2: the tool still follows a fast motion within 0.1 mm.
    pub substeps_alone: usize,
}

/// How the gripper is driven.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "snake_case", deny_unknown_fields)]
pub enum GripperDriveKind {
    /// As strong as the real gripper, but without limit of speed beyond the fingers' own inertia and without latency: about
    /// 5 ms from wide open to a tennis ball. The paper's gripper, less its 1000 N.
    #[default]
    Ideal,
}

impl Default for ArenaConfig {
    fn default() -> Self {
        Self {
            gripper: GripperDriveKind::default(),
            friction: 0.667,
            restitution_scale: 1.0,
            drag: false,
            labels: true,
            floor_visible: false,
            depth: DepthConfig::default(),
            frame_rate_hz: 100.0,
            latency_s: 0.0,
            step_s: 1e-3,
            substeps: 4,
            substeps_alone: 2,
        }
    }
}

impl ArenaConfig {
    /// Whether every value can be used; `file` and `table` name the place in errors.
    ///
    /// # Errors
    /// The first value out of range, or a frame interval that is not a whole number of steps.
    pub fn check(&self, file: &str, table: &str) -> Result<(), InputError> {
        let fault = |field: &str, value: f64, expected: &str| {
            Err(InputError::new(file, format!("{table}.{field}"), value, expected))
        };
        for (field, value) in
            [("friction", self.friction), ("restitution_scale", self.restitution_scale), ("latency_s", self.latency_s)]
        {
            if !(value.is_finite() && value >= 0.0) {
                return fault(field, value, "zero or more");
            }
        }
        self.depth.check(file, &format!("{table}.depth"))?;
        InputError::positive(file, format!("{table}.frame_rate_hz"), self.frame_rate_hz)?;
        if !(self.step_s > 0.0 && self.step_s <= 2e-3) {
            return fault("step_s", self.step_s, "above zero and at most 0.002, beyond which contacts are wrong");
        }
        for (field, value) in [("substeps", self.substeps), ("substeps_alone", self.substeps_alone)] {
            if !(1..=100).contains(&value) {
                return fault(field, value as f64, "1 to 100");
            }
        }
        let steps = 1.0 / self.frame_rate_hz / self.step_s;
        if steps < 0.5 || (steps - steps.round()).abs() > 1e-6 * steps {
            return fault(
                "frame_rate_hz",
                self.frame_rate_hz,
                "a rate whose interval is a whole number of steps (step_s)",
            );
        }
        Ok(())
    }

    /// Steps of the physics from one image to the next.
    pub fn steps_per_frame(&self) -> u64 {
        (1.0 / self.frame_rate_hz / self.step_s).round().max(1.0) as u64
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_empty_table_is_the_default_and_a_misspelt_field_a_fault() {
        assert_eq!(toml::from_str::<ArenaConfig>("").unwrap(), ArenaConfig::default());
        let config: ArenaConfig = toml::from_str("friction = 0.5\ngripper = { kind = \"ideal\" }").unwrap();
        assert_eq!(config.friction, 0.5);
        assert!(toml::from_str::<ArenaConfig>("frictoin = 0.5").is_err());
    }

    #[test]
    fn values_out_of_range_are_named() {
        assert_eq!(ArenaConfig::default().check("s.toml", "arena"), Ok(()));
        let check = |config: ArenaConfig| config.check("s.toml", "arena").unwrap_err().to_string();
        let fault = check(ArenaConfig { friction: -1.0, ..Default::default() });
        assert!(fault.contains("s.toml: arena.friction"), "{fault}");
        let fault = check(ArenaConfig { frame_rate_hz: 300.0, ..Default::default() });
        assert!(fault.contains("arena.frame_rate_hz"), "{fault}");
        let fault = check(ArenaConfig { step_s: f64::NAN, ..Default::default() });
        assert!(fault.contains("arena.step_s"), "{fault}");
    }
}
