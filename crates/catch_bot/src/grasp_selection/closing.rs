//! How the fingers close: up to a speed, at an acceleration.

/// Steps in which moving fingers are followed.
const WAIT_STEP_S: f64 = 5e-4;

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

    /// How long fingers `width_m` apart may go on toward an aperture before they begin to close, to be `object_width_m` apart
    /// `contact_in_s` from now. `rate_mps` is how fast they open now, negative while they close; zero is the least.
    pub fn wait_s(
        &self,
        mut width_m: f64,
        mut rate_mps: f64,
        aperture_m: f64,
        object_width_m: f64,
        contact_in_s: f64,
    ) -> f64 {
        let most_change_mps = self.acceleration_mps2 * WAIT_STEP_S;
        let mut wait_s = 0.0;
        while wait_s + self.duration_from_s(width_m - object_width_m, -rate_mps) < contact_in_s {
            let travel_m = aperture_m - width_m;
            // In steps of h a speed v is stopped within v²/2a + v·h/2.
            let half_step_s = WAIT_STEP_S / 2.0;
            let in_steps_s = half_step_s.hypot((2.0 * travel_m.abs() / self.acceleration_mps2).sqrt());
            let stoppable_mps = 2.0 * travel_m.abs() / (half_step_s + in_steps_s);
            let wanted_mps = self.speed_mps.min(stoppable_mps).min(travel_m.abs() / WAIT_STEP_S);
            let change_mps = wanted_mps.copysign(travel_m) - rate_mps;
            rate_mps += change_mps.clamp(-most_change_mps, most_change_mps);
            width_m += rate_mps * WAIT_STEP_S;
            wait_s += WAIT_STEP_S;
        }
        wait_s
    }

    /// How long it takes for `travel_m` of fingers that close at `speed_mps` already.
    fn duration_from_s(&self, travel_m: f64, speed_mps: f64) -> f64 {
        let (travel_m, a) = (travel_m.max(0.0), self.acceleration_mps2);
        let ramp_m = (self.speed_mps * self.speed_mps - speed_mps * speed_mps).max(0.0) / (2.0 * a);
        if travel_m < ramp_m {
            ((speed_mps * speed_mps + 2.0 * a * travel_m).sqrt() - speed_mps) / a
        } else {
            (travel_m - ramp_m) / self.speed_mps + (self.speed_mps - speed_mps).max(0.0) / a
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
