//! The texts of the files that describe arm, gripper and workcell, and what they describe.

use std::{collections::BTreeMap, path::Path};

use catch_body::{
    Gripper, InputError, Robot, clearance::ArmClearance, robot::LimitScale, robot_file::RobotFiles, workcell::Workcell,
};
use serde::{Deserialize, Serialize};

/// Texts of meshes by the names with which a file names them.
pub type Meshes = BTreeMap<String, String>;

/// Texts of the files from which a brain's arm and gripper are made, so that a recording can make them again.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Sources {
    /// The robot's URDF.
    pub robot_urdf: String,
    /// The robot's `robot.toml`.
    pub robot_toml: String,
    /// Meshes of the robot's visual shapes.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub robot_meshes: Meshes,
    /// The gripper's file.
    pub gripper_toml: String,
    /// Meshes of the gripper's visual shapes.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub gripper_meshes: Meshes,
    /// The workcell's file, where there is one.
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
        let robot = robot.with_meshes(&beside(names.robot_toml, &self.robot_meshes))?;
        let gripper = Gripper::from_toml(names.gripper_toml, &self.gripper_toml)?;
        let gripper = gripper.with_meshes(&beside(names.gripper_toml, &self.gripper_meshes))?;
        let mut robot = robot.with_limits_scaled(&self.limit_scale).with_mount_of(&gripper);
        if let Some(text) = &self.workcell_toml {
            robot.obstacles = Workcell::from_toml(names.workcell_toml, text)?.obstacles;
        }
        Ok((robot, gripper))
    }
}

/// Reads of `meshes` those that the file called `file` names.
fn beside<'a>(file: &'a str, meshes: &'a Meshes) -> impl Fn(&str) -> Result<(String, Vec<u8>), InputError> + 'a {
    move |name| {
        let path = Path::new(file).with_file_name(name).display().to_string();
        let text = meshes.get(name).ok_or_else(|| {
            InputError::new(&path, "the file", "nothing", format!("the mesh of a visual shape, as {file} names it"))
        })?;
        Ok((path, text.clone().into_bytes()))
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
