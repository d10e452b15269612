//! The choice of catch time, grasp and redundancy.
//!
//! Best first: every pair of catch time and grasp that the elbow could reach enters a heap with the least that it can cost. What
//! is on top is looked at more closely: a pair becomes postures ([`SrsArm::swivels`](catch_body::inverse_kinematics::SrsArm::swivels)
//! cut to what each joint can reach), a posture gets its arrival velocities, an arrival its motion, and each step adds what it
//! costs. The first motion that keeps all limits and clearances ends a pass, and most of the rest is never looked at. The search is
//! weighted, not admissible: failures of a grasp add a penalty to its catches at all times, which may put a better one last. What
//! is found nowhere is sought again at times in between, and what got as far as a motion or the approach a little sooner and
//! later; only then has the search failed. In flight each image brings as many such passes as a bounded amount of work allows.

mod frontier;
mod settings;

use catch_body::{JointVector, MAX_JOINTS, Pose};
use nalgebra::{Point3, Vector3};

use super::{
    CatchPlan, CatchSearch, Incoming, PlanningFailure, Start,
    point_to_point::{PointToPoint, Reached},
    posture::Posture,
    reachability::{ReachableSet, fraction_used},
    swept_volume::{Entering, Obstacle},
    terminal_velocity::{TerminalVelocity, Weights as TerminalVelocityWeights},
};
use frontier::{Frontier, Node, Stage};
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
/// The work of an approach and a motion, and of its openings, in the units of [`Config::max_work`].
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

/// What is known at one catch time.
struct CatchTimeSample {
    local_flight: LocalFlight,
    joints: [ReachableSet; MAX_JOINTS],
    ranges: [[f64; 2]; MAX_JOINTS],
}

/// A catch time with a grasp.
struct Candidate {
    sample: usize,
    ranked: RankedGrasp,
    /// Whether the object can come into the open gripper on a straight line, once that was asked.
    enters: Option<bool>,
    /// Postures whose velocities at the catch were looked for, and those that were tried in vain.
    velocity_trials: usize,
    failed: usize,
}

impl Candidate {
    fn new(sample: usize, ranked: RankedGrasp) -> Self {
        Self { sample, ranked, enters: None, velocity_trials: 0, failed: 0 }
    }
}

/// What a search is about, and what it has met.
struct Search<'a> {
    start: &'a Start,
    incoming: &'a Incoming<'a>,
    /// What was last in the way into each grasp.
    obstacles: Vec<Obstacle>,
    /// The work that has been done.
    work: usize,
}

impl<'a> Search<'a> {
    fn new(start: &'a Start, incoming: &'a Incoming) -> Self {
        Self { start, incoming, obstacles: vec![Obstacle::default(); incoming.grasps.grasps.len()], work: 0 }
    }
}

