//! One pass of a search: the catches of a time grid, best first.

use catch_body::{Pose, workcell::FLOOR_Z_M};
use nalgebra::{Point3, Vector3};

use super::{
    OFFSETS, PASSES, ReachableCatch, Search, WORK_OF_A_MOTION, WORK_OF_A_POSTURE, WORK_OF_A_TERMINAL_VELOCITY,
    WORK_OF_AN_APPROACH, WORK_OF_APERTURES,
    candidate::{Candidate, CatchTimeSample},
    frontier::{Frontier, Node, Stage},
    settings::{COMFORT, DELAY, LATEST_CATCH_S, MAX_MOTION_TRIALS, MAX_VELOCITY_TRIALS, NEARBY_S, REACH_FRACTION},
};
use crate::{
    grasp_selection::{Grasp, Passing, RankedGrasp},
    trajectory_optimization::{
        CatchPlan, CatchSearch, MIN_LEAD_S, PlanningFailure,
        point_to_point::PointToPoint,
        posture::Posture,
        reachability::fraction_used,
        swept_volume::Entering,
        terminal_velocity::{TerminalVelocity, Weights as TerminalVelocityWeights},
    },
    trajectory_prediction::{FlightPropagator, LocalFlight},
};

/// State of a search pass: its candidates, and how far each has been evaluated.
pub struct Pass<'a, 's> {
    planner: &'a CatchSearch,
    search: &'s mut Search<'a>,
    /// True if nothing is left out because of the reach map, and postures are sought from all starts.
    is_thorough: bool,
    samples: Vec<CatchTimeSample>,
    candidates: Vec<Candidate>,
    frontier: Frontier,
    /// Number of failures of each grasp, at any time.
    failures: Vec<usize>,
    /// Failure that came nearest to a catch.
    failure: PlanningFailure,
}

impl<'a, 's> Pass<'a, 's> {
    /// The pass of this number, with the candidates of its time grid.
    pub fn new(planner: &'a CatchSearch, search: &'s mut Search<'a>, number: usize) -> Self {
        let failures = vec![0; search.incoming.grasps.grasps.len()];
        let mut this = Self {
            planner,
            search,
            is_thorough: number % PASSES >= OFFSETS.len(),
            samples: Vec::new(),
            candidates: Vec::new(),
            frontier: Frontier::default(),
            failures,
            failure: PlanningFailure::OutOfReach,
        };
        this.add_grid(OFFSETS[number % OFFSETS.len()]);
        this
    }

    /// The cheapest catch that it finds, doing no more than `most_work`.
    pub fn run(mut self, most_work: usize) -> Result<CatchPlan, PlanningFailure> {
        let (before, finder) = (self.search.work, &self.planner.motion.finder);
        let mut goes_nearby = self.is_thorough;
        loop {
            let Some(node) = self.frontier.pop() else {
                if !std::mem::take(&mut goes_nearby) {
                    return Err(self.failure);
                }
                self.add_nearby();
                continue;
            };
            let failures = self.failures[self.candidates[node.candidate].ranked.index];
            if node.failures < failures {
                self.frontier.push(Node { failures, ..node });
                continue;
            }
            self.search.work += match node.stage {
                Stage::Pose => finder.work(self.is_thorough),
                Stage::Posture(_) => WORK_OF_A_POSTURE,
                Stage::TerminalVelocity(..) => WORK_OF_A_TERMINAL_VELOCITY,
            };
            if self.search.work - before > most_work {
                return Err(PlanningFailure::OutOfBudget);
            }
            match node.stage {
                Stage::Pose => self.expand_pose(&node),
                Stage::Posture(posture) => self.expand_posture(&node, posture),
                Stage::TerminalVelocity(posture, balanced) => {
                    if let Some(plan) = self.try_motions(&node, posture, balanced) {
                        return Ok(plan);
                    }
                }
            }
        }
    }

