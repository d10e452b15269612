//! Users' own data: files to start from, their checks, and data of other systems.
//!
//! The only crate that reads descriptions of others, COLLADA, PLY and glTF, and that repairs surfaces: who
//! has an arm and an object in files of this project needs none of it.

pub mod capsule_fit;
pub mod check;
pub mod cloud_file;
pub mod cloud_registration;
pub mod description;
mod gripper_check;
mod isosurface;
mod json;
mod mesh_files;
mod mesh_paths;
pub mod mesh_repair;
mod object_check;
pub mod object_import;
mod registration_evidence;
mod robot_check;
pub mod robot_import;
pub mod ros_calibration;
mod row_numbers;
pub mod surface_file;
pub mod templates;
mod yaml;

use catch_body::InputError;

/// The fault of a MuJoCo model in place of a description: MuJoCo itself makes one of it.
fn model_of_mujoco(file: &str) -> InputError {
    let expected = format!("URDF: `python -m catchingbot.mujoco {file} --out DIR` writes DIR/model.urdf");
    InputError::new(file, "root element", "<mujoco>, a MuJoCo model", expected)
}