impl CatchSearch {
    /// The best catch of an object on `flight` that the arm can reach from `start`, without a bound on the work.
    ///
    /// # Errors
    /// Why there is none.
    pub fn search(&self, start: &Start, incoming: &Incoming) -> Result<CatchPlan, PlanningFailure> {
        let mut search = Search::new(start, incoming);
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
    /// new image.
    ///
    /// # Errors
    /// Why they found none.
    pub fn search_in_passes(
        &self,
        pass: &mut usize,
        start: &Start,
        incoming: &Incoming,
    ) -> Result<CatchPlan, PlanningFailure> {
        let mut search = Search::new(start, incoming);
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

    /// The cheapest catch that one pass finds, doing no more than `most_work`.
    fn best_first(&self, search: &mut Search, pass: usize, most_work: usize) -> Result<CatchPlan, PlanningFailure> {
        let (mut samples, mut candidates, any_grasp) = self.candidates(search, OFFSETS[pass % OFFSETS.len()]);
        let mut goes_nearby = pass % PASSES >= OFFSETS.len();
        let Search { start, incoming, ref mut obstacles, ref mut work } = *search;
        let grasps = &incoming.grasps.grasps;
        // Ranking grasps is work as well, a fiftieth of a unit each.
        *work += samples.len() * grasps.len() / 50;
        let before = *work;
        let (weights, from, scaling) = (&self.motion.config.weights, &start.state.q, self.motion.moving_scaling());
        let config = &self.motion.config.search;
        let most_poses = if self.motion.finder.is_numerical() { config.max_numerical_poses } else { usize::MAX };
        let mut frontier = Frontier::new(config.failure_penalty);
        let unseen = |candidate: usize, it: &Candidate, samples: &[CatchTimeSample]| {
            let LocalFlight { time_s, V_WO, .. } = &samples[it.sample].local_flight;
            let holding = self.holding_cost(it.ranked.cost, &V_WO.linear, self.motion.config.max_speed_fraction, 0.0);
            let cost = holding + weights.delay * (time_s - start.time_s);
            Node { candidate, stage: Stage::Pose, cost, failures: 0 }
        };
        for (candidate, it) in candidates.iter().enumerate() {
            frontier.push(unseen(candidate, it, &samples));
        }
        let is_near = !samples.is_empty();
        let mut failure = if is_near && !any_grasp { PlanningFailure::NoGrasp } else { PlanningFailure::OutOfReach };
        let mut looked_at = 0;
        let mut failures = vec![0; grasps.len()];
        loop {
            let Some(node) = frontier.pop() else {
                if !std::mem::take(&mut goes_nearby) {
                    return Err(failure);
                }
                looked_at = 0;
                let known = candidates.len();
                self.add_nearby(start, incoming, &mut samples, &mut candidates);
                *work += candidates.len() - known;
                for (candidate, it) in candidates.iter().enumerate().skip(known) {
                    frontier.push(unseen(candidate, it, &samples));
                }
                continue;
            };
            let Node { candidate, stage, cost, .. } = node;
            let Candidate { sample, ranked, enters, velocity_trials, failed } = &mut candidates[candidate];
            let (at, RankedGrasp { index, X_WG, approach, .. }) = (&samples[*sample], *ranked);
            let failures = &mut failures[index];
            if node.failures < *failures {
                frontier.push(Node { failures: *failures, ..node });
                continue;
            }
            *work += stage.work();
            if *work - before > most_work {
                return Err(PlanningFailure::OutOfBudget);
            }
            let (catch_s, v_WO) = (at.local_flight.time_s, at.local_flight.V_WO.linear);
            let entering = Entering { incoming, local_flight: &at.local_flight, grasp: &grasps[index] };
            let point_to_point = |q: &JointVector| self.motion.point_to_point(start, catch_s, &X_WG, q, &v_WO, scaling);
            let obstacle = &mut obstacles[index];
            let v_GO = X_WG.rotation.inverse_transform_vector(&v_WO);
            match stage {
                Stage::Pose if looked_at == most_poses => {}
                Stage::Pose => {
                    looked_at += 1;
                    let postures = self.motion.finder.postures(&self.motion.robot, &X_WG, from, &at.ranges);
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
                        let cost = cost
                            + weights.reach_fraction * reach_fraction.powi(4)
                            + weights.comfort * (posture.q - self.motion.robot.comfortable_q).norm();
                        frontier.push(Node { stage: Stage::Posture(posture), cost, ..node });
                    }
                }
                Stage::Posture(_) if *velocity_trials == config.max_velocity_trials => {}
                Stage::Posture(_) | Stage::TerminalVelocity(..) if *failed == config.max_motion_trials => {}
                Stage::Posture(posture) => {
                    let q = posture.q;
                    if !self.motion.stands_clear(&q, entering.grasp.aperture_m) {
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
    /// anywhere.
    fn candidates(&self, task: &Search, offset: f64) -> (Vec<CatchTimeSample>, Vec<Candidate>, bool) {
        let base = Point3::from(self.motion.robot.X_WB.translation.vector);
        let (mut samples, mut candidates, mut any_grasp) = (Vec::new(), Vec::new(), false);
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
            let (ranked, any) = task.incoming.grasps.rank(X_WO, v_WO, &base, task.incoming.config, may_reach);
            any_grasp |= any;
            candidates.extend(ranked.into_iter().map(|ranked| Candidate::new(samples.len(), ranked)));
            samples.push(at);
        }
        (samples, candidates, any_grasp)
    }

    /// Adds what got as far as the approach or a motion, a little sooner and later.
    fn add_nearby(
        &self,
        start: &Start,
        incoming: &Incoming,
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
                    candidates.push(Candidate::new(samples.len(), ranked));
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
