//! `catchingbot eval`: many throws.

use std::{
    collections::BTreeMap,
    fs, io,
    path::{Path, PathBuf},
    sync::Arc,
    time::Instant,
};

use anyhow::Context;
use catch_body::InputError;
use catch_lab::{
    camera_placement,
    evaluation::{
        Cell, Evaluation, MOST_THREADS, Row,
        cell_summary::CellSummary,
        published::{published_rate, published_rates},
        results::{REPORT_FILE, Results},
        summary_table,
        trial_table::PARQUET_FILE,
    },
    parallel,
    scenario::setup::Setup,
    trial::stopwatch::{StageTimes, Stopwatch},
};
use catch_recording::whole_file::{self, COMMAND_LINE};
use catch_view::pages::report_page::{self, MOST_MISSES, Report};
use clap::Args;
use comfy_table::Table;
use serde::Serialize;
use serde_json::json;

use super::{ChoiceArguments, MOST, each_or_default, whole};
use crate::{
    calibrate,
    place_cameras::rig_document,
    screen::{self, FAINT, STRONG},
    watch::{self, Watch},
};

/// Name of the file with the wall times of the stages.
const TIMES_FILE: &str = "times.json";

/// Arguments of `eval`.
#[derive(Debug, Args)]
pub struct EvalArguments {
    #[command(flatten)]
    choice: ChoiceArguments,
    /// Object: a built-in name or a file; may be given more than once [default: the scenario's]
    #[arg(long, value_name = "NAME|FILE")]
    object: Vec<String>,
    /// Throw: a built-in name or a file; may be given more than once [default: the scenario's]
    #[arg(long, value_name = "NAME|FILE")]
    throw: Vec<String>,
    /// Seed of everything random
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = whole(0, MOST))]
    seed: u64,
    /// Throws per object and throw
    #[arg(long, value_name = "N", default_value_t = 57, value_parser = whole(1, 10_000_000))]
    trials: u64,
    /// Number of the first throw, to share an evaluation between machines
    #[arg(long, value_name = "N", default_value_t = 0, value_parser = whole(0, MOST))]
    first: u64,
    /// Trials that run at the same time [default: the number of cores]
    #[arg(long, value_name = "N", value_parser = whole(1, MOST_THREADS as u64))]
    threads: Option<u64>,
    /// Folder for the results
    #[arg(long, value_name = "DIR", default_value = "out/eval")]
    out: PathBuf,
    /// Open a page that follows the run, on this machine only
    #[arg(long)]
    watch: bool,
    /// Go on with the results that are in the folder
    #[arg(long)]
    resume: bool,
}

/// Wall times, which stand beside the results.
#[derive(Serialize)]
struct Times {
    wall_s: f64,
    threads: usize,
    /// Trials that were run now; those of an earlier run are not timed.
    trials: usize,
    stages: BTreeMap<&'static str, StageTimes>,
}

/// Tells how an evaluation goes on, should it be interrupted.
pub fn tell_how_to_resume(out: &Path) {
    screen::at_interrupt(format!(
        "interrupted: the trials that were finished are kept in {}; the same command with --resume goes on",
        out.display()
    ));
}

