//! Settings of the cycle.

use serde::{Deserialize, Serialize};

use crate::settings::{DURATION_S, FRACTION, Faults, PERIOD_S, POSITIVE, SettingError, Settings};

/// Settings of the cycle.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct CycleConfig {
    /// Images after which an object in flight is told from the others.
    pub identify_images: usize,
    /// What moves slower does not fly, in m/s.
    pub min_flight_mps: f64,
    /// What seems faster has been exchanged for another object, in m/s.
    pub max_flight_mps: f64,
    /// Longest time between two images of one flight, in seconds.
    pub max_gap_s: f64,
    /// An object that has been followed for so long without a plan is not caught any more, in seconds.
    pub give_up_s: f64,
    /// From the catch on: how long the fingers are given to close upon the object, in seconds.
    pub squeeze_s: f64,
    /// Fingers that have closed to less than this fraction of the object's width hold nothing.
    pub min_held_fraction: f64,
    /// How long an object is held after the catch, in seconds.
    pub hold_s: f64,
    /// How long the gripper is given to open, and the object to fall out of it, in seconds.
    pub release_s: f64,
    /// How often the motions of one phase are sent at most: one that is rejected again and again never will be accepted.
    pub max_sent: usize,
    /// How long a motion may be overdue before it is sent anew, in seconds.
    pub max_overdue_s: f64,
}

impl Default for CycleConfig {
    fn default() -> Self {
        Self {
            identify_images: 3,
            min_flight_mps: 0.5,
            max_flight_mps: 30.0,
            max_gap_s: 0.1,
            give_up_s: 1.5,
            squeeze_s: 0.3,
            min_held_fraction: 0.5,
            hold_s: 1.6,
            release_s: 0.5,
            max_sent: 20,
            max_overdue_s: 0.05,
        }
    }
}

impl Settings for CycleConfig {
    fn faults(&self) -> Vec<SettingError> {
        Faults::default()
            .values(&POSITIVE, [("min_flight_mps", self.min_flight_mps), ("max_flight_mps", self.max_flight_mps)])
            .values(&PERIOD_S, [("max_gap_s", self.max_gap_s), ("max_overdue_s", self.max_overdue_s)])
            .values(&DURATION_S, [("give_up_s", self.give_up_s), ("squeeze_s", self.squeeze_s)])
            .values(&DURATION_S, [("hold_s", self.hold_s), ("release_s", self.release_s)])
            .values(&FRACTION, [("min_held_fraction", self.min_held_fraction)])
            .at_most(("min_flight_mps", self.min_flight_mps), ("max_flight_mps", self.max_flight_mps))
            // With the first image of a flight nothing has moved yet.
            .counts_from(2, [("identify_images", self.identify_images)])
            .counts([("max_sent", self.max_sent)])
            .all()
    }
}
