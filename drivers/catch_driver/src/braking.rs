//! The last set-points of an arm, and the way to a stop within its limits.

use catch_body::{JointVector, Robot};

/// Duration of a cycle in seconds.
pub const CYCLE_S: f64 = 1e-3;
/// Fraction of the limits that braking uses.
const BRAKE_RATIO: f64 = 0.9;
/// Rate of the last decay of the velocity while braking, in 1/s.
const BRAKE_RATE: f64 = 100.0;
/// Velocity in rad/s and acceleration in rad/s² below which a joint stands.
const AT_REST: [f64; 2] = [1e-6, 2e-3];

/// The last three set-points that the controller executed, the newest first.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Executed(pub [JointVector; 3]);

impl Executed {
    /// An arm that is held at `q`.
    pub fn at_rest(q: JointVector) -> Self {
        Self([q; 3])
    }

    /// The same motion, moved to where it is known to be.
    #[must_use]
    pub fn moved_to(&self, q: JointVector) -> Self {
        Self(self.0.map(|it| it + (q - self.0[0])))
    }

    /// Set-point that the controller executes without an answer: constant acceleration.
    pub fn extrapolated(&self) -> JointVector {
        let [q, before, earlier] = self.0;
        (q - before) * 3.0 + earlier
    }

    /// The set-points one cycle later.
    #[must_use]
    pub fn then(&self, q: JointVector) -> Self {
        Self([q, self.0[0], self.0[1]])
    }

    /// The newest set-point.
    pub fn q(&self) -> JointVector {
        self.0[0]
    }

    /// Velocity by the last difference, in rad/s.
    pub fn dq(&self) -> JointVector {
        (self.0[0] - self.0[1]) / CYCLE_S
    }

    /// Acceleration by the last two differences, in rad/s².
    pub fn ddq(&self) -> JointVector {
        (self.0[0] - self.0[1] * 2.0 + self.0[2]) / (CYCLE_S * CYCLE_S)
    }

    /// Returns whether the arm stands.
    pub fn is_at_rest(&self) -> bool {
        self.dq().amax() < AT_REST[0] && self.ddq().amax() < AT_REST[1]
    }

    /// The highest ratio of velocity, acceleration and jerk to the limits if `q` is executed next.
    pub fn ratio(&self, q: &JointVector, robot: &Robot) -> f64 {
        let next = self.then(*q);
        let (dq, ddq) = (next.dq(), next.ddq());
        let jerk = (ddq - self.ddq()) / CYCLE_S;
        let of_joint = |i: usize| {
            let joint = &robot.joints[i];
            let of_jerk = joint.limits.jerk.map_or(0.0, |most| jerk[i].abs() / most);
            let of_velocity = dq[i].abs() / joint.max_speed(q[i], dq[i]);
            of_velocity.max(ddq[i].abs() / joint.limits.acceleration).max(of_jerk)
        };
        (0..robot.dof()).map(of_joint).fold(0.0, f64::max)
    }
}

/// Set-point of the next cycle on the way to a stop within the limits of `robot`, joint by joint: the
/// velocity decays as a critically damped oscillator's, its acceleration and jerk cut.
pub fn brake(executed: &Executed, robot: &Robot) -> JointVector {
    if executed.is_at_rest() {
        return executed.q();
    }
    let (dq, ddq) = (executed.dq(), executed.ddq());
    let mut q = executed.q();
    for (i, joint) in robot.joints.iter().enumerate() {
        let most = joint.limits.acceleration * BRAKE_RATIO;
        let change = joint.limits.jerk.unwrap_or(f64::INFINITY) * BRAKE_RATIO * CYCLE_S;
        let jerk = -BRAKE_RATE * (BRAKE_RATE * dq[i] + 2.0 * ddq[i]);
        let wanted = (ddq[i] + jerk * CYCLE_S).clamp(-most, most);
        let ddq = wanted.clamp(ddq[i] - change, ddq[i] + change);
        q[i] += (dq[i] + ddq * CYCLE_S) * CYCLE_S;
    }
    q
}
