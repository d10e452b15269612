//! Trajectory optimization as in the paper (III-D): a B-spline for all joints from inverse kinematics and linear interpolation
//! through rounds of tightening tolerances, then from the previous motion at every replan.
//!
//! Text and code differ. The text minimizes the distance from the comfortable pose; the code has no cost, and its solver stops
//! where the tolerances are just met. The code is followed; a cost is only there to make the programs convex. The code wants the
//! start within tolerances too, so that its plans do not start where the arm is; the text wants it exact. The code carries out
//! what could not be solved. By default the text is followed there, and a motion that misses its tolerances is taken only if it
//! comes closer than the running one, and none that breaks a limit or collides; settings marked "code" go the other way.

use catch_body::{JointVector, MAX_JOINTS, Pose};
use catch_bot::settings::{DURATION_S, FRACTION, Faults, NOT_NEGATIVE, PERIOD_S, SettingError, Settings};
use catch_bot::{
    grasp_selection::{Approach, Grasp},
    trajectory_optimization::{CatchPlan, MotionPlanner, Start, failure_counter::FailureCounter, terminal_velocity},
    trajectory_prediction::FlightTrajectory,
};
use catch_cell::{BSpline, Setpoint};
use nalgebra::{Point3, UnitQuaternion};
use serde::{Deserialize, Serialize};

use crate::sqp::{MET, Problem, StartState, Tolerance, Waypoint, clamped_knots};

/// Duration of the first guess in the authors' code, whatever the catch time.
const FIRST_GUESS_S: f64 = 1.0;

/// Settings of the paper's trajectory optimization.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Config {
    /// Control points of the B-spline (code).
    pub control_points: usize,
    /// Fraction of the object's velocity at which the gripper moves along (paper).
    pub speed_fraction: f64,
    /// The gripper follows the object from this long before the catch, in seconds (paper: 30 ms).
    pub pre_grasp_s: f64,
    /// Factor on the tolerance of the gripper's position then (paper).
    pub pre_grasp_loosening: f64,
    /// Factor on the tolerance of its orientation then (paper: the same; code: 1).
    pub pre_grasp_rotation_loosening: f64,
    /// Tolerances of the first round (code).
    pub loosest: Tolerances,
    /// Rounds of the first plan, which goes on until one fails (code).
    pub rounds: usize,
    /// Factor on the tolerances from one round to the next (code).
    pub tightening: f64,
    /// Tolerances of replans (code).
    pub replan: Tolerances,
    /// Weight of the distance from the comfortable pose. Makes the programs convex; without `stops_when_met` it is the text's
    /// cost.
    pub comfort_weight: f64,
    /// Whether any motion within the tolerances will do, as in the code.
    pub stops_when_met: bool,
    /// Whether there is a cost at all (text); else each program stays near the last one's motion, which no cost tells it to
    /// (code).
    pub has_cost: bool,
    /// Whether motions start in the state of the joints (text). Else the last link starts within the tolerances of the catch, and
    /// the joints are free (code).
    pub starts_in_joints: bool,
    /// Whether the last link is then meant where it is sensed, and not where the running plan has it.
    pub starts_where_sensed: bool,
    /// Whether the gripper's velocity counts before the grasp (text).
    pub pre_grasp_velocity: bool,
    /// How long the spline goes on after the catch, in seconds, without coming to rest (code: 0.6). At zero it ends there, and
    /// braking follows.
    pub tail_s: f64,
    /// Whether acceleration limits are part of the programs; neither text nor code has them.
    pub limits_acceleration: bool,
    /// Whether motions are kept from being carried out that break a limit of the arm or collide; the code knows no such check.
    pub checks_motions: bool,
    /// Whether what could not be solved is carried out, and is the guess of the next program (code).
    pub keeps_unsolved: bool,
    /// Whether the gripper keeps the orientation that it was planned with first; its position follows the flight (code).
    pub freezes_orientation: bool,
    /// Whether inverse kinematics for the guess takes the last link's axes for those of the gripper (code).
    pub confuses_wrist: bool,
    /// How far beyond the gripper's origin, along its approach, the point is that is meant to be there, in metres (code: 0.01).
    pub weld_error_m: f64,
    /// Whether the guess has the duration of the last motion, one second at first (code); else the one that is wanted.
    pub guesses_duration: bool,
}

