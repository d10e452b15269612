//! Motions to the catches that the brain plans first in real throws.

use std::path::Path;

use anyhow::{Context, Result};
use catch_body::{JointVector, Robot};
use catch_bot::trajectory_optimization::{
    CatchPlan, CatchSplines,
    joint_spline::{End, JointState},
};
use catch_cell::BSpline;
use catch_lab::{
    scenario::setup::{Choice, Setup},
    trial,
};
use serde_json::{Value, json};

use super::{measured, values};
use crate::Options;

/// Spans of the splines, of equal length as a peer's; the acceleration at the start is free as theirs is.
const SPANS: [f64; 10] = [1.0; 10];
/// Times at which a motion is compared with limits.
const SAMPLES: usize = 200;

/// From rest to the state in which the first plan of a throw of the scenario honest catches, in its time.
pub fn problems(options: &Options, _: &Path) -> Result<Value> {
    let setup = Setup::load(&Choice { scenario: Some("honest"), ..Choice::default() })?;
    let robot = &setup.robot;
    let splines = CatchSplines::new(&SPANS, false);
    let plans = (0..).filter_map(|index| first_plan(&setup, options.seed, index)).take(options.trials as usize);
    let cases = plans.map(|plan| case(robot, &splines, &plan));
    let limit =
        |pick: fn(&catch_body::robot::JointLimits) -> f64| values(robot, &robot.per_joint(|it| pick(&it.limits)));
    Ok(json!({
        "lower_rad": limit(|it| it.lower),
        "upper_rad": limit(|it| it.upper),
        "velocity_radps": limit(|it| it.velocity),
        "acceleration_radps2": limit(|it| it.acceleration),
        "control_points": splines.at.control_points,
        "samples": SAMPLES,
        "cases": cases.collect::<Option<Vec<_>>>().context("a plan that ends before it begins")?,
    }))
}

/// The first plan of a throw.
fn first_plan(setup: &Setup, seed: u64, index: u64) -> Option<CatchPlan> {
    let mut brain = setup.brain(seed, index);
    let ended = trial::run_brain(&mut brain, setup, seed, index, &mut |tick, _| {
        tick.report.and_then(|report| report.plan.clone()).map_or(Ok(()), |plan| Err(Box::new(plan)))
    });
    ended.err().map(|plan| *plan)
}

/// The problem of a plan, and our motion.
fn case(robot: &Robot, splines: &CatchSplines, plan: &CatchPlan) -> Option<Value> {
    let start_s = plan.trajectory.start_s();
    let duration_s = plan.catch_s - start_s;
    let ([q, dq, ddq], [q_end, dq_end, _]) =
        (plan.trajectory.evaluate(start_s), plan.trajectory.evaluate(plan.catch_s));
    let joint = |i: usize| {
        let limits = &robot.joints[i].limits;
        let end = End::At {
            q: q_end[i],
            dq: dq_end[i],
            ddq: [f64::NEG_INFINITY, f64::INFINITY],
            last_speed: limits.velocity,
        };
        let start = JointState { q: q[i], dq: dq[i], ddq: ddq[i] };
        splines.at.solve(&start, &end, duration_s, limits, robot.comfortable_q[i]).ok()
    };
    let (joints, time_s) = measured(|| (0..robot.dof()).map(joint).collect::<Option<Vec<_>>>());
    let ours = joints.map(|joints| {
        let point = |k: usize| JointVector::from_fn(|i, _| joints.get(i).map_or(0.0, |points| points[k]));
        let spline = BSpline {
            knots_s: splines.at.knots.iter().map(|knot| knot * duration_s).collect(),
            control_points: (0..splines.at.control_points).map(point).collect(),
        };
        let at = |k: usize| spline.evaluate(duration_s * k as f64 / (SAMPLES - 1) as f64).map(|it| values(robot, &it));
        (0..SAMPLES).map(at).collect::<Vec<_>>()
    });
    (duration_s > 0.0).then(|| {
        let [start, end] = [[q, dq], [q_end, dq_end]].map(|state| state.map(|it| values(robot, &it)));
        json!({"start": start, "end": end, "duration_s": duration_s, "ours": ours, "time_s": time_s})
    })
}
