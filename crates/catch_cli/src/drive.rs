//! `catchingbot drive`: a real cell, through the driver that its file names.

use std::{
    env,
    io::{self, BufRead, BufReader},
    path::{Path, PathBuf},
    process,
};

use anyhow::Context;
use catch_body::InputError;
use catch_cell::cell_file::CellFile;
use catch_lab::{
    recording,
    scenario::setup::{Choice, Setup},
};
use catch_recording::{RecordedCell, bounded_file::FileKind, drive_job::DriveJob, whole_file::COMMAND_LINE};
use clap::Args;

use crate::{
    screen,
    watch::{self, Watch},
};

/// How a driver says where a recording is.
const RECORDED: &str = "recorded: ";

/// Arguments of `drive`.
#[derive(Debug, Args)]
pub struct DriveArguments {
    /// The cell's file: `catchingbot new cell` writes one
    #[arg(value_name = "CELL.toml")]
    cell: PathBuf,
    /// Nothing moves: plans are made of real images, checked and recorded
    #[arg(long)]
    dry_run: bool,
    /// Open a page that shows each throw as soon as it is recorded, on this machine only
    #[arg(long)]
    watch: bool,
    /// Folder for the recordings
    #[arg(long, value_name = "DIR", default_value = "out")]
    out: PathBuf,
}

/// Lets the driver catch.
///
/// # Errors
/// A fault in the cell's file; a driver that is missing or fails.
pub fn run(DriveArguments { cell, dry_run, watch, out }: &DriveArguments) -> anyhow::Result<()> {
    start("drive", cell, out, *dry_run, *watch)
}

/// Reads a cell's file and all that it names.
///
/// # Errors
/// The first fault, with file and field.
pub fn read(path: &Path) -> Result<(CellFile, RecordedCell), InputError> {
    let (links, setup) = setup(path, &[])?;
    let cell = RecordedCell { cameras: setup.cameras.clone(), ..recording::cell(&setup, 0, 0) };
    Ok((links, cell))
}

/// As [`read`], with further settings of the scenario, as an arena has it.
///
/// # Errors
/// As [`read`].
pub fn setup(path: &Path, more: &[String]) -> Result<(CellFile, Setup), InputError> {
    let file = path.display().to_string();
    let text = FileKind::toml("the file of a cell (`catchingbot new cell`)").read_text(path)?;
    let links = CellFile::from_toml(&file, &text)?;
    // A name of a file is one beside the cell's.
    let beside = |name: &String| {
        let there = path.with_file_name(name);
        if there.exists() { there.display().to_string() } else { name.clone() }
    };
    let [scenario, robot, gripper, object] = [&links.scenario, &links.robot, &links.gripper, &links.object].map(beside);
    let workcell = links.workcell.as_ref().map(beside);
    let settings = [&[format!("flight_rig={}", beside(&links.rig))], more].concat();
    let choice = Choice {
        scenario: Some(&scenario),
        robot: Some(&robot),
        gripper: Some(&gripper),
        workcell: workcell.as_deref(),
        object: Some(&object),
        settings: &settings,
        ..Choice::default()
    };
    let setup = Setup::load(&choice).map_err(|fault| {
        let field = fault.field.trim_start_matches("--").replace("set flight_rig", "rig");
        if fault.file == COMMAND_LINE { InputError { file: file.clone(), field, ..fault } } else { fault }
    })?;
    Ok((links, setup))
}

/// Starts the driver with a task, and waits for its end. A page shows what it records, if that is wanted.
///
/// # Errors
/// As [`run`].
pub fn start(command: &str, path: &Path, out: &Path, dry_run: bool, is_watched: bool) -> anyhow::Result<()> {
    let (links, cell) = read(path)?;
    let driver = links.arm.driver.clone();
    let job = out.join(format!("{command}.job"));
    std::fs::create_dir_all(out).with_context(|| out.display().to_string())?;
    let file = path.display().to_string();
    let task = DriveJob { file, links, cell, out: out.to_owned(), dry_run };
    task.write(&job).with_context(|| job.display().to_string())?;
    let beside = env::current_exe().ok().map(|it| it.with_file_name(&driver)).filter(|it| it.exists());
    let program = beside.unwrap_or_else(|| PathBuf::from(&driver));
    let mut driving = process::Command::new(&program);
    driving.arg(command).arg(&job);
    let title = format!("{}: {}", if dry_run { "Dry run" } else { "Drive" }, path.display());
    match if is_watched { watch_to_end(&mut driving, &title) } else { driving.status() } {
        Ok(status) if status.success() => Ok(()),
        // It has said which field is wrong.
        Ok(status) if status.code() == Some(2) => {
            let (found, expected) = (format!("{driver}, which refuses this file"), "what it said above");
            Err(InputError::new(path.display().to_string(), "arm.driver", found, expected).into())
        }
        Ok(status) => anyhow::bail!("the driver {driver} ended: {status}"),
        Err(fault) if fault.kind() == io::ErrorKind::NotFound => {
            let expected = format!(
                "a program beside catchingbot or on the PATH; `cargo install --locked --path drivers/{driver}` \
                 installs one of this project's"
            );
            let file = path.display().to_string();
            Err(InputError::new(file, "arm.driver", format!("no program `{driver}`"), expected).into())
        }
        Err(fault) => Err(fault).with_context(|| program.display().to_string()),
    }
}

/// Waits for the end of a driver, whose lines say what it has recorded; a page with this title shows it.
fn watch_to_end(driving: &mut process::Command, title: &str) -> io::Result<process::ExitStatus> {
    let mut driver = driving.stdout(process::Stdio::piped()).spawn()?;
    let watch = Watch::start(true, title, None)?;
    for line in driver.stdout.take().into_iter().flat_map(|it| BufReader::new(it).lines()) {
        let line = line?;
        if let Some((watch, recording)) = watch.as_ref().zip(line.strip_prefix(RECORDED).map(PathBuf::from)) {
            let label = recording.display().to_string();
            watch.thrown(label, None, move || watch::recorded(&recording));
        }
        screen::line(&line)?;
    }
    let status = driver.wait()?;
    if let Some(watch) = watch {
        watch.end();
    }
    Ok(status)
}
