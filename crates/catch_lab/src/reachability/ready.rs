//! The best waiting pose for a distribution of throws.
//!
//! A pose is worth what the planner can do from it: for every throw of the distribution that the
//! [oracle](super::oracle) calls within reach it is asked for a catch, as if the flight were known when the
//! first estimate usually is, and the costs of its choices are summed; a throw that is out of reach or that
//! it cannot catch costs most. Poses near the best one so far are tried at random, in ever smaller steps.
//! What the best one is worth is told by throws that it was not chosen for.

use std::sync::Arc;

use catch_body::{
    JointVector,
    inverse_kinematics::{ParallelAxesArm, SphericalShoulderArm, SrsArm},
    statistics::median,
};
use catch_bot::{
    Preparation, grasp_selection,
    trajectory_optimization::{Incoming, Start, failure_counter::FailureCounter},
    trajectory_prediction::FlightTrajectory,
};
use catch_cell::arm::Setpoint;
use catch_sim::Release;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;

use crate::{
    reachability::oracle::{Flight, Oracle},
    scenario::setup::Setup,
};

/// Usual time of the brain's first estimate, in seconds: three frames at 100 Hz, and one more.
const FIRST_ESTIMATE_S: f64 = 0.04;
/// Times of a catch that the oracle is asked for are this far apart, in seconds.
const CATCH_INTERVAL_S: f64 = 0.03;
/// Cost of a throw that cannot be caught: more than any catch.
const MISSED: f64 = 60.0;
/// A waiting arm keeps this far from itself and from the floor, in metres.
const CLEARANCE_M: f64 = 0.05;

/// A pose and what it is worth.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Ready {
    /// Joint positions.
    pub q: JointVector,
    /// Throws that the planner can catch from there.
    pub caught: usize,
    /// Throws that were asked for.
    pub throws: usize,
    /// Mean cost.
    pub cost: f64,
    /// Median over the throws of the largest joint's travel to the catch, in radians.
    pub travel_rad: f64,
}

/// The throws for which a pose is wanted, and planners to ask.
pub struct Corridor<'a> {
    parts: Vec<Part>,
    /// True if the oracle is asked before the planner. Where only the planner has inverse kinematics in
    /// closed form, it is the quicker one.
    asks_oracle: bool,
    oracle: Oracle<'a>,
}

struct Part {
    known: Arc<Preparation>,
    grasping: grasp_selection::Config,
    /// Flights as the oracle and as the planner have them.
    flights: Vec<(Flight, FlightTrajectory)>,
}

impl<'a> Corridor<'a> {
    /// `throws` throws of each setup. All setups share one robot.
    ///
    /// # Panics
    /// Without any setup.
    pub fn new(setups: &'a [Setup], throws: u64, seed: u64) -> Self {
        let parts = setups.iter().map(|setup| Part {
            known: setup.known().clone(),
            grasping: setup.uncalibrated_config().grasp_selection,
            flights: (0..throws)
                .map(|index| (Flight::of(setup, seed, index), flight(&setup.release(seed, index))))
                .collect(),
        });
        let robot = &setups[0].robot;
        let is_in_closed_form = SrsArm::of(robot).is_some() || ParallelAxesArm::of(robot).is_some();
        Self {
            asks_oracle: is_in_closed_form || SphericalShoulderArm::of(robot).is_none(),
            parts: parts.collect(),
            oracle: Oracle::of(&setups[0]),
        }
    }

    /// Evaluates waiting at `q`; `None` if the arm cannot stand there, or if the mean cost is above
    /// `most_cost`.
    pub fn value(&self, q: &JointVector, most_cost: f64) -> Option<Ready> {
        let mut joints = self.oracle.robot.joints.iter().zip(q.iter());
        let within = joints.all(|(joint, q)| (joint.limits.lower..=joint.limits.upper).contains(q));
        if !within || self.oracle.clearance_m(q) < CLEARANCE_M {
            return None;
        }
        let start = Start { time_s: FIRST_ESTIMATE_S, state: Setpoint::at_rest(*q) };
        let throws: usize = self.parts.iter().map(|part| part.flights.len()).sum();
        let (mut cost, mut travels) = (0.0, Vec::new());
        let failures = FailureCounter::default();
        for part in &self.parts {
            for (true_flight, flight) in &part.flights {
                let incoming =
                    Incoming { flight, grasps: &part.known.grasps, config: &part.grasping, failures: &failures };
                let may_reach = !self.asks_oracle || self.first_catch_s(true_flight, q).is_some();
                let plan = if may_reach { part.known.search.search(&start, &incoming).ok() } else { None };
                cost += plan.as_ref().map_or(MISSED, |plan| plan.cost) / throws as f64;
                if cost > most_cost {
                    return None;
                }
                travels.extend(plan.map(|plan| (plan.q - q).amax()));
            }
        }
        let (caught, travel_rad) = (travels.len(), median(travels).unwrap_or(0.0));
        Some(Ready { q: *q, caught, throws, cost, travel_rad })
    }

    /// Returns the number of throws within reach of an arm that waits at `q`, according to the oracle.
    pub fn within_reach(&self, q: &JointVector) -> usize {
        let flights = self.parts.iter().flat_map(|part| &part.flights);
        flights.filter(|(flight, _)| self.first_catch_s(flight, q).is_some()).count()
    }

    fn first_catch_s(&self, flight: &Flight, q: &JointVector) -> Option<f64> {
        self.oracle.first_catch_s(flight, q, FIRST_ESTIMATE_S, CATCH_INTERVAL_S)
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
        let mut best = self.value(start, f64::INFINITY);
        for attempt in 0..tries {
            // From a third of each joint's range down to a few hundredths of a radian.
            let size = 0.6 * libm::pow(0.05_f64 / 0.6, attempt as f64 / tries as f64);
            let centre = best.map_or(*start, |ready| ready.q);
            let step = self.oracle.robot.per_joint(|joint| (joint.limits.upper - joint.limits.lower) / 6.0);
            let q = JointVector::from_fn(|i, _| {
                let moves = rng.random_bool(0.5);
                let by: f64 = rng.random_range(-1.0..1.0);
                centre[i] + if moves { by * size * step[i] } else { 0.0 }
            });
            let most_cost = best.map_or(f64::INFINITY, |best| best.cost);
            best = self.value(&q, most_cost).or(best);
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
        p_WOcm: release.p_WO,
        v_WOcm: release.v_WO,
        R_WO: release.q_WO,
        w_WO: release.omega_WO,
        ..FlightTrajectory::default()
    }
}
