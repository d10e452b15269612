//! The choice of catch time, grasp and redundancy, and the ladder of replans.
//!
//! Every combination of catch time, ranked grasp, elbow swivel and inverse-kinematics branch is asked whether each joint can
//! be there in time; what is left is scored, the best get their arrival velocities, and the first that also has a motion
//! is taken. Reachability is thus the selector: nothing is planned that the arm cannot do, and when nothing is left the throw
//! is out of reach.

use catch_body::{JointVector, MAX_JOINTS, Pose};
use nalgebra::{Point3, Vector3};
use serde::{Deserialize, Serialize};

use super::{
    CatchPlan, Planner, Refusal, Start,
    arrival::{self, Arrival, arrival},
    motion::{BRAKE_SHARE, Shares},
    reachability::{Interval, JointReach},
};
use crate::{
    grasp_selection::{self, Approach, Entry, Grasp, GraspSet},
    trajectory_prediction::{FlightTrajectory, Passage},
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

/// How long, how far and in how many steps before the catch the object's way into the gripper is checked.
const WAY_IN_S: f64 = 0.08;
const WAY_IN_M: f64 = 0.15;
const WAY_IN_STEPS: usize = 16;

/// A catch that every joint can reach.
#[derive(Debug, Clone, Copy)]
struct Candidate {
    catch_s: f64,
    grasp: usize,
    approach: Approach,
    X_WG: Pose,
    q: JointVector,
    swivel: f64,
    cost: f64,
}

impl Planner {
    /// The best catch of an object on `flight` that the arm can reach from `start`.
    pub fn search(
        &self,
        start: &Start,
        flight: &FlightTrajectory,
        grasps: &GraspSet,
        grasp_config: &grasp_selection::Config,
    ) -> Result<CatchPlan, Refusal> {
        let shares = self.shares(start);
        let mut candidates = self.candidates(start, flight, grasps, grasp_config)?;
        candidates.sort_by(|a, b| a.cost.total_cmp(&b.cost));

        // Arrival velocities cost more than reachability: they are found for the most promising only, whose grasps the object
        // can enter on a straight line.
        let mut entries = Vec::new();
        let mut arrivals: Vec<(Candidate, Arrival)> = candidates
            .iter()
            .filter(|candidate| {
                let key = (candidate.grasp, candidate.catch_s.to_bits());
                let known = entries.iter().find(|(other, _)| *other == key).map(|(_, free)| *free);
                known.unwrap_or_else(|| {
                    let v_GO =
                        candidate.X_WG.rotation.inverse_transform_vector(&flight.twist_at(candidate.catch_s).linear);
                    let free = self.enters_straight(
                        &grasps.grasps[candidate.grasp],
                        &v_GO,
                        grasps,
                        grasp_config.way_in_margin_m,
                    );
                    entries.push((key, free));
                    free
                })
            })
            .filter_map(|candidate| {
                let arrival = self.arrive(start, candidate.catch_s, &candidate.X_WG, &candidate.q, flight, shares)?;
                let weights = &self.config.weights;
                let missing = 1.0 - arrival.speed_fraction / self.config.max_speed_fraction.max(1e-9);
                let cost = candidate.cost + weights.speed * missing + weights.spin * arrival.spin_radps;
                Some((Candidate { cost, ..*candidate }, arrival))
            })
            .take(4 * self.config.attempts)
            .collect();
        if arrivals.is_empty() {
            return Err(Refusal::OutOfReach);
        }
        arrivals.sort_by(|a, b| a.0.cost.total_cmp(&b.0.cost));
        arrivals
            .iter()
            .take(self.config.attempts)
            .find_map(|(candidate, arrival)| {
                let grasp = &grasps.grasps[candidate.grasp];
                let mut plan = self.finish(start, candidate, grasp, *arrival, shares)?;
                plan.open_width_m = self.opening(&plan, flight, grasps, grasp_config)?;
                Some(plan)
            })
            .ok_or(Refusal::NoMotion)
    }

    /// Whether the object can come into a gripper that is fully open and does not turn, at `v_GO` in G, without touching it.
    fn enters_straight(&self, grasp: &Grasp, v_GO: &Vector3<f64>, grasps: &GraspSet, margin_m: f64) -> bool {
        let entry = Entry::new(&self.gripper, self.gripper.max_width_m, margin_m);
        let Some(direction) = v_GO.try_normalize(1e-6) else { return true };
        (0..=WAY_IN_STEPS).all(|step| {
            let mut X_GO = grasp.X_OG.inverse();
            X_GO.translation.vector -= direction * (WAY_IN_M * step as f64 / WAY_IN_STEPS as f64);
            entry.is_clear_of(&grasps.outline, &X_GO)
        })
    }

    /// The narrowest opening with which the object touches neither fingers nor housing on its way into the moving gripper,
    /// the fingers closing in time for the catch; `None` if there is none.
    fn opening(
        &self,
        plan: &CatchPlan,
        flight: &FlightTrajectory,
        grasps: &GraspSet,
        config: &grasp_selection::Config,
    ) -> Option<f64> {
        let passage = Passage::of(flight, plan.catch_s);
        let way: [_; WAY_IN_STEPS + 1] = std::array::from_fn(|step| {
            let before_s = WAY_IN_S * step as f64 / WAY_IN_STEPS as f64;
            let time_s = plan.catch_s - before_s;
            let X_WG = self.robot.gripper_pose(&plan.trajectory.setpoint(time_s).q);
            (before_s, X_WG.inverse() * passage.pose_at(time_s))
        });
        let (narrow, wide) = (plan.grasp.open_width_m, self.gripper.max_width_m);
        [0.0, 0.25, 0.5, 1.0].iter().map(|share| narrow + share * (wide - narrow)).find(|&open_m| {
            way.iter().all(|(before_s, X_GO)| {
                // How far the fingers have closed by then; toward the end less and less space is left on purpose.
                let width_m = (plan.grasp.object_width_m + before_s * config.closing_speed_mps).min(open_m);
                let margin_m = config.way_in_margin_m.min((width_m - plan.grasp.object_width_m) / 4.0);
                Entry::new(&self.gripper, width_m, margin_m - 1e-4).is_clear_of(&grasps.outline, X_GO)
            })
        })
    }

    /// The same catch for a flight that is known better: same time and grasp, the elbow where it was or close by.
    pub fn retarget(
        &self,
        start: &Start,
        flight: &FlightTrajectory,
        plan: &CatchPlan,
        grasps: &GraspSet,
        grasp_config: &grasp_selection::Config,
    ) -> Option<CatchPlan> {
        let X_WG = flight.pose_at(plan.catch_s) * plan.grasp.X_OG;
        let srs = self.srs.as_ref()?;
        let circle = srs.elbow_circle(&X_WG)?;
        let step = std::f64::consts::TAU / self.config.swivels as f64;
        // What a motion leaves of the limits, the next replan can use: more is taken only where less does not do.
        let shares = [0.0, 0.5, 1.0].map(|more| self.cold_shares().toward(self.moving_shares(), more));
        let attempts = shares.iter().flat_map(|shares| [0.0, 0.5, -0.5, 1.0, -1.0].map(|offset| (shares, offset)));
        let mut found = attempts.into_iter().find_map(|(shares, offset)| {
            let swivel = plan.swivel + offset * step;
            let solutions = srs.solve(&circle, swivel);
            let q = *solutions.iter().min_by(|a, b| (*a - plan.q).norm().total_cmp(&(*b - plan.q).norm()))?;
            let arrival = self.arrive(start, plan.catch_s, &X_WG, &q, flight, *shares)?;
            let CatchPlan { catch_s, approach, cost, .. } = *plan;
            let candidate = Candidate { catch_s, grasp: 0, approach, X_WG, q, swivel, cost };
            self.finish(start, &candidate, &plan.grasp, arrival, *shares)
        })?;
        found.open_width_m = self.opening_or_widest(&found, flight, grasps, grasp_config);
        Some(found)
    }

    /// The narrowest opening that lets the object in, or, where none does any more, the widest: it hits least.
    pub fn opening_or_widest(
        &self,
        plan: &CatchPlan,
        flight: &FlightTrajectory,
        grasps: &GraspSet,
        config: &grasp_selection::Config,
    ) -> f64 {
        self.opening(plan, flight, grasps, config).unwrap_or(self.gripper.max_width_m)
    }

    fn shares(&self, start: &Start) -> Shares {
        if start.state.dq == JointVector::zeros() { self.cold_shares() } else { self.moving_shares() }
    }

    /// All catches that every joint can reach in time.
    fn candidates(
        &self,
        start: &Start,
        flight: &FlightTrajectory,
        grasps: &GraspSet,
        grasp_config: &grasp_selection::Config,
    ) -> Result<Vec<Candidate>, Refusal> {
        let Some(srs) = &self.srs else { return Err(Refusal::NoMotion) };
        let base = Point3::from(self.robot.X_WB.translation.vector);
        let mut candidates = Vec::new();
        let mut any_grasp = false;
        let steps = (2.0 / self.config.time_step_s) as usize;
        for step in 0..steps {
            let lead_s = self.config.min_lead_s + step as f64 * self.config.time_step_s;
            let catch_s = start.time_s + lead_s;
            let X_WO = flight.pose_at(catch_s);
            if X_WO.translation.vector.z < 0.0 {
                break;
            }
            if srs.elbow_circle(&X_WO).is_none() && (X_WO.translation.vector - base.coords).norm() > 2.0 {
                continue;
            }
            let joints = self.reaches(start, lead_s, self.shares(start));
            for ranked in grasps.rank(&X_WO, &flight.twist_at(catch_s).linear, &base, grasp_config) {
                any_grasp = true;
                let Some(circle) = srs.elbow_circle(&ranked.X_WG) else { continue };
                for step in 0..self.config.swivels {
                    let swivel = std::f64::consts::TAU * step as f64 / self.config.swivels as f64;
                    for q in srs.solve(&circle, swivel).iter() {
                        let Some(effort) = effort(&joints, &start.state.q, q, self.robot.dof()) else { continue };
                        let weights = &self.config.weights;
                        let cost = ranked.cost
                            + weights.effort * effort.powi(4)
                            + weights.comfort * (q - self.robot.comfortable_q).norm()
                            + weights.delay * lead_s;
                        candidates.push(Candidate {
                            catch_s,
                            grasp: ranked.index,
                            approach: ranked.approach,
                            X_WG: ranked.X_WG,
                            q: *q,
                            swivel,
                            cost,
                        });
                    }
                }
            }
        }
        match (any_grasp, candidates.is_empty()) {
            (_, false) => Ok(candidates),
            (true, true) => Err(Refusal::OutOfReach),
            (false, true) => Err(Refusal::NoGrasp),
        }
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
    fn arrive(
        &self,
        start: &Start,
        catch_s: f64,
        X_WG: &Pose,
        q: &JointVector,
        flight: &FlightTrajectory,
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
        arrival(
            &jacobian,
            &flight.twist_at(catch_s).linear,
            &bounds,
            self.config.max_speed_fraction,
            &arrival::Weights::BALANCED,
        )
    }

    /// Turns a candidate into a plan: a motion at the arrival's speed, or slower, or standing still.
    fn finish(
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
