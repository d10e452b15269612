//! The arm's robot controller: follows the commanded trajectories by computed torque and watches the limits.
//!
//! It is on the robot's side, as in a real cell: it knows the arm's model and its encoders and nothing of the
//! world. What it takes and rejects is the [`Executor`]'s business, as in any other cell.

use std::collections::HashMap;

use catch_body::{JointVector, Robot, robot::Inertia};
use catch_cell::{
    ArmState, ArmTrajectory, Executor, ExecutorConfig, LimitCheck, LimitKind, LimitViolation, Rejection, Setpoint,
};

use crate::{
    config::{ModelLink, RobotController},
    random_streams::Draws,
    truth::ServoReport,
};
use nalgebra::{Matrix3, Vector3};

/// Measured velocities may exceed their limit by this factor before they count.
const VELOCITY_TOLERANCE: f64 = 1.01;
/// Greatest error of a time stamp, lag, and fraction of declined trajectories of an inexact controller.
const MOST_STAMP_ERROR_S: f64 = 0.0005;
const LAG_S: f64 = 0.002;
const DECLINED: f64 = 0.1;

/// Follows trajectories.
#[derive(Debug, Clone)]
pub struct Servo {
    config: RobotController,
    draws: Draws,
    executor: Executor,
    /// The arm that it takes the arm for, if that is another.
    other_model: Option<Robot>,
    /// Acceleration from the integral of the joints' position errors, in rad/s².
    error_integral: JointVector,
    /// Acceleration that was last demanded of the joints, in rad/s².
    pub asked_radps2: JointVector,
    /// Excursions that last: entries of the report by limit and joint.
    excursions: HashMap<(LimitKind, usize), usize>,
    /// Report of the controller so far.
    pub report: ServoReport,
}

impl Servo {
    /// A servo that holds the arm at `q`. `model` is the arm as the servo believes it to be and should carry
    /// its gripper; what is random about the controller comes from `draws`.
    pub fn new(model: Robot, q: JointVector, config: RobotController, draws: Draws) -> Self {
        // Trajectories that break a limit are counted and executed as well as the torque limits allow, and so
        // are accelerations that jump along a trajectory, as those of the paper's method do at the catch.
        let checks = ExecutorConfig {
            continuous_start: !config.takes_jumps,
            continuous_inside: false,
            ends_at_rest: !config.takes_jumps,
            limit_check: LimitCheck::Report,
        };
        Self {
            other_model: (!config.links.is_empty()).then(|| with_links(&model, &config.links)),
            config,
            draws,
            executor: Executor::new(model, q, checks),
            error_integral: JointVector::zeros(),
            asked_radps2: JointVector::zeros(),
            excursions: HashMap::new(),
            report: ServoReport::default(),
        }
    }

    /// Takes the report since the last call, or since the beginning.
    pub fn take_report(&mut self) -> ServoReport {
        self.excursions.clear();
        std::mem::take(&mut self.report)
    }

    /// Lag behind each point of a trajectory.
    fn lag_s(&self) -> f64 {
        if self.config.inexact { LAG_S } else { 0.0 }
    }

    /// Takes or rejects a trajectory that arrives at `now_s`.
    pub fn receive(&mut self, trajectory: &ArmTrajectory, now_s: f64) {
        let is_declined = self.draws.unit() < DECLINED && self.config.inexact;
        let answer = if is_declined {
            Err(self.executor.decline(trajectory.id))
        } else {
            self.executor.receive(trajectory, now_s)
        };
        match answer {
            Ok(violations) => {
                self.report.accepted_trajectories += 1;
                self.report.command_violations.extend(violations);
            }
            Err(Rejection::Late { .. }) => self.report.late_trajectories += 1,
            Err(reason) => {
                self.report.rejected_trajectories += 1;
                self.report.discontinuous_trajectories += u32::from(matches!(reason, Rejection::Discontinuous { .. }));
            }
        }
    }

    /// The arm as the controller reports it at `now_s`, with what was rejected since the last call, from the
    /// encoders' `q` and `dq`.
    pub fn arm_state(&mut self, now_s: f64, q: JointVector, dq: JointVector) -> ArmState {
        let mut state = self.executor.arm_state(now_s - self.lag_s(), q, dq);
        let stamp_error_s = MOST_STAMP_ERROR_S * self.draws.between([-1.0, 1.0]);
        state.time_s = now_s;
        if self.config.inexact {
            state.time_s += stamp_error_s;
            let Setpoint { q, dq, ddq } = &mut state.commanded;
            for values in [&mut state.q, &mut state.dq, q, dq, ddq] {
                values.apply(|value| *value = f64::from(*value as f32));
            }
        }
        state
    }

