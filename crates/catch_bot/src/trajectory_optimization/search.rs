//! The choice of catch time, grasp and redundancy.
//!
//! Best first: every pair of catch time and grasp that the elbow could reach enters a heap with the least
//! that it can cost. What is on top is looked at more closely: a pair becomes postures
//! ([`SrsArm::swivels`](catch_body::inverse_kinematics::SrsArm::swivels) cut to what each joint can reach), a
//! posture gets its arrival velocities, an arrival its motion, and each step adds what it costs. The first
//! motion that keeps all limits and clearances ends a pass, and most of the rest is never looked at.
//!
//! Arms without closed form have a [`ReachMap`](super::reach_map::ReachMap): pairs that are too far by it are
//! left out, and the others enter with the reachability margin that it estimates, until postures tell the
//! true one.
//!
//! An arm of fewer than six joints cannot take every pose. A hand that holds a ball may turn about its
//! centre: from each ranked grasp of a ball such an arm comes to one of its own, which is ranked anew.
//!
//! The search is weighted, not admissible: failures of a grasp add a penalty to its catches at all times, and
//! the map's estimate may be too high, by 0.1 to 0.3; either may put a better catch last. What is found
//! nowhere is sought again at times in between. Then, in a second round, nothing is left out for the map's
//! sake, postures are sought from more starts and along the null space, and what got as far as a motion or
//! the approach is tried a little sooner and later; only then has the search failed. In flight each image
//! brings as many passes as a bounded amount of work allows, the same for all arms.

mod candidate;
mod frontier;
mod pass;
mod reach;
mod settings;

use catch_body::Pose;
use nalgebra::Vector3;

use super::{
    CatchPlan, CatchSearch, Incoming, MAX_SPEED_FRACTION, PlanningFailure, Start,
    point_to_point::{PointToPoint, Reached},
    posture::Posture,
    swept_volume::Obstacle,
    terminal_velocity::TerminalVelocity,
};
use crate::grasp_selection::{Approach, Grasp, RankedGrasp};
use pass::Pass;
use reach::Reach;
pub use settings::{REACH_FRACTION, Weights};

/// Offsets of the passes' catch times, in fractions of the step between them.
const OFFSETS: [f64; 8] = [0.5, 0.0, 0.25, 0.75, 0.125, 0.625, 0.375, 0.875];
/// Passes that make up a search. In the second round what got as far as the approach or a motion is tried a
/// little sooner and later, too (`NEARBY_S`).
pub const PASSES: usize = 2 * OFFSETS.len();
/// The work of all search passes at one image, in units of 1 to 2 µs.
const MAX_WORK: usize = 4000;
/// The work of a posture and of an arrival.
const WORK_OF_A_POSTURE: usize = 3;
const WORK_OF_A_TERMINAL_VELOCITY: usize = 10;
/// The work of an approach, of a motion, and of its apertures.
const WORK_OF_AN_APPROACH: usize = 5;
const WORK_OF_A_MOTION: usize = 80;
const WORK_OF_APERTURES: usize = 30;

/// Expected speed at which a hand can follow across its approach, in m/s, before its posture is known;
/// chosen.
const EXPECTED_ACROSS_MPS: f64 = 0.5;

/// A catch that every joint can reach.
#[derive(Debug, Clone, Copy)]
pub(super) struct ReachableCatch {
    pub catch_s: f64,
    pub approach: Approach,
    pub X_WG: Pose,
    pub posture: Posture,
    pub cost: f64,
    /// Part of the cost from the grasp's heuristics for a gripper that stands still, without the velocity.
    pub still_cost: f64,
}

/// State of a search: its inputs and its intermediate results.
struct Search<'a> {
    start: &'a Start,
    incoming: &'a Incoming<'a>,
    /// Earliest times of the gripper's poses, if they are known for the pose from which the arm departed.
    reach: Option<Reach<'a>>,
    /// Obstacle that blocked the approach of each grasp last.
    obstacles: Vec<Obstacle>,
    /// The work that has been done.
    work: usize,
}

impl CatchSearch {
    /// The best catch of an object on `flight` that the arm can reach from `start`, without a bound on the
    /// work.
    ///
    /// # Errors
    /// Why there is none.
    pub fn search(&self, start: &Start, incoming: &Incoming) -> Result<CatchPlan, PlanningFailure> {
        self.run_passes(&mut 0, (start, incoming), self.departure_s(start), usize::MAX)
    }

