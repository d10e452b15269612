//! Catches as the paper and its authors' code count them.

use catch_sim::Truth;
use nalgebra::Point3;

use super::samples::{is_squeezed, sample_at};
use crate::trial::PAPER_LOOKS_AT_S;

/// Largest distance of the object along z of the gripper for a catch by the paper's measure.
pub(super) const PAPER_DISTANCE_M: f64 = 0.025;
/// Largest distance of the object along z of the gripper for a catch by the authors' code.
pub(super) const CODE_DISTANCE_M: f64 = 0.05;
/// Time at which a catch by the paper's measure is checked again.
pub(super) const HELD_LATER_S: f64 = PAPER_LOOKS_AT_S + 0.4;

/// Distance of the object's origin from the gripper's along z of the gripper at the time of the paper's
/// measure.
pub(super) fn distance_along_z_m(truth: &Truth, origin_O: &Point3<f64>) -> Option<f64> {
    let sample = sample_at(truth, PAPER_LOOKS_AT_S)?;
    let p_GO_W = (sample.X_WO * origin_O).coords - sample.X_WG.translation.vector;
    Some(sample.X_WG.rotation.inverse_transform_vector(&p_GO_W).z.abs())
}

/// Returns whether the object is squeezed at `time_s`; a trial that ended before has no object to hold any
/// more.
pub(super) fn is_held_at(truth: &Truth, time_s: f64) -> bool {
    let at = truth.samples.partition_point(|sample| sample.time_s < time_s - 0.5e-3);
    let pair = at.checked_sub(1).and_then(|before| truth.samples.get(before..=at));
    pair.is_some_and(|pair| is_squeezed(&pair[0], &pair[1]))
}
