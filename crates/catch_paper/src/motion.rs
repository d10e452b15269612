//! Trajectory optimization as in the paper (III-D): a B-spline for all joints from inverse kinematics and linear interpolation
//! through rounds of tightening tolerances, then from the previous motion at every replan.
//!
//! Text and code differ. The text minimizes the distance from the comfortable pose; the code has no cost, and its solver stops
//! where the tolerances are just met. The code is followed; a cost is only there to make the programs convex. The code wants the
//! start within the tolerances too, so that its plans do not start where the arm is; the text wants it exact and is followed.
//! The code carries out what could not be solved; here a motion that misses its tolerances is taken only if it comes closer
//! than the running one, and none that breaks a limit or collides.

use catch_body::{JointVector, MAX_JOINTS};
use catch_bot::settings::{DURATION_S, FRACTION, Faults, NOT_NEGATIVE, SettingError, Settings};
use catch_bot::{
    grasp_selection::{Approach, Grasp},
    trajectory_optimization::{CatchPlan, MotionPlanner, Start, terminal_velocity},
    trajectory_prediction::FlightTrajectory,
};
use catch_cell::BSpline;
use nalgebra::Point3;
use serde::{Deserialize, Serialize};

use crate::sqp::{MET, Problem, Solution, Tolerance, Waypoint, clamped_knots};

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
    /// Factor on the tolerances of the gripper's pose then (paper).
    pub pre_grasp_loosening: f64,
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
}

impl Default for Config {
    fn default() -> Self {
        Self {
            control_points: 8,
            speed_fraction: 0.3,
            pre_grasp_s: 0.03,
            pre_grasp_loosening: 10.0,
            loosest: Tolerances { position_m: 0.1, rotation_error_rad: 0.8, velocity_mps: 2.0 },
            rounds: 12,
            tightening: 0.875,
            replan: Tolerances { position_m: 0.02, rotation_error_rad: 0.1, velocity_mps: 0.4 },
            comfort_weight: 1e-4,
            stops_when_met: true,
        }
    }
}

