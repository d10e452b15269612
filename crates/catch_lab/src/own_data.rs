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
mod registration_evidence;
pub mod robot_import;
pub mod ros_calibration;
pub mod templates;