    /// Expands a pose to the postures that the joints can reach.
    fn expand_pose(&mut self, node: &Node) {
        let (motion, start) = (&self.planner.motion, self.search.start);
        let from = &start.state.q;
        let &Candidate { sample, ranked: RankedGrasp { index, X_WG, .. }, margin_cost, .. } =
            &self.candidates[node.candidate];
        let postures = self.turned(node).unwrap_or_else(|| {
            let ranges = &self.samples[sample].ranges;
            let found = motion.finder.postures(&motion.robot, &X_WG, from, ranges, self.is_thorough);
            found.into_iter().map(|posture| (*node, posture)).collect()
        });
        let at = &self.samples[sample];
        // The object's approach is costly to look at; here it only tells why there is no catch.
        if !postures.is_empty() && self.failure < PlanningFailure::NoMotion {
            let incoming = self.search.incoming;
            let grasp = &incoming.grasps.grasps[index];
            let entering = Entering { incoming, local_flight: &at.local_flight, grasp };
            self.search.work += WORK_OF_AN_APPROACH;
            let v_GO = X_WG.rotation.inverse_transform_vector(&at.local_flight.V_WO.linear);
            let is_free = self.planner.straight_approach_is_free(&v_GO, &entering, &mut self.search.obstacles[index]);
            self.failure = if is_free { PlanningFailure::NoMotion } else { PlanningFailure::Blocked };
        }
        for (node, posture) in postures {
            let Some(reach_fraction) = fraction_used(&at.joints, from, &posture.q, motion.robot.dof()) else {
                continue;
            };
            let cost = node.cost - margin_cost
                + REACH_FRACTION * reach_fraction.powi(4)
                + COMFORT * (posture.q - motion.robot.comfortable_q).norm();
            self.frontier.push(Node { stage: Stage::Posture(posture), cost, ..node });
        }
    }

    /// The postures that hold a ball near the pose, the hand turned about it as an arm of few joints can turn
    /// it, each with the node of a candidate of its own; `None` for others.
    fn turned(&mut self, node: &Node) -> Option<Vec<(Node, Posture)>> {
        let (planner, &mut Search { start, incoming, .. }) = (self.planner, &mut *self.search);
        let &Candidate { sample, ranked, margin_cost, .. } = &self.candidates[node.candidate];
        let grasp = &incoming.grasps.grasps[ranked.index];
        let (p_GO, robot, base) = (planner.pivot_G(incoming, grasp)?, &planner.motion.robot, self.base());
        let CatchTimeSample { local_flight: LocalFlight { X_WO, V_WO, .. }, ranges, .. } = &self.samples[sample];
        let passing = Passing::new(X_WO, &V_WO.linear, &base, &incoming.config.weights);
        let least = |ranked: &RankedGrasp| planner.least_holding_cost(incoming, ranked, &V_WO.linear);
        let mut found = Vec::new();
        for q in robot.turned_solutions(&ranked.X_WG, &p_GO, &start.state.q, ranges) {
            let X_OG = X_WO.inverse() * robot.gripper_pose(&q);
            if passing.can_be_caught(&[X_OG * Vector3::x(), X_OG * Vector3::y()]) {
                let turned = Grasp { X_OG, ..grasp.clone() };
                let again = passing.rank_alone(ranked.index, &turned);
                let cost = node.cost + least(&again) - least(&ranked);
                found.push((Node { candidate: self.candidates.len(), cost, ..*node }, Posture { q, elbow: None }));
                let candidate = Candidate::new(sample, again, margin_cost);
                self.candidates.push(Candidate { turned: Some(turned), ..candidate });
            }
        }
        Some(found)
    }

    /// Expands a posture to the velocities of the joints at the catch.
    fn expand_posture(&mut self, node: &Node, posture: Posture) {
        let (motion, &mut Search { start, incoming, .. }) = (&self.planner.motion, &mut *self.search);
        let from = &start.state.q;
        let Candidate { sample, ranked, velocity_trials, failed, .. } = &mut self.candidates[node.candidate];
        let used_up = *velocity_trials == MAX_VELOCITY_TRIALS || *failed == MAX_MOTION_TRIALS;
        if used_up || !motion.stands_clear(&posture.q) {
            return;
        }
        *velocity_trials += 1;
        let at = &self.samples[*sample];
        let (v_WO, scaling) = (&at.local_flight.V_WO.linear, motion.moving_scaling());
        let point_to_point =
            motion.point_to_point((start, incoming), &at.local_flight, &ranked.X_WG, &posture.q, scaling);
        let bounds = motion.terminal_velocity_bounds(&at.joints, from, &posture.q);
        let Some(terminal_velocity) = bounds.and_then(|bounds| point_to_point.terminal_velocity(&bounds)) else {
            self.failures[ranked.index] += usize::from(*velocity_trials == MAX_VELOCITY_TRIALS);
            return;
        };
        let planner = self.planner;
        let found = (&ranked.X_WG, ranked.still_cost);
        let cost = node.cost + planner.holding_cost_moving(incoming, found, v_WO, &terminal_velocity)
            - planner.least_holding_cost(incoming, ranked, v_WO);
        self.frontier.push(Node { stage: Stage::TerminalVelocity(posture, terminal_velocity), cost, ..*node });
    }