impl Settings for Config {
    fn faults(&self) -> Vec<SettingError> {
        Faults::default()
            .counts([("rounds", self.rounds)])
            .values(&(7.0..=40.0), [("control_points", self.control_points as f64)])
            .values(&FRACTION, [("speed_fraction", self.speed_fraction), ("tightening", self.tightening)])
            .values(&DURATION_S, [("pre_grasp_s", self.pre_grasp_s)])
            .values(
                &NOT_NEGATIVE,
                [("pre_grasp_loosening", self.pre_grasp_loosening), ("comfort_weight", self.comfort_weight)],
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
    grasp: Grasp,
    config: &Config,
) -> Option<CatchPlan> {
    let q = inverse_kinematics(planner, &(flight.pose_at(catch_s) * grasp.X_OG))?;
    let mut guess = between(&start.state.q, &q, config.control_points);
    let mut tolerance: Tolerance = config.loosest.into();
    let mut best: Option<(Solution, BSpline)> = None;
    for _ in 0..config.rounds {
        let problem = problem(planner, start, flight, catch_s, &grasp, tolerance, config);
        let Some(found) = problem.solve(&guess).ok().filter(|found| found.excess < MET) else { break };
        guess.clone_from(&found.spline.control_points);
        if let Some(trajectory) = completed(planner, &found.spline, &grasp) {
            best = Some((found, trajectory));
        }
        tolerance = tolerance.scaled(config.tightening);
    }
    let (found, trajectory) = best?;
    Some(catch_plan(planner, flight, catch_s, grasp, &found.spline, trajectory))
}

/// The running plan for a flight that is known better: `None` if nothing comes closer to it.
pub fn follow(
    planner: &MotionPlanner,
    start: &Start,
    flight: &FlightTrajectory,
    plan: &CatchPlan,
    config: &Config,
) -> Option<CatchPlan> {
    let (catch_s, grasp) = (plan.catch_s, &plan.grasp);
    let problem = problem(planner, start, flight, catch_s, grasp, config.replan.into(), config);
    // Control points are about where the curve is at the means of three knots (Greville's abscissae).
    let running = |time_s: f64| plan.trajectory.setpoint(time_s);
    let places = problem.knots_s[1..].windows(3).take(config.control_points);
    let guess: Vec<JointVector> = places.map(|knots| running(knots.iter().sum::<f64>() / 3.0).q).collect();
    let found = problem.solve(&guess).ok()?;
    if found.excess >= MET && found.excess >= problem.excess_of(running, config.speed_fraction) {
        return None;
    }
    let trajectory = completed(planner, &found.spline, grasp)?;
    Some(catch_plan(planner, flight, catch_s, grasp.clone(), &found.spline, trajectory))
}

/// A motion with braking after it, `None` if that breaks any limit or collides.
fn completed(planner: &MotionPlanner, to_catch: &BSpline, grasp: &Grasp) -> Option<BSpline> {
    planner.completed(to_catch.clone(), grasp).filter(|trajectory| planner.keeps_limits(trajectory))
}

/// Joint positions that put the gripper at `X_WG`, near the comfortable pose.
fn inverse_kinematics(planner: &MotionPlanner, X_WG: &catch_body::Pose) -> Option<JointVector> {
    let robot = planner.robot();
    let mut ranges = [[0.0; 2]; MAX_JOINTS];
    for (range, joint) in ranges.iter_mut().zip(&robot.joints) {
        *range = [joint.limits.lower, joint.limits.upper];
    }
    let comfortable = &robot.comfortable_q;
    let near = robot.nearby_solution(X_WG, comfortable, &ranges);
    near.or_else(|| {
        let all = robot.solutions_within(X_WG, comfortable, &ranges);
        all.into_iter().min_by(|a, b| (a - comfortable).norm().total_cmp(&(b - comfortable).norm()))
    })
}

/// Both poses of the gripper, before the grasp and at it, and the velocities there.
fn problem<'a>(
    planner: &'a MotionPlanner,
    start: &Start,
    flight: &FlightTrajectory,
    catch_s: f64,
    grasp: &Grasp,
    tolerance: Tolerance,
    config: &Config,
) -> Problem<'a> {
    let robot = planner.robot();
    let at = |time_s: f64, tolerance: Tolerance| Waypoint {
        time_s,
        X_WG: flight.pose_at(time_s) * grasp.X_OG,
        v_WO: flight.twist_at(time_s).linear,
        tolerance,
    };
    let looser = Tolerance { velocity_mps: tolerance.velocity_mps, ..tolerance.scaled(config.pre_grasp_loosening) };
    Problem {
        robot,
        // The paper constrains the origin of the gripper's frame.
        p_GP: Point3::origin(),
        knots_s: clamped_knots(start.time_s, catch_s, config.control_points),
        start: start.state,
        start_acceleration: true,
        limits: planner.limits_from(start),
        waypoints: vec![at(catch_s - config.pre_grasp_s, looser), at(catch_s, tolerance)],
        speed_fraction: [config.speed_fraction; 2],
        comfortable_q: robot.comfortable_q,
        comfort_weight: config.comfort_weight,
        speed_weight: 0.0,
        first_will_do: config.stops_when_met,
    }
}

fn catch_plan(
    planner: &MotionPlanner,
    flight: &FlightTrajectory,
    catch_s: f64,
    grasp: Grasp,
    spline: &BSpline,
    trajectory: BSpline,
) -> CatchPlan {
    let [q, dq, _] = spline.evaluate(catch_s);
    let V_WG = planner.robot().gripper_twist(&q, &dq);
    let v_WO = flight.twist_at(catch_s).linear;
    CatchPlan {
        catch_s,
        X_WG: flight.pose_at(catch_s) * grasp.X_OG,
        aperture_m: grasp.aperture_m,
        approach_is_free: true,
        grasp,
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
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Tolerances {
    /// Along each axis, in metres.
    pub position_m: f64,
    /// About each axis, in radians.
    pub rotation_error_rad: f64,
    /// Along each axis, in m/s.
    pub velocity_mps: f64,
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
}
