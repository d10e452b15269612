//! Closing of a gripper.

use catch_bot::grasp_selection::Closing;
use proptest::prelude::*;

proptest! {
    /// Against stepping through it.
    #[test]
    fn travels_and_times_agree(travel_m in 1e-4f64..0.1, speed_mps in 0.05f64..2.0, acceleration_mps2 in 1.0f64..50.0) {
        let closing = Closing { speed_mps, acceleration_mps2 };
        let (duration_s, steps) = (closing.duration_s(travel_m), 20_000);
        let step_s = duration_s / f64::from(steps);
        let mut gone_m = 0.0;
        for i in 0..steps {
            let middle_s = (f64::from(i) + 0.5) * step_s;
            prop_assert!((closing.remaining_m(travel_m, duration_s - f64::from(i) * step_s) - (travel_m - gone_m)).abs() < 1e-3 * travel_m);
            gone_m += (acceleration_mps2 * middle_s).min(speed_mps) * step_s;
        }
        prop_assert!((gone_m - travel_m).abs() < 1e-3 * travel_m);
        prop_assert!(closing.remaining_m(travel_m, 0.0) < 1e-9);
    }
}

proptest! {
    /// Fingers that stand at their aperture wait as long as there is time, and those that wait longer than that touch later.
    #[test]
    fn fingers_on_the_move_touch_when_they_should(
        width_m in 0.04f64..0.08, rate_mps in -0.1f64..0.1, aperture_m in 0.04f64..0.08, contact_in_s in 0.8f64..1.2,
    ) {
        let closing = Closing { speed_mps: 0.1, acceleration_mps2: 1.0 };
        let (object_m, step_s) = (0.03, 1e-4);
        let wait_s = closing.wait_s(width_m, rate_mps, aperture_m, object_m, contact_in_s);
        // Goes to the aperture as the gripper's drive does, then closes.
        let (mut at_m, mut at_mps, mut time_s) = (width_m, rate_mps, 0.0);
        while at_m > object_m {
            let (target_m, closes) = if time_s < wait_s { (aperture_m, false) } else { (-1.0, true) };
            let ahead_m: f64 = target_m - at_m;
            let most_mps = if closes { 0.1 } else { (2.0 * ahead_m.abs()).sqrt().min(0.1).min(ahead_m.abs() / step_s) };
            at_mps += (most_mps.copysign(ahead_m) - at_mps).clamp(-step_s, step_s);
            at_m += at_mps * step_s;
            time_s += step_s;
        }
        prop_assert!((time_s - contact_in_s).abs() < 2e-3, "after {time_s} s");
    }
}

#[test]
fn fingers_that_stand_wait_for_what_closing_leaves() {
    let closing = Closing { speed_mps: 0.1, acceleration_mps2: 1.0 };
    let wait_s = closing.wait_s(0.06, 0.0, 0.06, 0.03, 0.6);
    assert!((wait_s - (0.6 - closing.duration_s(0.03))).abs() < 2e-3);
    assert_eq!(closing.wait_s(0.06, 0.0, 0.06, 0.03, 0.1), 0.0, "it is too late already");
}

#[test]
fn fingers_without_inertia_close_evenly() {
    let closing = Closing { speed_mps: 2.0, acceleration_mps2: f64::INFINITY };
    assert_eq!(closing.duration_s(0.02), 0.01);
    assert!((closing.remaining_m(0.02, 0.004) - 0.008).abs() < 1e-12);
}
