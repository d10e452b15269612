//! The plans that the arm was sent, as far as its controller has not rejected them.

use std::collections::VecDeque;

use catch_cell::{ArmState, ArmTrajectory, Setpoint, TrajectoryId};

use crate::trajectory_optimization::CatchPlan;

/// A trajectory that does not execute this long after its start, by the arm's own clock, has been lost on its
/// way, in seconds: longer than time stamps are off and the robot controller lags.
const LOST_AFTER_S: f64 = 0.02;

/// The plans that are executed or will be, oldest first, each with the identifier of its trajectory.
#[derive(Debug, Clone, Default)]
pub struct SentPlans {
    plans: VecDeque<(TrajectoryId, CatchPlan)>,
    /// The highest identifier that has been used.
    last_id: u64,
}

impl SentPlans {
    /// The trajectory to send for a new plan.
    pub fn send(&mut self, plan: CatchPlan) -> ArmTrajectory {
        let trajectory = ArmTrajectory { id: self.next_id(), spline: plan.trajectory.clone() };
        self.plans.push_back((trajectory.id, plan));
        trajectory
    }

    /// An identifier that has not been used.
    pub fn next_id(&mut self) -> TrajectoryId {
        self.last_id = self.last_id.saturating_add(1);
        TrajectoryId(self.last_id)
    }

    /// Learns from the arm's state what became of the trajectories. A plan that was rejected or lost is
    /// dropped, and so are those that went on from it. Returns whether any was.
    pub fn acknowledge(&mut self, arm: &ArmState) -> bool {
        // Identifiers must be higher than all before them, whoever used those.
        let told = arm.rejected.iter().map(|it| it.id).chain(arm.executing);
        self.last_id = told.map(|id| id.0).fold(self.last_id, u64::max);

        let before = self.plans.len();
        let is_rejected = |id: TrajectoryId| arm.rejected.iter().any(|it| it.id == id);
        let kept = self.plans.iter().position(|(id, _)| is_rejected(*id)).unwrap_or(before);
        self.plans.truncate(kept);
        let executing = self.plans.iter().position(|(id, _)| Some(*id) == arm.executing);
        let is_due = |plan: &CatchPlan| plan.trajectory.start_s() + LOST_AFTER_S < arm.time_s;
        // Where trajectories follow each other more quickly than observations, all up to the executing one
        // were taken.
        let pending = executing.map_or(0, |at| at + 1);
        let kept = self.plans.iter().skip(pending).position(|(_, plan)| is_due(plan));
        self.plans.truncate(kept.map_or(self.plans.len(), |at| pending + at));
        let has_dropped = self.plans.len() < before;
        self.plans.drain(..executing.unwrap_or(0));
        has_dropped
    }

    /// All of them, oldest first.
    pub fn iter(&self) -> impl Iterator<Item = &CatchPlan> {
        self.plans.iter().map(|(_, plan)| plan)
    }

    /// The plan that will be executing when all that was sent has started.
    pub fn last(&self) -> Option<&CatchPlan> {
        self.plans.back().map(|(_, plan)| plan)
    }

    /// Set-point of the arm at `time_s`: of the plan that will be executing then, or, if there is none,
    /// extrapolated from the set-point of the arm's controller now.
    pub fn setpoint(&self, time_s: f64, arm: &ArmState) -> Setpoint {
        let executing = self.plans.iter().rev().find(|(_, plan)| plan.trajectory.start_s() <= time_s);
        executing.map_or_else(|| arm.extrapolated(time_s), |(_, plan)| plan.trajectory.setpoint(time_s))
    }

    /// Forgets all plans. Identifiers go on from those that have been used.
    pub fn clear(&mut self) {
        self.plans.clear();
    }
}
