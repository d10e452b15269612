//! The truth's samples: which one, and what it says of the grasp.

use catch_sim::{ThrownObject, Truth, TruthSample, free_flight::coasted};
use nalgebra::{Point3, Vector3};

/// Fingers that move slower have closed.
const CLOSED_SPEED_MPS: f64 = 0.005;
/// A gripper that is commanded to be narrower than it is by less than this, in metres, neither closes nor
/// squeezes: an impact moves the fingers of an open one as far.
const CLOSING_BY_M: f64 = 1e-3;

/// Returns whether the object is squeezed: the gripper is commanded to be narrower than it is, and both
/// fingers press, or one finger and the palm with the gripper closed upon it. A part that touches presses:
/// contact is an impulse above zero.
pub(crate) fn is_squeezed(before: &TruthSample, now: &TruthSample) -> bool {
    let (left, right) = (now.contact.left_finger, now.contact.right_finger);
    let finger_speed = (now.width_m - before.width_m).abs() / (now.time_s - before.time_s);
    let closes = now.commanded_width_m < now.width_m - CLOSING_BY_M;
    closes && ((left && right) || ((left || right) && now.contact.palm && finger_speed < CLOSED_SPEED_MPS))
}

/// Velocity of the object's centre of mass relative to the gripper, in W.
pub(super) fn relative_velocity(sample: &TruthSample, object: &ThrownObject) -> Vector3<f64> {
    let p_OC_W = sample.X_WO.rotation * object.com_O.coords;
    let p_GC_W = sample.X_WO.translation.vector + p_OC_W - sample.X_WG.translation.vector;
    sample.V_WO.velocity_at(&p_OC_W) - sample.V_WG.velocity_at(&p_GC_W)
}

/// The sample nearest to `time_s`; the last one for times beyond it.
pub fn sample_at(truth: &Truth, time_s: f64) -> Option<&TruthSample> {
    let next = truth.samples.partition_point(|sample| sample.time_s < time_s - 0.5e-3);
    truth.samples.get(next.min(truth.samples.len().checked_sub(1)?))
}

/// The last sample before `time_s`.
pub(super) fn sample_before(truth: &Truth, time_s: f64) -> Option<&TruthSample> {
    let next = truth.samples.partition_point(|sample| sample.time_s < time_s - 1e-9);
    truth.samples.get(next.checked_sub(1)?)
}

/// Position of the object's O at `time_s` if nothing had touched it: from its last free state on without air,
/// whose effect is negligible over these milliseconds.
pub fn undisturbed_position(truth: &Truth, object: &ThrownObject, time_s: f64) -> Option<Point3<f64>> {
    let free_until = truth.samples.iter().position(|sample| sample.contact.any()).unwrap_or(truth.samples.len());
    let free = &truth.samples[..free_until];
    let next = free.partition_point(|sample| sample.time_s < time_s - 0.5e-3);
    let sample = free.get(next.min(free.len().checked_sub(1)?))?;
    let (X_WO, _) = coasted(object, (&sample.X_WO, &sample.V_WO), time_s - sample.time_s);
    Some(X_WO.translation.vector.into())
}