impl Default for Config {
    fn default() -> Self {
        Self {
            control_points: 8,
            speed_fraction: 0.3,
            pre_grasp_s: 0.03,
            pre_grasp_loosening: 10.0,
            pre_grasp_rotation_loosening: 10.0,
            loosest: Tolerances { position_m: 0.1, rotation_error_rad: 0.8, velocity_mps: 2.0, time_s: 0.0 },
            rounds: 12,
            tightening: 0.875,
            replan: Tolerances { position_m: 0.02, rotation_error_rad: 0.1, velocity_mps: 0.4, time_s: 0.0 },
            comfort_weight: 1e-4,
            stops_when_met: true,
            has_cost: true,
            starts_in_joints: true,
            starts_where_sensed: false,
            pre_grasp_velocity: true,
            tail_s: 0.0,
            limits_acceleration: true,
            checks_motions: true,
            keeps_unsolved: false,
            freezes_orientation: false,
            confuses_wrist: false,
            weld_error_m: 0.0,
            guesses_duration: false,
        }
    }
}

impl Settings for Config {
    fn faults(&self) -> Vec<SettingError> {
        Faults::default()
            .counts([("rounds", self.rounds)])
            .values(&(7.0..=40.0), [("control_points", self.control_points as f64)])
            .values(&FRACTION, [("speed_fraction", self.speed_fraction), ("tightening", self.tightening)])
            .values(&DURATION_S, [("pre_grasp_s", self.pre_grasp_s), ("tail_s", self.tail_s)])
            .values(
                &NOT_NEGATIVE,
                [
                    ("pre_grasp_loosening", self.pre_grasp_loosening),
                    ("pre_grasp_rotation_loosening", self.pre_grasp_rotation_loosening),
                    ("comfort_weight", self.comfort_weight),
                    ("weld_error_m", self.weld_error_m),
                ],
            )
            .table("loosest", &self.loosest)
            .table("replan", &self.replan)
            .all()
    }
}

/// The first plan: round by round, until one cannot be met.
pub fn plan(
    planner: &MotionPlanner,
    start: &Start,
    flight: &FlightTrajectory,
    catch_s: f64,
    grasp: &Grasp,
    config: &Config,
) -> Option<CatchPlan> {
    let X_WG = flight.pose_at(catch_s) * grasp.X_OG;
    let goal = Goal::new(flight, catch_s, grasp, config.freezes_orientation.then_some(X_WG.rotation));
    let q = inverse_kinematics(planner, &X_WG, config)?;
    let mut guess = between(&start.state.q, &q, config.control_points);
    let mut duration_s = FIRST_GUESS_S;
    let mut tolerances = config.loosest;
    let mut best: Option<(BSpline, BSpline)> = None;
    for round in 0..config.rounds {
        let problem = problem(planner, start, &goal, &tolerances, duration_s, config);
        let Ok(found) = problem.solve(&guess) else { break };
        duration_s = found.spline.end_s() - start.time_s;
        let is_met = found.excess < MET;
        if is_met || (round == 0 && config.keeps_unsolved) {
            guess.clone_from(&found.spline.control_points);
            let trajectory = completed(planner, &found.spline, grasp, config);
            best = trajectory.map(|trajectory| (found.spline, trajectory)).or(best);
        }
        if !is_met {
            break;
        }
        tolerances = tolerances.scaled(config.tightening);
    }
    best.map(|(found, trajectory)| catch_plan(planner, &goal, &found, trajectory))
}

