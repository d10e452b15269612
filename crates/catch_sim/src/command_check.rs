//! Whether a commanded trajectory keeps within the arm's limits.

use catch_body::{JointVector, Robot};
use catch_cell::ArmTrajectory;

use crate::truth::{LimitKind, LimitViolation};

/// What a ratio may exceed 1 by: rounding in whoever computed the trajectory.
const ROUNDING: f64 = 1e-9;
/// How finely velocities and accelerations are sampled between knots. Accelerations are linear there and largest at knots.
const KINEMATICS_INTERVAL_S: f64 = 1e-3;
/// Torques are smooth and cost more.
const TORQUE_INTERVAL_S: f64 = 2e-3;

const KINDS: [LimitKind; 4] = [LimitKind::Position, LimitKind::Velocity, LimitKind::Acceleration, LimitKind::Torque];

/// The highest ratio of value to limit along a trajectory.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PeakRatios {
    dof: usize,
    ratio: [JointVector; 4],
    time_s: [JointVector; 4],
}

impl PeakRatios {
    /// Samples a valid trajectory at its knots, on both sides of them, and densely between.
    ///
    /// Torques are those of inverse dynamics; `robot` should carry its gripper.
    pub fn of(robot: &Robot, trajectory: &ArmTrajectory) -> Self {
        let nothing = [JointVector::zeros(); 4];
        let mut peaks = Self { dof: robot.dof(), ratio: nothing, time_s: nothing };
        let spline = &trajectory.spline;
        let (start_s, end_s) = (spline.start_s(), spline.end_s());
        let dense = |interval_s: f64| {
            let count = ((end_s - start_s) / interval_s).ceil() as usize;
            (0..=count).map(move |i| (start_s + i as f64 * interval_s).min(end_s))
        };
        // A knot that is repeated lets the acceleration jump: look from both sides.
        let knots = spline.knots_s.iter().flat_map(|&knot| [knot.next_down().max(start_s), knot]);
        for time_s in dense(KINEMATICS_INTERVAL_S).chain(knots.clone()) {
            let [q, dq, ddq] = spline.evaluate(time_s);
            for (i, joint) in robot.joints.iter().enumerate() {
                let limits = &joint.limits;
                let middle = (limits.lower + limits.upper) / 2.0;
                peaks.note(0, i, (q[i] - middle) / ((limits.upper - limits.lower) / 2.0), time_s);
                peaks.note(1, i, dq[i] / limits.velocity, time_s);
                peaks.note(2, i, ddq[i] / limits.acceleration, time_s);
            }
        }
        for time_s in dense(TORQUE_INTERVAL_S).chain(knots) {
            let [q, dq, ddq] = spline.evaluate(time_s);
            let torque = robot.inverse_dynamics(&q, &dq, &ddq);
            for (i, joint) in robot.joints.iter().enumerate() {
                peaks.note(3, i, torque[i] / joint.limits.torque, time_s);
            }
        }
        peaks
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
