//! The best waiting pose for a distribution of throws.
//!
//! A pose is worth what the planner can do from it: for every throw of the distribution it is asked for a catch, as if the flight
//! were known when the first estimate usually is, and the costs of its choices are summed; a throw that it cannot catch
//! costs most. Poses near the best one so far are tried at random, in ever smaller steps.

use std::sync::Arc;

use catch_body::{JointVector, clearance::ArmClearance};
use catch_bot::{
    Preparation, grasp_selection,
    trajectory_optimization::{CatchPlan, Incoming, Start},
    trajectory_prediction::FlightTrajectory,
};
use catch_cell::arm::Setpoint;
use catch_sim::Release;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;

use crate::{scenario::setup::Setup, statistics::median};

/// When the brain usually has its first estimate: the paper's six frames at 100 Hz, and one more.
const FIRST_ESTIMATE_S: f64 = 0.07;
/// What a throw costs that cannot be caught: more than any catch.
const MISSED: f64 = 60.0;
/// A waiting arm keeps this far from itself and from the floor, in metres.
const CLEARANCE_M: f64 = 0.05;

/// A pose and what it is worth.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Ready {
    /// Joint positions.
    pub q: JointVector,
    /// Throws that can be caught from there.
    pub caught: usize,
    /// Throws that were asked for.
    pub throws: usize,
    /// Mean cost.
    pub cost: f64,
    /// Median over the throws of the largest joint's travel to the catch, in radians.
    pub travel_rad: f64,
}

/// The throws for which a pose is wanted, and planners to ask.
pub struct Corridor {
    parts: Vec<Part>,
    clearance: ArmClearance,
    robot: catch_body::Robot,
    width_m: f64,
}

struct Part {
    known: Arc<Preparation>,
    grasping: grasp_selection::Config,
    flights: Vec<FlightTrajectory>,
}

impl Corridor {
    /// `throws` throws of each setup. All setups share one robot.
    ///
    /// # Panics
    /// Without any setup.
    pub fn new(setups: &[Setup], throws: u64, seed: u64) -> Self {
        let parts = setups.iter().map(|setup| Part {
            known: setup.known().clone(),
            grasping: setup.brain_config(seed, 0).grasp_selection,
            flights: (0..throws).map(|index| flight(&setup.release(seed, index))).collect(),
        });
        let Setup { robot, gripper, .. } = &setups[0];
        Self {
            parts: parts.collect(),
            clearance: ArmClearance::new(robot, gripper),
            robot: robot.clone(),
            width_m: gripper.max_width_m,
        }
    }

    /// The catches that the planner would choose from `q`, `None` for each throw that it cannot catch.
    pub fn catches(&self, q: &JointVector) -> Vec<Option<CatchPlan>> {
        let start = Start { time_s: FIRST_ESTIMATE_S, state: Setpoint::at_rest(*q) };
        let ask = |part: &Part, flight| {
            let incoming = Incoming { flight, grasps: part.known.grasps(), config: &part.grasping };
            part.known.search().search(&start, &incoming).ok()
        };
        self.parts.iter().flat_map(|part| part.flights.iter().map(move |flight| ask(part, flight))).collect()
    }

    /// What waiting at `q` is worth; `None` if the arm cannot stand there.
    pub fn value(&self, q: &JointVector) -> Option<Ready> {
        let X_WL = self.robot.link_poses(q);
        let free =
            self.clearance.self_clearance(&X_WL, self.width_m).min(self.clearance.floor_clearance(&X_WL, self.width_m));
        let within = self
            .robot
            .joints
            .iter()
            .zip(q.iter())
            .all(|(joint, q)| (joint.limits.lower..=joint.limits.upper).contains(q));
        if !within || free < CLEARANCE_M {
            return None;
        }
        let catches = self.catches(q);
        let cost = catches.iter().map(|plan| plan.as_ref().map_or(MISSED, |plan| plan.cost)).sum::<f64>()
            / catches.len() as f64;
        let travels: Vec<f64> = catches.iter().flatten().map(|plan| (plan.q - q).amax()).collect();
        Some(Ready {
            q: *q,
            caught: travels.len(),
            throws: catches.len(),
            cost,
            travel_rad: median(travels).unwrap_or(0.0),
        })
    }

    /// Tries `tries` poses, starting from `start`; `observer` is told after each how many were tried, and of
    /// the best so far.
    pub fn search(
        &self,
        start: &JointVector,
        tries: usize,
        seed: u64,
        observer: &mut dyn FnMut(usize, &Ready),
    ) -> Option<Ready> {
        let mut rng = Pcg64::seed_from_u64(seed);
        let mut best = self.value(start);
        for attempt in 0..tries {
            // From a third of each joint's range down to a few hundredths of a radian.
            let size = 0.6 * (0.05_f64 / 0.6).powf(attempt as f64 / tries as f64);
            let centre = best.map_or(*start, |ready| ready.q);
            let step = self.robot.per_joint(|joint| (joint.limits.upper - joint.limits.lower) / 6.0);
            let q = JointVector::from_fn(|i, _| {
                let moves = rng.random_bool(0.5);
                let by: f64 = rng.random_range(-1.0..1.0);
                centre[i] + if moves { by * size * step[i] } else { 0.0 }
            });
            if let Some(ready) = self.value(&q)
                && best.is_none_or(|best| ready.cost < best.cost)
            {
                best = Some(ready);
            }
            if let Some(best) = &best {
                observer(attempt + 1, best);
            }
        }
        best
    }
}

/// The flight of a release without air.
fn flight(release: &Release) -> FlightTrajectory {
    FlightTrajectory {
        time_s: 0.0,
        p_WO: release.p_WO,
        v_WO: release.v_WO,
        R_WO: release.q_WO,
        w_WO: release.omega_WO,
        ..FlightTrajectory::default()
    }
}
