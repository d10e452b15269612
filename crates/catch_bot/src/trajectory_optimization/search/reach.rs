//! Use of the reach map in a search.

use catch_body::Pose;

use super::REACH_FRACTION;
use crate::trajectory_optimization::reach_map::ReachMap;

/// A reach map, and when the arm departed from the pose for which it holds.
#[derive(Clone, Copy)]
pub struct Reach<'a> {
    pub map: &'a ReachMap,
    pub departure_s: f64,
}

impl Reach<'_> {
    /// Returns whether the gripper can be at `X_WG` by a catch time, as far as samples show.
    pub fn is_in_time(&self, X_WG: &Pose, catch_s: f64) -> bool {
        self.map.is_in_time(X_WG, catch_s - self.departure_s)
    }

    /// Estimated cost of the reachability margin: where the arm needs most of the time, it needs most of its
    /// joints' limits.
    pub fn margin_cost(&self, X_WG: &Pose, catch_s: f64) -> f64 {
        REACH_FRACTION * (self.map.least_time_s(X_WG) / (catch_s - self.departure_s)).min(1.0).powi(4)
    }
}