/// Many throws: a table, and a row per trial on disk.
///
/// # Errors
/// Faults in the arguments and files; results that cannot be written.
pub fn run(arguments: &EvalArguments, json: bool) -> anyhow::Result<()> {
    let folder = &*arguments.out;
    tell_how_to_resume(folder);
    let started = Instant::now();
    let evaluation = evaluation(arguments)?;
    let setup = &evaluation.cells[0].setup;
    let calibration = calibrate::before_throws(setup, arguments.seed, !json)?;
    let is_calibrated = setup.scenario.calibration.is_some();
    let score = is_calibrated.then(|| camera_placement::score_of(setup, &setup.used_cameras(arguments.seed)));
    let score = score.transpose()?;
    if let Some(score) = score.as_ref().filter(|_| !json) {
        screen::fact("cameras", &score.summary(setup))?;
    }
    let threads = arguments.threads.map_or_else(parallel::threads, |it| it as usize);
    let watch = Watch::start(arguments.watch, &format!("Scenario {}", setup.scenario.name), Some(evaluation.total()))?;
    let done = complete(&evaluation, folder, (arguments.resume, threads), watch.as_ref())?;
    if let Some(watch) = watch {
        watch.end();
    }
    let Done { rows, timed, stopwatch } = &done;

    let wall_s = started.elapsed().as_secs_f64();
    let identity = evaluation.identity();
    let cells = identity.summarize(rows);
    let times = Times { wall_s, threads, trials: *timed, stages: stopwatch.summary().into_iter().collect() };
    // If nothing was left to run, the times of the run that did it all stay, and so does the report that
    // shows them, unless rows were added by hand.
    let times_file = folder.join(TIMES_FILE);
    let before: Option<serde_json::Value> = fs::read(&times_file).ok().and_then(|it| serde_json::from_slice(&it).ok());
    let is_reported = before.as_ref().is_some_and(|it| it["rows"] == rows.len()) && folder.join(REPORT_FILE).exists();
    if *timed > 0 || !is_reported {
        let mut text = before.filter(|it| *timed == 0 && it.is_object()).unwrap_or(serde_json::to_value(&times)?);
        text["rows"] = rows.len().into();
        whole_file::write(&times_file, serde_json::to_string_pretty(&text)? + "\n")?;
        write_report(&evaluation, &done, (MOST_MISSES, threads), folder)?;
    }
    if !json {
        return Ok(print(&cells, &times, stopwatch, folder)?);
    }
    let published = published_rates();
    let cell = |summary: &CellSummary| {
        let mut cell = json!(summary);
        cell["published"] = json!(published_rate(&published, summary));
        cell
    };
    let mut document = json!({
        "scenario": identity.cells[0].name,
        "resolved": identity.cells[0],
        "seed": identity.seed,
        "first": identity.first,
        "cells": cells.iter().map(cell).collect::<Vec<_>>(),
        "trials": rows.len(),
        "caught": rows.iter().filter(|row| row.verdict.caught).count(),
        "results": folder.to_string_lossy(),
        "wall_s": wall_s,
        "stages": times.stages,
    });
    if let Some(score) = score {
        document["calibration"] = json!(calibration);
        document["rig"] = rig_document(&setup.scenario.flight_rig, &score);
    }
    screen::document(&document)
}

/// An evaluation whose trials are all there.
pub struct Done {
    pub rows: Vec<Row>,
    /// Trials that were run now.
    pub timed: usize,
    /// Times of these trials.
    pub stopwatch: Stopwatch,
}

/// Goes on with the results in a folder until all trials are done, or begins with them.
///
/// # Errors
/// A folder with results of something else, or one that cannot be written.
pub fn complete(
    evaluation: &Evaluation,
    folder: &Path,
    (resume, threads): (bool, usize),
    watch: Option<&Watch>,
) -> Result<Done, InputError> {
    let (mut results, mut rows) = Results::open(folder, evaluation, resume)?;
    let done_before = rows.len();
    let mut stopwatch = Stopwatch::default();
    let mut caught = rows.iter().filter(|row| row.verdict.caught).count();
    for cell in &evaluation.cells {
        calibrate::cameras(&cell.setup, evaluation.seed);
    }
    let bar = screen::progress_bar(evaluation.total(), "trials");
    bar.set_position(done_before as u64);
    bar.reset_eta();
    let setups: Vec<Arc<Setup>> =
        watch.iter().flat_map(|_| &evaluation.cells).map(|it| Arc::new(it.setup.clone())).collect();
    evaluation.run(done_before, threads, &mut |row, times| {
        results.add(&row)?;
        stopwatch.merge(times);
        caught += usize::from(row.verdict.caught);
        bar.inc(1);
        bar.set_message(format!("{caught} caught"));
        let is_of =
            |it: &&Arc<Setup>| (&it.scenario.object, &it.scenario.throw) == (&row.scene.object, &row.scene.throw);
        if let Some((watch, setup)) = watch.zip(setups.iter().find(is_of)) {
            let (setup, seed, index) = (setup.clone(), row.scene.seed, row.scene.index);
            watch.thrown(row.scene.label(), row.verdict.reason, move || watch::again(&setup, seed, index));
        }
        rows.push(row);
        Ok(())
    })?;
    bar.finish_and_clear();
    results.finish(&rows)?;
    Ok(Done { timed: rows.len() - done_before, rows, stopwatch })
}

