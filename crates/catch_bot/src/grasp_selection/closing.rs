//! How the fingers close: up to a speed, at an acceleration.

/// A closing of the fingers from standing, relative to each other.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Closing {
    /// Highest speed in m/s.
    pub speed_mps: f64,
    /// Acceleration in m/s².
    pub acceleration_mps2: f64,
}

impl Closing {
    /// How long it takes for `travel_m`.
    pub fn duration_s(&self, travel_m: f64) -> f64 {
        let travel_m = travel_m.max(0.0);
        // s = a·t²/2 up to the speed v at t = v/a, s = v·t − v²/2a from there on.
        let ramp_m = self.speed_mps * self.speed_mps / (2.0 * self.acceleration_mps2);
        if travel_m < ramp_m {
            (2.0 * travel_m / self.acceleration_mps2).sqrt()
        } else {
            travel_m / self.speed_mps + self.speed_mps / (2.0 * self.acceleration_mps2)
        }
    }

    /// How far there is still to go `before_s` the end of a closing by `travel_m`.
    pub fn remaining_m(&self, travel_m: f64, before_s: f64) -> f64 {
        let elapsed_s = self.duration_s(travel_m) - before_s;
        if elapsed_s <= 0.0 {
            return travel_m;
        }
        let ramp_s = self.speed_mps / self.acceleration_mps2;
        let gone_m = if elapsed_s < ramp_s {
            0.5 * self.acceleration_mps2 * elapsed_s * elapsed_s
        } else {
            self.speed_mps * (elapsed_s - ramp_s / 2.0)
        };
        (travel_m - gone_m).max(0.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
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
}
