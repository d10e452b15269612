//! Closing of a gripper.

use catch_body::{
    Gripper,
    gripper::{Closing, Fingers},
};
use proptest::prelude::*;

proptest! {
    /// Compares the closed forms with steps through the motion.
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
    /// The wait ends when closing takes what is left: fingers that wait longer touch later.
    #[test]
    fn fingers_on_the_move_touch_when_they_should(
        width_m in 0.04f64..0.08, rate_mps in -0.1f64..0.1, aperture_m in 0.04f64..0.08, contact_in_s in 0.8f64..1.2,
    ) {
        let closing = Closing { speed_mps: 0.1, acceleration_mps2: 1.0 };
        let (object_m, step_s) = (0.03, 2.5e-6);
        let wait_s = closing.wait_s(Fingers { width_m, rate_mps }, aperture_m, object_m, contact_in_s);
        // Goes to the aperture as fast as it may and stops there, then closes, in small steps. What is left
        // when it brakes from v at 1 m/s², step by step, is v²/2 + v·step/2.
        let (mut at_m, mut at_mps, mut time_s) = (width_m, rate_mps, 0.0);
        while at_m > object_m {
            let (target_m, closes) = if time_s < wait_s { (aperture_m, false) } else { (-1.0, true) };
            let ahead_m: f64 = target_m - at_m;
            let braking_mps = ((step_s * step_s + 8.0 * ahead_m.abs()).sqrt() - step_s) / 2.0;
            let most_mps = if closes { 0.1 } else { braking_mps.min(0.1) };
            at_mps += (most_mps.copysign(ahead_m) - at_mps).clamp(-step_s, step_s);
            at_m += at_mps * step_s;
            time_s += step_s;
        }
        prop_assert!((time_s - contact_in_s).abs() < 1e-4, "after {time_s} s");
    }

    /// On the way to an aperture neither speed nor acceleration is more than the fingers have, and they come
    /// to stand there.
    #[test]
    fn fingers_go_to_an_aperture_within_their_limits(
        width_m in 0.0f64..0.1, rate_mps in -0.4f64..0.4, aperture_m in 0.0f64..0.1,
        speed_mps in 0.4f64..0.8, acceleration_mps2 in 0.5f64..10.0,
    ) {
        let closing = Closing { speed_mps, acceleration_mps2 };
        let start = Fingers { width_m, rate_mps };
        let step_s = 1e-3;
        let mut before = start;
        for i in 1..4000 {
            let now = closing.after(start, aperture_m, f64::from(i) * step_s);
            prop_assert!(now.rate_mps.abs() <= speed_mps + 1e-12);
            prop_assert!((now.rate_mps - before.rate_mps).abs() <= acceleration_mps2 * step_s * (1.0 + 1e-6) + 1e-12);
            let mean_mps = f64::midpoint(now.rate_mps, before.rate_mps);
            prop_assert!((now.width_m - before.width_m - mean_mps * step_s).abs() <= acceleration_mps2 * step_s * step_s);
            before = now;
        }
        prop_assert!((before.width_m - aperture_m).abs() < 1e-12 && before.rate_mps == 0.0, "{before:?}");
    }
}

/// A wait from rest follows from the gripper's data sheet alone: it is what the closed form of closing
/// leaves.
#[test]
fn fingers_that_stand_wait_for_what_closing_leaves() {
    let toml = include_str!("../../../../assets/grippers/franka_hand.toml");
    let gripper = Gripper::from_toml("franka_hand.toml", toml).unwrap();
    let (speed_mps, acceleration_mps2) = (gripper.max_speed_mps, gripper.max_acceleration_mps2);
    let closing = Closing { speed_mps, acceleration_mps2 };
    let standing = Fingers { width_m: 0.06, rate_mps: 0.0 };
    let travel_m = 0.03;
    let (v, a) = (speed_mps, acceleration_mps2);
    let wait_s = closing.wait_s(standing, 0.06, 0.06 - travel_m, 0.6);
    assert!((wait_s - (0.6 - travel_m / v - v / (2.0 * a))).abs() < 1e-9, "{wait_s}");
    assert_eq!(closing.wait_s(standing, 0.06, 0.03, 0.1), 0.0, "it is too late already");
    // Fingers that open turn back as soon as they begin to close: v/a to stop, and as far again.
    let opening = Fingers { width_m: 0.05, rate_mps: v };
    let back_m = v * v / (2.0 * a);
    let least_s = v / a + (0.02 + back_m) / v + v / (2.0 * a);
    let wait_s = closing.wait_s(opening, 0.075, 0.03, least_s + 0.02);
    // The distance by which they open while they wait is closed at the same speed.
    assert!((wait_s - 0.01).abs() < 1e-9, "{wait_s}");
}

#[test]
fn fingers_without_inertia_close_evenly() {
    let closing = Closing { speed_mps: 2.0, acceleration_mps2: f64::INFINITY };
    assert_eq!(closing.duration_s(0.02), 0.01);
    assert!((closing.remaining_m(0.02, 0.004) - 0.008).abs() < 1e-12);
}
