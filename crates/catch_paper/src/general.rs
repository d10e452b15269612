//! A catch whose time and pose are given, by the general form ([`crate::sqp`]): what
//! [`PosedPlanner`](crate::posed::PosedPlanner) does by closed forms and one small program per joint, for
//! arms and demands that have none.

use catch_body::JointVector;
use catch_bot::trajectory_optimization::{
    MAX_SPEED_FRACTION, MotionPlanner, Start,
    motion::{LimitScaling, ROUNDING},
    posture::Posture,
    reachability::fraction_used,
};
use catch_cell::spline::DEGREE;

use crate::posed::{PosedCatch, Target};
use crate::sqp::{MET, Problem, StartState, Tolerance, Waypoint, clamped_knots};

/// Control points of the motion.
const CONTROL_POINTS: usize = 10;
/// Postures at most from which it is sought.
const SEEDS: usize = 4;
/// Weight of the distance from the comfortable pose against the fraction of the object's velocity.
const COMFORT_WEIGHT: f64 = 1e-4;
/// A speed fraction this close to the highest that is wanted, relative, needs no further search.
const GOOD_ENOUGH: f64 = 0.99;

/// The motion to `target` with the highest speed fraction that was found, the acceleration at the start being
/// free; `None` if none was found, which proves nothing.
pub fn catch_at(planner: &MotionPlanner, start: &Start, target: &Target) -> Option<PosedCatch> {
    let MotionPlanner { robot, config, .. } = planner;
    let scaling = LimitScaling { velocity: config.velocity_scaling, acceleration: 1.0 - ROUNDING };
    let reaches = planner.reaches(start, target.catch_s - start.time_s, scaling);
    let ranges = planner.ranges(&reaches, &start.state.q);
    let dof = robot.dof();
    let all = robot.solutions_within(&target.X_WG, &start.state.q, &ranges);
    let used = |q: &JointVector| fraction_used(&reaches, &start.state.q, q, dof);
    let mut seeds: Vec<_> = all.into_iter().filter_map(|q| Some((used(&q)?, q))).collect();
    seeds.sort_by(|a, b| a.0.total_cmp(&b.0));

    let Target { catch_s, X_WG, v_WO } = *target;
    let problem = Problem {
        robot,
        knots_s: clamped_knots(start.time_s, catch_s, CONTROL_POINTS),
        start: start.state,
        keeps_start: StartState::Velocity,
        stretch: [1.0; 2],
        stretch_guess: 1.0,
        limits: (0..dof).map(|i| planner.limits(i, &start.state, scaling)).collect(),
        waypoints: vec![Waypoint {
            time_s: catch_s,
            X_WG,
            p_GP: planner.gripper.grasp_centre(),
            v_WO,
            fraction: None,
            tolerance: Tolerance::NONE,
        }],
        speed_fraction: [0.0, MAX_SPEED_FRACTION],
        comfortable_q: Some(robot.comfortable_q),
        comfort_weight: COMFORT_WEIGHT,
        speed_weight: 1.0,
        first_will_do: false,
    };
    let mut best: Option<PosedCatch> = None;
    for (_, q) in seeds.iter().take(SEEDS) {
        // Straight ahead in time to a posture that is right: the limits are what is left to be found.
        let last = (CONTROL_POINTS - 1) as f64;
        let guess: Vec<_> = (0..CONTROL_POINTS).map(|i| start.state.q.lerp(q, i as f64 / last)).collect();
        let Some(found) = problem.solve(&guess).ok().filter(|it| it.excess < MET) else { continue };
        if best.as_ref().is_some_and(|best| best.speed_fraction >= found.speed_fraction)
            || !planner.keeps_torque(&found.spline)
        {
            continue;
        }
        let q = found.spline.control_points[found.spline.knots_s.len() - DEGREE - 2];
        let (posture, speed_fraction) = (Posture { q, elbow: None }, found.speed_fraction);
        best = Some(PosedCatch { posture, speed_fraction, spline: found.spline });
        if speed_fraction >= GOOD_ENOUGH * MAX_SPEED_FRACTION {
            break;
        }
    }
    best
}
