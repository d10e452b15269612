//! The arm's drive cabinet: follows the commanded trajectories by computed torque and watches the limits.
//!
//! It is on the robot's side, as in a real cell: it knows the arm's model and its encoders and nothing of the world.

use catch_body::{JointVector, Robot};
use catch_cell::{ArmTrajectory, arm::Setpoint};

use crate::{
    command_check::PeakRatios,
    truth::{LimitKind, LimitViolation, ServoReport},
};

/// Natural frequency of the position controller in rad/s; it is critically damped. A twentieth of the rate at which the servo
/// runs, so that sampling costs little phase.
const BANDWIDTH_RADPS: f64 = 50.0;
/// How far a trajectory may be from the one that is executing where it takes over, in radians, rad/s and rad/s²: rounding.
const CONTINUITY: f64 = 1e-6;
/// Times closer than this are the same.
const SAME_TIME_S: f64 = 1e-9;
/// Measured velocities may exceed their limit by this factor before they count.
const VELOCITY_TOLERANCE: f64 = 1.01;

/// Follows trajectories.
#[derive(Debug, Clone)]
pub struct Servo {
    /// The arm with its gripper, as the servo believes it to be.
    model: Robot,
    /// The executing trajectory first, then those that take over later.
    plan: Vec<ArmTrajectory>,
    /// Excursions that last: entries of the report by joint, for position and velocity.
    excursions: [Vec<Option<usize>>; 2],
    report: ServoReport,
}

impl Servo {
    /// A servo that holds the arm at `q`. `model` should carry its gripper.
    pub fn new(model: Robot, q: JointVector) -> Self {
        let excursions = [vec![None; model.dof()], vec![None; model.dof()]];
        Self { model, plan: vec![ArmTrajectory::at_rest(0.0, q)], excursions, report: ServoReport::default() }
    }

    /// What was noticed so far.
    pub fn report(&self) -> &ServoReport {
        &self.report
    }

    /// What the arm should do at `time_s`.
    pub fn setpoint(&self, time_s: f64) -> Setpoint {
        self.executing(time_s).setpoint(time_s)
    }

    fn executing(&self, time_s: f64) -> &ArmTrajectory {
        let executing = self.plan.iter().rev().find(|trajectory| trajectory.start_s() <= time_s + SAME_TIME_S);
        executing.unwrap_or(&self.plan[0])
    }

    /// Takes a trajectory that arrives at `now_s`, or refuses it: late, invalid, not ending at rest, or not continuing what is
    /// executing at its start. What breaks a limit is counted and executed as well as the torque limits allow.
    pub fn receive(&mut self, trajectory: ArmTrajectory, now_s: f64) {
        if !self.is_sound(&trajectory) {
            self.report.refused_trajectories += 1;
            return;
        }
        let start_s = trajectory.start_s();
        if start_s < now_s - SAME_TIME_S {
            self.report.late_trajectories += 1;
            return;
        }
        let (old, new) = (self.setpoint(start_s), trajectory.setpoint(start_s));
        let jumps = [old.q - new.q, old.dq - new.dq, old.ddq - new.ddq];
        if !jumps.iter().all(|jump| jump.amax() <= CONTINUITY) {
            self.report.refused_trajectories += 1;
            return;
        }
        self.report.accepted_trajectories += 1;
        self.report.command_violations.extend(PeakRatios::of(&self.model, &trajectory).violations());
        self.plan.retain(|other| other.start_s() < start_s - SAME_TIME_S);
        self.plan.push(trajectory);
    }

