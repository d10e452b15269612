//! Tests of the brain from outside.

mod allocation;
mod camera_alignment;
mod contact_lead;
mod coverage;
mod darboux;
mod edge_cases;
mod grasp_fit;
mod joint_spline;
mod near_cameras;
mod pose_estimation;
mod reach_map;
mod reachability;
mod sent_plans;
mod synthetic;
mod terminal_velocity;
mod trajectory_prediction;
mod unlabelled;

use catch_bot::perception::ReferenceModel;
