//! The paper's perception and prediction beside ours, on the same images.

mod beside_ours;
#[path = "../../../catch_bot/tests/it/synthetic.rs"]
mod synthetic;

use catch_bot::perception::ReferenceModel;