    /// Whether a trajectory is a finite spline that ends at rest and asks nothing of joints that do not exist.
    fn is_sound(&self, trajectory: &ArmTrajectory) -> bool {
        let spline = &trajectory.spline;
        if !spline.is_valid() || spline.start_s() >= spline.end_s() {
            return false;
        }
        let [_, end_velocity, _] = spline.evaluate(spline.end_s());
        let knots_evaluate = spline
            .knots_s
            .iter()
            .all(|&knot| spline.evaluate(knot).iter().all(|values| values.iter().all(|value| value.is_finite())));
        let dof = self.model.dof();
        let fits = spline.control_points.iter().all(|point| point.iter().skip(dof).all(|&value| value == 0.0));
        fits && knots_evaluate && end_velocity.amax() <= CONTINUITY
    }

    /// Torques for the step that begins at `time_s`, by computed torque with the encoders' `q` and `dq`:
    /// τ = ID(q, q̇, q̈_d + ω²·(q_d − q) + 2ω·(q̇_d − q̇)) (Siciliano et al., Robotics, section 8.5.2), clamped.
    pub fn torque(&mut self, time_s: f64, step_s: f64, q: &JointVector, dq: &JointVector) -> JointVector {
        let wanted = self.setpoint(time_s);
        let acceleration =
            wanted.ddq + (wanted.q - q) * BANDWIDTH_RADPS.powi(2) + (wanted.dq - dq) * (2.0 * BANDWIDTH_RADPS);
        let mut torque = self.model.inverse_dynamics(q, dq, &acceleration);
        let mut is_clamped = false;
        for (i, joint) in self.model.joints.iter().enumerate() {
            let limit = joint.limits.torque;
            self.report.peak_torque_ratio = self.report.peak_torque_ratio.max(torque[i].abs() / limit);
            is_clamped |= torque[i].abs() > limit;
            torque[i] = torque[i].clamp(-limit, limit);
        }
        if is_clamped {
            self.report.torque_clamped_s += step_s;
        }
        // What has been replaced will not come back.
        let executing_since = self.executing(time_s).start_s();
        self.plan.retain(|trajectory| trajectory.start_s() >= executing_since);
        torque
    }

    /// Watches the limits in motion: the encoders at `time_s`, and the velocity one step before.
    pub fn watch(&mut self, time_s: f64, step_s: f64, q: &JointVector, dq: &JointVector, dq_before: &JointVector) {
        for i in 0..self.model.dof() {
            let limits = self.model.joints[i].limits;
            let middle = (limits.lower + limits.upper) / 2.0;
            let position = (q[i] - middle).abs() / ((limits.upper - limits.lower) / 2.0);
            let velocity = dq[i].abs() / limits.velocity;
            let acceleration = (dq[i] - dq_before[i]).abs() / step_s / limits.acceleration;
            let report = &mut self.report;
            report.peak_velocity_ratio = report.peak_velocity_ratio.max(velocity);
            report.peak_acceleration_ratio = report.peak_acceleration_ratio.max(acceleration);
            self.note_excursion(0, LimitKind::Position, i, position, 1.0, time_s);
            self.note_excursion(1, LimitKind::Velocity, i, velocity, VELOCITY_TOLERANCE, time_s);
        }
    }

    /// Takes down how close the arm is to itself and to the floor.
    pub fn note_clearances(&mut self, self_m: f64, floor_m: f64) {
        let smaller = |kept: Option<f64>, new: f64| Some(kept.map_or(new, |kept| kept.min(new)));
        self.report.min_self_clearance_m = smaller(self.report.min_self_clearance_m, self_m);
        self.report.min_floor_clearance_m = smaller(self.report.min_floor_clearance_m, floor_m);
    }

    fn note_excursion(&mut self, slot: usize, kind: LimitKind, joint: usize, ratio: f64, tolerated: f64, time_s: f64) {
        let excursion = &mut self.excursions[slot][joint];
        if ratio <= tolerated {
            *excursion = None;
            return;
        }
        let violations = &mut self.report.motion_violations;
        let entry = *excursion.get_or_insert_with(|| {
            violations.push(LimitViolation { joint, kind, ratio, time_s });
            violations.len() - 1
        });
        violations[entry].ratio = violations[entry].ratio.max(ratio);
    }
}
