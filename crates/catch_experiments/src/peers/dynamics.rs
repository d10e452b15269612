//! Dynamics and kinematics of the arm at random states.

use std::path::Path;

use anyhow::{Context, Result};
use catch_body::{JointVector, Robot};
use catch_lab::{
    assets::{Asset, Kind, Origin},
    scenario::setup::{Choice, Setup},
};
use catch_sim::random_streams::{Draws, Stream};
use serde_json::{Value, json};

use super::{any_posture, arm, drawn, measured, rows, values};
use crate::Options;

/// Random states.
const STATES: usize = 1000;
/// Highest speed and acceleration of a state, in rad/s and rad/s².
const MOST: [f64; 2] = [2.0, 10.0];

/// Random states, and torques, accelerations and poses of the gripper at them.
pub fn problems(options: &Options, folder: &Path) -> Result<Value> {
    let robot = arm()?;
    let mut draws = Draws::new(Stream::Brain, options.seed, 0);
    let states: Vec<[JointVector; 3]> = (0..STATES)
        .map(|_| {
            let [dq, ddq] = MOST.map(|most| drawn(&robot, &mut draws, |_| [-most, most]));
            [any_posture(&robot, &mut draws), dq, ddq]
        })
        .collect();
    let (torques, inverse_s) =
        measured(|| states.iter().map(|[q, dq, ddq]| robot.inverse_dynamics(q, dq, ddq)).collect::<Vec<_>>());
    let driven: Vec<_> = states.iter().zip(&torques).collect();
    let (accelerations, forward_s) = measured(|| {
        driven.iter().map(|([q, dq, _], torque)| forward(&robot, q, dq, torque)).collect::<Option<Vec<_>>>()
    });
    let (poses, kinematics_s) = measured(|| states.iter().map(|[q, ..]| robot.gripper_pose(q)).collect::<Vec<_>>());
    let all = |of: &[JointVector]| of.iter().map(|it| values(&robot, it)).collect::<Vec<_>>();
    let urdf = write_urdf(folder)?;
    let time_us = [inverse_s, forward_s, kinematics_s].map(|it| it * 1e6 / STATES as f64);
    Ok(json!({
        "urdf": urdf,
        "rotor_inertia_kgm2": values(&robot, &robot.per_joint(|joint| joint.rotor_inertia)),
        "X_LG": rows(&robot.X_LG),
        "states": states.iter().map(|it| it.each_ref().map(|it| values(&robot, it))).collect::<Vec<_>>(),
        "torques_nm": all(&torques),
        "accelerations_radps2": all(&accelerations.context("a mass matrix that has no factors")?),
        "X_WG": poses.iter().map(rows).collect::<Vec<_>>(),
        "time_us": time_us,
    }))
}

/// Joint accelerations M⁻¹·(τ − C − g) that torques cause.
fn forward(robot: &Robot, q: &JointVector, dq: &JointVector, torque: &JointVector) -> Option<JointVector> {
    let bias = robot.inverse_dynamics(q, dq, &JointVector::zeros());
    Some(robot.mass_matrix(q).cholesky()?.solve(&(torque - bias)))
}

/// Writes the description of the arm of the default scenario, and returns where.
pub fn write_urdf(folder: &Path) -> Result<String> {
    let robot = Setup::load(&Choice::default())?.scenario.robot;
    let asset = Asset::find(Kind::Robot, &robot, &Origin::BuiltIn(Default::default()), ("experiment", "robot"))?;
    let file = folder.join("robot.urdf");
    std::fs::write(&file, asset.read_text_beside("robot.urdf")?.1)?;
    Ok(file.display().to_string())
}
