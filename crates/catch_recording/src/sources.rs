//! The texts of the files that describe arm, gripper and workcell, and what they describe.

use catch_body::{
    Gripper, InputError, Robot, clearance::ArmClearance, robot::LimitScale, robot_file::RobotFiles, workcell::Workcell,
};
use serde::{Deserialize, Serialize};

/// Texts of the files from which a brain's arm and gripper are made, so that a recording can make them again.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Sources {
    /// The robot's URDF.
    pub robot_urdf: String,
    /// The robot's `robot.toml`.
    pub robot_toml: String,
    /// The gripper's file.
    pub gripper_toml: String,
    /// The workcell's file, where there is one.
    #[serde(default)]
    pub workcell_toml: Option<String>,
    /// Scaling of the arm's velocity and acceleration limits.
    pub limit_scale: LimitScale,
}

/// Names by which errors call the [`Sources`].
#[derive(Debug, Clone, Copy)]
pub struct SourceNames<'a> {
    /// The robot's URDF.
    pub robot_urdf: &'a str,
    /// The robot's `robot.toml`.
    pub robot_toml: &'a str,
    /// The gripper's file.
    pub gripper_toml: &'a str,
    /// The workcell's file.
    pub workcell_toml: &'a str,
}

impl Sources {
    /// The arm, with what stands around it, and the gripper that the texts describe.
    ///
    /// # Errors
    /// The first fault in one of them.
    pub fn parse(&self, names: &SourceNames) -> Result<(Robot, Gripper), InputError> {
        let robot = Robot::from_files(&RobotFiles {
            urdf_file: names.robot_urdf,
            urdf: &self.robot_urdf,
            toml_file: names.robot_toml,
            toml: &self.robot_toml,
        })?;
        let gripper = Gripper::from_toml(names.gripper_toml, &self.gripper_toml)?;
        let mut robot = robot.with_limits_scaled(&self.limit_scale).with_mount_of(&gripper);
        if let Some(text) = &self.workcell_toml {
            robot.obstacles = Workcell::from_toml(names.workcell_toml, text)?.obstacles;
        }
        Ok((robot, gripper))
    }
}

/// Checks that the arm in its ready pose is clear of its workcell.
///
/// # Errors
/// Names the obstacle that it stands in.
pub fn check_waits_clear(robot: &Robot, gripper: &Gripper, file: &str) -> Result<(), InputError> {
    let X_WL = robot.link_poses(&robot.ready_q);
    for obstacle in &robot.obstacles {
        let alone = Robot { obstacles: vec![obstacle.clone()], ..robot.clone() };
        let distance_m = ArmClearance::new(&alone, gripper).environment_clearance(&X_WL, gripper.max_width_m);
        if distance_m <= 0.0 {
            let expected = format!("an obstacle that the waiting arm does not touch: {} stands in it", robot.name);
            return Err(InputError::new(file, "boxes or capsules", format!("`{}`", obstacle.name), expected));
        }
    }
    Ok(())
}
