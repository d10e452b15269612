//! What one joint can reach in a given time under its velocity and acceleration limits: exact and in closed form.
//!
//! With |q̇| ≤ V and |q̈| ≤ A, the positions that can be reached in time T form an interval, and for each of them so do the
//! velocities on arrival. The extremes are bang-bang: brake (or back up) as late as possible, then accelerate without pause.
//! Position limits on the way are left to the spline that follows.

use catch_body::{JointVector, MAX_JOINTS};

/// A closed interval; empty if `low` exceeds `high`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Interval {
    /// Lower end.
    pub low: f64,
    /// Upper end.
    pub high: f64,
}

impl Interval {
    /// The part that both share.
    pub fn intersection(&self, other: &Self) -> Self {
        Self { low: self.low.max(other.low), high: self.high.min(other.high) }
    }

    /// Halfway between its ends.
    pub fn middle(&self) -> f64 {
        f64::midpoint(self.low, self.high)
    }

    /// Half of what lies between its ends.
    pub fn half_width(&self) -> f64 {
        (self.high - self.low) / 2.0
    }

    /// Its values times `factor`.
    pub fn scaled(&self, factor: f64) -> Self {
        let ends = [factor * self.low, factor * self.high];
        Self { low: ends[0].min(ends[1]), high: ends[0].max(ends[1]) }
    }

    /// Whether nothing lies in it.
    pub fn is_empty(&self) -> bool {
        self.low > self.high
    }
}

/// What a joint may do and where it starts from.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ReachableSet {
    /// Velocity at the start in rad/s, within ± `velocity`.
    pub start_velocity: f64,
    /// Velocity limit V in rad/s.
    pub velocity: f64,
    /// Acceleration limit A in rad/s².
    pub acceleration: f64,
    /// Time T in seconds.
    pub time_s: f64,
}

impl ReachableSet {
    /// How far the joint can get: the interval of displacements in radians.
    pub fn displacements(&self) -> Interval {
        Interval { low: -self.mirrored().highest(), high: self.highest() }
    }

    /// Velocities with which it can arrive after a displacement that it can reach.
    pub fn terminal_velocities(&self, displacement: f64) -> Interval {
        Interval { low: -self.mirrored().highest_velocity(-displacement), high: self.highest_velocity(displacement) }
    }

    fn mirrored(&self) -> Self {
        Self { start_velocity: -self.start_velocity, ..*self }
    }

    /// Accelerate to V at once, then hold it: s = V·T − (V − v₀)²/2A, or v₀·T + A·T²/2 if V is not reached.
    fn highest(&self) -> f64 {
        let Self { start_velocity: v0, velocity: V, acceleration: A, time_s: T } = *self;
        if v0 + A * T <= V { v0 * T + A * T * T / 2.0 } else { V * T - (V - v0).powi(2) / (2.0 * A) }
    }

    /// First −A (down to −V at most), then +A until the end; for large displacements V is reached and held.
    fn highest_velocity(&self, displacement: f64) -> f64 {
        let Self { start_velocity: v0, velocity: V, acceleration: A, time_s: T } = *self;
        // Without saturation, with the switch at T − t: s = v₀·T + A·(t² − T²/2).
        let square = (displacement - v0 * T) / A + T * T / 2.0;
        let rising = square.max(0.0).sqrt().min(T);
        let lowest = v0 - A * (T - rising);
        if lowest >= -V {
            return (lowest + A * rising).min(V);
        }
        // Held at −V in between: s = −V·T + (v₀ + V)²/2A + A·t²/2.
        let rest = displacement + V * T - (v0 + V).powi(2) / (2.0 * A);
        (-V + (2.0 * A * rest.max(0.0)).sqrt()).min(V)
    }
}

/// The largest fraction of its reachability interval that a joint must use to get from `start` to `q`, from its middle on;
/// `None` if one cannot get there.
pub fn fraction_used(
    joints: &[ReachableSet; MAX_JOINTS],
    start: &JointVector,
    q: &JointVector,
    dof: usize,
) -> Option<f64> {
    let mut most: f64 = 0.0;
    for i in 0..dof {
        let far = joints[i].displacements();
        let (middle, half) = ((far.low + far.high) / 2.0, (far.high - far.low) / 2.0);
        let fraction = ((q[i] - start[i] - middle) / half).abs();
        if fraction > 1.0 {
            return None;
        }
        most = most.max(fraction);
    }
    Some(most)
}

#[cfg(test)]
mod tests {
    use super::*;
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

        /// The extremes are reached: integrating the bang-bang motion arrives at the claimed displacement and velocity.
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
}
