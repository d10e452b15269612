//! Agreement of poses with a flight.

use nalgebra::{Matrix3, Vector3};

use crate::perception::ObjectPose;

/// A pose agrees with a flight within this distance, in metres (original).
const INLIER_M: f64 = 0.01;
/// A pose agrees with a flight within so many standard deviations, root mean square over the axes.
const INLIER_SD: f64 = 3.0;

/// Returns whether a pose agrees with a flight that passes `off_m` beside its position: by less than
/// [`INLIER_M`], or by what the pose may be off. One camera knows where along its ray a far object is to
/// centimetres, and across it to millimetres.
pub(super) fn agrees(pose: &ObjectPose, off_m: &Vector3<f64>) -> bool {
    off_m.norm() < INLIER_M || is_within(off_m, &of_position(pose))
}

/// The same of a position by the information on it.
pub(super) fn is_within(off_m: &Vector3<f64>, information: &Matrix3<f64>) -> bool {
    let is_known = information.trace() > 0.0;
    off_m.norm() < INLIER_M || is_known && off_m.dot(&(information * off_m)) < 3.0 * INLIER_SD * INLIER_SD
}

/// Information on a pose's position alone, whatever its orientation.
pub(super) fn of_position(pose: &ObjectPose) -> Matrix3<f64> {
    let block = |i, j| pose.information.fixed_view::<3, 3>(i, j).into_owned();
    let (turns, mixed, shifts) = (block(0, 0), block(0, 3), block(3, 3));
    let seen = turns + Matrix3::identity() * (1e-6 * turns.trace() + 1e-12);
    seen.cholesky().map_or(shifts, |factor| shifts - mixed.transpose() * factor.solve(&mixed))
}

/// Returns whether all numbers of a pose are finite.
pub(super) fn is_finite(pose: &ObjectPose) -> bool {
    let numbers = pose.X_WO.translation.vector.sum() + pose.X_WO.rotation.coords.sum() + pose.information.sum();
    pose.capture_s.is_finite() && numbers.is_finite()
}
