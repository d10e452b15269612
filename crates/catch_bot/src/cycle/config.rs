//! Settings of the cycle.

use catch_body::quantity;
use serde::{Deserialize, Serialize};

/// Settings of the cycle.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct CycleConfig {
    /// An object that has been followed for so long without a plan is not caught any more, in seconds.
    #[serde(deserialize_with = "quantity::phase_s")]
    pub give_up_s: f64,
    /// How long an object is held after the catch, in seconds.
    #[serde(deserialize_with = "quantity::phase_s")]
    pub hold_s: f64,
}

impl Default for CycleConfig {
    fn default() -> Self {
        Self { give_up_s: 1.5, hold_s: 1.6 }
    }
}
