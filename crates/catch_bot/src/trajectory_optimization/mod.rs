//! Trajectory optimization (paper, III-D): how the arm gets to a catch.
//!
//! A [`CatchSearch`] answers two questions. [`CatchSearch::search`]: which catch time, grasp and redundancy
//! can the arm reach? [`CatchSearch::retarget`]: the flight is known better now, how does the running motion
//! change? A [`MotionPlanner`] generates the motions for both. Its steps are each in a module:
//!
//! * [`reach_map`]: when the gripper can be where, before any inverse kinematics;
//! * [`reachability`]: what each joint can reach in the time left, exactly;
//! * [`terminal_velocity`]: the joint velocities at the catch, so that the gripper moves along with the
//!   object;
//! * [`joint_spline`]: the motion, one small [quadratic program](catch_body::quadratic_program) per joint,
//!   and the braking after it;
//! * [`motion`]: both put together and checked against torque limits and collision.

pub mod failure_counter;
pub mod joint_spline;
pub mod motion;
pub mod point_to_point;
pub mod posture;
pub mod reach_map;
pub mod reachability;
mod rest_to_rest;
pub mod retarget;
pub mod search;
mod swept_volume;
pub mod terminal_velocity;

use std::sync::Arc;

use catch_body::{
    Gripper, JointVector, Pose, Robot, clearance::ArmClearance, quantity, shape::Cuboid, symmetry::Symmetry,
};
use catch_cell::{BSpline, Setpoint};
use nalgebra::Point3;
use serde::{Deserialize, Serialize};

use crate::{
    grasp_selection::{self, Approach, Grasp, GraspSet},
    trajectory_prediction::FlightTrajectory,
};
use failure_counter::FailureCounter;
use joint_spline::{EndKind, Ends, JointSpline};
use posture::{Elbow, PostureFinder};
use reach_map::ReachMap;

/// Settings of trajectory optimization.
#[quantity::checked(default, deny_unknown_fields)]
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Config {
    /// Plans stay this far from the ends of the joints' ranges, in radians, so that an impact cannot push a
    /// joint out. No setting of a file, like the two scalings after it.
    #[serde(skip)]
    pub position_margin_rad: f64,
    /// Fraction of the velocity limits that plans may use.
    #[serde(skip)]
    pub velocity_scaling: f64,
    /// Fraction of the torque limits that a plan may use.
    #[serde(skip)]
    pub torque_scaling: f64,
    /// Fraction of the velocity limits that a joint may have at the catch: the impact of a banana adds up to
    /// 5 %.
    pub terminal_velocity_scaling: quantity::limit_scaling,
    /// Mass of the object in kg, if it is known: the velocity that its impact adds to the joints is kept free
    /// for it.
    pub object_mass_kg: quantity::thrown_mass_kg<Option<f64>>,
    /// The arm keeps this far from itself and from the floor, in metres.
    pub clearance_m: quantity::size_m,
    /// Weights of the choice among reachable catches.
    pub weights: search::Weights,
}

impl Default for Config {
    fn default() -> Self {
        Self {
            position_margin_rad: 0.02,
            velocity_scaling: 0.98,
            terminal_velocity_scaling: 0.9,
            object_mass_kg: None,
            torque_scaling: 0.95,
            clearance_m: 0.02,
            weights: search::Weights::default(),
        }
    }
}

/// Highest fraction of the object's velocity at which the gripper moves along (paper, III-D: 30 %).
pub const MAX_SPEED_FRACTION: f64 = 0.3;
/// Weight of keeping close to the comfortable pose, λ in [`joint_spline`]; the paper minimizes this distance
/// alone.
const COMFORT_WEIGHT: f64 = 0.02;
/// Weight of a steady velocity just before the catch, μ in [`joint_spline`], for the paper's pre-grasp
/// constraints.
const STEADY_END_WEIGHT: f64 = 0.002;
/// Distance between the catch times that are tried, in seconds, if nobody asks for another.
const TIME_STEP_S: f64 = 0.02;
/// A new search must leave at least this much time until the catch, in seconds.
const MIN_LEAD_S: f64 = 0.12;

