//! Settings of the cycle.

use catch_body::quantity;
use serde::{Deserialize, Serialize};

/// Settings of the cycle.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct CycleConfig {
    /// Time for which an object is held after the catch, in seconds.
    #[serde(deserialize_with = "quantity::phase_s")]
    pub hold_s: f64,
}

impl Default for CycleConfig {
    fn default() -> Self {
        Self { hold_s: 1.6 }
    }
}
