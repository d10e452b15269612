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
use catch_recording::{
    RecordedCell,
    bounded_file::FileKind,
    drive_job::DriveJob,
    whole_file::{COMMAND_LINE, make_writable},
};
use clap::Args;
use serde_json::json;

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
    pub cell: PathBuf,
    /// Nothing moves: plans are made of real images, checked and recorded
    #[arg(long)]
    pub dry_run: bool,
    /// Open a page that shows each throw as soon as it is recorded, on this machine only
    #[arg(long)]
    pub watch: bool,
    /// Folder for the recordings
    #[arg(long, value_name = "DIR", default_value = "out")]
    pub out: PathBuf,
}

/// Lets the driver catch.
///
/// # Errors
/// A fault in the cell's file; a driver that is missing or fails.
pub fn run(arguments: &DriveArguments, json: bool) -> anyhow::Result<()> {
    let recordings = start("drive", arguments, json)?;
    if !json {
        return Ok(());
    }
    let recordings: Vec<_> = recordings.iter().map(|it| it.to_string_lossy()).collect();
    let cell = arguments.cell.to_string_lossy();
    screen::document(&json!({ "cell": cell, "dry_run": arguments.dry_run, "recordings": recordings }))
}

/// The program of a cell's driver: beside this one, on the PATH, or the path that the cell's file has.
///
/// # Errors
/// If there is none.
pub fn program(cell: &Path, links: &CellFile) -> Result<PathBuf, InputError> {
    let driver = &links.arm.driver;
    let beside = env::current_exe().ok().map(|it| it.with_file_name(""));
    let path = env::var_os("PATH").unwrap_or_default();
    let here = Path::new(driver).parent().filter(|it| !it.as_os_str().is_empty()).map(|_| PathBuf::new());
    let folders = beside.into_iter().chain(here).chain(env::split_paths(&path));
    let file_name = format!("{driver}{}", env::consts::EXE_SUFFIX);
    folders.map(|it| it.join(&file_name)).find(|it| it.is_file()).ok_or_else(|| {
        let expected = format!(
            "a program beside catchingbot or on the PATH; `cargo install --locked --path drivers/{driver}` \
             installs one of this project's"
        );
        InputError::new(cell.display(), "arm.driver", format!("no program `{driver}`"), expected)
    })
}

/// Reads a cell's file and all that it names, with further settings of the scenario.
///
/// # Errors
/// The first fault, with file and field.
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
/// Returns the recordings.
///
/// # Errors
/// As [`run`].
pub fn start(command: &str, arguments: &DriveArguments, json: bool) -> anyhow::Result<Vec<PathBuf>> {
    let DriveArguments { cell: path, dry_run, out, .. } = arguments;
    let (links, setup) = setup(path, &[])?;
    let program = program(path, &links)?;
    make_writable(out, "--out")?;
    let driver = links.arm.driver.clone();
    let job = out.join(format!("{command}.job"));
    let cell = RecordedCell { cameras: setup.cameras.clone(), ..recording::cell(&setup, 0, 0) };
    let task = DriveJob { file: path.display().to_string(), links, cell, out: out.clone(), dry_run: *dry_run };
    task.write(&job).with_context(|| job.display().to_string())?;
    let mut driving = process::Command::new(&program);
    driving.arg(command).arg(&job);
    let (status, recordings) = to_end(&mut driving, arguments, json).with_context(|| program.display().to_string())?;
    match status.code() {
        Some(0) => Ok(recordings),
        // It has said which field is wrong.
        Some(2) => {
            let (found, expected) = (format!("{driver}, which refuses this file"), "what it said above");
            Err(InputError::new(path.display(), "arm.driver", found, expected).into())
        }
        _ => anyhow::bail!("the driver {driver} ended: {status}"),
    }
}

/// Waits for the end of a driver, whose lines say what it has recorded.
fn to_end(
    driving: &mut process::Command,
    arguments: &DriveArguments,
    json: bool,
) -> io::Result<(process::ExitStatus, Vec<PathBuf>)> {
    let mut driver = driving.stdout(process::Stdio::piped()).spawn()?;
    let title = if arguments.dry_run { "Dry run" } else { "Drive" };
    let watch = Watch::start(arguments.watch, &format!("{title}: {}", arguments.cell.display()), None)?;
    let mut recordings = Vec::new();
    for line in driver.stdout.take().into_iter().flat_map(|it| BufReader::new(it).lines()) {
        let line = line?;
        if let Some(recording) = line.strip_prefix(RECORDED).map(PathBuf::from) {
            recordings.push(recording.clone());
            if let Some(watch) = &watch {
                watch.thrown(recording.display().to_string(), None, move || watch::recorded(&recording));
            }
        }
        if json { screen::note(&line) } else { screen::line(&line)? }
    }
    let status = driver.wait()?;
    if let Some(watch) = watch {
        watch.end();
    }
    Ok((status, recordings))
}