/// A catch: when, where and how the arm gets there.
#[derive(Debug, Clone, PartialEq)]
pub struct CatchPlan {
    /// Time at which the object is at the grasp centre, in seconds on the cell's clock.
    pub catch_s: f64,
    /// The grasp, fixed to the object.
    pub grasp: Grasp,
    /// Direction from which the object enters the gripper.
    pub approach: Approach,
    /// Pose of the gripper in W at the catch.
    pub X_WG: Pose,
    /// Joint positions at the catch, in radians.
    pub q: JointVector,
    /// Opening before the catch, in metres.
    pub aperture_m: f64,
    /// True if the object is predicted to enter without touching the open gripper.
    pub approach_is_free: bool,
    /// Posture of the elbow, for S-R-S arms.
    pub elbow: Option<Elbow>,
    /// Fraction of the object's velocity at which the gripper moves along with it.
    pub speed_fraction: f64,
    /// Angular speed of the gripper at the catch, in rad/s.
    pub spin_radps: f64,
    /// Weights of the choice of the velocities at the catch; replans keep to them.
    pub weights: terminal_velocity::Weights,
    /// Cost of the catch, by which the search chose it; less is better.
    pub cost: f64,
    /// Part of the cost that rates how well the object will be held: the heuristics and its speed past the
    /// fingers, as the flight is predicted now.
    pub holding_cost: f64,
    /// The motion: to the catch and on to rest.
    pub trajectory: BSpline,
}

impl CatchPlan {
    /// The catch of a `grasp` by a motion from elsewhere: the gripper is where the motion has it, and the
    /// object enters toward the palm.
    pub fn of_motion(
        robot: &Robot,
        trajectory: BSpline,
        flight: &FlightTrajectory,
        catch_s: f64,
        grasp: Grasp,
    ) -> Self {
        let [q, dq, _] = trajectory.evaluate(catch_s);
        let (V_WG, v_WO) = (robot.gripper_twist(&q, &dq), flight.twist_at(catch_s).linear);
        Self {
            catch_s,
            approach: Approach::TowardPalm,
            X_WG: robot.gripper_pose(&q),
            q,
            aperture_m: grasp.aperture_m,
            grasp,
            approach_is_free: true,
            elbow: None,
            speed_fraction: V_WG.linear.dot(&v_WO) / v_WO.norm_squared().max(f64::MIN_POSITIVE),
            spin_radps: V_WG.angular.norm(),
            weights: terminal_velocity::Weights::BALANCED,
            cost: 0.0,
            holding_cost: 0.0,
            trajectory,
        }
    }
}

/// Reason for which there is no plan, from the least to the most that was possible.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum PlanningFailure {
    /// No grasp suits the flight's direction.
    NoGrasp,
    /// The arm cannot be anywhere on the flight in time.
    OutOfReach,
    /// Catches are within reach, but the object would hit the open gripper on its approach.
    Blocked,
    /// Catches are within reach, but no motion to one keeps all limits: infeasible.
    NoMotion,
    /// The search was cut short by its bound on the work: there may be a catch.
    OutOfBudget,
}

/// State of the arm when a new motion takes over.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Start {
    /// Time at which the new motion takes over, in seconds on the cell's clock.
    pub time_s: f64,
    /// Position, velocity and acceleration then.
    pub state: Setpoint,
}

/// An object in flight, and how it may be held.
#[derive(Debug, Clone, Copy)]
pub struct Incoming<'a> {
    /// Predicted flight of the object.
    pub flight: &'a FlightTrajectory,
    /// Grasps of the object.
    pub grasps: &'a GraspSet,
    /// Settings of grasp selection.
    pub config: &'a grasp_selection::Config,
    /// Counts what fails numerically on the way to a catch.
    pub failures: &'a FailureCounter,
}

/// Generates motions of one arm with one gripper.
#[derive(Debug)]
pub struct MotionPlanner {
    /// Settings of the planner.
    pub config: Config,
    /// The arm with the gripper's mass on it.
    pub robot: Robot,
    /// The gripper that it plans for.
    pub gripper: Gripper,
    /// Finder of the arm's postures.
    pub finder: PostureFinder,
    /// Largest distance of the gripper's origin from each joint, in metres.
    to_gripper_m: JointVector,
    /// The base's distance from the farthest place of the gripper's origin, in metres.
    gripper_reach_m: f64,
    /// Largest extent of the arm with the gripper beyond each joint, in metres.
    pub extents_m: JointVector,
    clearance: ArmClearance,
    catch_splines: CatchSplines,
    brake_spline: JointSpline,
}

/// Splines of one kind: to a given velocity at the catch, and for the range of such velocities.
#[derive(Debug)]
pub struct CatchSplines {
    /// Spline to a given velocity.
    pub at: JointSpline,
    /// Spline to the lowest or highest velocity.
    pub range: JointSpline,
}

