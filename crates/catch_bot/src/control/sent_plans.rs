//! The plans that the arm was sent, as far as its controller has not rejected them.

use std::collections::VecDeque;

use catch_cell::{ArmState, ArmTrajectory, Setpoint, TrajectoryId};

use crate::trajectory_optimization::CatchPlan;

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

    /// Learns from the arm's state what became of the trajectories. A plan that was rejected or lost is dropped, and so are those
    /// that went on from it. Returns whether any was. `lost_after_s` is [`Config::lost_after_s`](super::Config::lost_after_s).
    pub fn acknowledge(&mut self, arm: &ArmState, lost_after_s: f64) -> bool {
        // Identifiers must be higher than all before them, whoever used those.
        let told = arm.rejected.iter().map(|it| it.id).chain(arm.executing);
        self.last_id = told.map(|id| id.0).fold(self.last_id, u64::max);

        let before = self.plans.len();
        let is_rejected = |id: TrajectoryId| arm.rejected.iter().any(|it| it.id == id);
        let kept = self.plans.iter().position(|(id, _)| is_rejected(*id)).unwrap_or(before);
        self.plans.truncate(kept);
        let executing = self.plans.iter().position(|(id, _)| Some(*id) == arm.executing);
        let is_due = |plan: &CatchPlan| plan.trajectory.start_s() + lost_after_s < arm.time_s;
        // Where trajectories follow each other more quickly than observations, all up to the executing one were taken.
        let pending = executing.map_or(0, |at| at + 1);
        let kept = self.plans.iter().skip(pending).position(|(_, plan)| is_due(plan));
        self.plans.truncate(kept.map_or(self.plans.len(), |at| pending + at));
        let has_dropped = self.plans.len() < before;
        self.plans.drain(..executing.unwrap_or(0));
        has_dropped
    }

    /// The plan that will be executing when all that was sent has started.
    pub fn last(&self) -> Option<&CatchPlan> {
        self.plans.back().map(|(_, plan)| plan)
    }

    /// What the arm will be asked for at `time_s`: by the plan that will be executing then, or, where that is none of these, by
    /// what its controller asks for now.
    pub fn setpoint(&self, time_s: f64, arm: &ArmState) -> Setpoint {
        let executing = self.plans.iter().rev().find(|(_, plan)| plan.trajectory.start_s() <= time_s);
        executing.map_or_else(|| arm.extrapolated(time_s), |(_, plan)| plan.trajectory.setpoint(time_s))
    }

    /// Forgets all plans. Identifiers go on from those that have been used.
    pub fn clear(&mut self) {
        self.plans.clear();
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        grasp_selection::{Approach, Grasp},
        trajectory_optimization::terminal_velocity::Weights,
    };
    use catch_body::{JointVector, Pose, shape::Cuboid};
    use catch_cell::{BSpline, RejectedTrajectory, Rejection};
    use nalgebra::{Point3, Vector3};

    /// A plan whose trajectory stands at `q` from `start_s` on.
    fn plan(start_s: f64, q: f64) -> CatchPlan {
        let grasp = Grasp {
            X_OG: Pose::identity(),
            object_width_m: 0.05,
            aperture_m: 0.1,
            strength_m: 0.0,
            overhang_m: 0.0,
            held_G: Cuboid { centre: Point3::origin(), size: Vector3::zeros() },
        };
        CatchPlan {
            catch_s: start_s + 0.5,
            grasp,
            approach: Approach::TowardPalm,
            X_WG: Pose::identity(),
            q: JointVector::repeat(q),
            aperture_m: 0.1,
            approach_is_free: true,
            elbow: None,
            speed_fraction: 0.0,
            spin_radps: 0.0,
            weights: Weights::BALANCED,
            cost: 0.0,
            holding_cost: 0.0,
            trajectory: BSpline::at_rest(start_s, JointVector::repeat(q)),
        }
    }

    fn arm(time_s: f64, executing: Option<u64>, rejected: &[u64]) -> ArmState {
        let (q, dq) = (JointVector::zeros(), JointVector::repeat(1.0));
        let reject = |id: &u64| RejectedTrajectory { id: TrajectoryId(*id), reason: Rejection::Declined };
        ArmState {
            time_s,
            q,
            dq,
            commanded: Setpoint { q, dq, ddq: JointVector::zeros() },
            executing: executing.map(TrajectoryId),
            rejected: rejected.iter().map(reject).collect(),
        }
    }

    fn sent(starts_s: &[f64]) -> SentPlans {
        let mut plans = SentPlans::default();
        for (i, start_s) in starts_s.iter().enumerate() {
            let trajectory = plans.send(plan(*start_s, i as f64 + 1.0));
            assert_eq!(trajectory.id, TrajectoryId(i as u64 + 1));
        }
        plans
    }

    fn catches(plans: &SentPlans) -> Vec<f64> {
        plans.plans.iter().map(|(_, plan)| plan.q[0]).collect()
    }

    #[test]
    fn a_rejected_plan_is_dropped_with_those_that_went_on_from_it() {
        let mut plans = sent(&[0.0, 0.1, 0.2]);
        assert!(plans.acknowledge(&arm(0.05, Some(1), &[2]), 0.02));
        assert_eq!(catches(&plans), [1.0]);
        assert!((plans.setpoint(0.3, &arm(0.05, Some(1), &[])).q[0] - 1.0).abs() < 1e-12);
        // The next one goes on from what executes, under a new identifier.
        assert_eq!(plans.send(plan(0.3, 9.0)).id, TrajectoryId(4));
    }

    #[test]
    fn nothing_is_dropped_while_stamps_are_a_little_off() {
        let mut plans = sent(&[0.0, 0.1]);
        assert!(!plans.acknowledge(&arm(0.1004, Some(1), &[]), 0.02));
        assert_eq!(catches(&plans), [1.0, 2.0]);
        assert!(!plans.acknowledge(&arm(0.11, Some(2), &[]), 0.02));
        assert_eq!(catches(&plans), [2.0], "what has been replaced is forgotten");
    }

    #[test]
    fn what_does_not_begin_has_been_lost() {
        let mut plans = sent(&[0.0, 0.1, 0.2]);
        assert!(plans.acknowledge(&arm(0.15, Some(1), &[]), 0.02));
        assert_eq!(catches(&plans), [1.0]);
        let mut plans = sent(&[0.1]);
        assert!(plans.acknowledge(&arm(0.15, None, &[]), 0.02));
        assert_eq!(plans.last(), None);
    }

    /// A moving arm whose trajectory nobody here has sent is not taken to stand still.
    #[test]
    fn what_somebody_else_has_sent_is_extrapolated() {
        let mut plans = SentPlans::default();
        let state = arm(0.5, Some(40), &[41]);
        assert!(!plans.acknowledge(&state, 0.02));
        let ahead = plans.setpoint(0.51, &state);
        assert!((ahead.q[0] - 0.01).abs() < 1e-15 && ahead.dq[0] == 1.0);
        assert_eq!(plans.send(plan(0.51, 1.0)).id, TrajectoryId(42));
    }
}
