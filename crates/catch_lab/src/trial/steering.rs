//! An arm that is steered by joint accelerations, as learned policies do: whatever is wanted, what is sent
//! keeps the limits.

use catch_body::{Gripper, JointVector, MAX_JOINTS, Robot, clearance::ArmClearance, robot::LimitScale};
use catch_cell::{BSpline, LimitKind, Setpoint, executor::PeakRatios};

/// Ratios of the limits that are used: room for what the controller needs to follow.
const USED: LimitScale = LimitScale { velocity: 0.95, acceleration: 0.9, jerk: 0.95 };
const USED_TORQUE: f64 = 0.85;
/// Fractions of a wanted acceleration that are tried in this order, joint by joint; then the joint brakes.
const FRACTIONS: [f64; 4] = [1.0, 0.6, 0.3, 0.0];
/// Rounds of trying.
const TRIES: usize = 12;
/// The arm keeps this far from itself and its surroundings, in metres, where it is looked at: once a period.
/// Who begins nearer comes no nearer.
const CLEARANCE_M: f64 = 0.04;
/// Largest distance of the surface of an arm from the line through its joints, in metres.
const SURFACE_M: f64 = 0.2;
/// Spans of the braking.
const BRAKING_SPANS: usize = 3;

/// Turns wanted joint accelerations into trajectories that keep the limits of an arm, keep it clear of itself
/// and its surroundings, and end at rest.
///
/// A trajectory ramps to the wanted acceleration within one control period and then brakes, its acceleration
/// linear between knots. As each that was sent is good to its end at rest, none needs to follow where no
/// other is.
#[derive(Debug, Clone)]
pub struct Steering {
    /// Model of the arm with the gripper, and the limits that are used.
    robot: Robot,
    clearance: ArmClearance,
    max_width_m: f64,
    /// No point of arm and gripper is farther from a joint's axis.
    length_m: f64,
    period_s: f64,
    /// Duration of one span of the braking: from the highest velocity it takes no more than the highest
    /// acceleration.
    span_s: f64,
}

impl Steering {
    /// Creates the steering of an arm with a gripper, for actions every `period_s`.
    pub fn new(robot: &Robot, gripper: &Gripper, period_s: f64) -> Self {
        let clearance = ArmClearance::new(robot, gripper);
        let links_m = robot.joints.iter().skip(1).map(|joint| joint.X_PL.translation.vector.norm());
        let hand_m = robot.X_LG.translation.vector.norm() + gripper.fingertip_y_m() + gripper.max_width_m;
        let length_m = links_m.sum::<f64>() + hand_m + SURFACE_M;
        let mut robot = robot.clone().carrying(gripper).with_limits_scaled(&USED);
        robot.joints.iter_mut().for_each(|joint| joint.limits.torque *= USED_TORQUE);
        let spans = robot.joints.iter().map(|joint| {
            let limits = &joint.limits;
            let by_velocity = limits.velocity / (1.3 * limits.acceleration);
            by_velocity.max(limits.jerk.map_or(0.0, |jerk| 2.0 * limits.acceleration / jerk))
        });
        let span_s = spans.fold(period_s, f64::max);
        Self { robot, clearance, max_width_m: gripper.max_width_m, length_m, period_s, span_s }
    }

    /// The highest accelerations that it asks for, in rad/s².
    pub fn max_acceleration(&self) -> JointVector {
        self.of_joints(|i| self.robot.joints[i].limits.acceleration)
    }

    /// The highest velocities that it asks for, in rad/s.
    pub fn max_velocity(&self) -> JointVector {
        self.of_joints(|i| self.robot.joints[i].limits.velocity)
    }

    fn of_joints(&self, of: impl Fn(usize) -> f64) -> JointVector {
        JointVector::from_fn(|i, _| if i < self.robot.dof() { of(i) } else { 0.0 })
    }

