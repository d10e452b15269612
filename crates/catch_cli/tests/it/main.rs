//! Tests of the program: wrong input, reproducibility, evaluations, and what it writes.

mod browser;
mod calibrate;
mod corners;
mod depth_scan;
mod determinism;
#[cfg(unix)]
mod documented;
mod evaluation;
mod foreign_files;
mod honest;
mod inputs;
mod mcap_file;
mod mutated_files;
mod mutations;
mod nothing_lost;
mod object_import;
mod other_readers;
mod own_data;
mod pages;
mod public_arms;
mod recorded_flights;
mod recording;
mod reference;
mod refusals;
mod robot_import;
mod system_limits;
mod texts_of_others;
mod views;
mod visual_shapes;
mod watch;
mod wrong_input;

use std::process::{Command, Output};

/// Says that a test is skipped for want of a tool; in CI, which installs the tools, that is a failure.
///
/// # Panics
/// Where the environment variable `CI` is `true`.
#[expect(clippy::print_stderr, reason = "whoever runs the tests should know what was not tested")]
fn skipped_without(tool: &str) {
    assert!(std::env::var_os("CI").is_none_or(|value| value != "true"), "CI lacks {tool}");
    eprintln!("skipped for want of {tool}");
}

/// Runs the program.
fn catchingbot(arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_catchingbot")).args(arguments).output().unwrap()
}

/// Standard output as text.
fn stdout(output: &Output) -> String {
    String::from_utf8(output.stdout.clone()).unwrap()
}

/// Standard error as text.
fn stderr(output: &Output) -> String {
    String::from_utf8(output.stderr.clone()).unwrap()
}
