//! The paper's own method, for comparison: its perception (ICP, III-B), its prediction (RANSAC alone, III-B), its grasp selection
//! (III-C, [`grasp`]) and its trajectory optimization (III-D, [`motion`]).
//!
//! Figures that the paper does not give are those of the authors' code. Where code and text differ the modules say so, and which
//! one is followed. What a real arm could not do is not done here either: motions start where the arm is, none breaks a limit of
//! the arm (they are part of the program; the paper has position and velocity limits only), none is carried out that is not
//! safe, and the gripper closes when the prediction says so, not when the simulator's truth does. A scenario may lift the
//! limits of its arm; the method is the same.

pub mod grasp;
pub mod motion;

use catch_body::JointVector;
use nalgebra::Point3;
use serde::{Deserialize, Serialize};

use crate::{
    CatchingBot, Status, perception,
    trajectory_optimization::{CatchPlan, Start, sqp::Tolerance},
    trajectory_prediction::{self, FlightTrajectory},
};

/// Settings of the paper's method.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Config {
    /// Settings of III-C.
    pub grasp: grasp::Config,
    /// Settings of III-D.
    pub motion: motion::Config,
    /// The object is within reach between these distances from the axis of the base, in metres (code).
    pub reach_m: [f64; 2],
    /// Times after the first sighting among which it is sought when it comes within reach and leaves it, in seconds (code).
    pub sought_s: [f64; 2],
    /// How many such times (code).
    pub sought: usize,
    /// The catch is at this share of the sum of both times (code: just before the middle).
    pub catch_share: f64,
    /// Time between plans, in seconds (code).
    pub period_s: f64,
    /// Plans are not changed any more in the last seconds before the catch (code).
    pub freeze_s: f64,
}

impl Default for Config {
    fn default() -> Self {
        Self {
            grasp: grasp::Config::default(),
            motion: motion::Config::default(),
            reach_m: [0.42, 0.75],
            sought_s: [0.5, 1.0],
            sought: 20,
            catch_share: 0.475,
            period_s: 0.025,
            freeze_s: 0.2,
        }
    }
}

/// A brain's settings with the paper's perception and prediction in place of ours.
pub fn with_its_stages(mut config: crate::Config) -> crate::Config {
    config.perception.method = perception::Method::IcpPointToPoint;
    config.trajectory_prediction.method = trajectory_prediction::Method::Ransac;
    config
}

/// III-C and III-D: grasp and catch time are chosen once; the motion to it follows the flight as it becomes better known.
pub fn decide(brain: &CatchingBot, start: &Start, flight: &FlightTrajectory) -> (Status, Option<CatchPlan>) {
    let known = &brain.known;
    let config = &known.config.paper_method;
    // Plans are due at whole multiples of the period: the first tick at or after each.
    let mut ticks = brain.sensed.iter().rev().map(|sensed| sensed.0 + 1e-9);
    let time_s = ticks.next().unwrap_or(start.time_s);
    let before_s = ticks.next().unwrap_or(f64::NEG_INFINITY);
    let is_due = (time_s / config.period_s).floor() > (before_s / config.period_s).floor();
    if let Some(plan) = &brain.plan {
        let kept = (Status::PlanKept, Some(plan.clone()));
        if !is_due || time_s > plan.catch_s - config.freeze_s {
            return kept;
        }
        let again = motion::follow(&known.planner, start, flight, plan, &config.motion);
        return again.map_or(kept, |plan| (Status::Planned, Some(plan)));
    }
    if !is_due {
        return (Status::NoPlan, None);
    }
    let base = Point3::from(known.planner.robot().X_WB.translation.vector);
    let first_seen_s = brain.poses.first().map_or(time_s, |pose| pose.capture_s);
    let Some(catch_s) = catch_time_s(flight, first_seen_s, &base, config) else {
        return (Status::OutOfReach, None);
    };
    if catch_s <= time_s + config.freeze_s {
        return (Status::OutOfReach, None);
    }
    let gripper = known.planner.gripper();
    let Some(chosen) = grasp::select(&known.reference, gripper, flight, catch_s, &base, brain.seed, &config.grasp)
    else {
        return (Status::NoGrasp, None);
    };
    match motion::plan(&known.planner, start, flight, catch_s, chosen, &config.motion) {
        Some(plan) => (Status::Planned, Some(plan)),
        None => (Status::NoPlan, None),
    }
}

/// The catch time (code; the text only says that it is chosen with the grasp): a fixed share of the times at which the object
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
    Some(first_seen_s + config.catch_share * (first + last))
}

/// The tolerances of one optimization, as files have them.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Tolerances {
    /// Along each axis, in metres.
    pub position_m: f64,
    /// About each axis, in radians.
    pub rotation_rad: f64,
    /// Along each axis, in m/s.
    pub velocity_mps: f64,
}

impl From<Tolerances> for Tolerance {
    fn from(it: Tolerances) -> Self {
        Self { position_m: it.position_m, rotation_rad: it.rotation_rad, velocity_mps: it.velocity_mps }
    }
}

/// Joint positions between two, evenly spaced.
fn between(from: &JointVector, to: &JointVector, count: usize) -> Vec<JointVector> {
    (0..count).map(|i| from.lerp(to, i as f64 / (count - 1) as f64)).collect()
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
            p_WO: Point3::new(0.6, 0.0, 5.0),
            v_WO: Vector3::new(0.0, 4.5, 0.0),
            ..FlightTrajectory::default()
        };
        let config = Config { sought: 501, ..Config::default() };
        let catch_s = catch_time_s(&flight, 0.0, &Point3::origin(), &config).unwrap();
        assert!((catch_s - 0.475 * 1.4).abs() < 2e-3, "{catch_s}");
        // Seen later by 0.1 s, its clock starts later.
        let catch_s = catch_time_s(&flight, 0.1, &Point3::origin(), &config).unwrap();
        assert!((catch_s - 0.1 - 0.475 * 1.2).abs() < 2e-3, "{catch_s}");
        let far = FlightTrajectory { p_WO: Point3::new(3.0, 0.0, 5.0), ..flight };
        assert_eq!(catch_time_s(&far, 0.0, &Point3::origin(), &config), None);
    }
}
