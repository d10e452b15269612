//! Settings of the cycle.

use serde::{Deserialize, Serialize};

use crate::settings::{DURATION_S, Faults, SettingError, Settings};

/// Settings of the cycle.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct CycleConfig {
    /// An object that has been followed for so long without a plan is not caught any more, in seconds.
    pub give_up_s: f64,
    /// How long an object is held after the catch, in seconds.
    pub hold_s: f64,
}

impl Default for CycleConfig {
    fn default() -> Self {
        Self { give_up_s: 1.5, hold_s: 1.6 }
    }
}

impl Settings for CycleConfig {
    fn faults(&self) -> Vec<SettingError> {
        Faults::default().values(&DURATION_S, [("give_up_s", self.give_up_s), ("hold_s", self.hold_s)]).all()
    }
}