    /// A motion from `start` at `start_s` that has the accelerations `wanted`, in rad/s², a period later, as
    /// far as the limits allow, and then brakes. `None` if no such motion keeps them: the one that is
    /// executing does.
    pub fn motion(&self, start_s: f64, start: &Setpoint, wanted: &JointVector) -> Option<BSpline> {
        let mut tried = [0_usize; MAX_JOINTS];
        for _ in 0..TRIES {
            let acceleration = self.of_joints(|i| self.acceleration(i, start, wanted[i], tried[i]));
            let motion = self.braked(start_s, start, &acceleration);
            let violations = PeakRatios::of(&self.robot, &motion).violations();
            let mut next = tried;
            if violations.is_empty() {
                if self.keeps_clear(&motion) {
                    return Some(motion);
                }
                next = tried.map(|it| (it + 1).min(FRACTIONS.len()));
            }
            for violation in violations {
                // A torque and the hand's speed depend on all joints.
                let joints = if matches!(violation.kind, LimitKind::Torque | LimitKind::HandSpeed) {
                    0..self.robot.dof()
                } else {
                    violation.joint..violation.joint + 1
                };
                joints.for_each(|i| next[i] = (tried[i] + 1).min(FRACTIONS.len()));
            }
            if next == tried {
                return None;
            }
            tried = next;
        }
        None
    }

    /// Returns whether the arm keeps its distances until it is at rest, with the gripper open.
    fn keeps_clear(&self, motion: &BSpline) -> bool {
        let start_s = motion.start_s();
        let at = |look: u32| motion.setpoint(start_s + f64::from(look) * self.period_s).q;
        let least_m = |q: &JointVector| self.clearance.least(&self.robot.link_poses(q), self.max_width_m);
        let needed_m = least_m(&motion.setpoint(start_s).q).min(CLEARANCE_M);
        let looks = ((motion.end_s() - start_s) / self.period_s).ceil() as u32;
        // Two points of the arm come nearer to each other by no more than twice what all joints move times
        // its length.
        let (mut looked_at, mut spare_m) = (None::<JointVector>, 0.0);
        // Backwards: where it comes to rest is most likely too near.
        (1..=looks).rev().map(at).all(|q| {
            let moved_m = looked_at.map_or(f64::INFINITY, |before| (q - before).abs().sum() * 2.0 * self.length_m);
            if moved_m <= spare_m {
                return true;
            }
            spare_m = least_m(&q) - needed_m;
            looked_at = Some(q);
            spare_m >= -1e-9
        })
    }

    /// Acceleration of a joint in its `tried`-th try.
    fn acceleration(&self, i: usize, start: &Setpoint, wanted: f64, tried: usize) -> f64 {
        let limits = &self.robot.joints[i].limits;
        let most = limits.acceleration;
        // The acceleration ramps: the velocity after the period is dq + (ddq + a)·T/2.
        let to_velocity = |dq: f64| 2.0 * (dq - start.dq[i]) / self.period_s - start.ddq[i];
        let wanted = match FRACTIONS.get(tried) {
            Some(fraction) => (wanted * fraction).max(to_velocity(-limits.velocity)).min(to_velocity(limits.velocity)),
            None => to_velocity(0.0),
        };
        let ramp = limits.jerk.map_or(f64::INFINITY, |jerk| jerk * self.period_s);
        wanted.clamp(-most, most).max(start.ddq[i] - ramp).min(start.ddq[i] + ramp)
    }

    /// A motion from `start` whose acceleration is `a` a period later, and which then comes to rest.
    ///
    /// With accelerations a after the period, then b, b and 0 a span apart: (a + b)/2 + b + b/2 = -dq/h
    /// brings the joint to rest.
    fn braked(&self, start_s: f64, start: &Setpoint, a: &JointVector) -> BSpline {
        let h = self.span_s;
        let dq = start.dq + (start.ddq + a) * (self.period_s / 2.0);
        let b = -(dq / h + a / 2.0) / 2.0;
        let braking = (0..=BRAKING_SPANS).map(|span| start_s + self.period_s + span as f64 * h);
        let times_s: Vec<f64> = std::iter::once(start_s).chain(braking).collect();
        spline(&times_s, start, &[start.ddq, *a, b, b, JointVector::zeros()])
    }
}

