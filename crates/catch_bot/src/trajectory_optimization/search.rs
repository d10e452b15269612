//! The choice of catch time, grasp and redundancy.
//!
//! Best first: every pair of catch time and grasp that the elbow could reach enters a heap with the least that it can cost. What
//! is on top is looked at more closely: a pair becomes postures ([`SrsArm::swivels`](catch_body::inverse_kinematics::SrsArm::swivels)
//! cut to what each joint can reach), a posture gets its arrival velocities, an arrival its motion, and each step adds what it
//! costs. The first motion that keeps all limits and clearances is therefore the best there is, and most of the rest is
//! never looked at. What is found nowhere is sought once more, in finer steps of time and with all that the limits allow;
//! only then is it refused.

use std::{cmp::Ordering, collections::BinaryHeap};

use catch_body::{JointVector, MAX_JOINTS, Pose, inverse_kinematics::SrsArm};
use nalgebra::{Point3, Vector3};
use serde::{Deserialize, Serialize};

use super::{
    CatchPlan, Planner, Refusal, Start,
    arrival::{self, Arrival, arrival},
    motion::{BRAKE_SHARE, Shares},
    reachability::{Interval, JointReach},
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

/// Swivel angles that are tried in each arc, as shares of it.
const SHARES_OF_ARC: [f64; 5] = [0.5, 0.25, 0.75, 0.05, 0.95];
/// Latest catch, in seconds from the start.
const LATEST_S: f64 = 2.0;
/// How much finer the second search is.
const FINER: f64 = 5.0;

/// A catch that every joint can reach.
#[derive(Debug, Clone, Copy)]
pub(super) struct Candidate {
    pub catch_s: f64,
    pub approach: Approach,
    pub X_WG: Pose,
    pub q: JointVector,
    pub swivel: f64,
    pub cost: f64,
}

/// What is known at one catch time.
struct Instant {
    catch_s: f64,
    v_WO: Vector3<f64>,
    joints: [JointReach; MAX_JOINTS],
    ranges: [[f64; 2]; MAX_JOINTS],
}

/// A catch on its way to being a plan: `cost` is the least that it can cost.
struct Node {
    cost: f64,
    instant: usize,
    ranked: RankedGrasp,
    stage: Stage,
}

enum Stage {
    Pose,
    Posture { q: JointVector, swivel: f64 },
    Arrival { q: JointVector, swivel: f64, arrival: Arrival },
}

impl Ord for Node {
    /// The cheapest is the greatest, and among equals the one whose grasp comes first, so that the order is always the same.
    fn cmp(&self, other: &Self) -> Ordering {
        let key = |it: &Self| (it.instant, it.ranked.index);
        other.cost.total_cmp(&self.cost).then_with(|| key(other).cmp(&key(self)))
    }
}

impl PartialOrd for Node {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl PartialEq for Node {
    fn eq(&self, other: &Self) -> bool {
        self.cmp(other) == Ordering::Equal
    }
}

impl Eq for Node {}

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
        let srs = self.srs.as_ref().ok_or(Refusal::NoMotion)?;
        let task = Task { start, flight, grasps, grasp_config, shares: self.shares(start) };
        self.best_first(srs, &task, self.config.time_step_s).or_else(|_| {
            let task = Task { shares: self.moving_shares(), ..task };
            self.best_first(srs, &task, self.config.time_step_s / FINER)
        })
    }

    fn best_first(&self, srs: &SrsArm, task: &Task, time_step_s: f64) -> Result<CatchPlan, Refusal> {
        let (instants, poses, any_grasp) = self.poses(srs, task, time_step_s);
        let mut refusal = if any_grasp { Refusal::OutOfReach } else { Refusal::NoGrasp };
        let mut heap = BinaryHeap::from(poses);
        let mut attempts = 0;
        let weights = &self.config.weights;
        while let Some(Node { cost, instant, ranked, stage }) = heap.pop() {
            let at = &instants[instant];
            match stage {
                Stage::Pose => {
                    let Some(circle) = srs.elbow_circle(&ranked.X_WG) else { continue };
                    let ranges = at.ranges[..7].try_into().expect("an S-R-S arm has seven joints");
                    let swivels = srs.swivels(&circle, ranges);
                    if swivels.iter().all(|(_, arcs)| arcs.is_empty()) {
                        continue;
                    }
                    refusal = refusal.max(Refusal::Blocked);
                    let grasp = &task.grasps.grasps[ranked.index];
                    let v_GO = ranked.X_WG.rotation.inverse_transform_vector(&at.v_WO);
                    if !self.enters_straight(grasp, &v_GO, task.grasps, task.grasp_config.way_in_margin_m) {
                        continue;
                    }
                    for (branch, arcs) in swivels {
                        for arc in arcs.iter() {
                            for share in SHARES_OF_ARC {
                                let swivel = arc[0] + share * (arc[1] - arc[0]);
                                let q = srs.solve_branch(&circle, swivel, branch);
                                let effort = effort(&at.joints, &task.start.state.q, &q, self.robot.dof());
                                let Some(effort) = effort else { continue };
                                let cost = cost
                                    + weights.effort * effort.powi(4)
                                    + weights.comfort * (q - self.robot.comfortable_q).norm();
                                heap.push(Node { cost, instant, ranked, stage: Stage::Posture { q, swivel } });
                            }
                        }
                    }
                }
                Stage::Posture { q, swivel } => {
                    refusal = refusal.max(Refusal::NoMotion);
                    let found = self.arrive(task.start, at.catch_s, &ranked.X_WG, &q, &at.v_WO, task.shares);
                    let Some(arrival) = found else { continue };
                    let missing = 1.0 - arrival.speed_fraction / self.config.max_speed_fraction.max(1e-9);
                    let cost = cost + weights.speed * missing + weights.spin * arrival.spin_radps;
                    heap.push(Node { cost, instant, ranked, stage: Stage::Arrival { q, swivel, arrival } });
                }
                Stage::Arrival { q, swivel, arrival } => {
                    let RankedGrasp { approach, X_WG, index, .. } = ranked;
                    let candidate = Candidate { catch_s: at.catch_s, approach, X_WG, q, swivel, cost };
                    let plan = self.finish(task.start, &candidate, &task.grasps.grasps[index], arrival, task.shares);
                    let opened = plan.and_then(|plan| {
                        let open_width_m = self.opening(&plan, task.flight, task.grasps, task.grasp_config)?;
                        Some(CatchPlan { open_width_m, ..plan })
                    });
                    attempts += 1;
                    if let Some(plan) = opened {
                        return Ok(plan);
                    }
                    if attempts == self.config.attempts {
                        return Err(Refusal::NoMotion);
                    }
                }
            }
        }
        Err(refusal)
    }

    /// Every catch time with every grasp that suits the flight there and that the elbow can reach; and whether any suits it.
    fn poses(&self, srs: &SrsArm, task: &Task, time_step_s: f64) -> (Vec<Instant>, Vec<Node>, bool) {
        let base = Point3::from(self.robot.X_WB.translation.vector);
        let (mut instants, mut poses, mut any_grasp) = (Vec::new(), Vec::new(), false);
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
                let bend = srs.elbow_bend(&ranked.X_WG);
                let within = |q4: f64| ranges[3][0] <= q4 && q4 <= ranges[3][1];
                if bend.is_none_or(|bend| !within(bend) && !within(-bend)) {
                    continue;
                }
                let cost = ranked.cost + self.config.weights.delay * lead_s;
                poses.push(Node { cost, instant: instants.len(), ranked, stage: Stage::Pose });
            }
            instants.push(Instant { catch_s, v_WO, joints, ranges });
        }
        (instants, poses, any_grasp)
    }

    /// Positions that the joints can have within their ranges, reaching what they can.
    pub(super) fn ranges(&self, joints: &[JointReach; MAX_JOINTS], q: &JointVector) -> [[f64; 2]; MAX_JOINTS] {
        let margin = self.config.position_margin_rad;
        std::array::from_fn(|i| {
            let Some(joint) = self.robot.joints.get(i) else { return [0.0; 2] };
            let far = joints[i].displacements();
            [(joint.limits.lower + margin).max(q[i] + far.low), (joint.limits.upper - margin).min(q[i] + far.high)]
        })
    }

    fn shares(&self, start: &Start) -> Shares {
        if start.state.dq == JointVector::zeros() { self.cold_shares() } else { self.moving_shares() }
    }

    /// What each joint can reach in `time_s` from the start.
    pub(super) fn reaches(&self, start: &Start, time_s: f64, shares: Shares) -> [JointReach; MAX_JOINTS] {
        std::array::from_fn(|i| {
            let limits = self.robot.joints.get(i).map(|joint| joint.limits);
            let velocity = limits.map_or(0.0, |it| it.velocity * shares.velocity);
            JointReach {
                start_velocity: start.state.dq[i].clamp(-velocity, velocity),
                velocity,
                acceleration: limits.map_or(1.0, |it| it.acceleration * shares.acceleration),
                time_s,
            }
        })
    }

    /// The arrival at `q`, within what the joints can reach and what leaves them room to brake.
    pub(super) fn arrive(
        &self,
        start: &Start,
        catch_s: f64,
        X_WG: &Pose,
        q: &JointVector,
        v_WO: &Vector3<f64>,
        shares: Shares,
    ) -> Option<Arrival> {
        let joints = self.reaches(start, catch_s - start.time_s, shares);
        let mut bounds = [Interval { low: 0.0, high: 0.0 }; MAX_JOINTS];
        for (i, joint) in self.robot.joints.iter().enumerate() {
            let displacement = q[i] - start.state.q[i];
            let far = joints[i].displacements();
            if displacement < far.low || displacement > far.high {
                return None;
            }
            // v² = 2·a·s leaves room to brake before the end of the joint's range.
            let braking = BRAKE_SHARE * joint.limits.acceleration;
            let room = |distance: f64| (2.0 * braking * distance.max(0.0)).sqrt();
            let margin = self.config.position_margin_rad;
            let below = q[i] - joint.limits.lower - margin;
            let above = joint.limits.upper - margin - q[i];
            if below < 0.0 || above < 0.0 {
                return None;
            }
            let stoppable = Interval { low: -room(below), high: room(above) };
            let most = self.config.arrival_velocity_share * joint.limits.velocity;
            let gentle = Interval { low: -most, high: most };
            bounds[i] = joints[i].arrival_velocities(displacement).intersection(&stoppable).intersection(&gentle);
        }
        let X_WL = self.robot.link_poses(q);
        let jacobian = self.robot.jacobian(&X_WL, &(X_WG * self.gripper.grasp_centre()));
        arrival(&jacobian, v_WO, &bounds, self.config.max_speed_fraction, &arrival::Weights::BALANCED)
    }

    /// Turns a candidate into a plan: a motion at the arrival's speed, or slower, or standing still.
    pub(super) fn finish(
        &self,
        start: &Start,
        candidate: &Candidate,
        grasp: &Grasp,
        arrival: Arrival,
        shares: Shares,
    ) -> Option<CatchPlan> {
        [1.0, 0.75, 0.4, 0.0].iter().find_map(|share| {
            let dq = arrival.dq * *share;
            let trajectory = self.motion(start, candidate.catch_s, &candidate.q, &dq, grasp.open_width_m, shares)?;
            Some(CatchPlan {
                catch_s: candidate.catch_s,
                grasp: grasp.clone(),
                approach: candidate.approach,
                X_WG: candidate.X_WG,
                q: candidate.q,
                open_width_m: grasp.open_width_m,
                swivel: candidate.swivel,
                speed_fraction: arrival.speed_fraction * share,
                spin_radps: arrival.spin_radps * share,
                cost: candidate.cost,
                trajectory,
            })
        })
    }
}

/// The largest share of its reach that a joint must use to get from `start` to `q`, `None` if one cannot.
pub(super) fn effort(
    joints: &[JointReach; MAX_JOINTS],
    start: &JointVector,
    q: &JointVector,
    dof: usize,
) -> Option<f64> {
    let mut most: f64 = 0.0;
    for i in 0..dof {
        let far = joints[i].displacements();
        let (middle, half) = ((far.low + far.high) / 2.0, (far.high - far.low) / 2.0);
        let share = ((q[i] - start[i] - middle) / half).abs();
        if share > 1.0 {
            return None;
        }
        most = most.max(share);
    }
    Some(most)
}
