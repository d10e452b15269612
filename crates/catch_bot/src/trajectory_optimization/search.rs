//! The choice of catch time, grasp and redundancy.
//!
//! Best first: every pair of catch time and grasp that the elbow could reach enters a heap with the least that it can cost. What
//! is on top is looked at more closely: a pair becomes postures ([`SrsArm::swivels`](catch_body::inverse_kinematics::SrsArm::swivels)
//! cut to what each joint can reach), a posture gets its arrival velocities, an arrival its motion, and each step adds what it
//! costs. The first motion that keeps all limits and clearances ends a pass, and most of the rest is never looked at.
//!
//! Arms without closed form have a [`ReachMap`](super::reach_map::ReachMap): pairs that are too far by it are left out, and the others enter with the
//! reachability margin that it estimates, until postures tell the true one.
//!
//! The search is weighted, not admissible: failures of a grasp add a penalty to its catches at all times, and the map's estimate
//! may be too high, by 0.1 to 0.3; either may put a better catch last. What is found nowhere is sought again at times in between.
//! Then, in a second round, nothing is left out for the map's sake, postures are sought from more starts and along the null space,
//! and what got as far as a motion or the approach is tried a little sooner and later; only then has the search failed. In flight
//! each image brings as many passes as a bounded amount of work allows, the same for all arms.

mod candidate;
mod frontier;
mod reach;
mod settings;

use catch_body::{JointVector, Pose};
use nalgebra::{Point3, Vector3};

use super::{
    CatchPlan, CatchSearch, Incoming, PlanningFailure, Start,
    point_to_point::{PointToPoint, Reached},
    posture::Posture,
    reachability::fraction_used,
    swept_volume::{Entering, Obstacle},
    terminal_velocity::{TerminalVelocity, Weights as TerminalVelocityWeights},
};
use candidate::{Candidate, CatchTimeSample};
use frontier::{Frontier, Node, Stage};
use reach::Reach;
pub use settings::{Config, Weights};

use crate::{
    grasp_selection::{Approach, Grasp, RankedGrasp, heuristics},
    trajectory_prediction::{FlightPropagator, LocalFlight},
};

/// Where the catch times of the passes lie, in fractions of the step between them.
const OFFSETS: [f64; 8] = [0.5, 0.0, 0.25, 0.75, 0.125, 0.625, 0.375, 0.875];
/// Passes that make up a search. In the second round what got as far as the approach or a motion is tried a little sooner and
/// later, too ([`Config::nearby_s`]).
pub const PASSES: usize = 2 * OFFSETS.len();
/// The work of a posture and of an arrival, in the units of [`Config::max_work`].
const WORK_OF_A_POSTURE: usize = 3;
const WORK_OF_A_TERMINAL_VELOCITY: usize = 10;
/// That of an approach and a motion, and of its openings.
const WORK_OF_A_MOTION: usize = 80;
const WORK_OF_APERTURES: usize = 30;

/// A catch that every joint can reach.
#[derive(Debug, Clone, Copy)]
pub(super) struct ReachableCatch {
    pub catch_s: f64,
    pub approach: Approach,
    pub X_WG: Pose,
    pub posture: Posture,
    pub cost: f64,
    /// What of it the heuristics are.
    pub grasp_cost: f64,
}

/// What a search is about, and what it has met.
struct Search<'a> {
    start: &'a Start,
    incoming: &'a Incoming<'a>,
    /// What can be reached when, if that is known for where the arm departed from.
    reach: Option<Reach<'a>>,
    /// What was last in the way into each grasp.
    obstacles: Vec<Obstacle>,
    /// The work that has been done.
    work: usize,
}

impl CatchSearch {
    /// The best catch of an object on `flight` that the arm can reach from `start`, without a bound on the work.
    ///
    /// # Errors
    /// Why there is none.
    pub fn search(&self, start: &Start, incoming: &Incoming) -> Result<CatchPlan, PlanningFailure> {
        let mut search = self.begin(start, incoming, self.departure_s(start));
        let mut failure = PlanningFailure::NoGrasp;
        for pass in 0..PASSES {
            match self.best_first(&mut search, pass, usize::MAX) {
                Err(why) => failure = failure.max(why),
                found => return found,
            }
        }
        Err(failure)
    }

