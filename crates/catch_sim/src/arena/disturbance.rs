//! The disturbance with which the referee tests whether an object is held.

use std::f64::consts::TAU;

use nalgebra::Vector3;

/// Amplitude and frequency, in m/s² and Hz, along (1, 1, 1).
const DISTURBANCE_MPS2: f64 = 5.0;
const DISTURBANCE_HZ: f64 = 2.0;

/// A disturbance that begins some time after the first contact with the gripper, at a step of the physics:
/// whatever the rate of observations.
#[derive(Debug, Clone, Copy)]
pub(super) struct Disturbance {
    after_s: f64,
    contact_s: Option<f64>,
}

impl Disturbance {
    /// Disturbance that begins so long after a contact that is to come.
    pub fn after_contact(after_s: f64) -> Self {
        Self { after_s, contact_s: None }
    }

    /// The gripper touches the object; the first time counts.
    pub fn note_contact(&mut self, time_s: f64) {
        self.contact_s.get_or_insert(time_s);
    }

    /// Returns whether the disturbance has begun.
    pub fn has_begun(&self, now_s: f64) -> bool {
        self.contact_s.is_some_and(|contact_s| now_s >= contact_s + self.after_s - 1e-9)
    }
}

/// Acceleration in W so long after it began.
pub(super) fn acceleration_mps2(since_s: f64) -> Vector3<f64> {
    Vector3::repeat(DISTURBANCE_MPS2 * libm::sin(TAU * DISTURBANCE_HZ * since_s) / 3.0f64.sqrt())
}
