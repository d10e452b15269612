//! Grasp selection (paper, III-C).
use catch_body::Gripper;
use serde::{Deserialize, Serialize};

use crate::perception::ReferenceModel;

/// Settings of grasp selection.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Config {}

/// Ways of holding an object.
#[derive(Debug)]
pub struct GraspSet;
impl GraspSet {
    /// Samples.
    pub fn sample(_: &ReferenceModel, _: &Gripper, _: &Config, _: u64) -> Self {
        Self
    }
}
