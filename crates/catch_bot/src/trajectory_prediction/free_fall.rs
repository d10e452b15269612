//! Evidence that a thing falls freely, and is no hand that moves.

use catch_body::dynamics::gravity;
use nalgebra::{Matrix3x6, Matrix6, Vector3, Vector6};

use super::{
    FlightTrajectory, WINDOW,
    agreement::{agrees, is_finite, of_position},
    newest,
};
use crate::perception::ObjectPose;

/// Degrees of freedom that "the errors are as the poses say" counts for.
const SCALE_PRIOR_DOF: f64 = 12.0;

/// Logarithm of how much likelier the newest poses are of a thing that falls freely than of one that moves
/// uniformly. `None` if they do not tell.
///
/// A hand moves nearly uniformly for a tenth of a second; in that time gravity bends a path by 12 mm. Both
/// motions are those that fit best to the positions which agree with `flight`, since one of them first did:
/// the thing may have been held before. How far positions err is estimated along with them, so two densities
/// of Student's t are compared. If fewer than half of the positions agree, they tell nothing.
pub fn log_evidence(poses: &[ObjectPose], flight: &FlightTrajectory) -> Option<f64> {
    let fits = |pose: &&ObjectPose| {
        let off_m = pose.X_WO.translation.vector - flight.pose_at(pose.capture_s).translation.vector;
        is_finite(pose) && agrees(pose, &(off_m / flight.error_scale.max(1.0)))
    };
    let since = newest(poses, WINDOW).iter().skip_while(|pose| !fits(pose));
    let agreeing: Vec<&ObjectPose> = since.clone().filter(fits).collect();
    if 2 * agreeing.len() < since.count() {
        return None;
    }
    let v_WO = flight.v_WOcm;
    let uniform = squares(&agreeing, flight, &Vector3::zeros())?;
    let falling = squares(&agreeing, flight, &(gravity() - v_WO * (flight.drag_per_m * v_WO.norm())))?;
    let dof = SCALE_PRIOR_DOF + 3.0 * agreeing.len() as f64 - 6.0;
    Some(0.5 * dof * libm::log((SCALE_PRIOR_DOF + uniform) / (SCALE_PRIOR_DOF + falling)))
}

/// Least sum of squares, in standard deviations, by which positions are off a motion of constant
/// acceleration near a flight. `None` if no such motion is determined.
fn squares(poses: &[&ObjectPose], flight: &FlightTrajectory, a_W: &Vector3<f64>) -> Option<f64> {
    let (mut information, mut pull, mut squares) = (Matrix6::zeros(), Vector6::zeros(), 0.0);
    for pose in poses {
        let elapsed_s = pose.capture_s - flight.time_s;
        let moved_m = flight.v_WOcm * elapsed_s + a_W * (0.5 * elapsed_s * elapsed_s);
        let off_m = pose.X_WO.translation.vector - flight.p_WOcm.coords - moved_m;
        let weight = of_position(pose);
        let mut by_start = Matrix3x6::identity();
        by_start.fixed_view_mut::<3, 3>(0, 3).fill_diagonal(elapsed_s);
        let weighted = by_start.transpose() * weight;
        information += weighted * by_start;
        pull += weighted * off_m;
        squares += off_m.dot(&(weight * off_m));
    }
    let left = squares - pull.dot(&information.cholesky()?.solve(&pull));
    left.is_finite().then(|| left.max(0.0))
}

#[cfg(test)]
mod tests {
    use nalgebra::Point3;
    use proptest::prelude::*;

    use super::*;
    use crate::{perception::synthetic::Normal, tracker::tracks::tests::pose};

    /// Poses a hundredth of a second apart, which err at random.
    fn seen(v_WO: Vector3<f64>, a_W: Vector3<f64>, error_m: f64, count: u32, seed: u64) -> Vec<ObjectPose> {
        let mut normal = Normal::new(seed);
        let mut place = |t: f64| Point3::from(v_WO * t + a_W * (0.5 * t * t) + normal.vector() * error_m);
        (0..count).map(|i| 0.01 * f64::from(i)).map(|t| pose(t, place(t))).collect()
    }

    /// A flight that is within 7 mm of uniform motion for a tenth of a second.
    fn flight_near(v_WO: Vector3<f64>) -> FlightTrajectory {
        let p_WOcm = Point3::from(gravity() * 0.01 / 16.0);
        FlightTrajectory { p_WOcm, v_WOcm: v_WO - gravity() * 0.05, ..FlightTrajectory::default() }
    }

    proptest! {
        #[test]
        fn what_falls_and_what_does_not_are_told_apart(
            v in prop::array::uniform3(-5.0..5.0_f64), error_m in 0.0..0.001_f64, seed in 0..1000_u64,
        ) {
            let v_WO = Vector3::from(v);
            let flight = FlightTrajectory { v_WOcm: v_WO, ..FlightTrajectory::default() };
            let falling = seen(v_WO, gravity(), error_m, 11, seed);
            let evidence = log_evidence(&falling, &flight).unwrap();
            prop_assert!(evidence > 7.0, "{evidence}");
            let uniform = log_evidence(&seen(v_WO, Vector3::zeros(), error_m, 11, seed), &flight_near(v_WO)).unwrap();
            prop_assert!(uniform < -7.0, "{uniform}");
            // It was held until it flew.
            let held = (1..20).map(|i| pose(-0.01 * f64::from(i), Point3::new(0.5, 0.5, -0.5)));
            let both: Vec<ObjectPose> = held.chain(falling).collect();
            prop_assert!((log_evidence(&both, &flight).unwrap() - evidence).abs() < 1e-9);
        }

        /// Errors ten times as large as the poses say do not look like gravity.
        #[test]
        fn errors_are_no_evidence(seed in 0..1000_u64) {
            let flight = FlightTrajectory { error_scale: 10.0, ..flight_near(Vector3::zeros()) };
            let evidence = log_evidence(&seen(Vector3::zeros(), Vector3::zeros(), 0.01, 11, seed), &flight);
            prop_assert!(evidence.is_some_and(|it| it != 0.0 && it < 7.0), "{evidence:?}");
        }
    }

    #[test]
    fn what_does_not_tell_is_no_evidence() {
        let flight = FlightTrajectory::default();
        let of = |poses: &[ObjectPose]| log_evidence(poses, &flight);
        let falling = seen(Vector3::zeros(), gravity(), 0.0, 11, 0);
        assert_eq!(of(&[]), None);
        assert_eq!(of(&falling[..1]), None, "one position has no velocity");
        let off = falling.iter().map(|it| pose(it.capture_s, Point3::new(it.capture_s, 0.0, 0.0)));
        assert_eq!(of(&off.collect::<Vec<_>>()), None, "few agree");
        let nowhere = falling.iter().map(|it| pose(it.capture_s, Point3::new(f64::NAN, 0.0, 0.0)));
        assert_eq!(of(&nowhere.collect::<Vec<_>>()), None);
        let mut blind = falling;
        blind.iter_mut().for_each(|it| it.information.fill(0.0));
        assert_eq!(of(&blind), None);
    }
}