    /// Runs as many passes of the [search](Self::search) as a bounded amount of work allows, from number
    /// `pass` on, which is counted up by those that found nothing. A flight that nothing catches at first is
    /// searched once more with every new image. `departure_s` is the time at which the arm
    /// [departed](Self::departure_s) from the ready pose, if it did and has not stood still anywhere else
    /// since.
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
        self.run_passes(pass, (start, incoming), departure_s, MAX_WORK)
    }

    /// Runs passes from number `*pass` on until one finds a catch or so much work is done.
    fn run_passes(
        &self,
        pass: &mut usize,
        (start, incoming): (&Start, &Incoming),
        departure_s: Option<f64>,
        most_work: usize,
    ) -> Result<CatchPlan, PlanningFailure> {
        let obstacles = vec![Obstacle::default(); incoming.grasps.grasps.len()];
        let reach = self.reach_map.as_deref().zip(departure_s).map(|(map, departure_s)| Reach { map, departure_s });
        let mut search = Search { start, incoming, reach, obstacles, work: 0 };
        let mut failure = PlanningFailure::NoGrasp;
        for _ in 0..PASSES {
            let left = most_work.saturating_sub(search.work);
            if left == 0 {
                break;
            }
            match Pass::new(self, &mut search, *pass).run(left) {
                Err(why) => failure = failure.max(why),
                found => return found,
            }
            *pass += 1;
        }
        Err(failure)
    }

    /// Cost that rates how well an object will be held: its grasp's heuristics, its velocity relative to the
    /// gripper, `v_G` in G, and the gripper's angular speed.
    fn holding_cost(&self, incoming: &Incoming, still_cost: f64, v_G: &Vector3<f64>, spin_radps: f64) -> f64 {
        let weights = &self.motion.config.weights;
        let (speed_mps, direction) = (v_G.norm(), v_G.try_normalize(1e-6).unwrap_or_default());
        still_cost
            + incoming.config.weights.of_direction(direction.x.abs(), direction.y)
            + weights.speed * speed_mps
            + weights.spin * spin_radps
    }

    /// Holding cost for a gripper at `X_WG` that moves.
    fn holding_cost_moving(
        &self,
        incoming: &Incoming,
        (X_WG, still_cost): (&Pose, f64),
        v_WO: &Vector3<f64>,
        moves: &TerminalVelocity,
    ) -> f64 {
        let v_G = X_WG.rotation.inverse_transform_vector(&(v_WO - moves.v_WG));
        self.holding_cost(incoming, still_cost, &v_G, moves.w_WG.norm())
    }

    /// The least that it may be expected to cost, before a posture is known.
    fn least_holding_cost(&self, incoming: &Incoming, ranked: &RankedGrasp, v_WO: &Vector3<f64>) -> f64 {
        let v_G = ranked.X_WG.rotation.inverse_transform_vector(v_WO);
        let across = (1.0 - EXPECTED_ACROSS_MPS / libm::hypot(v_G.x, v_G.z).max(1e-6)).max(0.0);
        let v_G = v_G.component_mul(&Vector3::new(across, 1.0 - MAX_SPEED_FRACTION, across));
        self.holding_cost(incoming, ranked.still_cost, &v_G, 0.0)
    }

    /// Turns a candidate into a plan over these splines, whose motion still has to be safe; `None` if it
    /// cannot brake.
    pub(super) fn finish(
        &self,
        incoming: &Incoming,
        reachable: &ReachableCatch,
        grasp: &Grasp,
        (terminal_velocity, control_points): Reached,
        point_to_point: &PointToPoint,
    ) -> Option<CatchPlan> {
        let trajectory =
            self.motion.through(point_to_point.start.time_s, reachable.catch_s, control_points, incoming.failures)?;
        let ReachableCatch { catch_s, approach, X_WG, posture: Posture { q, elbow }, cost, still_cost } = *reachable;
        let passing = (&X_WG, still_cost);
        let holding_cost = self.holding_cost_moving(incoming, passing, &point_to_point.v_WO, &terminal_velocity);
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
            spin_radps: terminal_velocity.w_WG.norm(),
            weights: point_to_point.weights,
            cost,
            holding_cost,
            trajectory,
        })
    }
}
