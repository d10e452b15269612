//! Our catch planner: a search over catch times, grasps and arm angles, and replans of the catch that it
//! chose.

use std::sync::Arc;

use super::{CatchPlanner, Config, Decision, Progress, Situation, Status, is_still_good};
use crate::{
    grasp_selection::{self, GraspSet},
    trajectory_optimization::{
        CatchPlan, CatchSearch, Incoming, PlanningFailure, failure_counter::FailureCounter, retarget::Correction,
    },
};

/// Best-first search over a grid of catch times, and replans with switching hysteresis.
#[derive(Debug, Clone)]
pub struct TimeGridSearch {
    config: Config,
    grasping: grasp_selection::Config,
    grasps: Arc<GraspSet>,
    search: Arc<CatchSearch>,
    /// Programs and factorizations that failed numerically in this throw.
    failures: u32,
}

impl TimeGridSearch {
    /// Creates the planner for an arm with a gripper, and an object by its grasp candidates.
    pub fn new(
        config: Config,
        grasping: grasp_selection::Config,
        grasps: Arc<GraspSet>,
        search: Arc<CatchSearch>,
    ) -> Self {
        Self { config, grasping, grasps, search, failures: 0 }
    }

    /// Runs as many search passes as one image allows.
    fn pass(
        &self,
        situation: &Situation<'_>,
        incoming: &Incoming<'_>,
        progress: &mut Progress,
    ) -> Result<CatchPlan, PlanningFailure> {
        let Progress { ref mut passes, departure_s, .. } = *progress;
        let found = self.search.search_in_passes(passes, &situation.start, incoming, departure_s);
        found.inspect(|_| *passes = 0)
    }

    /// A first catch.
    fn first(&self, situation: &Situation<'_>, incoming: &Incoming<'_>) -> Decision {
        let departure_s = self.search.departure_s(&situation.start);
        let mut progress = Progress { departure_s, ..situation.progress };
        match self.pass(situation, incoming, &mut progress) {
            Ok(plan) => {
                progress.reference_cost = Some(plan.holding_cost);
                Decision { status: Status::Planned, plan: Some(plan), progress }
            }
            Err(failure) => {
                let status = match failure {
                    PlanningFailure::NoGrasp => Status::NoGrasp,
                    PlanningFailure::OutOfReach => Status::OutOfReach,
                    PlanningFailure::Blocked => Status::Blocked,
                    PlanningFailure::NoMotion => Status::NoPlan,
                    PlanningFailure::OutOfBudget => Status::OutOfBudget,
                };
                Decision { status, plan: None, progress }
            }
        }
    }

    /// Corrects a running catch: the same catch adjusted, or a little sooner or later. Another one takes its
    /// place where its approach is blocked, or where it promised more than it now does. Without any of these
    /// the hand comes as near as the arm can, and at last the old motion stays.
    fn replan(&self, situation: &Situation<'_>, incoming: &Incoming<'_>, running: &CatchPlan) -> Decision {
        let (start, search) = (&situation.start, &self.search);
        let to = Correction::new(start, incoming, running, running.catch_s);
        let mut progress = situation.progress;
        // Fingers that have begun to close are timed for this catch.
        let is_closing = situation.is_closing();
        let mut adjusted = search.retarget(&to);
        if !is_closing && !adjusted.as_ref().is_some_and(|it| it.approach_is_free) {
            adjusted = search.shifted(&to).or(adjusted);
        }
        let is_good = match &adjusted {
            Some(adjusted) => adjusted.approach_is_free,
            None => is_still_good(running, &to.X_WG(), &search.motion.gripper),
        };
        // A catch that the flight, known better, has made worse is compared with the best there is now.
        let gain = self.config.switching_hysteresis;
        let has_worsened = adjusted
            .as_ref()
            .zip(progress.reference_cost)
            .is_some_and(|(it, reference)| it.holding_cost > reference + gain);
        let is_better = |it: &CatchPlan| {
            !is_good || adjusted.as_ref().is_some_and(|adjusted| it.holding_cost + gain < adjusted.holding_cost)
        };
        let is_compared = !is_closing && (!is_good || has_worsened);
        let another = is_compared.then(|| self.pass(situation, incoming, &mut progress).ok()).flatten();
        let another = another.filter(is_better);
        if has_worsened || another.is_some() {
            let compared = another.as_ref().or(adjusted.as_ref());
            progress.reference_cost = compared.map(|it| it.holding_cost).or(progress.reference_cost);
        }
        if let Some(plan) = another.or(adjusted) {
            return Decision { status: Status::Planned, plan: Some(plan), progress };
        }
        let kept = || CatchPlan { grasp: to.grasp.clone(), ..running.clone() };
        let kept = || (Status::PlanKept, search.opened(kept(), &to));
        let (status, plan) = search.nearest(&to).map_or_else(kept, |plan| (Status::Approached, plan));
        Decision { status, plan: Some(plan), progress }
    }
}

impl CatchPlanner for TimeGridSearch {
    fn plan(&mut self, situation: &Situation<'_>) -> Decision {
        let failures = FailureCounter::default();
        let Self { grasps, grasping, .. } = &*self;
        let incoming = Incoming { flight: situation.flight, grasps, config: grasping, failures: &failures };
        let decision = match situation.running {
            None => self.first(situation, &incoming),
            Some(running) => self.replan(situation, &incoming, running),
        };
        self.failures += failures.count();
        decision
    }

    fn waiting_width_m(&self) -> Option<f64> {
        self.grasps.widest_aperture_m
    }

    fn numerical_failures(&self) -> u32 {
        self.failures
    }

    fn reset(&mut self) {
        self.failures = 0;
    }
}
