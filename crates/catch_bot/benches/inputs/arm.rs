//! An arm with a gripper for benches of planning.

use catch_body::{Gripper, Robot, robot_file::RobotFiles};
use catch_bot::trajectory_optimization::{Config, MotionPlanner, Start};
use catch_cell::arm::Setpoint;

/// An arm with a gripper, with settings changed.
pub fn planner(change: impl Fn(&mut Config)) -> MotionPlanner {
    let files = RobotFiles {
        urdf_file: "robot.urdf",
        urdf: include_str!("../../../../assets/robots/iiwa14/robot.urdf"),
        toml_file: "robot.toml",
        toml: include_str!("../../../../assets/robots/iiwa14/robot.toml"),
    };
    let gripper = include_str!("../../../../assets/grippers/wsg50.toml");
    let mut config = Config::default();
    change(&mut config);
    MotionPlanner::new(Robot::from_files(&files).unwrap(), Gripper::from_toml("gripper.toml", gripper).unwrap(), config)
}

/// The arm standing still at joint angles.
pub fn at_rest(planner: &MotionPlanner, q: &[f64], time_s: f64) -> Start {
    Start { time_s, state: Setpoint::at_rest(planner.robot.joint_vector(q).unwrap()) }
}