    /// Torques for the step that begins at `time_s`, by computed torque with the encoders' `q` and `dq`: τ =
    /// ID(q, q̇, q̈_d + K_P·(q_d − q) + K_I·∫(q_d − q) + K_D·(q̇_d − q̇)) (Siciliano et al., Robotics,
    /// section 8.5.2), clamped unless motors have no limit.
    ///
    /// Against windup the integral of a joint waits while its torque is clamped and would go further
    /// (conditional integration: Åström & Hägglund, PID Controllers, section 3.5).
    pub fn torque(&mut self, time_s: f64, step_s: f64, q: &JointVector, dq: &JointVector) -> JointVector {
        let wanted = self.executor.advance(time_s - self.lag_s());
        let gains = &self.config.gains;
        let error = wanted.q - q;
        let increment = error * (gains.integral_per_s3 * step_s);
        let acceleration = wanted.ddq
            + error * gains.proportional_per_s2
            + (wanted.dq - dq) * gains.derivative_per_s
            + (self.error_integral + increment);
        let model = self.other_model.as_ref().unwrap_or(self.executor.robot());
        let mut torque = model.inverse_dynamics(q, dq, &acceleration);
        let mut is_clamped = false;
        for (i, joint) in self.executor.robot().joints.iter().enumerate() {
            let limit = joint.limits.torque;
            self.report.peak_torque_ratio = self.report.peak_torque_ratio.max(torque[i].abs() / limit);
            let is_beyond = torque[i].abs() > limit && !self.config.unlimited_torque;
            if is_beyond {
                is_clamped = true;
                torque[i] = torque[i].clamp(-limit, limit);
            }
            if !is_beyond || increment[i] * torque[i] < 0.0 {
                self.error_integral[i] += increment[i];
            }
        }
        if is_clamped {
            self.report.torque_clamped_s += step_s;
        }
        self.asked_radps2 = acceleration;
        torque
    }

    /// Watches the limits in motion, by where the joints truly are at `time_s` and their velocity one step
    /// before: the report is the referee's.
    pub fn watch(&mut self, time_s: f64, step_s: f64, q: &JointVector, dq: &JointVector, dq_before: &JointVector) {
        for i in 0..self.executor.robot().dof() {
            let joint = &self.executor.robot().joints[i];
            let (limits, max_speed) = (joint.limits, joint.max_speed(q[i], dq[i]));
            let middle = (limits.lower + limits.upper) / 2.0;
            let position = (q[i] - middle).abs() / ((limits.upper - limits.lower) / 2.0);
            let velocity = dq[i].abs() / max_speed;
            let acceleration = (dq[i] - dq_before[i]).abs() / step_s / limits.acceleration;
            let report = &mut self.report;
            report.peak_velocity_ratio = report.peak_velocity_ratio.max(velocity);
            report.peak_acceleration_ratio = report.peak_acceleration_ratio.max(acceleration);
            self.note_excursion(LimitKind::Position, i, position, time_s);
            self.note_excursion(LimitKind::Velocity, i, velocity, time_s);
        }
        let robot = self.executor.robot();
        if let Some(most_mps) = robot.max_hand_speed_mps {
            let (last, ratio) = (robot.dof() - 1, robot.hand_speed_mps(q, dq) / most_mps);
            self.note_excursion(LimitKind::HandSpeed, last, ratio, time_s);
        }
    }

    /// Takes down how close the arm is to itself and to the floor.
    pub fn note_clearances(&mut self, self_m: f64, floor_m: f64) {
        let smaller = |kept: Option<f64>, new: f64| Some(kept.map_or(new, |kept| kept.min(new)));
        self.report.min_self_clearance_m = smaller(self.report.min_self_clearance_m, self_m);
        self.report.min_floor_clearance_m = smaller(self.report.min_floor_clearance_m, floor_m);
    }

    fn note_excursion(&mut self, kind: LimitKind, joint: usize, ratio: f64, time_s: f64) {
        let tolerated = if kind == LimitKind::Position { 1.0 } else { VELOCITY_TOLERANCE };
        if ratio <= tolerated {
            self.excursions.remove(&(kind, joint));
            return;
        }
        let violations = &mut self.report.motion_violations;
        let entry = *self.excursions.entry((kind, joint)).or_insert_with(|| {
            violations.push(LimitViolation { joint, kind, ratio, time_s });
            violations.len() - 1
        });
        violations[entry].ratio = violations[entry].ratio.max(ratio);
    }
}

/// An arm of these links, without damping.
fn with_links(model: &Robot, links: &[ModelLink]) -> Robot {
    let mut other = model.clone();
    for (joint, link) in other.joints.iter_mut().zip(links) {
        let about_com = Matrix3::from_diagonal(&Vector3::from(link.inertia_kgm2));
        joint.inertia = Inertia { mass: link.mass_kg, com: link.com_m.into(), about_com };
        joint.rotor_inertia = link.rotor_inertia_kgm2;
        joint.damping = 0.0;
    }
    other
}