    /// Expands velocities at the catch to a motion that keeps all limits and clearances, with a free
    /// approach.
    fn try_motions(&mut self, node: &Node, posture: Posture, balanced: TerminalVelocity) -> Option<CatchPlan> {
        let (planner, motion) = (self.planner, &self.planner.motion);
        let Search { start, incoming, ref mut obstacles, ref mut work, .. } = *self.search;
        let Candidate { sample, ranked, failed, turned, .. } = &mut self.candidates[node.candidate];
        if *failed == MAX_MOTION_TRIALS {
            return None;
        }
        let RankedGrasp { index, X_WG, approach, still_cost, .. } = *ranked;
        let at = &self.samples[*sample];
        let (catch_s, v_WO) = (at.local_flight.time_s, &at.local_flight.V_WO.linear);
        let grasp = turned.as_ref().unwrap_or(&incoming.grasps.grasps[index]);
        let (entering, obstacle) =
            (Entering { incoming, local_flight: &at.local_flight, grasp }, &mut obstacles[index]);
        let reachable = ReachableCatch { catch_s, approach, X_WG, posture, cost: node.cost, still_cost };
        let bounds = motion.terminal_velocity_bounds(&at.joints, &start.state.q, &posture.q)?;
        for weights in [TerminalVelocityWeights::BALANCED, TerminalVelocityWeights::STEADY] {
            let to_catch =
                motion.point_to_point((start, incoming), &at.local_flight, &X_WG, &posture.q, motion.moving_scaling());
            let to_catch = PointToPoint { weights, ..to_catch };
            let known = (weights == TerminalVelocityWeights::BALANCED).then_some(balanced);
            let Some(terminal_velocity) = known.or_else(|| to_catch.terminal_velocity(&bounds)) else { continue };
            *work += 2 * WORK_OF_AN_APPROACH;
            let v_G = X_WG.rotation.inverse_transform_vector(&(v_WO - terminal_velocity.v_WG));
            if !planner.approach_is_free(&X_WG, &terminal_velocity, &entering, obstacle)
                || !planner.straight_approach_is_free(&v_G, &entering, obstacle)
            {
                continue;
            }
            *work += WORK_OF_A_MOTION;
            // Where no velocities along the flight are left, none are with other weights.
            let Some(reached) = to_catch.best(bounds, -1.0) else { break };
            let Some(plan) = planner.finish(incoming, &reachable, grasp, reached, &to_catch) else { continue };
            *work += WORK_OF_APERTURES;
            // Less work than clearances, and fails more often.
            let Some(aperture_m) = planner.aperture(&plan, incoming, &at.local_flight) else { continue };
            if motion.is_safe(&plan.trajectory, catch_s, grasp) {
                return Some(CatchPlan { aperture_m, approach_is_free: true, ..plan });
            }
        }
        *failed += 1;
        self.failures[index] += 1;
        None
    }

