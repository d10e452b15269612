//! Tests of the brain's first half from outside.
mod allocation;
mod camera_alignment;
mod coverage;
mod edge_cases;
mod pose_estimation;
mod synthetic;
mod unlabelled;

use catch_bot::perception::ReferenceModel;
