//! Catch planning as in the paper (III-C and III-D): grasp and catch time are chosen once; the motion follows the flight as it
//! becomes better known.

use std::sync::Arc;

use catch_bot::{
    Preparation, Status,
    control::{CatchPlanner, Decision, Situation},
    perception::ReferenceModel,
    settings::{SettingError, Settings},
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
    /// For the arm and the object of a preparation; grasps are drawn by `seed`.
    ///
    /// # Errors
    /// A setting that is out of its range.
    pub fn new(config: Config, known: &Preparation, seed: u64) -> Result<Self, SettingError> {
        config.check()?;
        Ok(Self { config, reference: known.reference().clone(), search: known.search().clone(), seed })
    }

    /// Grasp, catch time and a first motion.
    fn first(&self, situation: &Situation<'_>) -> (Status, Option<CatchPlan>) {
        let (config, planner) = (&self.config, self.search.motion());
        let (time_s, flight) = (situation.observed_s.0 + ROUNDING_S, situation.flight);
        let base = Point3::from(planner.robot().X_WB.translation.vector);
        let Some(catch_s) = catch_time_s(flight, situation.first_seen_s, &base, config) else {
            return (Status::OutOfReach, None);
        };
        if catch_s <= time_s + config.freeze_s {
            return (Status::OutOfReach, None);
        }
        let gripper = planner.gripper();
        let Some(chosen) = grasp::select(&self.reference, gripper, flight, catch_s, &base, self.seed, &config.grasp)
        else {
            return (Status::NoGrasp, None);
        };
        match motion::plan(planner, &start(situation, &config.motion), flight, catch_s, &chosen, &config.motion) {
            Some(plan) => (Status::Planned, Some(plan)),
            None => (Status::NoPlan, None),
        }
    }
}

/// Where a motion starts: in what the arm is commanded, or where the arm is.
fn start(situation: &Situation<'_>, config: &motion::Config) -> Start {
    let Start { time_s, state } = situation.start;
    let (q, dq) = situation.sensed;
    let state = if config.starts_where_sensed { Setpoint { q, dq, ..state } } else { state };
    Start { time_s, state }
}

/// Ticks are due a little early, for rounding.
const ROUNDING_S: f64 = 1e-9;

impl CatchPlanner for PaperPlanner {
    fn plan(&mut self, situation: &Situation<'_>) -> Decision {
        let config = &self.config;
        // Plans are due at whole multiples of the period: the first tick at or after each.
        let (now_s, before_s) = situation.observed_s;
        let time_s = now_s + ROUNDING_S;
        let before_s = before_s.map_or(f64::NEG_INFINITY, |it| it + ROUNDING_S);
        let is_due = (time_s / config.period_s).floor() > (before_s / config.period_s).floor();
        let (status, plan) = match situation.running {
            Some(running) => {
                let again = if is_due && time_s <= running.catch_s - config.freeze_s {
                    let start = start(situation, &config.motion);
                    motion::follow(self.search.motion(), &start, situation.flight, running, &config.motion)
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

/// The catch time (code; the text only says that it is chosen with the grasp): a fixed fraction of the times at which the object
/// comes within reach and leaves it, counted from the first sighting, which in the paper's simulator is the throw.
fn catch_time_s(flight: &FlightTrajectory, first_seen_s: f64, base: &Point3<f64>, config: &Config) -> Option<f64> {
    let [from_s, until_s] = config.sought_s;
    let steps = config.sought.max(2) - 1;
    let within = |after_s: &f64| {
        let p_WO = flight.pose_at(first_seen_s + after_s).translation.vector;
        let far_m = (p_WO - base.coords).xy().norm();
        (config.reach_m[0]..=config.reach_m[1]).contains(&far_m)
    };
    let mut times = (0..=steps).map(|i| from_s + (until_s - from_s) * i as f64 / steps as f64).filter(within);
    let first = times.next()?;
    let last = times.next_back().unwrap_or(first);
    Some(first_seen_s + config.catch_time_fraction * (first + last))
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
        let config = Config { sought: 501, ..Config::default() };
        let catch_s = catch_time_s(&flight, 0.0, &Point3::origin(), &config).unwrap();
        assert!((catch_s - 0.475 * 1.4).abs() < 2e-3, "{catch_s}");
        // Seen later by 0.1 s, its clock starts later.
        let catch_s = catch_time_s(&flight, 0.1, &Point3::origin(), &config).unwrap();
        assert!((catch_s - 0.1 - 0.475 * 1.2).abs() < 2e-3, "{catch_s}");
        let far = FlightTrajectory { p_WOcm: Point3::new(3.0, 0.0, 5.0), ..flight };
        assert_eq!(catch_time_s(&far, 0.0, &Point3::origin(), &config), None);
    }
}