    /// As many of the passes that make up the [search](Self::search) as a bounded amount of work allows, from number `pass` on,
    /// which is counted up by those that found nothing. A flight that nothing catches at first is searched once more with every
    /// new image. `departure_s` is when the arm [departed](Self::departure_s) from the ready pose, if it did and has not stood still
    /// anywhere else since.
    ///
    /// # Errors
    /// Why they found none.
    pub fn search_in_passes(
        &self,
        pass: &mut usize,
        start: &Start,
        incoming: &Incoming,
        departure_s: Option<f64>,
    ) -> Result<CatchPlan, PlanningFailure> {
        let mut search = self.begin(start, incoming, departure_s);
        let mut failure = PlanningFailure::NoGrasp;
        for _ in 0..PASSES {
            let left = self.motion.config.search.max_work.saturating_sub(search.work);
            if left == 0 {
                break;
            }
            match self.best_first(&mut search, *pass, left) {
                Err(why) => failure = failure.max(why),
                found => return found,
            }
            *pass += 1;
        }
        Err(failure)
    }

    fn begin<'a>(&'a self, start: &'a Start, incoming: &'a Incoming<'a>, departure_s: Option<f64>) -> Search<'a> {
        let obstacles = vec![Obstacle::default(); incoming.grasps.grasps.len()];
        let reach = self.reach_map.as_deref().zip(departure_s);
        let reach = reach.map(|(map, departure_s)| Reach { map, departure_s });
        Search { start, incoming, reach, obstacles, work: 0 }
    }

    /// The cheapest catch that one pass finds, doing no more than `most_work`.
    fn best_first(&self, search: &mut Search, pass: usize, most_work: usize) -> Result<CatchPlan, PlanningFailure> {
        let is_thorough = pass % PASSES >= OFFSETS.len();
        let (mut samples, mut candidates, any_grasp) =
            self.candidates(search, OFFSETS[pass % OFFSETS.len()], is_thorough);
        let mut goes_nearby = is_thorough;
        let Search { start, incoming, reach, ref mut obstacles, ref mut work } = *search;
        let grasps = &incoming.grasps.grasps;
        // Ranking grasps is work as well, a fiftieth of a unit each.
        *work += samples.len() * grasps.len() / 50;
        let before = *work;
        let (weights, from, scaling) = (&self.motion.config.weights, &start.state.q, self.motion.moving_scaling());
        let (config, finder) = (&self.motion.config.search, &self.motion.finder);
        let mut frontier = Frontier::new(config.failure_penalty);
        let unseen = |candidate: usize, it: &Candidate, samples: &[CatchTimeSample]| {
            let LocalFlight { time_s, V_WO, .. } = &samples[it.sample].local_flight;
            let holding = self.holding_cost(it.ranked.cost, &V_WO.linear, self.motion.config.max_speed_fraction, 0.0);
            let cost = holding + weights.delay * (time_s - start.time_s) + it.margin_cost;
            Node { candidate, stage: Stage::Pose, cost, failures: 0 }
        };
        for (candidate, it) in candidates.iter().enumerate() {
            frontier.push(unseen(candidate, it, &samples));
        }
        let is_near = !samples.is_empty();
        let mut failure = if is_near && !any_grasp { PlanningFailure::NoGrasp } else { PlanningFailure::OutOfReach };
        let mut failures = vec![0; grasps.len()];
        loop {
            let Some(node) = frontier.pop() else {
                if !std::mem::take(&mut goes_nearby) {
                    return Err(failure);
                }
                let known = candidates.len();
                self.add_nearby(start, incoming, reach, &mut samples, &mut candidates);
                *work += candidates.len() - known;
                for (candidate, it) in candidates.iter().enumerate().skip(known) {
                    frontier.push(unseen(candidate, it, &samples));
                }
                continue;
            };
            let Node { candidate, stage, cost, .. } = node;
            let Candidate { sample, ranked, margin_cost, enters, velocity_trials, failed } = &mut candidates[candidate];
            let (at, RankedGrasp { index, X_WG, approach, .. }) = (&samples[*sample], *ranked);
            let failures = &mut failures[index];
            if node.failures < *failures {
                frontier.push(Node { failures: *failures, ..node });
                continue;
            }
            *work += match stage {
                Stage::Pose => finder.work(is_thorough),
                Stage::Posture(_) => WORK_OF_A_POSTURE,
                Stage::TerminalVelocity(..) => WORK_OF_A_TERMINAL_VELOCITY,
            };
            if *work - before > most_work {
                return Err(PlanningFailure::OutOfBudget);
            }
            let (catch_s, v_WO) = (at.local_flight.time_s, at.local_flight.V_WO.linear);
            let entering = Entering { incoming, local_flight: &at.local_flight, grasp: &grasps[index] };
            let point_to_point = |q: &JointVector| self.motion.point_to_point(start, catch_s, &X_WG, q, &v_WO, scaling);
            let obstacle = &mut obstacles[index];
            let v_GO = X_WG.rotation.inverse_transform_vector(&v_WO);
            match stage {
                Stage::Pose => {
                    let postures = finder.postures(&self.motion.robot, &X_WG, from, &at.ranges, is_thorough);
                    // The object's approach is costly to look at; here it only tells why there is no catch.
                    if !postures.is_empty() && failure < PlanningFailure::NoMotion {
                        failure = if self.straight_approach_is_free(&v_GO, &entering, obstacle) {
                            PlanningFailure::NoMotion
                        } else {
                            PlanningFailure::Blocked
                        };
                    }
                    for posture in postures {
                        let Some(reach_fraction) = fraction_used(&at.joints, from, &posture.q, self.motion.robot.dof())
                        else {
                            continue;
                        };
                        let cost = cost - *margin_cost
                            + weights.reach_fraction * reach_fraction.powi(4)
                            + weights.comfort * (posture.q - self.motion.robot.comfortable_q).norm();
                        frontier.push(Node { stage: Stage::Posture(posture), cost, ..node });
                    }
                }
                Stage::Posture(_) if *velocity_trials == config.max_velocity_trials => {}
                Stage::Posture(_) | Stage::TerminalVelocity(..) if *failed == config.max_motion_trials => {}
                Stage::Posture(posture) => {
                    let q = posture.q;
                    if !self.motion.stands_clear(&q) {
                        continue;
                    }
                    *velocity_trials += 1;
                    let bounds = self.motion.terminal_velocity_bounds(&at.joints, from, &q);
                    let Some(terminal_velocity) =
                        bounds.and_then(|bounds| point_to_point(&q).terminal_velocity(&bounds))
                    else {
                        *failures += usize::from(*velocity_trials == config.max_velocity_trials);
                        continue;
                    };
                    let holding = |fraction, spin| self.holding_cost(ranked.cost, &v_WO, fraction, spin);
                    let least = holding(self.motion.config.max_speed_fraction, 0.0);
                    let cost = cost + holding(terminal_velocity.speed_fraction, terminal_velocity.w_WG.norm()) - least;
                    frontier.push(Node { stage: Stage::TerminalVelocity(posture, terminal_velocity), cost, ..node });
                }
                Stage::TerminalVelocity(posture, balanced) => {
                    let q = posture.q;
                    let reachable = ReachableCatch { catch_s, approach, X_WG, posture, cost, grasp_cost: ranked.cost };
                    let Some(bounds) = self.motion.terminal_velocity_bounds(&at.joints, from, &q) else { continue };
                    for weights in [TerminalVelocityWeights::BALANCED, TerminalVelocityWeights::STEADY] {
                        let point_to_point = PointToPoint { weights, ..point_to_point(&q) };
                        let known = (weights == TerminalVelocityWeights::BALANCED).then_some(balanced);
                        let Some(terminal_velocity) = known.or_else(|| point_to_point.terminal_velocity(&bounds))
                        else {
                            continue;
                        };
                        if !self.approach_is_free(&X_WG, &terminal_velocity, &entering, obstacle)
                            || !*enters
                                .get_or_insert_with(|| self.straight_approach_is_free(&v_GO, &entering, obstacle))
                        {
                            continue;
                        }
                        *work += WORK_OF_A_MOTION;
                        // Where no velocities along the flight are left, none are with other weights.
                        let Some(reached) = point_to_point.best(bounds, -1.0) else { break };
                        let Some(plan) = self.finish(&reachable, entering.grasp, reached, &point_to_point) else {
                            continue;
                        };
                        *work += WORK_OF_APERTURES;
                        if let Some(aperture_m) = self.aperture(&plan, incoming, &at.local_flight) {
                            return Ok(CatchPlan { aperture_m, approach_is_free: true, ..plan });
                        }
                    }
                    *failed += 1;
                    *failures += 1;
                }
            }
        }
    }