/// The report as a page, with pages of the first misses.
///
/// # Errors
/// Files that cannot be written.
pub fn write_report(
    evaluation: &Evaluation,
    done: &Done,
    (most_misses, threads): (usize, usize),
    folder: &Path,
) -> anyhow::Result<()> {
    let Done { rows, stopwatch, .. } = done;
    let written = || format!("the report in {}", folder.display());
    let pages = report_page::record_misses(evaluation, rows, (most_misses, threads), folder).with_context(written)?;
    let scenario = &evaluation.cells[0].setup.scenario.name;
    let cells = &evaluation.identity().summarize(rows);
    let report = Report { scenario, seed: evaluation.seed, cells, rows, stopwatch, pages: &pages };
    Ok(whole_file::write(&folder.join(REPORT_FILE), report_page::page(&report))?)
}

/// Every object with every throw.
fn evaluation(arguments: &EvalArguments) -> Result<Evaluation, InputError> {
    let mut cells: Vec<Cell> = Vec::new();
    for object in each_or_default(&arguments.object) {
        let mut of_object: Option<Setup> = None;
        for throw in each_or_default(&arguments.throw) {
            let setup = match (&of_object, &throw) {
                (Some(setup), Some(throw)) => setup.thrown(throw)?,
                _ => Setup::load(&arguments.choice.with(object.as_deref(), throw.as_deref()))?,
            };
            let setup = match cells.first() {
                Some(first) => setup.sharing_calibrations(&first.setup),
                None => setup,
            };
            let setup = of_object.insert(setup).clone();
            let names = (&setup.scenario.object, &setup.scenario.throw);
            if cells.iter().any(|it| (&it.setup.scenario.object, &it.setup.scenario.throw) == names) {
                let found = format!("{} with the {} throw twice", names.0, names.1);
                return Err(InputError::new(COMMAND_LINE, "--object and --throw", found, "each pair once"));
            }
            cells.push(Cell::new(setup));
        }
    }
    Ok(Evaluation { cells, seed: arguments.seed, first: arguments.first, trials: arguments.trials })
}

fn print(cells: &[CellSummary], times: &Times, stopwatch: &Stopwatch, folder: &Path) -> io::Result<()> {
    screen::line("")?;
    screen::line(&table(cells).trim_fmt())?;
    screen::line("")?;
    let (caught, trials): (usize, usize) = cells.iter().fold((0, 0), |(a, b), cell| (a + cell.caught, b + cell.trials));
    let Times { wall_s, trials: timed, .. } = times;
    let which = if *timed == trials { String::new() } else { format!(", {timed} of them run now") };
    screen::line(&format!("  {STRONG}{caught} of {trials} caught{STRONG:#}{FAINT}{which} in {wall_s:.1} s{FAINT:#}"))?;
    if let Some(repeated) = summary_table::repeated_throws(cells) {
        screen::line(&format!("  {repeated}"))?;
    }
    for (stage, StageTimes { p50_ms, p99_ms, max_ms, .. }) in stopwatch.summary() {
        screen::fact(
            stage,
            &format!(
                "p50 {}, p99 {}, max {max_ms:.1} ms",
                summary_table::shown_ms(p50_ms),
                summary_table::shown_ms(p99_ms)
            ),
        )?;
    }
    screen::fact("report", &screen::command(&["view", &folder.to_string_lossy()]))?;
    screen::fact("results", &folder.join(PARQUET_FILE).display().to_string())
}

/// The table for the terminal.
pub fn table(cells: &[CellSummary]) -> Table {
    // Long headings and lists of reasons take several lines, so that the table fits into a terminal.
    let headings = summary_table::HEADINGS.map(|heading| match heading.split_once(' ') {
        Some((first, words)) if heading.len() > 8 => format!("{first}\n{words}"),
        _ => heading.to_owned(),
    });
    let mut table = screen::table(headings, summary_table::NUMBERS);
    table.add_rows(summary_table::lines(cells).into_iter().map(|line| line.map(|cell| cell.replace(", ", ",\n"))));
    table
}
