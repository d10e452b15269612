//! The driver as a program: `catchingbot drive` and `catchingbot doctor` start it with a task.

#![allow(clippy::print_stdout, clippy::print_stderr, missing_docs)]

use std::{
    path::{Path, PathBuf},
    process::ExitCode,
};

use catch_franka::{doctor, drive};
use catch_recording::drive_job::DriveJob;
use clap::{Parser, Subcommand};

/// Driver of the arms of Franka Robotics. `catchingbot drive CELL.toml` starts it.
#[derive(Debug, Parser)]
#[command(version)]
struct Arguments {
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// Lets a brain catch
    Drive {
        /// Task that `catchingbot drive` wrote
        job: PathBuf,
    },
    /// Measures the link to arm and cameras, while the arm is held
    Doctor {
        /// Task that `catchingbot doctor` wrote
        job: PathBuf,
    },
}

fn job(path: &Path) -> anyhow::Result<DriveJob> {
    DriveJob::read(path).map_err(|fault| anyhow::anyhow!("{}: {fault}", path.display()))
}

fn main() -> ExitCode {
    let done = match Arguments::parse().command {
        Command::Drive { job: path } => job(&path).and_then(|it| drive::run(&it)),
        Command::Doctor { job: path } => job(&path).and_then(|it| doctor::run(&it)),
    };
    match done {
        Ok(()) => ExitCode::SUCCESS,
        Err(fault) => {
            eprintln!("error: {fault:#}");
            ExitCode::FAILURE
        }
    }
}
