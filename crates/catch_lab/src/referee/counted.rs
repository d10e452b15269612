//! Catches as the paper and its authors' code count them.

use catch_sim::Truth;
use nalgebra::Point3;

use super::samples::{is_squeezed, sample_at};
use crate::trial::PAPER_LOOKS_AT_S;

/// Largest distance of the object along z of the gripper for a catch by the paper's measure.
const PAPER_DISTANCE_M: f64 = 0.025;
/// Largest distance of the object along z of the gripper for a catch by the authors' code.
const CODE_DISTANCE_M: f64 = 0.05;
/// Time at which a catch by the paper's measure is checked again.
const HELD_LATER_S: f64 = PAPER_LOOKS_AT_S + 0.4;

/// Result of the paper's measures in a trial.
pub(super) struct Counted {
    /// True if the object is near enough along z of the gripper for the paper's text.
    pub is_within_text: bool,
    /// True if the object is near enough for the authors' code.
    pub is_within_code: bool,
    /// True if the object is squeezed 0.4 s after the instant of the paper's measure.
    pub is_held_later: bool,
}

impl Counted {
    /// Evaluates the truth; `origin_O` is the point that stands for the object.
    pub fn of(truth: &Truth, origin_O: &Point3<f64>) -> Self {
        let distance_m = distance_along_z_m(truth, origin_O);
        let is_within = |most_m: f64| distance_m.is_some_and(|distance_m| distance_m < most_m);
        Self {
            is_within_text: is_within(PAPER_DISTANCE_M),
            is_within_code: is_within(CODE_DISTANCE_M),
            is_held_later: is_held_at(truth, HELD_LATER_S),
        }
    }
}

/// Distance of the object's origin from the gripper's along z of the gripper at the time of the paper's
/// measure.
fn distance_along_z_m(truth: &Truth, origin_O: &Point3<f64>) -> Option<f64> {
    let sample = sample_at(truth, PAPER_LOOKS_AT_S)?;
    let p_GO_W = (sample.X_WO * origin_O).coords - sample.X_WG.translation.vector;
    Some(sample.X_WG.rotation.inverse_transform_vector(&p_GO_W).z.abs())
}

/// Returns whether the object is squeezed at `time_s`; a trial that ended before has no object to hold any
/// more.
fn is_held_at(truth: &Truth, time_s: f64) -> bool {
    let at = truth.samples.partition_point(|sample| sample.time_s < time_s - 0.5e-3);
    let pair = at.checked_sub(1).and_then(|before| truth.samples.get(before..=at));
    pair.is_some_and(|pair| is_squeezed(&pair[0], &pair[1]))
}
