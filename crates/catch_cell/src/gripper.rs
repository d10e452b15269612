//! The gripper's state and the moves it is sent.

use serde::{Deserialize, Serialize};

/// A gripper as it reports itself.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct GripperState {
    /// Distance between the fingers' inner faces in metres.
    pub width_m: f64,
    /// Its rate of change in m/s, negative while closing.
    pub speed_mps: f64,
    /// Force of each finger in N, positive while squeezing.
    pub force_n: f64,
}

/// One move of the fingers.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct GripperMove {
    /// When it begins.
    pub start_s: f64,
    /// Where it ends: the distance between the inner faces. A width below the object's squeezes it.
    pub width_m: f64,
    /// Highest speed of the fingers relative to each other.
    pub speed_mps: f64,
    /// Highest force of each finger.
    pub force_n: f64,
}
