//! The choice of catch time, grasp and redundancy.
//!
//! Best first: every pair of catch time and grasp that the elbow could reach enters a heap with the least that it can cost. What
//! is on top is looked at more closely: a pair becomes postures ([`SrsArm::swivels`](catch_body::inverse_kinematics::SrsArm::swivels)
//! cut to what each joint can reach), a posture gets its arrival velocities, an arrival its motion, and each step adds what it
//! costs. The first motion that keeps all limits and clearances is therefore the best there is, and most of the rest is
//! never looked at. What is found nowhere is sought once more, in finer steps of time and with all that the limits allow;
//! only then is it refused.

use std::{cmp::Ordering, collections::BinaryHeap};

use catch_body::{JointVector, MAX_JOINTS, Pose};
use nalgebra::{Point3, Vector3};
use serde::{Deserialize, Serialize};

use super::{
    CatchPlan, Planner, Refusal, Start,
    arrival::Weights as ArrivalWeights,
    motion::Shares,
    posture::{Posture, PostureFinder},
    reachability::{Interval, JointReach},
    reaching::{Reaching, effort},
};
use crate::{
    grasp_selection::{self, Approach, Grasp, GraspSet, RankedGrasp},
    trajectory_prediction::FlightTrajectory,
};

/// Weights of the choice among catches that the arm can reach. All terms are costs.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Weights {
    /// On the effort: the largest share of a joint's reach that is used, raised to the fourth power.
    pub effort: f64,
    /// On the distance from the comfortable pose, per radian.
    pub comfort: f64,
    /// On the missing speed fraction, relative to the highest.
    pub speed: f64,
    /// On the gripper's angular speed, per rad/s.
    pub spin: f64,
    /// On waiting longer, per second.
    pub delay: f64,
}

impl Default for Weights {
    fn default() -> Self {
        Self { effort: 1.0, comfort: 0.02, speed: 0.5, spin: 0.2, delay: 0.5 }
    }
}

/// Latest catch, in seconds from the start.
const LATEST_S: f64 = 2.0;
/// How much finer the second search is.
const FINER: f64 = 4.0;
/// Pairs of catch time and grasp that one search looks at, the best first.
const MOST_PAIRS: usize = 500;
/// The same where each takes an iteration.
const MOST_NUMERICAL_PAIRS: usize = 16;
/// Motions that are tried for one of them.
const ATTEMPTS_PER_PAIR: usize = 2;

/// A catch that every joint can reach.
#[derive(Debug, Clone, Copy)]
pub(super) struct Candidate {
    pub catch_s: f64,
    pub approach: Approach,
    pub X_WG: Pose,
    pub posture: Posture,
    pub cost: f64,
}

/// What is known at one catch time.
struct Moment {
    catch_s: f64,
    v_WO: Vector3<f64>,
    joints: [JointReach; MAX_JOINTS],
    ranges: [[f64; 2]; MAX_JOINTS],
}

/// A catch on its way to being a plan.
#[derive(Clone, Copy)]
struct Node {
    instant: usize,
    ranked: RankedGrasp,
    stage: Stage,
}

#[derive(Clone, Copy)]
enum Stage {
    Pose,
    Posture(Posture),
    Arrival(Posture),
}

/// Nodes, the one that can become cheapest on top.
#[derive(Default)]
struct Frontier {
    nodes: Vec<Node>,
    heap: BinaryHeap<Ticket>,
}

/// The least that a node can cost, and which node.
struct Ticket {
    cost: f64,
    node: usize,
}

impl Frontier {
    fn push(&mut self, cost: f64, node: Node) {
        self.heap.push(Ticket { cost, node: self.nodes.len() });
        self.nodes.push(node);
    }

    fn pop(&mut self) -> Option<(f64, Node)> {
        self.heap.pop().map(|ticket| (ticket.cost, self.nodes[ticket.node]))
    }
}

impl Ord for Ticket {
    /// The cheapest is the greatest, and among equals the one that came first, so that the order is always the same.
    fn cmp(&self, other: &Self) -> Ordering {
        other.cost.total_cmp(&self.cost).then(other.node.cmp(&self.node))
    }
}

