//! A whole motion: to the catch, then braking to rest, within every limit.

use catch_body::{JointVector, MAX_JOINTS, robot::JointLimits};
use catch_cell::{ArmTrajectory, BSpline, arm::Setpoint, spline::DEGREE};

use super::{
    Planner, Start,
    joint_spline::{End, JointSpline, JointState},
};

/// Braking uses this share of the acceleration limits when its duration is chosen; the spline needs room to ramp.
pub(super) const BRAKE_SHARE: f64 = 0.5;
/// Shortest braking in seconds.
const MIN_BRAKE_S: f64 = 0.2;
/// Instants at which torque and clearance are checked along a motion.
const CHECKS: usize = 40;
/// Instants at which torque is checked on the way to the catch: at each of its spans' ends and in the middle.
const TORQUE_CHECKS: usize = 20;
/// Distance from the acceleration limits that rounding needs, relative.
pub(super) const ROUNDING: f64 = 1e-7;

/// Shares of the velocity and acceleration limits that a motion may use.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Shares {
    /// Of the velocity limits.
    pub velocity: f64,
    /// Of the acceleration limits.
    pub acceleration: f64,
}

impl Shares {
    /// Between these (0) and `other` (1).
    pub(super) fn toward(self, other: Self, by: f64) -> Self {
        let between = |from: f64, to: f64| from + by * (to - from);
        Self {
            velocity: between(self.velocity, other.velocity),
            acceleration: between(self.acceleration, other.acceleration),
        }
    }
}

impl Planner {
    /// From rest, a plan leaves room for replans.
    pub(super) fn cold_shares(&self) -> Shares {
        Shares { velocity: self.config.cold_velocity_share, acceleration: self.config.cold_acceleration_share }
    }

    /// On the move it may use all there is.
    pub(super) fn moving_shares(&self) -> Shares {
        Shares { velocity: self.config.velocity_share, acceleration: 1.0 - ROUNDING }
    }

    /// The motion from `start` that is at `q` with velocity `dq` at `catch_s` and then brakes; `None` if none of its kind keeps
    /// the joint limits, the torque limits and the clearances. The gripper is `width_m` open.
    pub fn motion(
        &self,
        start: &Start,
        catch_s: f64,
        q: &JointVector,
        dq: &JointVector,
        width_m: f64,
        shares: Shares,
    ) -> Option<ArmTrajectory> {
        let duration_s = catch_s - start.time_s;
        let comfortable = &self.robot.comfortable_q;
        // The braking spline's first span takes up the acceleration at the catch: its first velocity control point,
        // q̇ + q̈·h/2, must keep the velocity limit too.
        let onset_s = self.brake_spline.knots[DEGREE + 1] * self.braking_s(dq) / 2.0;
        let to_catch = self.spline(&self.catch_splines.at, &start.state, start.time_s, duration_s, shares, |i| {
            let most = self.robot.joints[i].limits.velocity * self.moving_shares().velocity;
            let ddq = [(-most - dq[i]) / onset_s, (most - dq[i]) / onset_s];
            (End::At { q: q[i], dq: dq[i], ddq }, comfortable[i])
        })?;
        let [q, dq, ddq] = to_catch.evaluate(catch_s);
        let braking = self.braking(&Setpoint { q, dq, ddq }, catch_s)?;
        let trajectory = ArmTrajectory { spline: to_catch.followed_by(&braking) };
        self.is_safe(&trajectory, width_m).then_some(trajectory)
    }

    /// From `state` to rest within the joint limits, as quickly as is comfortable.
    pub fn braking(&self, state: &Setpoint, start_s: f64) -> Option<BSpline> {
        let mut duration_s = self.braking_s(&state.dq);
        for _ in 0..4 {
            let spline =
                self.spline(&self.brake_spline, state, start_s, duration_s, self.moving_shares(), |_| (End::Rest, 0.0));
            if spline.is_some() {
                return spline;
            }
            duration_s *= 1.3;
        }
        None
    }

    /// How long braking from `dq` should take.
    fn braking_s(&self, dq: &JointVector) -> f64 {
        let needed = |i: usize| dq[i].abs() / (BRAKE_SHARE * self.robot.joints[i].limits.acceleration);
        (0..self.robot.dof()).map(needed).fold(MIN_BRAKE_S, f64::max)
    }

    /// One spline per joint, put together.
    fn spline(
        &self,
        kind: &JointSpline,
        state: &Setpoint,
        start_s: f64,
        duration_s: f64,
        shares: Shares,
        end: impl Fn(usize) -> (End, f64),
    ) -> Option<BSpline> {
        let mut control_points = vec![JointVector::zeros(); kind.control_points()];
        for i in 0..self.robot.dof() {
            let limits = self.limits(i, state, shares);
            let start = JointState { q: state.q[i], dq: state.dq[i], ddq: state.ddq[i] };
            let (end, comfortable) = end(i);
            let points = kind.solve(&start, &end, duration_s, &limits, comfortable)?;
            for (row, point) in control_points.iter_mut().zip(points) {
                row[i] = point;
            }
        }
        let knots_s = kind.knots.iter().map(|knot| start_s + knot * duration_s).collect();
        Some(BSpline { knots_s, control_points })
    }

    /// What a motion of joint `i` may use. A joint that starts closer to the end of its range than the margin may stay there.
    pub(super) fn limits(&self, i: usize, state: &Setpoint, shares: Shares) -> JointLimits {
        let limits = &self.robot.joints[i].limits;
        JointLimits {
            lower: (limits.lower + self.config.position_margin_rad).min(state.q[i]),
            upper: (limits.upper - self.config.position_margin_rad).max(state.q[i]),
            velocity: limits.velocity * shares.velocity,
            acceleration: limits.acceleration * shares.acceleration,
            ..*limits
        }
    }

    /// Whether torque limits hold along a motion.
    pub(super) fn keeps_torque(&self, spline: &BSpline) -> bool {
        let (start_s, length_s) = (spline.start_s(), spline.end_s() - spline.start_s());
        (0..=TORQUE_CHECKS).all(|i| {
            let [q, dq, ddq] = spline.evaluate(start_s + length_s * i as f64 / TORQUE_CHECKS as f64);
            let torque = self.robot.inverse_dynamics(&q, &dq, &ddq);
            (0..self.robot.dof())
                .all(|i| torque[i].abs() <= self.robot.joints[i].limits.torque * self.config.torque_share)
        })
    }

    /// Whether torque limits and clearances hold along a trajectory.
    fn is_safe(&self, trajectory: &ArmTrajectory, width_m: f64) -> bool {
        let (start_s, length_s) = (trajectory.start_s(), trajectory.end_s() - trajectory.start_s());
        (0..=CHECKS).all(|i| {
            let at = trajectory.setpoint(start_s + length_s * i as f64 / CHECKS as f64);
            let torque = self.robot.inverse_dynamics(&at.q, &at.dq, &at.ddq);
            let within = (0..MAX_JOINTS.min(self.robot.dof()))
                .all(|i| torque[i].abs() <= self.robot.joints[i].limits.torque * self.config.torque_share);
            // The gripper's width matters little and only to the fingers; the floor and the arm itself are far from them.
            within && {
                let X_WL = self.robot.link_poses(&at.q);
                self.clearance.self_clearance(&X_WL, width_m) >= self.config.clearance_m
                    && self.clearance.floor_clearance(&X_WL, width_m) >= self.config.clearance_m
            }
        })
    }
}
