//! The controller: the plan that is being executed, and the commands that follow from decisions.

use std::collections::VecDeque;

use catch_body::{Gripper, Robot};
use catch_cell::{Command, Observation, arm::Setpoint};

use super::{Config, Decision, GripperPlan, Progress, closing, gripper_moves};
use crate::{
    grasp_selection,
    trajectory_optimization::{CatchPlan, Start},
    trajectory_prediction::FlightTrajectory,
};

/// Plans that are remembered: more than can be under way.
const SENT: usize = 8;
/// Where a trajectory is followed the cabinet's setpoint is its own, but for rounding, in radians.
const SAME_SETPOINT_RAD: f64 = 1e-7;

/// What is under way: the running plan, the closing of the gripper, and what was sent for them.
#[derive(Debug, Clone)]
pub struct Controller {
    config: Config,
    grasping: grasp_selection::Config,
    robot: Robot,
    gripper: Gripper,

    plan: Option<CatchPlan>,
    closing: Option<GripperPlan>,
    progress: Progress,
    /// The plans that were sent last, the running one included, oldest first.
    sent: VecDeque<CatchPlan>,
}

impl Controller {
    /// For an arm that waits, its gripper open.
    pub fn new(config: Config, grasping: grasp_selection::Config, robot: Robot, gripper: Gripper) -> Self {
        let sent = VecDeque::with_capacity(SENT);
        Self { config, grasping, robot, gripper, plan: None, closing: None, progress: Progress::default(), sent }
    }

    /// The plan that is being executed.
    pub fn plan(&self) -> Option<&CatchPlan> {
        self.plan.as_ref()
    }

    /// The closing of the gripper as commanded last.
    pub fn closing(&self) -> Option<GripperPlan> {
        self.closing
    }

    /// What the planner wanted to know again.
    pub fn progress(&self) -> Progress {
        self.progress
    }

    /// Whether it is too late to change anything.
    pub fn is_committed(&self, now_s: f64) -> bool {
        self.plan.as_ref().is_some_and(|plan| now_s > plan.catch_s - self.config.commit_s)
    }

    /// A trajectory that came too late was refused, and so was every one that went on from it: the plan is then the one that
    /// the arm follows.
    pub fn drop_refused(&mut self, observation: &Observation) {
        let now_s = observation.time_s;
        let is_followed = |plan: &CatchPlan| {
            let setpoint = plan.trajectory.setpoint(now_s);
            (setpoint.q - observation.arm.setpoint_q).amax() < SAME_SETPOINT_RAD
        };
        let begun = self.sent.iter().rposition(|plan| plan.trajectory.start_s() < now_s);
        let Some(begun) = begun.filter(|&begun| !is_followed(&self.sent[begun])) else { return };
        let followed = self.sent.iter().take(begun).rposition(is_followed);
        self.sent.truncate(followed.map_or(0, |at| at + 1));
        self.plan = self.sent.back().cloned();
    }

    /// Where the arm will be when a motion that is planned now takes over.
    pub fn start(&self, observation: &Observation) -> Start {
        let time_s = observation.time_s + self.config.expected_latency_s;
        let state = match &self.plan {
            Some(plan) => plan.trajectory.setpoint(time_s),
            // Encoders are noisy and a loaded arm sags; what is executing is known exactly.
            None => Setpoint::at_rest(observation.arm.setpoint_q),
        };
        Start { time_s, state }
    }

    /// Takes over what was decided, and times the gripper by the newest flight.
    pub fn command(&mut self, now_s: f64, decision: Decision, flight: &FlightTrajectory) -> Command {
        self.progress = decision.progress;
        let Some(plan) = decision.plan else { return Command::default() };
        let closing = closing(&plan, flight, &self.robot, &self.gripper, &self.grasping, &self.config);
        // Fingers that have started to close go on: a new list of moves would open them again.
        let is_closing = self.closing.is_some_and(|closing| closing.start_s <= now_s);
        let moves = gripper_moves(now_s, plan.open_width_m, &closing, &self.gripper, &self.config);
        let arm = decision.status.is_new_motion().then(|| plan.trajectory.clone());
        if arm.is_some() {
            if self.sent.len() == SENT {
                self.sent.pop_front();
            }
            self.sent.push_back(plan.clone());
        }
        if !is_closing {
            self.closing = Some(closing);
        }
        self.plan = Some(plan);
        Command { arm, gripper: (!is_closing).then_some(moves), windows: None }
    }
}