    /// Adds every catch time on the flight, and with each every grasp that suits it there and that the elbow
    /// can reach. Grasps that are too far by the reach map are among them only if the search is thorough, as
    /// the map is no proof.
    fn add_grid(&mut self, offset: f64) {
        let (motion, &mut Search { start, incoming, reach, .. }) = (&self.planner.motion, &mut *self.search);
        let base = self.base();
        let farthest_m = motion.gripper_reach_m + incoming.grasps.farthest_held_m() + incoming.flight.com_O.norm();
        let mut any_grasp = false;
        let mut propagator = incoming.flight.propagator();
        let steps = (LATEST_CATCH_S / self.planner.time_step_s) as usize;
        for step in 0..steps {
            let lead_s = MIN_LEAD_S + (step as f64 + offset) * self.planner.time_step_s;
            let catch_s = start.time_s + lead_s;
            let p_WOcm = propagator.position_at(catch_s);
            if p_WOcm.z < FLOOR_Z_M {
                break;
            }
            if (p_WOcm - base).norm() > farthest_m {
                continue;
            }
            let at = self.sample(&mut propagator, catch_s);
            let (X_WO, v_WO) = (&at.local_flight.X_WO, &at.local_flight.V_WO.linear);
            let may_reach = motion.finder.may_reach(X_WO, &at.ranges);
            let is_in_time =
                |X_OG: &Pose| self.is_thorough || reach.is_none_or(|reach| reach.is_in_time(&(X_WO * X_OG), catch_s));
            let may_catch = |X_OG: &Pose| may_reach(X_OG) && is_in_time(X_OG);
            let (ranked, any) = incoming.grasps.rank(X_WO, v_WO, &base, incoming.config, may_catch);
            any_grasp |= any;
            self.samples.push(at);
            ranked.into_iter().for_each(|ranked| self.add(ranked));
        }
        if !self.samples.is_empty() && !any_grasp {
            self.failure = PlanningFailure::NoGrasp;
        }
        // Ranking grasps is work as well, a fiftieth of a unit each.
        self.search.work += self.samples.len() * incoming.grasps.grasps.len() / 50;
    }

    /// Adds what got as far as the approach or a motion, a little sooner and later.
    fn add_nearby(&mut self) {
        let &mut Search { start, incoming, .. } = &mut *self.search;
        let (base, known) = (self.base(), self.candidates.len());
        let mut propagator = incoming.flight.propagator();
        for at in 0..self.samples.len() {
            let failed = self.candidates[..known].iter().filter(|it| it.sample == at && it.failed > 0);
            let close: Vec<usize> = failed.map(|it| it.ranked.index).collect();
            for by_s in NEARBY_S.iter().filter(|_| !close.is_empty()) {
                let catch_s = self.samples[at].local_flight.time_s + by_s;
                if catch_s < start.time_s + MIN_LEAD_S {
                    continue;
                }
                let sample = self.sample(&mut propagator, catch_s);
                let LocalFlight { X_WO, V_WO, .. } = sample.local_flight;
                self.samples.push(sample);
                for &index in &close {
                    let passing = Passing::new(&X_WO, &V_WO.linear, &base, &incoming.config.weights);
                    self.add(passing.rank_alone(index, &incoming.grasps.grasps[index]));
                }
            }
        }
        self.search.work += self.candidates.len() - known;
    }

    /// Adds a grasp at the newest catch time, with the least that it can cost.
    fn add(&mut self, ranked: RankedGrasp) {
        let &mut Search { start, incoming, reach, .. } = &mut *self.search;
        let sample = self.samples.len() - 1;
        let LocalFlight { time_s, V_WO, .. } = &self.samples[sample].local_flight;
        let margin_cost = reach.map_or(0.0, |it| it.margin_cost(&ranked.X_WG, *time_s));
        let holding = self.planner.least_holding_cost(incoming, &ranked, &V_WO.linear);
        let cost = holding + DELAY * (time_s - start.time_s) + margin_cost;
        let candidate = self.candidates.len();
        self.frontier.push(Node { candidate, stage: Stage::Pose, cost, failures: 0 });
        self.candidates.push(Candidate::new(sample, ranked, margin_cost));
    }

    /// Reachable sets and flight at a catch time.
    fn sample(&self, propagator: &mut FlightPropagator, catch_s: f64) -> CatchTimeSample {
        let (motion, start) = (&self.planner.motion, self.search.start);
        let joints = motion.reaches(start, catch_s - start.time_s, motion.moving_scaling());
        let ranges = motion.ranges(&joints, &start.state.q);
        CatchTimeSample { local_flight: propagator.local_flight_at(catch_s), joints, ranges }
    }

    /// The origin of the arm's base in W.
    fn base(&self) -> Point3<f64> {
        Point3::from(self.planner.motion.robot.X_WB.translation.vector)
    }
}
