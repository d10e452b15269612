//! A driver as a program: `catchingbot drive` and `catchingbot doctor` start it with a task.

use std::{
    path::{Path, PathBuf},
    process::ExitCode,
};

use catch_body::InputError;
use catch_recording::drive_job::DriveJob;
use clap::{Parser, Subcommand};

use crate::{
    doctor,
    drive::{self, Driver},
};

/// Driver of a real arm. `catchingbot drive CELL.toml` starts it.
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

/// Does what the arguments say. The exit code is 2 for wrong input, 1 for anything else that fails.
pub fn main<D: Driver>() -> ExitCode {
    let done = match Arguments::parse().command {
        Command::Drive { job: path } => job(&path).and_then(|it| drive::run::<D>(&it)),
        Command::Doctor { job: path } => job(&path).and_then(|it| doctor::run::<D>(&it)),
    };
    match done {
        Ok(()) => ExitCode::SUCCESS,
        Err(fault) => {
            eprintln!("error: {fault:#}");
            ExitCode::from(if fault.is::<InputError>() { 2 } else { 1 })
        }
    }
}
