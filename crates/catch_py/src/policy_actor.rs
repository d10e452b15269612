//! Commands from a learned policy's actions: they keep the arm's limits.

use std::{mem, time::Instant};

use catch_body::JointVector;
use catch_bot::Report;
use catch_cell::{ArmTrajectory, BSpline, Brain as _, Command, GripperMove, Observation, Setpoint, TrajectoryId};
use catch_lab::{
    scenario::setup::Setup,
    trial::{StateSnapshot, residual::ResidualMotion, steering::Steering, stopwatch::Stopwatch},
};
use catch_recording::brain::ChosenBrain;

use crate::policy_view::{SeenArray, row};

/// Trajectories that are remembered: more than are sent until one is told to be rejected.
const REMEMBERED: usize = 64;

/// Meaning of an action for each joint, as a fraction of a limit.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Action {
    /// The acceleration.
    Acceleration,
    /// The change of its position until the next action.
    Delta,
    /// The offset from the motion of the scenario's brain.
    Residual,
}

impl Action {
    /// Numbers of an action: one for each joint, and one for the gripper where the brain does not close it.
    pub fn len(self, dof: usize) -> usize {
        dof + usize::from(self != Self::Residual)
    }
}

/// Time from one action to the next.
fn period_s(setup: &Setup) -> f64 {
    let arena = &setup.scenario.arena;
    arena.steps_per_frame() as f64 * arena.step_s
}

/// Steers arm and gripper by actions alone.
pub struct SteeredArm {
    steering: Steering,
    is_delta: bool,
    /// Trajectory that holds the arm at the beginning, and the newest trajectories that were sent and not
    /// rejected, with their identifiers.
    sent: Vec<(u64, BSpline)>,
    last_id: u64,
    closes: Option<bool>,
}

impl SteeredArm {
    /// An arm at rest at `now_s`.
    pub fn new(setup: &Setup, action: Action, now_s: f64) -> Self {
        Self {
            steering: Steering::new(&setup.robot, &setup.gripper, period_s(setup)),
            is_delta: action == Action::Delta,
            sent: vec![(0, BSpline::at_rest(now_s, setup.robot.ready_q))],
            last_id: 0,
            closes: None,
        }
    }

    /// Acts as far as the limits allow.
    pub fn command(&mut self, setup: &Setup, sensed: &Observation, start_s: f64, action: &[f64]) -> Command {
        let (wanted, closes) = (joints(setup, action), action[setup.robot.dof()] > 0.0);
        self.sent.retain(|(id, _)| sensed.arm.rejected.iter().all(|it| it.id.0 != *id));
        let newest = self.sent.last().map(|(_, motion)| motion.setpoint(start_s));
        let start = newest.unwrap_or(Setpoint::at_rest(sensed.arm.commanded.q));
        let accelerations = if self.is_delta {
            // Half of what is missing within a period: faster swings.
            let dq = wanted.component_mul(&self.steering.max_velocity());
            (dq - start.dq) * (0.5 / period_s(setup))
        } else {
            wanted.component_mul(&self.steering.max_acceleration())
        };
        let mut command = Command::default();
        // An arm that rests and is to rest needs no new motion.
        let is_at_rest = [start.dq, start.ddq, accelerations].iter().all(|it| *it == JointVector::zeros());
        let motion = if is_at_rest { None } else { self.steering.motion(start_s, &start, &accelerations) };
        if let Some(motion) = motion {
            self.last_id += 1;
            self.sent.push((self.last_id, motion.clone()));
            self.sent.drain(..self.sent.len().saturating_sub(REMEMBERED));
            command.arm = Some(ArmTrajectory { id: TrajectoryId(self.last_id), spline: motion });
        }
        if self.closes.replace(closes) != Some(closes) {
            let gripper = &setup.gripper;
            let width_m = if closes { 0.0 } else { gripper.max_width_m };
            let (speed_mps, force_n) = (gripper.max_speed_mps, gripper.max_force_n);
            command.gripper = Some(vec![GripperMove { start_s, width_m, speed_mps, force_n }]);
        }
        command
    }
}

/// The scenario's brain, whose motions actions shift.
pub struct ShiftedBrain {
    brain: Box<ChosenBrain>,
    stopwatch: Stopwatch,
    motion: ResidualMotion,
    /// Command of the brain.
    command: Command,
    sensed: Option<(StateSnapshot, Instant)>,
}

impl ShiftedBrain {
    /// One that has seen nothing yet.
    pub fn new(setup: &Setup, seed: u64, index: u64) -> Self {
        let ready_q = &setup.robot.ready_q;
        Self {
            brain: Box::new(setup.brain(seed, index)),
            stopwatch: Stopwatch::default(),
            motion: ResidualMotion::new(&setup.robot, &setup.gripper, period_s(setup), ready_q),
            command: Command::default(),
            sensed: None,
        }
    }

    /// Returns the state and the plan of the brain after its last tick.
    pub fn report(&self) -> &Report {
        self.brain.report()
    }

    /// One decision about what was sensed.
    pub fn tick(&mut self, sensed: &mut Observation) {
        let since = Instant::now();
        let arm = self.motion.arm_of_brain(&sensed.arm);
        let real = arm.map(|arm| mem::replace(&mut sensed.arm, arm));
        self.stopwatch.start();
        self.command = self.brain.tick(sensed, &mut self.stopwatch);
        self.stopwatch.stop();
        if let Some(real) = real {
            sensed.arm = real;
        }
        let report = Some(self.brain.report().clone());
        let snapshot = StateSnapshot { time_s: sensed.time_s, report, stage_ms: self.stopwatch.last_tick_ms() };
        self.sensed = Some((snapshot, since));
    }

    /// Returns the brain's command, shifted, with its snapshot and the duration of the computation in
    /// seconds.
    pub fn command(&mut self, setup: &Setup, start_s: f64, action: &[f64]) -> Option<(Command, StateSnapshot, f64)> {
        let (snapshot, since) = self.sensed.take()?;
        let command = self.motion.shifted(mem::take(&mut self.command), start_s, &joints(setup, action));
        Some((command, snapshot, since.elapsed().as_secs_f64()))
    }

    /// Offsets of the joints from the brain's motion, how long it is until the catch in seconds, and 1 where
    /// one is planned.
    pub fn seen(&self, setup: &Setup, time_s: f64) -> SeenArray {
        let offset = self.motion.offset(time_s).q;
        let plan = self.report().plan.as_ref().map_or([0.0; 2], |plan| [plan.catch_s - time_s, 1.0]);
        row("plan", [&offset.as_slice()[..setup.robot.dof()], &plan].concat())
    }
}

/// The numbers of an action that are for joints.
fn joints(setup: &Setup, action: &[f64]) -> JointVector {
    let mut joints = JointVector::zeros();
    joints.iter_mut().zip(&action[..setup.robot.dof()]).for_each(|(joint, value)| *joint = value.clamp(-1.0, 1.0));
    joints
}
