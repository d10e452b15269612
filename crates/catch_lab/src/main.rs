//! `catchingbot`: throws things at a simulated robot arm that catches them, and tells how it went.
//!
//! Exit code 0: it ran, whatever was caught; 2: something is wrong with what was asked for; 1: anything else.

mod command_line;
mod screen;

use std::{io, process::ExitCode};

use catch_body::InputError;
use clap::Parser;
use command_line::Arguments;

fn main() -> ExitCode {
    let Err(fault) = command_line::run(Arguments::parse()) else { return ExitCode::SUCCESS };
    let of_output = fault.chain().find_map(|cause| cause.downcast_ref::<io::Error>());
    if of_output.is_some_and(|it| it.kind() == io::ErrorKind::BrokenPipe) {
        // Whoever read the output has seen enough.
        return ExitCode::SUCCESS;
    }
    screen::error(&format!("{fault:#}"));
    if fault.is::<InputError>() || fault.is::<command_line::check::Faulty>() {
        ExitCode::from(2)
    } else {
        ExitCode::FAILURE
    }
}
