//! Whether a commanded trajectory keeps within the arm's limits.

use catch_body::{JointVector, Robot};

use super::CONTINUITY;
use crate::{
    BSpline,
    rejection::{LimitKind, LimitViolation},
};

/// What a ratio may exceed 1 by: rounding in whoever computed the trajectory.
const ROUNDING: f64 = 1e-9;
/// How finely torques are sampled between knots, where they are smooth.
const TORQUE_INTERVAL_S: f64 = 4e-3;

const KINDS: [LimitKind; 5] =
    [LimitKind::Position, LimitKind::Velocity, LimitKind::Acceleration, LimitKind::Torque, LimitKind::Jerk];

/// The highest ratio of value to limit along a trajectory.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PeakRatios {
    dof: usize,
    ratio: [JointVector; KINDS.len()],
    time_s: [JointVector; KINDS.len()],
}

impl PeakRatios {
    /// Of a valid spline. Positions, velocities, accelerations and jerks are exact: between knots they are polynomials. Torques are
    /// those of inverse dynamics, sampled at the knots, on both sides of them, and densely between; `robot` should carry its gripper.
    /// Where the acceleration jumps the jerk is infinite.
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
            let count = ((end_s - start_s) / TORQUE_INTERVAL_S).ceil() as usize;
            for time_s in (0..=count).map(|k| (start_s + k as f64 * TORQUE_INTERVAL_S).min(end_s)) {
                let [q, dq, ddq] = spline.evaluate(time_s);
                let torque = robot.inverse_dynamics(&q, &dq, &ddq);
                for (i, joint) in robot.joints.iter().enumerate() {
                    peaks.note(3, i, torque[i] / joint.limits.torque, time_s);
                }
            }
        }
        peaks
    }

    /// One joint between two knots, from position, velocity and acceleration at both. Over the time s since the first the
    /// velocity is v + a·s + j·s²/2 and highest where the acceleration vanishes, the position where the velocity does.
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