/// The running plan for a flight that is known better: `None` if nothing comes closer to it.
pub fn follow(
    planner: &MotionPlanner,
    start: &Start,
    flight: &FlightTrajectory,
    plan: &CatchPlan,
    config: &Config,
) -> Option<CatchPlan> {
    let R_WG = config.freezes_orientation.then_some(plan.X_WG.rotation);
    let goal = Goal::new(flight, plan.catch_s, &plan.grasp, R_WG);
    let duration_s = plan.trajectory.end_s() - plan.trajectory.start_s();
    let problem = problem(planner, start, &goal, &config.replan, duration_s, config);
    if config.keeps_unsolved && config.tail_s > 0.0 {
        let found = problem.solve(&plan.trajectory.control_points).ok()?;
        let trajectory = completed(planner, &found.spline, &plan.grasp, config)?;
        return Some(catch_plan(planner, &goal, &found.spline, trajectory));
    }
    // Control points are about where the curve is at the means of three knots (Greville's abscissae).
    let running = |time_s: f64| plan.trajectory.setpoint(time_s);
    let places = problem.knots_s[1..].windows(3).take(config.control_points);
    let guess: Vec<JointVector> = places.map(|knots| running(knots.iter().sum::<f64>() / 3.0).q).collect();
    let found = problem.solve(&guess).ok()?;
    let is_worse = || found.excess >= MET && found.excess >= problem.excess_of(running, config.speed_fraction);
    if !config.keeps_unsolved && is_worse() {
        return None;
    }
    let trajectory = completed(planner, &found.spline, &plan.grasp, config)?;
    Some(catch_plan(planner, &goal, &found.spline, trajectory))
}

/// Where the gripper is to meet the object.
struct Goal<'a> {
    flight: &'a FlightTrajectory,
    catch_s: f64,
    grasp: &'a Grasp,
    /// The gripper in the object at the catch.
    X_OG: Pose,
}

impl<'a> Goal<'a> {
    /// The grasp's pose; if `R_WG` is given, with that orientation of the gripper at the catch, whatever the flight's. Before the
    /// catch it turns with the object all the same.
    fn new(flight: &'a FlightTrajectory, catch_s: f64, grasp: &'a Grasp, R_WG: Option<UnitQuaternion<f64>>) -> Self {
        let X_OG = R_WG.map_or(grasp.X_OG, |R_WG| {
            let X_WO = flight.pose_at(catch_s);
            let p_OG_W = R_WG * grasp.X_OG.rotation.inverse_transform_vector(&grasp.X_OG.translation.vector);
            X_WO.inverse() * Pose::from_parts((X_WO.translation.vector + p_OG_W).into(), R_WG)
        });
        Self { flight, catch_s, grasp, X_OG }
    }

    /// Pose of the gripper that holds the object at `time_s`.
    fn X_WG(&self, time_s: f64) -> Pose {
        self.flight.pose_at(time_s) * self.X_OG
    }
}

/// A motion with braking after it unless it has a tail, `None` if that breaks any limit or collides where that is checked.
fn completed(planner: &MotionPlanner, found: &BSpline, grasp: &Grasp, config: &Config) -> Option<BSpline> {
    // This method does not count what fails numerically.
    let failures = FailureCounter::default();
    if config.tail_s > 0.0 {
        return (!config.checks_motions || planner.keeps_limits(found)).then(|| found.clone());
    }
    if !config.checks_motions {
        let (catch_s, [q, dq, ddq]) = (found.end_s(), found.evaluate(found.end_s()));
        let braking = planner.braking(&Setpoint { q, dq, ddq }, catch_s, &failures);
        return Some(braking.map_or_else(|| found.clone(), |braking| found.clone().followed_by(&braking)));
    }
    planner.completed(found.clone(), grasp, &failures).filter(|trajectory| planner.keeps_limits(trajectory))
}

/// Joint positions that put the gripper at `X_WG`, near the comfortable pose.
fn inverse_kinematics(planner: &MotionPlanner, X_WG: &Pose, config: &Config) -> Option<JointVector> {
    let robot = planner.robot();
    let mut ranges = [[0.0; 2]; MAX_JOINTS];
    for (range, joint) in ranges.iter_mut().zip(&robot.joints) {
        *range = [joint.limits.lower, joint.limits.upper];
    }
    let comfortable = &robot.comfortable_q;
    let solution = |X_WG: &Pose| {
        let near = robot.nearby_solution(X_WG, comfortable, &ranges);
        near.or_else(|| {
            let all = robot.solutions_within(X_WG, comfortable, &ranges);
            all.into_iter().min_by(|a, b| (a - comfortable).norm().total_cmp(&(b - comfortable).norm()))
        })
    };
    if config.confuses_wrist {
        // The last link is to have the gripper's axes: R_WL = R_WG for the R_WG that is wanted. A guess need not be right; where the
        // wrist cannot be so, it is the comfortable pose.
        let R_WL = X_WG.rotation;
        let confused = Pose::from_parts(X_WG.translation, R_WL * robot.X_LG.rotation);
        return Some(solution(&confused).unwrap_or(*comfortable));
    }
    solution(X_WG)
}

