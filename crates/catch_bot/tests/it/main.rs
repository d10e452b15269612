//! Tests of the brain's first half from outside.
mod allocation;
mod edge_cases;
#[path = "../../src/perception/synthetic.rs"]
mod synthetic;

use catch_bot::perception::ReferenceModel;
