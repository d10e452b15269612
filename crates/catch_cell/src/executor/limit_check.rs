//! Check of a commanded trajectory against the arm's limits.

use catch_body::{JointVector, Robot};

use super::CONTINUITY;
use crate::{
    BSpline,
    rejection::{LimitKind, LimitViolation},
};

/// Tolerance of a ratio above 1: rounding in whoever computed the trajectory.
const ROUNDING: f64 = 1e-9;
/// Interval in seconds at which torques, and velocities whose limits depend on the position, are sampled
/// between knots, where they are smooth.
const SAMPLE_INTERVAL_S: f64 = 4e-3;

const KINDS: [LimitKind; 6] = [
    LimitKind::Position,
    LimitKind::Velocity,
    LimitKind::Acceleration,
    LimitKind::Torque,
    LimitKind::Jerk,
    LimitKind::HandSpeed,
];

/// The highest ratio of value to limit along a trajectory.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PeakRatios {
    dof: usize,
    ratio: [JointVector; KINDS.len()],
    time_s: [JointVector; KINDS.len()],
}

impl PeakRatios {
    /// Peak ratios of a valid spline. Positions, velocities, accelerations and jerks are exact: between knots
    /// they are polynomials. Torques are those of inverse dynamics, sampled at the knots, on both sides of
    /// them, and densely between, and so are the speed of the hand and velocities whose limits depend on the
    /// position; `robot` should carry its gripper. Where the acceleration jumps the jerk is infinite.
    pub fn of(robot: &Robot, spline: &BSpline) -> Self {
        let nothing = [JointVector::zeros(); KINDS.len()];
        let mut peaks = Self { dof: robot.dof(), ratio: nothing, time_s: nothing };
        let mut before: Option<JointVector> = None;
        for [start_s, end_s] in spline.spans() {
            let ends = [start_s, end_s].map(|time_s| spline.evaluate(time_s));
            let before = before.replace(ends[1][2]);
            for i in 0..peaks.dof {
                let has_jumped = before.is_some_and(|before| (ends[0][2][i] - before[i]).abs() > CONTINUITY);
                if has_jumped && robot.joints[i].limits.jerk.is_some() {
                    peaks.note(4, i, f64::INFINITY, start_s);
                }
                let of_joint = ends.map(|state| state.map(|values| values[i]));
                peaks.note_span(robot, i, start_s, end_s - start_s, of_joint);
            }
            let count = ((end_s - start_s) / SAMPLE_INTERVAL_S).ceil() as usize;
            for time_s in (0..=count).map(|k| (start_s + k as f64 * SAMPLE_INTERVAL_S).min(end_s)) {
                let [q, dq, ddq] = spline.evaluate(time_s);
                let torque = robot.inverse_dynamics(&q, &dq, &ddq);
                if let Some(most) = robot.max_hand_speed_mps {
                    peaks.note(5, peaks.dof - 1, robot.hand_speed_mps(&q, &dq) / most, time_s);
                }
                for (i, joint) in robot.joints.iter().enumerate() {
                    peaks.note(3, i, torque[i] / joint.limits.torque, time_s);
                    if joint.velocity_table.is_some() {
                        peaks.note(1, i, dq[i] / joint.max_speed(q[i], dq[i]), time_s);
                    }
                }
            }
        }
        peaks
    }

    /// Adds one joint between two knots, from position, velocity and acceleration at both. Over the time s
    /// since the first the velocity is v + a·s + j·s²/2 and highest where the acceleration vanishes, the
    /// position where the velocity does.
    fn note_span(&mut self, robot: &Robot, i: usize, start_s: f64, width_s: f64, [first, last]: [[f64; 3]; 2]) {
        let limits = &robot.joints[i].limits;
        let [q, v, a] = first;
        let j = (last[2] - a) / width_s;
        let middle = (limits.lower + limits.upper) / 2.0;
        if let Some(jerk) = limits.jerk {
            self.note(4, i, j / jerk, start_s);
        }
        let root = (a * a - 2.0 * j * v).sqrt();
        let turns = [(-a - root) / j, (-a + root) / j, -v / a, -a / j];
        for s in turns.into_iter().filter(|s| (0.0..=width_s).contains(s)).chain([0.0, width_s]) {
            let position = q + s * (v + s * (a / 2.0 + s * j / 6.0));
            self.note(0, i, (position - middle) / ((limits.upper - limits.lower) / 2.0), start_s + s);
            self.note(1, i, (v + s * (a + s * j / 2.0)) / limits.velocity, start_s + s);
            self.note(2, i, (a + s * j) / limits.acceleration, start_s + s);
        }
    }

