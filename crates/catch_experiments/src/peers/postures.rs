//! Inverse kinematics of poses that the arm can reach.

use std::path::Path;

use anyhow::Result;
use catch_bot::trajectory_optimization::posture::PostureFinder;
use catch_sim::random_streams::{Draws, Stream};
use serde_json::{Value, json};

use super::{any_posture, arm, dynamics::write_urdf, measured, rows, values};
use crate::Options;

/// Poses.
const POSES: usize = 1000;

/// Poses of the gripper at random postures, random starts, and all arcs of our solutions.
pub fn problems(options: &Options, folder: &Path) -> Result<Value> {
    let robot = arm()?;
    let finder = PostureFinder::new(&robot);
    let ranges = robot.joint_ranges();
    let mut draws = Draws::new(Stream::Brain, options.seed, 1);
    let cases = (0..POSES).map(|_| {
        let [q, start] = [(), ()].map(|()| any_posture(&robot, &mut draws));
        let X_WG = robot.gripper_pose(&q);
        let (found, time_s) = measured(|| finder.postures(&robot, &X_WG, &start, &ranges, true));
        let ours = found.first().map(|it| values(&robot, &it.q));
        json!({"X_WG": rows(&X_WG), "start": values(&robot, &start), "ours": ours, "solutions": found.len(), "time_s": time_s})
    });
    Ok(json!({
        "urdf": write_urdf(folder)?,
        "base": robot.base_link,
        "X_LG": rows(&robot.X_LG),
        "cases": cases.collect::<Vec<_>>(),
    }))
}