impl CatchSplines {
    /// Prepares the splines, with spans of these relative lengths; `start_acceleration` states whether the
    /// acceleration at the start is given.
    pub fn new(spans: &[f64], start_acceleration: bool) -> Self {
        let ends = |end| Ends { start_acceleration, end };
        Self {
            at: JointSpline::new(spans, ends(EndKind::At), COMFORT_WEIGHT, STEADY_END_WEIGHT),
            range: JointSpline::new(spans, ends(EndKind::Position), COMFORT_WEIGHT, 0.0),
        }
    }
}

impl MotionPlanner {
    /// Prepares what does not depend on any catch.
    pub fn new(robot: Robot, gripper: Gripper, config: Config) -> Self {
        let robot = robot.carrying(&gripper);
        // Short first spans take up the acceleration at a replan, short last ones steady the velocity before
        // the catch.
        let catch_splines = CatchSplines::new(&[0.35, 0.65, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 0.5, 0.5], true);
        let at_rest = Ends { start_acceleration: true, end: EndKind::Rest };
        let brake_spline = JointSpline::new(&[0.5, 0.5, 1.0, 1.0, 1.0, 1.0, 0.5, 0.5], at_rest, 0.0, 0.0);
        let flange_m = robot.X_LG.translation.vector.norm();
        let lengths_m = robot.per_joint(|joint| joint.X_PL.translation.vector.norm());
        let to_gripper_m = JointVector::from_fn(|i, _| lengths_m.iter().skip(i + 1).sum::<f64>() + flange_m);
        let mut extents_m = to_gripper_m.add_scalar(hand_m(&gripper));
        for (link, capsule) in &robot.capsules {
            let beyond_m = capsule.from.coords.norm().max(capsule.to.coords.norm()) + capsule.radius;
            // Link j follows joint j − 1.
            for i in 0..*link {
                let link_m = lengths_m.iter().take(*link).skip(i + 1).sum::<f64>();
                extents_m[i] = extents_m[i].max(link_m + beyond_m);
            }
        }
        Self {
            to_gripper_m,
            gripper_reach_m: lengths_m.sum() + flange_m,
            extents_m,
            finder: PostureFinder::new(&robot),
            clearance: ArmClearance::new(&robot, &gripper),
            robot,
            gripper,
            config,
            catch_splines,
            brake_spline,
        }
    }

    /// The base's distance from the farthest point to which the gripper can extend, in metres.
    pub fn longest_reach_m(&self) -> f64 {
        self.gripper_reach_m + hand_m(&self.gripper)
    }
}

/// The distance of the gripper's farthest corner from its origin, however wide it opens.
fn hand_m(gripper: &Gripper) -> f64 {
    let [left, right] = gripper.fingers(gripper.max_width_m);
    [gripper.body(), left, right].iter().map(Cuboid::farthest_corner).fold(0.0, f64::max)
}

/// Searches catches for one arm with one gripper, and adapts them to flights that are known better.
#[derive(Debug)]
pub struct CatchSearch {
    /// Planner of the motions.
    pub motion: MotionPlanner,
    /// Earliest times of the gripper's poses, if they were prepared.
    reach_map: Option<Arc<ReachMap>>,
    /// Distance between the catch times that are tried, in seconds.
    pub time_step_s: f64,
}

impl CatchSearch {
    /// The object's centre in G where the hand may turn about it as the arm can: a ball looks the same from
    /// everywhere, and an arm of few joints cannot take every pose.
    pub(super) fn pivot_G(&self, incoming: &Incoming, grasp: &Grasp) -> Option<Point3<f64>> {
        let turns = self.motion.robot.has_few_joints() && incoming.grasps.symmetry == Symmetry::Sphere;
        turns.then(|| grasp.X_OG.inverse_transform_point(&Point3::origin()))
    }

    /// Creates the search over the motions that the planner can generate. With a map of the poses that the
    /// arm can reach from its ready pose, hopeless times and grasps cost next to nothing; arms of [some
    /// kinds](ReachMap::serves) need it to be quick.
    pub fn new(motion: MotionPlanner, reach_map: Option<Arc<ReachMap>>) -> Self {
        Self { motion, reach_map, time_step_s: TIME_STEP_S }
    }

    /// Departure time of an arm that is about to move from the ready pose of the map, in seconds on the
    /// cell's clock; `None` if it is elsewhere already.
    pub fn departure_s(&self, start: &Start) -> Option<f64> {
        self.reach_map.as_ref().filter(|map| map.departs_at(start)).map(|_| start.time_s)
    }
}