    fn note(&mut self, kind: usize, joint: usize, ratio: f64, time_s: f64) {
        // Not a number counts as broken: it must not pass for being below one.
        let ratio = if ratio.is_nan() { f64::INFINITY } else { ratio.abs() };
        if ratio > self.ratio[kind][joint] {
            self.ratio[kind][joint] = ratio;
            self.time_s[kind][joint] = time_s;
        }
    }

    /// The highest ratio of any joint.
    pub fn highest(&self, kind: LimitKind) -> f64 {
        self.ratio[kind as usize].max()
    }

    /// The limits that are broken, with the worst value of each joint.
    pub fn violations(&self) -> Vec<LimitViolation> {
        let mut violations = Vec::new();
        for (k, kind) in KINDS.into_iter().enumerate() {
            for joint in 0..self.dof {
                let ratio = self.ratio[k][joint];
                if ratio > 1.0 + ROUNDING {
                    violations.push(LimitViolation { joint, kind, ratio, time_s: self.time_s[k][joint] });
                }
            }
        }
        violations
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::executor::tests::robot;
    use catch_body::velocity_table::VelocityTable;
    use proptest::prelude::*;

    /// An arm whose limits differ from joint to joint, those of position on both sides too, and state the
    /// jerk.
    fn arm() -> Robot {
        let mut robot = robot();
        for (joint, i) in robot.joints.iter_mut().zip(0..) {
            let limits = &mut joint.limits;
            (limits.lower, limits.upper) = (-1.0 - 0.1 * f64::from(i), 2.0 + 0.2 * f64::from(i));
            limits.jerk = Some(500.0 + 10.0 * f64::from(i));
        }
        robot
    }

    /// Ratios to the limits of `robot` at one instant, but for torque and jerk.
    fn ratios(robot: &Robot, spline: &BSpline, time_s: f64) -> [JointVector; 3] {
        let [q, dq, ddq] = spline.evaluate(time_s);
        let mut ratios = [JointVector::zeros(); 3];
        for (i, joint) in robot.joints.iter().enumerate() {
            let limits = &joint.limits;
            let beyond =
                if q[i] > 0.5 * (limits.lower + limits.upper) { q[i] - limits.lower } else { limits.upper - q[i] };
            ratios[0][i] = 2.0 * beyond / (limits.upper - limits.lower) - 1.0;
            ratios[1][i] = (dq[i] / limits.velocity).abs();
            ratios[2][i] = (ddq[i] / limits.acceleration).abs();
        }
        ratios
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(64))]

