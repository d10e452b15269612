//! What to do now: keep to the plan, adjust it, or make another; and the command that follows.

use catch_cell::{Command, Observation, arm::Setpoint};

use super::{closing, gripper_moves, is_still_good};
use crate::{
    CatchingBot, Status,
    method::Method,
    paper_method,
    trajectory_optimization::{CatchPlan, Incoming, Refusal, Start},
    trajectory_prediction::FlightTrajectory,
};

/// Plans that are remembered: more than can be under way.
pub(crate) const SENT: usize = 8;
/// Where a trajectory is followed the cabinet's setpoint is its own, but for rounding, in radians.
const SAME_SETPOINT_RAD: f64 = 1e-7;

impl CatchingBot {
    /// A trajectory that came too late was refused, and so was every one that went on from it: the plan is then the one that
    /// the arm follows.
    pub(crate) fn drop_refused(&mut self, observation: &Observation) {
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
    pub(crate) fn start(&self, observation: &Observation) -> Start {
        let time_s = observation.time_s + self.known.config.control.expected_latency_s;
        let state = match &self.plan {
            Some(plan) => plan.trajectory.setpoint(time_s),
            // Encoders are noisy and a loaded arm sags; what is executing is known exactly.
            None => Setpoint::at_rest(observation.arm.setpoint_q),
        };
        Start { time_s, state }
    }

    /// The ladder of replans: the same catch adjusted, else a little sooner or later, else the old motion while it is good enough,
    /// else another catch, else as near to it as the arm can still come. Another catch also takes the place of one that promised
    /// more than it now does.
    pub(crate) fn decide(&mut self, start: &Start, flight: &FlightTrajectory) -> (Status, Option<CatchPlan>) {
        if self.known.config.method == Method::Paper {
            return paper_method::decide(self, start, flight);
        }
        let incoming = Incoming { flight, grasps: &self.known.grasps, config: &self.known.config.grasp_selection };
        let refusals = &mut self.refusals;
        let mut look = || {
            let found = self.known.planner.look(refusals, start, &incoming);
            if found.is_ok() {
                *refusals = 0;
            }
            found
        };
        let Some(plan) = &self.plan else {
            return match look() {
                Ok(plan) => {
                    self.settled_cost = plan.holding_cost;
                    (Status::Planned, Some(plan))
                }
                Err(Refusal::NoGrasp) => (Status::NoGrasp, None),
                Err(Refusal::OutOfReach) => (Status::OutOfReach, None),
                Err(Refusal::Blocked) => (Status::Blocked, None),
                Err(Refusal::NoMotion) => (Status::NoPlan, None),
            };
        };
        let planner = &self.known.planner;
        // Fingers that have begun to close are timed for this catch.
        let is_closing = self.closing.is_some_and(|closing| closing.start_s <= start.time_s);
        let mut adjusted = planner.retarget(start, &incoming, plan);
        if !is_closing && !adjusted.as_ref().is_some_and(|it| it.lets_in) {
            adjusted = planner.shifted(start, &incoming, plan).or(adjusted);
        }
        let is_good = match &adjusted {
            Some(adjusted) => adjusted.lets_in,
            None => is_still_good(plan, flight, planner.gripper(), &self.known.config.control),
        };
        // A catch that the flight, known better, has made worse is compared with the best there is now.
        let gain = self.known.config.control.switch_gain;
        let has_worsened = adjusted.as_ref().is_some_and(|it| it.holding_cost > self.settled_cost + gain);
        let another = if is_closing || (is_good && !has_worsened) { None } else { look().ok() };
        let is_better = |it: &CatchPlan| {
            !is_good || adjusted.as_ref().is_some_and(|adjusted| it.holding_cost + gain < adjusted.holding_cost)
        };
        let another = another.filter(is_better);
        if has_worsened || another.is_some() {
            let settled = another.as_ref().or(adjusted.as_ref());
            self.settled_cost = settled.map_or(self.settled_cost, |it| it.holding_cost);
        }
        if let Some(plan) = another.or(adjusted) {
            return (Status::Planned, Some(plan));
        }
        match planner.nearest(start, &incoming, plan) {
            Some(plan) => (Status::Approached, Some(plan)),
            None => {
                let passage = flight.passage_at(plan.catch_s);
                let plan = planner.opened(plan.clone(), plan.open_width_m, start.time_s, &incoming, &passage);
                (Status::PlanKept, Some(plan))
            }
        }
    }

    /// Takes over the plan, and times the gripper by the newest flight.
    pub(crate) fn command(
        &mut self,
        now_s: f64,
        status: Status,
        plan: Option<CatchPlan>,
        flight: &FlightTrajectory,
    ) -> Command {
        let Some(plan) = plan else { return Command::default() };
        let gripper = self.known.planner.gripper();
        let grasping = &self.known.config.grasp_selection;
        let closing = closing(&plan, flight, self.known.planner.robot(), gripper, grasping, &self.known.config.control);
        // Fingers that have started to close go on: a new list of moves would open them again.
        let is_closing = self.closing.is_some_and(|closing| closing.start_s <= now_s);
        let moves = gripper_moves(now_s, plan.open_width_m, &closing, gripper, &self.known.config.control);
        let arm = status.is_new_motion().then(|| plan.trajectory.clone());
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