impl PartialOrd for Ticket {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl PartialEq for Ticket {
    fn eq(&self, other: &Self) -> bool {
        self.cmp(other) == Ordering::Equal
    }
}

impl Eq for Ticket {}

/// What a search is about.
struct Task<'a> {
    start: &'a Start,
    flight: &'a FlightTrajectory,
    grasps: &'a GraspSet,
    grasp_config: &'a grasp_selection::Config,
    shares: Shares,
}

impl Planner {
    /// The best catch of an object on `flight` that the arm can reach from `start`.
    ///
    /// # Errors
    /// Why there is none.
    pub fn search(
        &self,
        start: &Start,
        flight: &FlightTrajectory,
        grasps: &GraspSet,
        grasp_config: &grasp_selection::Config,
    ) -> Result<CatchPlan, Refusal> {
        let task = Task { start, flight, grasps, grasp_config, shares: self.shares(start) };
        self.best_first(&task, self.config.time_step_s).or_else(|_| {
            let task = Task { shares: self.moving_shares(), ..task };
            self.best_first(&task, self.config.time_step_s / FINER)
        })
    }

    fn best_first(&self, task: &Task, time_step_s: f64) -> Result<CatchPlan, Refusal> {
        let mut frontier = Frontier::default();
        let (instants, any_grasp) = self.poses(task, time_step_s, &mut frontier);
        let mut refusal = if any_grasp { Refusal::OutOfReach } else { Refusal::NoGrasp };
        // What a few postures could not do, similar ones usually cannot either.
        let mut failed: Vec<(usize, usize)> = Vec::new();
        let mut attempts = 0;
        let mut pairs = match self.finder {
            PostureFinder::Srs(_) => MOST_PAIRS,
            PostureFinder::Numerical => MOST_NUMERICAL_PAIRS,
        };
        let weights = &self.config.weights;
        while let Some((cost, Node { instant, ranked, stage })) = frontier.pop() {
            let at = &instants[instant];
            let from = &task.start.state.q;
            let reaching =
                |q: &JointVector| self.reaching(task.start, at.catch_s, &ranked.X_WG, q, &at.v_WO, task.shares);
            match stage {
                Stage::Pose if pairs == 0 => {}
                Stage::Pose => {
                    pairs -= 1;
                    let postures = self.postures(task, at, &ranked);
                    if let Err(why) = postures {
                        refusal = refusal.max(why);
                    }
                    for (effort, posture) in postures.into_iter().flatten() {
                        let cost = cost
                            + weights.effort * effort.powi(4)
                            + weights.comfort * (posture.q - self.robot.comfortable_q).norm();
                        frontier.push(cost, Node { instant, ranked, stage: Stage::Posture(posture) });
                    }
                }
                Stage::Posture(posture) => {
                    let q = posture.q;
                    refusal = refusal.max(Refusal::NoMotion);
                    if !self.stands_clear(&q, task.grasps.grasps[ranked.index].open_width_m) {
                        continue;
                    }
                    let bounds = self.arrival_bounds(&at.joints, from, &q);
                    let Some(arrival) = bounds.and_then(|bounds| reaching(&q).arrival(&bounds)) else { continue };
                    let missing = 1.0 - arrival.speed_fraction / self.config.max_speed_fraction.max(1e-9);
                    let cost = cost + weights.speed * missing + weights.spin * arrival.w_WG.norm();
                    frontier.push(cost, Node { instant, ranked, stage: Stage::Arrival(posture) });
                }
                Stage::Arrival(posture) => {
                    let q = posture.q;
                    let RankedGrasp { approach, X_WG, index, .. } = ranked;
                    let pair = (instant, index);
                    if failed.iter().filter(|it| **it == pair).count() >= ATTEMPTS_PER_PAIR {
                        continue;
                    }
                    let candidate = Candidate { catch_s: at.catch_s, approach, X_WG, posture, cost };
                    let Some(bounds) = self.arrival_bounds(&at.joints, from, &q) else { continue };
                    let mut moved = false;
                    for weights in [ArrivalWeights::BALANCED, ArrivalWeights::STEADY] {
                        let reaching = Reaching { weights, ..reaching(&q) };
                        let grasp = &task.grasps.grasps[index];
                        let Some(arrival) = reaching.arrival(&bounds) else { continue };
                        if !self.lets_in(
                            &X_WG,
                            &arrival,
                            at.catch_s,
                            task.flight,
                            grasp,
                            task.grasps,
                            task.grasp_config,
                        ) {
                            continue;
                        }
                        moved = true;
                        let Some(plan) = self.finish(&candidate, grasp, bounds, &reaching) else { continue };
                        let opening = self.opening(&plan, task.flight, task.grasps, task.grasp_config);
                        if let Some(open_width_m) = opening {
                            return Ok(CatchPlan { open_width_m, lets_in: true, ..plan });
                        }
                    }
                    attempts += usize::from(moved);
                    failed.push(pair);
                    if attempts == self.config.attempts {
                        return Err(Refusal::NoMotion);
                    }
                }
            }
        }
        Err(refusal)
    }

