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

#[test]
fn fingers_without_inertia_close_evenly() {
    let closing = Closing { speed_mps: 2.0, acceleration_mps2: f64::INFINITY };
    assert_eq!(closing.duration_s(0.02), 0.01);
    assert!((closing.remaining_m(0.02, 0.004) - 0.008).abs() < 1e-12);
}
