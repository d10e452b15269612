//! Tests of the whole: the architecture, wrong input, reproducibility, every object and throw, and what the brain cannot see.

mod all_cells;
mod blanked;
mod browser;
mod determinism;
mod evaluation;
mod frames;
mod general_form;
mod holding;
mod honest;
mod mcap_file;
mod own_data;
mod pages;
mod planning;
mod play;
mod recording;
mod robot_controller;
mod search_passes;
mod source;
mod standard_terms;
mod throws_out_of_reach;
mod tidy;
mod wrong_input;

use std::process::{Command, Output};

/// Runs the program.
fn catchingbot(arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_catchingbot")).args(arguments).output().unwrap()
}

/// What it printed as its result.
fn stdout(output: &Output) -> String {
    String::from_utf8(output.stdout.clone()).unwrap()
}

/// What it complained about.
fn stderr(output: &Output) -> String {
    String::from_utf8(output.stderr.clone()).unwrap()
}