/// Both poses of the gripper, before the grasp and at it, and the velocities there; that of the last link at the start if joints
/// are free there.
fn problem<'a>(
    planner: &'a MotionPlanner,
    start: &Start,
    goal: &Goal<'_>,
    tolerances: &Tolerances,
    duration_s: f64,
    config: &Config,
) -> Problem<'a> {
    let robot = planner.robot();
    let tolerance = Tolerance::from(*tolerances);
    // The frame P that is put where the gripper is meant to be.
    let p_GP = Point3::new(0.0, config.weld_error_m, 0.0);
    let X_PG = Pose::from_parts((-p_GP.coords).into(), UnitQuaternion::identity());
    let at = |time_s: f64, tolerance: Tolerance| {
        let (X_WP, v_WO) = (goal.X_WG(time_s), goal.flight.twist_at(time_s).linear);
        Waypoint { time_s, X_WG: X_WP * X_PG, p_GP, v_WO, fraction: None, tolerance }
    };
    let velocity_mps = if config.pre_grasp_velocity { tolerance.velocity_mps } else { f64::INFINITY };
    let looser = Tolerance {
        position_m: tolerance.position_m * config.pre_grasp_loosening,
        rotation_error_rad: tolerance.rotation_error_rad * config.pre_grasp_rotation_loosening,
        velocity_mps,
    };
    let from = (!config.starts_in_joints).then(|| {
        let Setpoint { q, dq, .. } = start.state;
        let X_WP = robot.gripper_pose(&q);
        let v_WO = robot.gripper_twist(&q, &dq).velocity_at(&(X_WP.rotation * p_GP.coords));
        Waypoint { time_s: start.time_s, X_WG: X_WP * X_PG, p_GP, v_WO, fraction: Some(1.0), tolerance }
    });
    let mut limits = if config.starts_in_joints {
        planner.limits_from(start)
    } else {
        robot.joints.iter().map(|joint| joint.limits).collect()
    };
    if !config.limits_acceleration {
        limits.iter_mut().for_each(|limits| limits.acceleration = f64::INFINITY);
    }
    let (catch_s, end_s) = (goal.catch_s, goal.catch_s + config.tail_s);
    let by = tolerances.time_s / (end_s - start.time_s);
    let stretch_guess = if config.guesses_duration { duration_s / (end_s - start.time_s) } else { 1.0 };
    let catch = [at(catch_s - config.pre_grasp_s, looser), at(catch_s, tolerance)];
    Problem {
        robot,
        knots_s: clamped_knots(start.time_s, end_s, config.control_points),
        start: start.state,
        keeps_start: if config.starts_in_joints { StartState::Acceleration } else { StartState::Nothing },
        stretch: [1.0 - by, 1.0 + by],
        stretch_guess,
        limits,
        waypoints: from.into_iter().chain(catch).collect(),
        speed_fraction: [config.speed_fraction; 2],
        comfortable_q: config.has_cost.then_some(robot.comfortable_q),
        comfort_weight: config.comfort_weight,
        speed_weight: 0.0,
        first_will_do: config.stops_when_met,
    }
}

fn catch_plan(planner: &MotionPlanner, goal: &Goal<'_>, found: &BSpline, trajectory: BSpline) -> CatchPlan {
    let (catch_s, grasp) = (goal.catch_s, goal.grasp);
    let [q, dq, _] = found.evaluate(catch_s);
    let V_WG = planner.robot().gripper_twist(&q, &dq);
    let v_WO = goal.flight.twist_at(catch_s).linear;
    CatchPlan {
        catch_s,
        X_WG: goal.X_WG(catch_s),
        aperture_m: grasp.aperture_m,
        approach_is_free: true,
        grasp: grasp.clone(),
        approach: Approach::ThroughGap,
        q,
        elbow: None,
        speed_fraction: V_WG.linear.dot(&v_WO) / v_WO.norm_squared(),
        spin_radps: V_WG.angular.norm(),
        weights: terminal_velocity::Weights::BALANCED,
        cost: 0.0,
        holding_cost: 0.0,
        trajectory,
    }
}