    /// Every catch time on the flight, and with every grasp that suits it there and that the elbow can reach; and whether any suits it
    /// anywhere. Grasps that are too far by the reach map are among them only if the search is `thorough`, as the map is no proof.
    fn candidates(&self, task: &Search, offset: f64, thorough: bool) -> (Vec<CatchTimeSample>, Vec<Candidate>, bool) {
        let base = Point3::from(self.motion.robot.X_WB.translation.vector);
        let (mut samples, mut candidates, mut any_grasp) = (Vec::new(), Vec::new(), false);
        let weights = &self.motion.config.weights;
        let mut propagator = task.incoming.flight.propagator();
        let steps = (self.motion.config.search.latest_catch_s / self.motion.config.time_step_s) as usize;
        for step in 0..steps {
            let lead_s = self.motion.config.min_lead_s + (step as f64 + offset) * self.motion.config.time_step_s;
            let catch_s = task.start.time_s + lead_s;
            let p_WO = propagator.position_at(catch_s);
            if p_WO.z < 0.0 {
                break;
            }
            if (p_WO - base).norm() > self.motion.longest_reach_m {
                continue;
            }
            let at = self.sample(task.start, &mut propagator, catch_s);
            let (X_WO, v_WO) = (&at.local_flight.X_WO, &at.local_flight.V_WO.linear);
            let may_reach = self.motion.finder.may_reach(X_WO, &at.ranges);
            let is_in_time =
                |X_OG: &Pose| thorough || task.reach.is_none_or(|reach| reach.is_in_time(&(X_WO * X_OG), catch_s));
            let may_catch = |X_OG: &Pose| may_reach(X_OG) && is_in_time(X_OG);
            let (ranked, any) = task.incoming.grasps.rank(X_WO, v_WO, &base, task.incoming.config, may_catch);
            any_grasp |= any;
            candidates.extend(ranked.into_iter().map(|ranked| {
                let margin_cost = task.reach.map_or(0.0, |it| it.margin_cost(&ranked.X_WG, catch_s, weights));
                Candidate::new(samples.len(), ranked, margin_cost)
            }));
            samples.push(at);
        }
        (samples, candidates, any_grasp)
    }

