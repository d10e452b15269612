//! The ladder of replans: a running catch adjusted to a flight that is known better.

use super::{CatchPlan, Planner, Start, posture::Posture, reaching::Reaching, search::Candidate};
use crate::{
    grasp_selection::{self, GraspSet},
    trajectory_prediction::FlightTrajectory,
};

impl Planner {
    /// The same catch for a flight that is known better: same time and grasp, the elbow where it was or close by.
    pub fn retarget(
        &self,
        start: &Start,
        flight: &FlightTrajectory,
        plan: &CatchPlan,
        grasps: &GraspSet,
        grasp_config: &grasp_selection::Config,
    ) -> Option<CatchPlan> {
        let X_WG = flight.pose_at(plan.catch_s) * plan.grasp.X_OG;
        let v_WO = flight.twist_at(plan.catch_s).linear;
        let known = Posture { q: plan.q, elbow: plan.elbow };
        // What a motion leaves of the limits, the next replan can use: more is taken only where less does not do.
        let shares = [0.0, 0.5, 1.0].map(|more| self.cold_shares().toward(self.moving_shares(), more));
        let attempts = shares.iter().flat_map(|shares| [0.0, 0.2, -0.2, 0.4, -0.4].map(|offset| (shares, offset)));
        let found = attempts.into_iter().find_map(|(shares, offset)| {
            let posture = self.finder.adjusted(&self.robot, &X_WG, &known, offset)?;
            let q = posture.q;
            let reaching = self.reaching(start, plan.catch_s, &X_WG, &q, &v_WO, *shares);
            let reaching = Reaching { weights: plan.weights, ..reaching };
            let joints = self.reaches(start, plan.catch_s - start.time_s, *shares);
            let bounds = self.arrival_bounds(&joints, &start.state.q, &q)?;
            let CatchPlan { catch_s, approach, cost, .. } = *plan;
            let candidate = Candidate { catch_s, approach, X_WG, posture, cost };
            self.finish(&candidate, &plan.grasp, bounds, &reaching)
        })?;
        Some(self.opened(found, plan.open_width_m, start.time_s, flight, grasps, grasp_config))
    }

    /// The same plan with the opening that it had if that lets the object in; else with the narrowest that does, or, where none
    /// does any more, the widest: it hits least. Where it is too late to change the opening, it stays.
    pub fn opened(
        &self,
        plan: CatchPlan,
        had_m: f64,
        now_s: f64,
        flight: &FlightTrajectory,
        grasps: &GraspSet,
        config: &grasp_selection::Config,
    ) -> CatchPlan {
        if self.first_that_lets_in(&[had_m], &plan, flight, grasps, config).is_some() {
            return CatchPlan { open_width_m: had_m, lets_in: true, ..plan };
        }
        let opening = self.opening(&plan, flight, grasps, config);
        let open_width_m = opening.unwrap_or(self.gripper.max_width_m);
        let fingers = config.closing(&self.gripper);
        let takes_s = fingers.duration_s((open_width_m - had_m).abs())
            + fingers.duration_s(open_width_m - plan.grasp.object_width_m)
            + config.settling_s;
        if now_s + takes_s > plan.catch_s {
            return CatchPlan { open_width_m: had_m, lets_in: false, ..plan };
        }
        CatchPlan { open_width_m, lets_in: opening.is_some(), ..plan }
    }
}
