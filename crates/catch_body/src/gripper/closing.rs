//! Closing motion of the fingers: limited in speed and acceleration.

/// Halvings after which a wait of seconds is known to a nanosecond.
const HALVINGS: usize = 32;

/// Distance and speed of the fingers.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Fingers {
    /// Distance between the fingers in metres.
    pub width_m: f64,
    /// Opening speed of the fingers in m/s, negative while they close.
    pub rate_mps: f64,
}

/// A closing of the fingers from standing, relative to each other.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Closing {
    /// Highest speed in m/s.
    pub speed_mps: f64,
    /// Acceleration in m/s².
    pub acceleration_mps2: f64,
}

impl Closing {
    /// Duration of a closing by `travel_m` from rest, in seconds.
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

    /// Longest time for which the fingers may go on toward an aperture before they close, to be
    /// `object_width_m` apart `contact_in_s` from now; at least zero.
    ///
    /// Whatever the fingers do first, they cannot be there sooner than by closing at once: the time of
    /// contact rises with the wait.
    pub fn wait_s(&self, fingers: Fingers, aperture_m: f64, object_width_m: f64, contact_in_s: f64) -> f64 {
        let contact_s = |wait_s: f64| {
            let Fingers { width_m, rate_mps } = self.after(fingers, aperture_m, wait_s);
            wait_s + self.duration_from_s(width_m - object_width_m, -rate_mps)
        };
        if contact_s(0.0) >= contact_in_s {
            return 0.0;
        }
        let (mut low_s, mut high_s) = (0.0, contact_in_s);
        for _ in 0..HALVINGS {
            let middle_s = f64::midpoint(low_s, high_s);
            if contact_s(middle_s) < contact_in_s { low_s = middle_s } else { high_s = middle_s }
        }
        high_s
    }

    /// Fingers that have gone toward an aperture for `time_s`, as quickly as they can, to stand there: up to
    /// a speed, on at it, and down to rest, after braking where they go the other way or too fast to stop in
    /// time.
    pub fn after(&self, fingers: Fingers, aperture_m: f64, time_s: f64) -> Fingers {
        let a = self.acceleration_mps2;
        let braking_m = fingers.rate_mps * fingers.rate_mps.abs() / (2.0 * a);
        // Whatever way the fingers move, they would come to rest here; beyond the aperture they have to come
        // back.
        let side = (aperture_m - fingers.width_m - braking_m).signum();
        let (far_m, start_mps) = (side * (aperture_m - fingers.width_m), side * fingers.rate_mps);
        // From the speed v up to w and down to rest: s = (w² − v²)/2a + w²/2a.
        let peak_mps = (a * far_m + 0.5 * start_mps * start_mps).max(0.0).sqrt().min(self.speed_mps).max(start_mps);
        let ramps_m = (2.0 * peak_mps * peak_mps - start_mps * start_mps) / (2.0 * a);
        let up_s = (peak_mps - start_mps) / a;
        let even_s = (far_m - ramps_m).max(0.0) / peak_mps.max(f64::MIN_POSITIVE);
        let down_s = peak_mps / a;
        let left_s = up_s + even_s + down_s - time_s;
        let (gone_m, speed_mps) = if left_s <= 0.0 {
            (far_m, 0.0)
        } else if left_s <= down_s {
            (far_m - 0.5 * a * left_s * left_s, a * left_s)
        } else if time_s >= up_s {
            (far_m - 0.5 * peak_mps * down_s - peak_mps * (left_s - down_s), peak_mps)
        } else {
            (start_mps * time_s + 0.5 * a * time_s * time_s, start_mps + a * time_s)
        };
        Fingers { width_m: fingers.width_m + side * gone_m, rate_mps: side * speed_mps }
    }

    /// Duration of a closing by `travel_m` of fingers that close at `speed_mps` already, in seconds.
    fn duration_from_s(&self, travel_m: f64, speed_mps: f64) -> f64 {
        let (travel_m, a) = (travel_m.max(0.0), self.acceleration_mps2);
        let ramp_m = (self.speed_mps * self.speed_mps - speed_mps * speed_mps).max(0.0) / (2.0 * a);
        if travel_m < ramp_m {
            ((speed_mps * speed_mps + 2.0 * a * travel_m).sqrt() - speed_mps) / a
        } else {
            (travel_m - ramp_m) / self.speed_mps + (self.speed_mps - speed_mps).max(0.0) / a
        }
    }

    /// Distance that remains `before_s` the end of a closing by `travel_m`, in metres.
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