        /// Against a dense sampling, which lies below the exact peaks by little. Accelerations peak at knots,
        /// which are among the samples.
        #[test]
        fn peaks_are_those_of_a_dense_sampling(
            spans in prop::collection::vec(0.05f64..0.3, 1..6),
            values in prop::collection::vec(-1.0f64..1.0, 9 * 7),
        ) {
            const SAMPLES: usize = 1000;
            let robot = arm();
            let mut knots_s = vec![0.5; 4];
            spans.iter().for_each(|span| knots_s.push(knots_s[knots_s.len() - 1] + span));
            knots_s.extend([knots_s[knots_s.len() - 1]; 3]);
            let point = |k: usize| JointVector::from_fn(|i, _| if i < 7 { values[7 * k + i] } else { 0.0 });
            let spline = BSpline { knots_s, control_points: (0..spans.len() + 3).map(point).collect() };
            let peaks = PeakRatios::of(&robot, &spline);
            let mut sampled = [JointVector::zeros(); 3];
            for [start_s, end_s] in spline.spans() {
                for time_s in (0..=SAMPLES).map(|k| start_s + (end_s - start_s) * k as f64 / SAMPLES as f64) {
                    for (most, now) in sampled.iter_mut().zip(ratios(&robot, &spline, time_s)) {
                        *most = most.sup(&now);
                    }
                }
            }
            for (kind, sampled) in sampled.iter().enumerate() {
                for i in 0..7 {
                    let (exact, sampled) = (peaks.ratio[kind][i], sampled[i]);
                    prop_assert!(exact >= sampled - 1e-9 && exact <= sampled + 2e-3 * (1.0 + sampled), "{kind} {i}: {exact} {sampled}");
                    let at = ratios(&robot, &spline, peaks.time_s[kind][i])[kind][i];
                    prop_assert!((at - exact).abs() < 1e-6 * (1.0 + exact), "{kind} {i}: {at} at the time of {exact}");
                }
            }
            for (i, joint) in robot.joints.iter().enumerate() {
                let jerks = spline.spans().map(|[start_s, end_s]| {
                    let [first, last] = [start_s, end_s].map(|time_s| spline.evaluate(time_s)[2][i]);
                    ((last - first) / (end_s - start_s) / joint.limits.jerk.unwrap()).abs()
                });
                let highest = jerks.fold(0.0, f64::max);
                prop_assert!((peaks.ratio[4][i] - highest).abs() < 1e-6 * (1.0 + highest));
            }
        }
    }

    /// Torques against inverse dynamics in a fine grid; between their own samples they are smooth.
    #[test]
    fn torques_are_those_of_inverse_dynamics() {
        let robot = robot();
        let point = |value: f64| JointVector::from_fn(|i, _| if i < 7 { value * (1.0 - 0.2 * i as f64) } else { 0.0 });
        let knots_s = vec![0.0, 0.0, 0.0, 0.0, 0.2, 0.3, 0.3, 0.3, 0.3];
        let spline = BSpline { knots_s, control_points: [0.0, 0.1, 0.4, 0.2, 0.3].map(point).to_vec() };
        let peaks = PeakRatios::of(&robot, &spline);
        let mut highest = JointVector::zeros();
        for k in 0..=3000 {
            let [q, dq, ddq] = spline.evaluate(f64::from(k) * 1e-4);
            let torque = robot.inverse_dynamics(&q, &dq, &ddq);
            for (i, joint) in robot.joints.iter().enumerate() {
                highest[i] = highest[i].max((torque[i] / joint.limits.torque).abs());
            }
        }
        for i in 0..7 {
            assert!((peaks.ratio[3][i] / highest[i] - 1.0).abs() < 5e-3, "{i}: {peaks:?} {highest:?}");
        }
        assert_eq!(peaks.highest(LimitKind::Torque), peaks.ratio[3].max());
    }

    /// A limit that depends on the position is broken where a joint is too fast for where it stands.
    #[test]
    fn velocities_are_compared_with_the_limit_where_the_joint_stands() {
        let mut robot = robot();
        let fast = robot.joints[0].limits.velocity;
        robot.joints[0].velocity_table = VelocityTable::new(vec![[0.0, -fast, fast], [1.0, -fast, 0.1 * fast]]);
        let points = |sign: f64| (0..5).map(|k| JointVector::ith(0, sign * 0.25 * fast * f64::from(k))).collect();
        let knots_s = vec![0.0, 0.0, 0.0, 0.0, 0.5, 1.0, 1.0, 1.0, 1.0];
        let [up, down] = [1.0, -1.0].map(|sign| {
            let spline = BSpline { knots_s: knots_s.clone(), control_points: points(sign) };
            PeakRatios::of(&robot, &spline).ratio[1][0]
        });
        let mut without = robot.clone();
        without.joints[0].velocity_table = None;
        let spline = BSpline { knots_s, control_points: points(1.0) };
        let plain = PeakRatios::of(&without, &spline).ratio[1][0];
        let sampled = (0..=1000).map(|k| {
            let [q, dq, _] = spline.evaluate(f64::from(k) * 1e-3);
            dq[0] / (fast * (1.0 - 0.9 * q[0].clamp(0.0, 1.0)))
        });
        assert!(
            (up / sampled.fold(0.0, f64::max) - 1.0).abs() < 1e-3 && up > plain && down == plain,
            "{up} {down} {plain}"
        );
    }

    /// An acceleration that jumps has no finite jerk; who states no limit of it is not told.
    #[test]
    fn jumps_of_the_acceleration_break_any_limit_of_the_jerk() {
        let point = |value| JointVector::ith(0, value);
        let knots_s = vec![0.0, 0.0, 0.0, 0.0, 0.5, 0.5, 1.0, 1.0, 1.0, 1.0];
        let spline = BSpline { knots_s, control_points: [0.0, 0.0, 0.0, 0.1, 0.1, 0.1].map(point).to_vec() };
        let limited = PeakRatios::of(&arm(), &spline).violations();
        assert!(
            limited
                .iter()
                .any(|it| (it.joint, it.kind, it.ratio, it.time_s) == (0, LimitKind::Jerk, f64::INFINITY, 0.5))
        );
        assert!(limited.iter().all(|it| it.joint == 0), "{limited:?}");
        assert_eq!(PeakRatios::of(&robot(), &spline).highest(LimitKind::Jerk), 0.0);
    }

    #[test]
    fn limits_are_broken_beyond_rounding_only() {
        let mut peaks = PeakRatios::of(&robot(), &BSpline::at_rest(0.0, JointVector::zeros()));
        assert_eq!(peaks.violations(), []);
        peaks.note(1, 3, -(1.0 + 0.5 * ROUNDING), 0.1);
        assert_eq!(peaks.violations(), []);
        peaks.note(1, 3, -1.5, 0.2);
        peaks.note(1, 3, 1.2, 0.3);
        peaks.note(2, 4, f64::NAN, 0.4);
        let expected = [(3, LimitKind::Velocity, 1.5, 0.2), (4, LimitKind::Acceleration, f64::INFINITY, 0.4)]
            .map(|(joint, kind, ratio, time_s)| LimitViolation { joint, kind, ratio, time_s });
        assert_eq!(peaks.violations(), expected);
    }
}
