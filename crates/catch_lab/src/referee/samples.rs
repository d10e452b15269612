//! The truth's samples: which one, and what it says of the grasp.

use catch_body::dynamics::gravity;
use catch_sim::{Truth, TruthSample};
use nalgebra::{Point3, Vector3};

/// Fingers that move slower have closed.
const CLOSED_SPEED_MPS: f64 = 0.005;
/// A gripper that is commanded to be narrower than it is by less than this, in metres, neither closes nor squeezes: an impact moves
/// the fingers of an open one as far.
const CLOSING_BY_M: f64 = 1e-3;

/// Whether the object is squeezed: the gripper is commanded to be narrower than it is, and both fingers press, or one finger and the
/// palm with the gripper closed upon it. A part that touches presses: contact is an impulse above zero.
pub(crate) fn is_squeezed(before: &TruthSample, now: &TruthSample) -> bool {
    let (left, right) = (now.contact.left_finger, now.contact.right_finger);
    let finger_speed = (now.width_m - before.width_m).abs() / (now.time_s - before.time_s);
    let closes = now.commanded_width_m < now.width_m - CLOSING_BY_M;
    closes && ((left && right) || ((left || right) && now.contact.palm && finger_speed < CLOSED_SPEED_MPS))
}

/// Velocity of the object's centre of mass relative to the gripper, in W.
pub(super) fn relative_velocity(sample: &TruthSample) -> Vector3<f64> {
    let p_GO_W = sample.X_WO.translation.vector - sample.X_WG.translation.vector;
    sample.V_WO.linear - sample.V_WG.velocity_at(&p_GO_W)
}

/// The sample nearest to `time_s`; the last one for times beyond it.
pub(crate) fn sample_at(truth: &Truth, time_s: f64) -> Option<&TruthSample> {
    let next = truth.samples.partition_point(|sample| sample.time_s < time_s - 0.5e-3);
    truth.samples.get(next.min(truth.samples.len().checked_sub(1)?))
}

/// The last sample before `time_s`.
pub(super) fn sample_before(truth: &Truth, time_s: f64) -> Option<&TruthSample> {
    let next = truth.samples.partition_point(|sample| sample.time_s < time_s - 1e-9);
    truth.samples.get(next.checked_sub(1)?)
}

/// Where the object would have been at `time_s` if nothing had touched it: from its last free state on along a parabola.
pub(crate) fn undisturbed_position(truth: &Truth, time_s: f64) -> Option<Point3<f64>> {
    let free_until = truth.samples.iter().position(|sample| sample.contact.any()).unwrap_or(truth.samples.len());
    let free = &truth.samples[..free_until];
    let next = free.partition_point(|sample| sample.time_s < time_s - 0.5e-3);
    let sample = free.get(next.min(free.len().checked_sub(1)?))?;
    // p + v·t + g·t²/2; the air does nothing in the milliseconds that this bridges.
    let t = time_s - sample.time_s;
    let p = sample.X_WO.translation.vector + sample.V_WO.linear * t + gravity() * (t * t / 2.0);
    Some(p.into())
}
