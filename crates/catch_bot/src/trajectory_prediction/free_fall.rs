//! Evidence that a thing falls freely, and is no hand that moves.

use catch_body::dynamics::gravity;
use nalgebra::{Matrix3x6, Matrix6, Vector3, Vector6};

use super::{FlightTrajectory, WINDOW, newest, ransac::is_finite};
use crate::perception::ObjectPose;

/// Degrees of freedom that "the errors are as the poses say" counts for.
const SCALE_PRIOR_DOF: f64 = 12.0;
/// A position agrees with a flight within so many standard deviations along each axis.
const OUTLIER_SD: f64 = 2.5;

/// Logarithm of how much likelier the newest poses are of a thing that falls freely than of one that moves
/// uniformly.
///
/// A hand moves nearly uniformly for a tenth of a second; in that time gravity bends a path by 12 mm. Both
/// motions are those that fit best to the positions which agree with `flight`. How far positions err is
/// estimated along with them, so two densities of Student's t are compared. The evidence is 0 if fewer than
/// half of the poses agree.
pub fn log_evidence(poses: &[ObjectPose], flight: &FlightTrajectory) -> f64 {
    let considered = newest(poses, WINDOW);
    let agrees = |pose: &&ObjectPose| {
        let off_m = pose.X_WO.translation.vector - flight.pose_at(pose.capture_s).translation.vector;
        let square = off_m.dot(&(pose.information.fixed_view::<3, 3>(3, 3) * off_m));
        is_finite(pose) && square < 3.0 * (OUTLIER_SD * flight.error_scale.max(1.0)).powi(2)
    };
    let agreeing: Vec<&ObjectPose> = considered.iter().filter(agrees).collect();
    if 2 * agreeing.len() < considered.len() {
        return 0.0;
    }
    let [uniform, falling] = [Vector3::zeros(), gravity()].map(|a_W| misfit(&agreeing, flight, &a_W));
    let dof = SCALE_PRIOR_DOF + 3.0 * agreeing.len() as f64 - 6.0;
    0.5 * dof * libm::log((SCALE_PRIOR_DOF + uniform) / (SCALE_PRIOR_DOF + falling))
}

/// Least sum of squares, in standard deviations, by which positions are off a motion of constant
/// acceleration near a flight.
fn misfit(poses: &[&ObjectPose], flight: &FlightTrajectory, a_W: &Vector3<f64>) -> f64 {
    let (mut information, mut pull, mut squares) = (Matrix6::zeros(), Vector6::zeros(), 0.0);
    for pose in poses {
        let elapsed_s = pose.capture_s - flight.time_s;
        let moved_m = flight.v_WOcm * elapsed_s + a_W * (0.5 * elapsed_s * elapsed_s);
        let off_m = pose.X_WO.translation.vector - flight.p_WOcm.coords - moved_m;
        let weight = pose.information.fixed_view::<3, 3>(3, 3);
        let mut by_start = Matrix3x6::identity();
        by_start.fixed_view_mut::<3, 3>(0, 3).fill_diagonal(elapsed_s);
        let weighted = by_start.transpose() * weight;
        information += weighted * by_start;
        pull += weighted * off_m;
        squares += off_m.dot(&(weight * off_m));
    }
    let explained = information.cholesky().map_or(0.0, |factor| pull.dot(&factor.solve(&pull)));
    (squares - explained).max(0.0)
}

#[cfg(test)]
mod tests {
    use nalgebra::Point3;
    use proptest::prelude::*;

    use super::*;
    use crate::tracker::tracks::tests::pose;

    /// Evidence of poses a hundredth of a second apart, which err by some millimetres to and fro.
    fn of_motion(v_WO: Vector3<f64>, a_W: Vector3<f64>, off_m: f64, count: u32) -> f64 {
        let place = |t: f64| Point3::new(1.0, 2.0, 0.5) + v_WO * t + a_W * (0.5 * t * t);
        let off_W = |i: u32| Vector3::new(1.0, -1.0, 1.0) * if i % 3 == 0 { off_m } else { -0.5 * off_m };
        let seen: Vec<ObjectPose> =
            (0..count).map(|i| (i, 0.01 * f64::from(i))).map(|(i, t)| pose(t, place(t) + off_W(i))).collect();
        let flight = FlightTrajectory { p_WOcm: place(0.0), v_WOcm: v_WO, ..FlightTrajectory::default() };
        log_evidence(&seen, &flight)
    }

    proptest! {
        #[test]
        fn what_falls_and_what_does_not_are_told_apart(
            v in prop::array::uniform3(-5.0..5.0_f64), off_m in 0.0..0.002_f64,
        ) {
            let v_WO = Vector3::from(v);
            prop_assert!(of_motion(v_WO, gravity(), off_m, 12) > 7.0);
            // The flight is another one by 6 mm within a tenth of a second: all poses agree with it.
            prop_assert!(of_motion(v_WO, Vector3::zeros(), off_m, 5) < 0.0);
            prop_assert!(of_motion(v_WO, gravity(), off_m, 3).abs() < 1.0, "three poses tell nothing");
        }

        /// Errors ten times as large as the poses say do not look like gravity.
        #[test]
        fn errors_are_no_evidence(seed in 0..1000_u64) {
            let mut normal = crate::perception::synthetic::Normal::new(seed);
            let seen: Vec<ObjectPose> =
                (0..12).map(|i| pose(0.01 * f64::from(i), (normal.vector() * 0.01).into())).collect();
            let evidence = log_evidence(&seen, &FlightTrajectory::default());
            prop_assert!(evidence < 7.0, "{evidence}");
        }
    }
}
