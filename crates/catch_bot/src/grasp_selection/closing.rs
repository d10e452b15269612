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
