//! Reachable sets of a double integrator.

use catch_bot::trajectory_optimization::reachability::*;
use proptest::prelude::*;

proptest! {
    /// No admissible motion made of random accelerations leaves the claimed intervals.
    #[test]
    fn random_motions_stay_inside(
        v0 in -1.0f64..1.0, time_s in 0.05f64..1.0, accelerations in prop::collection::vec(-1.0f64..=1.0, 1..9),
    ) {
        let reach = ReachableSet { start_velocity: v0, velocity: 1.0, acceleration: 5.0, time_s };
        let steps = 2000;
        let dt = time_s / f64::from(steps);
        let (mut q, mut dq) = (0.0, v0);
        for step in 0..steps {
            let index = (step as usize * accelerations.len()) / steps as usize;
            let next = (dq + accelerations[index].signum() * 5.0 * dt).clamp(-1.0, 1.0);
            q += (dq + next) / 2.0 * dt;
            dq = next;
        }
        let far = reach.displacements();
        prop_assert!(q >= far.low - 1e-9 && q <= far.high + 1e-9, "{q} not in {far:?}");
        let fast = reach.terminal_velocities(q);
        prop_assert!(dq >= fast.low - 1e-2 && dq <= fast.high + 1e-2, "{dq} not in {fast:?}");
    }

    /// The extremes are reached: integrating the bang-bang motion arrives at the claimed displacement and
    /// velocity.
    #[test]
    fn extreme_velocities_are_attained(v0 in -1.0f64..1.0, time_s in 0.05f64..1.0, fraction in 0.0f64..=1.0) {
        let reach = ReachableSet { start_velocity: v0, velocity: 1.0, acceleration: 5.0, time_s };
        let far = reach.displacements();
        let displacement = far.low + fraction * (far.high - far.low);
        let highest = reach.terminal_velocities(displacement).high;
        prop_assume!(highest < 1.0 - 1e-9);
        // Back up from the arrival: velocity is the larger of "falling from v0" and "rising to the end".
        let steps = 20_000;
        let dt = time_s / f64::from(steps);
        let velocity = |t: f64| (v0 - 5.0 * t).max(-1.0).max(highest - 5.0 * (time_s - t));
        let reached: f64 = (0..steps).map(|i| velocity((f64::from(i) + 0.5) * dt) * dt).sum();
        prop_assert!((reached - displacement).abs() < 1e-6, "{reached} instead of {displacement}");
    }
}