/// The cubic spline that begins in the position and velocity of `start` and whose accelerations are these at
/// the knots `times_s`.
///
/// Control points of a B-spline's derivative are Qᵢ = p·(Pᵢ₊₁ − Pᵢ)/(uᵢ₊ₚ₊₁ − uᵢ₊₁) (Piegl & Tiller, The
/// NURBS Book, eq. 3.4), here solved for P; those of the second derivative, which is piecewise linear, are
/// its values at the knots.
fn spline(times_s: &[f64], start: &Setpoint, accelerations: &[JointVector]) -> BSpline {
    let (first, last) = (times_s[0], times_s[times_s.len() - 1]);
    let knots_s = [&[first; 3], times_s, &[last; 3]].concat();
    let integrate = |from: JointVector, rates: &[JointVector], degree: usize| {
        // Knots of the integral, of which the ends are repeated once more than its degree.
        let knots = &knots_s[3 - degree..knots_s.len() - (3 - degree)];
        let mut points = vec![from];
        for (i, rate) in rates.iter().enumerate() {
            let width_s = knots[i + degree + 1] - knots[i + 1];
            points.push(points[i] + rate * (width_s / degree as f64));
        }
        points
    };
    let velocities = integrate(start.dq, accelerations, 2);
    BSpline { control_points: integrate(start.q, &velocities, 3), knots_s }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scenario::setup::{Choice, Setup};
    use proptest::prelude::*;

    #[test]
    fn a_spline_has_the_accelerations_that_it_is_made_of() {
        let of = JointVector::repeat;
        let start = Setpoint { q: of(0.3), dq: of(-0.2), ddq: of(1.0) };
        let (times_s, accelerations) = ([1.0, 1.1, 1.3, 1.35], [1.0, -2.0, 0.5, 0.0].map(of));
        let spline = spline(&times_s, &start, &accelerations);
        assert!(spline.is_valid());
        let [q, dq, _] = spline.evaluate(1.0);
        assert!((q - start.q).amax() < 1e-12 && (dq - start.dq).amax() < 1e-12);
        for (time_s, acceleration) in times_s.into_iter().zip(accelerations) {
            assert!((spline.evaluate(time_s)[2] - acceleration).amax() < 1e-9);
        }
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(16))]

        /// Whatever is wanted, each motion continues the one before, keeps the limits and ends at rest.
        #[test]
        fn no_wish_breaks_a_limit(
            wishes in prop::collection::vec(-3.0f64..3.0, 7 * 60),
            held in 1_usize..20,
            limits_the_hand in any::<bool>(),
        ) {
            let choice = Choice { scenario: Some("paper"), ..Choice::default() };
            let Setup { mut robot, gripper, .. } = Setup::load(&choice).unwrap();
            robot.max_hand_speed_mps = limits_the_hand.then_some(0.8);
            let steering = Steering::new(&robot, &gripper, 0.01);
            let robot = robot.carrying(&gripper);
            let mut sent = BSpline::at_rest(0.0, robot.ready_q);
            let mut taken = 0;
            for tick in 0..60 {
                let time_s = 0.01 * tick as f64;
                let row = &wishes[tick / held * 7..][..7];
                let wanted = JointVector::from_fn(|i, _| row.get(i).map_or(0.0, |it| it * robot.joints[i].limits.acceleration));
                let start = sent.setpoint(time_s);
                let Some(motion) = steering.motion(time_s, &start, &wanted) else { continue };
                prop_assert!(motion.setpoint(time_s).distance(&start).amax() < 1e-9);
                let [_, dq, ddq] = motion.evaluate(motion.end_s());
                prop_assert!(dq.amax() < 1e-9 && ddq.amax() < 1e-9);
                prop_assert!(PeakRatios::of(&robot, &motion).violations().is_empty());
                for look in 0..100 {
                    let X_WL = robot.link_poses(&motion.setpoint(time_s + 0.007 * f64::from(look)).q);
                    let width_m = gripper.max_width_m;
                    prop_assert!(steering.clearance.environment_clearance(&X_WL, width_m) > 0.0);
                    prop_assert!(steering.clearance.self_clearance(&X_WL, width_m) > 0.0);
                }
                (sent, taken) = (motion, taken + 1);
            }
            prop_assert!(taken > 20, "only {taken} of 60 were taken");
        }
    }
}
