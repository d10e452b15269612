//! Settings of the search.

use serde::{Deserialize, Serialize};

use crate::settings::{DURATION_S, Faults, NOT_NEGATIVE, SettingError, Settings};

/// Weights of the choice among catches that the arm can reach. All terms are costs.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Weights {
    /// On the reachability margin: the largest fraction of a joint's reach that is used, raised to the fourth power.
    pub reach_fraction: f64,
    /// On the distance from the comfortable pose, per radian.
    pub comfort: f64,
    /// On the object's speed relative to the gripper, per m/s: what passes the fingers slowly stays.
    pub speed: f64,
    /// On the gripper's angular speed, per rad/s.
    pub spin: f64,
    /// On waiting longer, per second.
    pub delay: f64,
}

impl Default for Weights {
    fn default() -> Self {
        Self { reach_fraction: 1.0, comfort: 0.02, speed: 1.4, spin: 0.3, delay: 0.5 }
    }
}

impl Settings for Weights {
    fn faults(&self) -> Vec<SettingError> {
        Faults::default()
            .values(
                &NOT_NEGATIVE,
                [
                    ("reach_fraction", self.reach_fraction),
                    ("comfort", self.comfort),
                    ("speed", self.speed),
                    ("spin", self.spin),
                    ("delay", self.delay),
                ],
            )
            .all()
    }
}

/// Settings of the search's extent and work.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Config {
    /// Latest catch, in seconds from the start.
    pub latest_catch_s: f64,
    /// What a failure of a grasp adds to the cost of all of its catches in the order of the search: what fails at one time mostly
    /// fails at the next as well, and a pass may not do more than so much work.
    pub failure_penalty: f64,
    /// The work of all passes at one image, in units of 1 to 2 µs.
    pub max_work: usize,
    /// Postures of a catch time and a grasp whose terminal velocities are sought: what a few could not do, similar ones usually
    /// cannot either.
    pub max_velocity_trials: usize,
    /// Those for which a motion is tried.
    pub max_motion_trials: usize,
    /// How much later than on the grid the second round tries what got as far as the swept-volume check or a motion, in seconds;
    /// negative for sooner.
    pub nearby_s: Vec<f64>,
}

impl Default for Config {
    fn default() -> Self {
        Self {
            latest_catch_s: 2.0,
            failure_penalty: 0.2,
            max_work: 4000,
            max_velocity_trials: 3,
            max_motion_trials: 2,
            nearby_s: vec![-0.001, -0.0005, 0.0005, 0.001],
        }
    }
}

impl Settings for Config {
    fn faults(&self) -> Vec<SettingError> {
        Faults::default()
            .values(&DURATION_S, [("latest_catch_s", self.latest_catch_s)])
            .values(&NOT_NEGATIVE, [("failure_penalty", self.failure_penalty)])
            .counts([
                ("max_work", self.max_work),
                ("max_velocity_trials", self.max_velocity_trials),
                ("max_motion_trials", self.max_motion_trials),
            ])
            .lists(&(-0.1..=0.1), [("nearby_s", &self.nearby_s[..])])
            .all()
    }
}
