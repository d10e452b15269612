//! What to do now: keep to the plan, adjust it, or make another; and the command that follows.

use catch_cell::{Command, Observation};

use super::{closing, gripper_moves, is_still_good};
use crate::{
    CatchingBot, Status,
    method::Method,
    paper_method,
    trajectory_optimization::{CatchPlan, Incoming, Refusal, Start},
    trajectory_prediction::FlightTrajectory,
};

impl CatchingBot {
    /// Where the arm will be when a motion that is planned now takes over. Encoders are noisy and a loaded arm sags; what it is
    /// commanded is known exactly.
    pub(crate) fn start(&self, observation: &Observation) -> Start {
        let time_s = observation.time_s + self.known.config.control.expected_latency_s;
        Start { time_s, state: self.sent.setpoint(time_s, &observation.arm) }
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
        let arm = status.is_new_motion().then(|| self.sent.send(plan.clone()));
        if !is_closing {
            self.closing = Some(closing);
        }
        self.plan = Some(plan);
        Command { arm, gripper: (!is_closing).then_some(moves), windows: None }
    }
}
