//! Catch planning as in the paper (III-C and III-D): grasp and catch time are chosen once; the motion follows
//! the flight as it becomes better known.

use std::sync::Arc;

use catch_bot::{
    Preparation, Status,
    control::{CatchPlanner, Decision, Situation},
    perception::ReferenceModel,
    trajectory_optimization::{CatchPlan, CatchSearch, Start},
    trajectory_prediction::FlightTrajectory,
};
use catch_cell::Setpoint;
use nalgebra::Point3;

use crate::{Config, grasp, motion};

/// The paper's catch planner.
#[derive(Debug, Clone)]
pub struct PaperPlanner {
    config: Config,
    reference: Arc<ReferenceModel>,
    search: Arc<CatchSearch>,
    seed: u64,
}

impl PaperPlanner {
    /// Creates the planner for the arm and the object of a preparation; grasps are drawn by `seed`.
    pub fn new(config: Config, known: &Preparation, seed: u64) -> Self {
        Self { config, reference: known.reference.clone(), search: known.search.clone(), seed }
    }

    /// Grasp, catch time and a first motion.
    fn first(&self, situation: &Situation<'_>) -> (Status, Option<CatchPlan>) {
        let (config, planner) = (&self.config, &self.search.motion);
        let (time_s, flight) = (situation.observed_s.0 + ROUNDING_S, situation.flight);
        let base = Point3::from(planner.robot.X_WB.translation.vector);
        let Some(catch_s) = catch_time_s(flight, situation.first_seen_s, &base) else {
            return (Status::OutOfReach, None);
        };
        if catch_s <= time_s + FREEZE_S {
            return (Status::OutOfReach, None);
        }
        let arm = (&planner.gripper, &base);
        let Some(chosen) = grasp::select(&self.reference, arm, (flight, catch_s), self.seed, &config.grasp) else {
            return (Status::NoGrasp, None);
        };
        match motion::plan(planner, &start(situation, &config.motion), (flight, catch_s), &chosen, &config.motion) {
            Some(plan) => (Status::Planned, Some(plan)),
            None => (Status::NoPlan, None),
        }
    }
}

/// Start of a motion: the commanded state of the arm, or the sensed one.
fn start(situation: &Situation<'_>, config: &motion::Config) -> Start {
    let Start { time_s, state } = situation.start;
    let (q, dq) = situation.sensed;
    let state = if config.starts_anywhere { Setpoint { q, dq, ..state } } else { state };
    Start { time_s, state }
}

/// The object is within reach between these distances from the axis of the base, in metres (code).
const REACH_M: [f64; 2] = [0.42, 0.75];
/// Times after the first sighting among which it is sought when it comes within reach and leaves it, in
/// seconds, and how many (code).
const SOUGHT_S: [f64; 2] = [0.5, 1.0];
const SOUGHT: usize = 20;
/// The catch is at this fraction of the sum of both times (code: just before the middle).
const CATCH_TIME_FRACTION: f64 = 0.475;
/// Time between plans, in seconds (code).
const PERIOD_S: f64 = 0.025;
/// Plans are not changed any more in the last seconds before the catch (code).
const FREEZE_S: f64 = 0.2;
/// Ticks are due a little early, for rounding.
const ROUNDING_S: f64 = 1e-9;

impl CatchPlanner for PaperPlanner {
    fn plan(&mut self, situation: &Situation<'_>) -> Decision {
        let config = &self.config;
        // Plans are due at whole multiples of the period: the first tick at or after each.
        let (now_s, before_s) = situation.observed_s;
        let time_s = now_s + ROUNDING_S;
        let before_s = before_s.map_or(f64::NEG_INFINITY, |it| it + ROUNDING_S);
        let is_due = (time_s / PERIOD_S).floor() > (before_s / PERIOD_S).floor();
        let (status, plan) = match situation.running {
            Some(running) => {
                let again = if is_due && time_s <= running.catch_s - FREEZE_S {
                    let start = start(situation, &config.motion);
                    motion::follow(&self.search.motion, &start, situation.flight, running, &config.motion)
                } else {
                    None
                };
                again.map_or_else(|| (Status::PlanKept, Some(running.clone())), |plan| (Status::Planned, Some(plan)))
            }
            None if is_due => self.first(situation),
            None => (Status::NoPlan, None),
        };
        Decision { status, plan, progress: situation.progress }
    }
}

/// The catch time (code; the text only says that it is chosen with the grasp): a fixed fraction of the times
/// at which the object comes within reach and leaves it, counted from the first sighting, which in the
/// paper's simulator is the throw.
fn catch_time_s(flight: &FlightTrajectory, first_seen_s: f64, base: &Point3<f64>) -> Option<f64> {
    let [from_s, until_s] = SOUGHT_S;
    let steps = SOUGHT - 1;
    let within = |after_s: &f64| {
        let p_WO = flight.pose_at(first_seen_s + after_s).translation.vector;
        let far_m = (p_WO - base.coords).xy().norm();
        (REACH_M[0]..=REACH_M[1]).contains(&far_m)
    };
    let mut times = (0..=steps).map(|i| from_s + (until_s - from_s) * i as f64 / steps as f64).filter(within);
    let first = times.next()?;
    let last = times.next_back().unwrap_or(first);
    Some(first_seen_s + CATCH_TIME_FRACTION * (first + last))
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Vector3;

    #[test]
    fn the_catch_is_just_before_the_middle_of_the_way_through_the_reach() {
        // On a circle of 0.6 m around the base between 0.6 and 0.8 s only.
        let flight = FlightTrajectory {
            time_s: 0.7,
            p_WOcm: Point3::new(0.6, 0.0, 5.0),
            v_WOcm: Vector3::new(0.0, 4.5, 0.0),
            ..FlightTrajectory::default()
        };
        let catch_s = catch_time_s(&flight, 0.0, &Point3::origin()).unwrap();
        // Of the times that are looked at the fifth is the first within, the twelfth the last.
        let at = |number: usize| 0.5 + 0.5 * number as f64 / 19.0;
        assert!((catch_s - 0.475 * (at(4) + at(11))).abs() < 1e-9, "{catch_s}");
        // Seen later by 0.09 s, its clock starts later.
        let catch_s = catch_time_s(&flight, 0.09, &Point3::origin()).unwrap();
        assert!((catch_s - 0.09 - 0.475 * (at(1) + at(7))).abs() < 1e-9, "{catch_s}");
        let far = FlightTrajectory { p_WOcm: Point3::new(3.0, 0.0, 5.0), ..flight };
        assert_eq!(catch_time_s(&far, 0.0, &Point3::origin()), None);
    }
}
