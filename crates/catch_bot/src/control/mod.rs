//! Control: from plans to commands.
use serde::{Deserialize, Serialize};

/// Settings of control.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Config {}

/// When and how the gripper closes.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct GripperPlan {
    /// When the fingers start to close.
    pub start_s: f64,
    /// When they are expected to touch the object.
    pub contact_s: f64,
}