    /// Adds what got as far as the approach or a motion, a little sooner and later.
    fn add_nearby(
        &self,
        start: &Start,
        incoming: &Incoming,
        reach: Option<Reach>,
        samples: &mut Vec<CatchTimeSample>,
        candidates: &mut Vec<Candidate>,
    ) {
        let base = Point3::from(self.motion.robot.X_WB.translation.vector);
        let mut propagator = incoming.flight.propagator();
        for at in 0..samples.len() {
            let close: Vec<usize> =
                candidates.iter().filter(|it| it.sample == at && it.failed > 0).map(|it| it.ranked.index).collect();
            for by_s in self.motion.config.search.nearby_s.iter().filter(|_| !close.is_empty()) {
                let catch_s = samples[at].local_flight.time_s + by_s;
                if catch_s < start.time_s + self.motion.config.min_lead_s {
                    continue;
                }
                let sample = self.sample(start, &mut propagator, catch_s);
                let LocalFlight { X_WO, V_WO, .. } = &sample.local_flight;
                for &index in &close {
                    let (grasp, weights) = (&incoming.grasps.grasps[index], &incoming.config.weights);
                    let ranked = heuristics::rank_alone(index, grasp, X_WO, &V_WO.linear, &base, weights);
                    let weights = &self.motion.config.weights;
                    let margin_cost = reach.map_or(0.0, |it| it.margin_cost(&ranked.X_WG, catch_s, weights));
                    candidates.push(Candidate::new(samples.len(), ranked, margin_cost));
                }
                samples.push(sample);
            }
        }
    }

    /// What can be reached by a catch time.
    fn sample(&self, start: &Start, propagator: &mut FlightPropagator, catch_s: f64) -> CatchTimeSample {
        let joints = self.motion.reaches(start, catch_s - start.time_s, self.motion.moving_scaling());
        let ranges = self.motion.ranges(&joints, &start.state.q);
        CatchTimeSample { local_flight: propagator.local_flight_at(catch_s), joints, ranges }
    }

    /// What tells how well an object will be held: its grasp's heuristics, how fast it passes the fingers and how fast they turn.
    fn holding_cost(&self, grasp_cost: f64, v_WO: &Vector3<f64>, speed_fraction: f64, spin_radps: f64) -> f64 {
        let weights = &self.motion.config.weights;
        grasp_cost + weights.speed * v_WO.norm() * (1.0 - speed_fraction) + weights.spin * spin_radps
    }

    /// Turns a candidate into a plan over these splines, `None` if that does not keep torque limits and clearances.
    pub(super) fn finish(
        &self,
        reachable: &ReachableCatch,
        grasp: &Grasp,
        (terminal_velocity, control_points): Reached,
        point_to_point: &PointToPoint,
    ) -> Option<CatchPlan> {
        let trajectory = self.motion.through(point_to_point.start.time_s, reachable.catch_s, control_points, grasp)?;
        let ReachableCatch { catch_s, approach, X_WG, posture: Posture { q, elbow }, cost, grasp_cost } = *reachable;
        let spin_radps = terminal_velocity.w_WG.norm();
        Some(CatchPlan {
            catch_s,
            grasp: grasp.clone(),
            approach,
            X_WG,
            q,
            aperture_m: grasp.aperture_m,
            approach_is_free: false,
            elbow,
            speed_fraction: terminal_velocity.speed_fraction,
            spin_radps,
            weights: point_to_point.weights,
            cost,
            holding_cost: self.holding_cost(
                grasp_cost,
                &point_to_point.v_WO,
                terminal_velocity.speed_fraction,
                spin_radps,
            ),
            trajectory,
        })
    }
}
