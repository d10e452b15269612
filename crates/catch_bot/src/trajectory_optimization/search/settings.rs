//! Weights and bounds of the search.

use catch_body::quantity;
use serde::{Deserialize, Serialize};

/// Weights of the choice among catches that the arm can reach. All terms are costs.
#[quantity::checked(default, deny_unknown_fields)]
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Weights {
    /// Weight of the object's speed relative to the gripper, per m/s: an object that passes the fingers
    /// slowly stays.
    pub speed: quantity::weight,
    /// Weight of the gripper's angular speed, per rad/s.
    pub spin: quantity::weight,
}

impl Default for Weights {
    fn default() -> Self {
        Self { speed: 1.4, spin: 0.3 }
    }
}

/// Weight on the reachability margin: the largest fraction of a joint's reach that is used, raised to the
/// fourth power.
pub const REACH_FRACTION: f64 = 1.0;
/// Weight on the distance from the comfortable pose, per radian.
pub const COMFORT: f64 = 0.02;
/// Weight on waiting longer, per second.
pub const DELAY: f64 = 0.5;
/// Latest catch, in seconds from the start.
pub const LATEST_CATCH_S: f64 = 2.0;
/// Penalty that a failure of a grasp adds to the cost of all of its catches in the order of the search: a
/// grasp that fails at one time mostly fails at the next as well, and the work of a pass is bounded.
pub const FAILURE_PENALTY: f64 = 0.2;
/// Postures of a catch time and a grasp whose terminal velocities are sought: what a few could not do,
/// similar ones usually cannot either.
pub const MAX_VELOCITY_TRIALS: usize = 3;
/// Postures of a catch time and a grasp for which a motion is tried.
pub const MAX_MOTION_TRIALS: usize = 2;
/// Shifts of the catch time with which the second round tries candidates that got as far as the swept-volume
/// check or a motion, in seconds; negative for sooner.
pub const NEARBY_S: [f64; 4] = [-0.001, -0.0005, 0.0005, 0.001];
