//! What users bring along: files of their own to start from, their checks, and data of other systems.

pub mod check;
pub mod cloud_file;
pub mod cloud_registration;
mod gripper_check;
mod mesh_files;
mod mesh_paths;
mod object_check;
pub mod object_import;
pub mod planner_cases;
pub mod robot_import;
pub mod ros_calibration;
pub mod templates;

use catch_body::InputError;

/// The fault of a MuJoCo model in place of a description: MuJoCo itself makes one of it.
fn model_of_mujoco(file: &str) -> InputError {
    let expected = format!("URDF: `python -m catchingbot.mujoco {file} --out DIR` writes DIR/model.urdf");
    InputError::new(file, "root element", "<mujoco>, a MuJoCo model", expected)
}
