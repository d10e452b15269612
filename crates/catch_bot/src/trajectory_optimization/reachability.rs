//! Reachable set of one joint in a given time under its velocity and acceleration limits: exact and in closed
//! form.
//!
//! With |q̇| ≤ V and |q̈| ≤ A, the positions that can be reached in time T form an interval, and for each of
//! them so do the velocities on arrival. The extremes are bang-bang: brake (or back up) as late as possible,
//! then accelerate without pause. Position limits on the way are left to the spline that follows.

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

    /// Returns whether the interval is empty.
    pub fn is_empty(&self) -> bool {
        self.low > self.high
    }
}

/// Limits of a joint, its start velocity, and the time.
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
    /// Interval of displacements that the joint can reach, in radians.
    pub fn displacements(&self) -> Interval {
        Interval { low: -self.mirrored().highest(), high: self.highest() }
    }

    /// Terminal velocities in rad/s that are possible after a `displacement` in radians, which must be within
    /// [`displacements`](Self::displacements).
    pub fn terminal_velocities(&self, displacement: f64) -> Interval {
        Interval { low: -self.mirrored().highest_velocity(-displacement), high: self.highest_velocity(displacement) }
    }

    /// The least time in which a joint at rest gets so far, whatever its velocity then: s = A·T²/2, or V·T −
    /// V²/2A.
    pub fn least_time_s(&self, displacement: f64) -> f64 {
        let Self { velocity: V, acceleration: A, .. } = *self;
        let distance = displacement.abs();
        if 2.0 * A * distance <= V * V { (2.0 * distance / A).sqrt() } else { distance / V + V / (2.0 * A) }
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

/// The largest fraction of its reachability interval that a joint must use to get from `start` to `q`, from
/// its middle on; `None` if one cannot get there.
pub fn fraction_used(
    joints: &[ReachableSet; MAX_JOINTS],
    start: &JointVector,
    q: &JointVector,
    dof: usize,
) -> Option<f64> {
    let mut most: f64 = 0.0;
    for i in 0..dof {
        let far = joints[i].displacements();
        let fraction = ((q[i] - start[i] - far.middle()) / far.half_width()).abs();
        if fraction > 1.0 {
            return None;
        }
        most = most.max(fraction);
    }
    Some(most)
}
