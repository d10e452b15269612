//! The paper's perception and prediction beside ours, on the same images.

#![allow(clippy::print_stdout, reason = "tests tell what they measured")]

mod beside_ours;
#[path = "../../../catch_bot/tests/it/synthetic.rs"]
mod synthetic;

use catch_bot::perception::ReferenceModel;