/// The tolerances of one optimization, as files have them.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Tolerances {
    /// Along each axis, in metres.
    pub position_m: f64,
    /// About each axis, in radians.
    pub rotation_error_rad: f64,
    /// Along each axis, in m/s.
    pub velocity_mps: f64,
    /// Of the duration of the motion, in seconds.
    #[serde(default)]
    pub time_s: f64,
}

impl Tolerances {
    /// All of them `by` times as large.
    fn scaled(&self, by: f64) -> Self {
        let Tolerance { position_m, rotation_error_rad, velocity_mps } = Tolerance::from(*self).scaled(by);
        Self { position_m, rotation_error_rad, velocity_mps, time_s: self.time_s * by }
    }
}

impl Settings for Tolerances {
    fn faults(&self) -> Vec<SettingError> {
        Faults::default()
            .values(
                &NOT_NEGATIVE,
                [
                    ("position_m", self.position_m),
                    ("rotation_error_rad", self.rotation_error_rad),
                    ("velocity_mps", self.velocity_mps),
                ],
            )
            .values(&PERIOD_S, [("time_s", self.time_s)].into_iter().filter(|(_, it)| *it != 0.0))
            .all()
    }
}

impl From<Tolerances> for Tolerance {
    fn from(it: Tolerances) -> Self {
        Self { position_m: it.position_m, rotation_error_rad: it.rotation_error_rad, velocity_mps: it.velocity_mps }
    }
}

/// Joint positions between two, evenly spaced.
fn between(from: &JointVector, to: &JointVector, count: usize) -> Vec<JointVector> {
    (0..count).map(|i| from.lerp(to, i as f64 / (count - 1) as f64)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use catch_body::shape::Cuboid;

    #[test]
    fn the_pose_before_the_grasp_is_looser_but_not_its_velocity() {
        let config = Config::default();
        let tolerance: Tolerance = config.replan.into();
        let scaled = tolerance.scaled(config.pre_grasp_loosening);
        assert_eq!(scaled.position_m, 0.2);
        // Twelve rounds end at 2.3 cm and 10°, what the authors' plans were seen to be off by.
        let last = Tolerance::from(config.loosest).scaled(config.tightening.powi(11));
        assert!((last.position_m - 0.023).abs() < 5e-4 && (last.rotation_error_rad.to_degrees() - 10.5).abs() < 0.1);
        assert_eq!(between(&JointVector::zeros(), &JointVector::repeat(7.0), 8)[3][0], 3.0);
    }

    /// A gripper whose orientation at the catch is fixed turns with the object before.
    #[test]
    fn before_the_catch_the_gripper_turns_with_the_object() {
        let flight = FlightTrajectory {
            v_WOcm: nalgebra::Vector3::new(0.0, -4.0, -1.0),
            w_WO: nalgebra::Vector3::new(0.0, 0.0, 2.0),
            ..FlightTrajectory::default()
        };
        let X_OG = Pose::translation(0.0, -0.08, 0.01);
        let (object_width_m, aperture_m, strength_m, overhang_m) = (0.05, 0.1, 0.0, 0.0);
        let held_G = Cuboid { centre: Point3::origin(), size: nalgebra::Vector3::zeros() };
        let grasp = Grasp { X_OG, object_width_m, aperture_m, strength_m, overhang_m, held_G };
        let R_WG = UnitQuaternion::from_euler_angles(0.3, 0.2, 0.1);
        let goal = Goal::new(&flight, 0.6, &grasp, Some(R_WG));
        let at = |time_s: f64| goal.X_WG(time_s).rotation;
        assert!(at(0.6).angle_to(&R_WG) < 1e-9);
        assert!((at(0.48).angle_to(&R_WG) - 0.24).abs() < 1e-9, "{}", at(0.48).angle_to(&R_WG));
        // The object's origin is where the grasp has it in the gripper.
        let p_GO = goal.X_WG(0.6).inverse_transform_point(&Point3::from(flight.pose_at(0.6).translation.vector));
        assert!((p_GO.coords - X_OG.inverse().translation.vector).norm() < 1e-9);
    }
}
