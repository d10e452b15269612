//! How the paper and its authors' code count catches.

use catch_sim::Truth;
use nalgebra::Point3;

use super::samples::{is_squeezed, sample_at};
use crate::trial::PAPER_LOOKS_AT_S;

/// How far along z of the gripper the object may be for the paper to call it caught.
const PAPER_DISTANCE_M: f64 = 0.025;
/// The same for the authors' code.
const CODE_DISTANCE_M: f64 = 0.05;
/// When it is asked whether what the paper counts is still held.
const HELD_LATER_S: f64 = PAPER_LOOKS_AT_S + 0.4;

/// What the paper's measures say of a trial.
pub(super) struct Counted {
    /// Whether the object is near enough along z of the gripper for the paper's text.
    pub is_within_text: bool,
    /// Whether it is for the code.
    pub is_within_code: bool,
    /// Whether it is squeezed a while later.
    pub is_held_later: bool,
}

impl Counted {
    /// By the truth; `origin_O` is the point that stands for the object.
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

/// How far the object's origin is from the gripper's along z of the gripper when the paper looks.
fn distance_along_z_m(truth: &Truth, origin_O: &Point3<f64>) -> Option<f64> {
    let sample = sample_at(truth, PAPER_LOOKS_AT_S)?;
    let p_GO_W = (sample.X_WO * origin_O).coords - sample.X_WG.translation.vector;
    Some(sample.X_WG.rotation.inverse_transform_vector(&p_GO_W).z.abs())
}

/// Whether the object is squeezed at `time_s`; a trial that ended before has no object to hold any more.
fn is_held_at(truth: &Truth, time_s: f64) -> bool {
    let at = truth.samples.partition_point(|sample| sample.time_s < time_s - 0.5e-3);
    let pair = at.checked_sub(1).and_then(|before| truth.samples.get(before..=at));
    pair.is_some_and(|pair| is_squeezed(&pair[0], &pair[1]))
}