    /// Postures in which the gripper is where `ranked` wants it, each with the share of its reach that a joint must use.
    fn postures(&self, task: &Task, at: &Moment, ranked: &RankedGrasp) -> Result<Vec<(f64, Posture)>, Refusal> {
        let from = &task.start.state.q;
        let postures = self.finder.postures(&self.robot, &ranked.X_WG, from, &at.ranges);
        if postures.is_empty() {
            return Err(Refusal::OutOfReach);
        }
        let v_GO = ranked.X_WG.rotation.inverse_transform_vector(&at.v_WO);
        let grasp = &task.grasps.grasps[ranked.index];
        if !self.enters_straight(grasp, &v_GO, task.grasps, task.grasp_config.way_in_margin_m) {
            return Err(Refusal::Blocked);
        }
        let effort = |it: &Posture| effort(&at.joints, from, &it.q, self.robot.dof());
        Ok(postures.into_iter().filter_map(|it| Some((effort(&it)?, it))).collect())
    }

    /// Every catch time with every grasp that suits the flight there and that the elbow can reach; and whether any suits it.
    fn poses(&self, task: &Task, time_step_s: f64, frontier: &mut Frontier) -> (Vec<Moment>, bool) {
        let base = Point3::from(self.robot.X_WB.translation.vector);
        let (mut instants, mut any_grasp) = (Vec::new(), false);
        let steps = (LATEST_S / time_step_s) as usize;
        for step in 0..steps {
            let lead_s = self.config.min_lead_s + step as f64 * time_step_s;
            let catch_s = task.start.time_s + lead_s;
            let X_WO = task.flight.pose_at(catch_s);
            if X_WO.translation.vector.z < 0.0 {
                break;
            }
            if (X_WO.translation.vector - base.coords).norm() > self.longest_reach_m {
                continue;
            }
            let joints = self.reaches(task.start, lead_s, task.shares);
            let ranges = self.ranges(&joints, &task.start.state.q);
            let v_WO = task.flight.twist_at(catch_s).linear;
            for ranked in task.grasps.rank(&X_WO, &v_WO, &base, task.grasp_config) {
                any_grasp = true;
                if !self.finder.may_reach(&ranked.X_WG, &ranges) {
                    continue;
                }
                let cost = ranked.cost + self.config.weights.delay * lead_s;
                frontier.push(cost, Node { instant: instants.len(), ranked, stage: Stage::Pose });
            }
            instants.push(Moment { catch_s, v_WO, joints, ranges });
        }
        (instants, any_grasp)
    }

    pub(super) fn shares(&self, start: &Start) -> Shares {
        if start.state.dq == JointVector::zeros() { self.cold_shares() } else { self.moving_shares() }
    }

    /// Turns a candidate into a plan, `None` if no motion to it keeps all limits and clearances.
    pub(super) fn finish(
        &self,
        candidate: &Candidate,
        grasp: &Grasp,
        bounds: [Interval; MAX_JOINTS],
        reaching: &Reaching,
    ) -> Option<CatchPlan> {
        let (arrival, control_points) = reaching.best(bounds, -1.0)?;
        let trajectory = self.motion(reaching.start.time_s, candidate.catch_s, control_points, grasp)?;
        let Candidate { catch_s, approach, X_WG, posture: Posture { q, elbow }, cost } = *candidate;
        Some(CatchPlan {
            catch_s,
            grasp: grasp.clone(),
            approach,
            X_WG,
            q,
            open_width_m: grasp.open_width_m,
            lets_in: false,
            elbow,
            speed_fraction: arrival.speed_fraction,
            spin_radps: arrival.w_WG.norm(),
            weights: reaching.weights,
            cost,
            trajectory,
        })
    }
}
