//! `catchingbot eval --ladder`: the paper's assumptions, removed one by one.

use std::{collections::BTreeMap, io, num::NonZero, thread};

use anyhow::Context;
use catch_body::InputError;
use catch_lab::{
    VERSION,
    assets::Kind,
    evaluation::{Cell, Evaluation, Row},
    ladder::{self, Step},
    referee::reason::Reason,
    results::Results,
    setup::COMMAND_LINE,
    statistics::wilson95,
};
use comfy_table::{CellAlignment, ContentArrangement, Table, TableComponent, presets};
use serde::Serialize;

use super::eval::EvalArguments;
use crate::screen::{self, FAINT, STRONG};

/// The JSON document.
#[derive(Serialize)]
struct Document {
    version: &'static str,
    seed: u64,
    first: u64,
    steps: Vec<StepResult>,
}

/// A step with all its objects.
#[derive(Serialize)]
struct StepResult {
    step: String,
    removes: &'static str,
    objects: Vec<ObjectResult>,
}

/// One object on one step.
#[derive(Serialize)]
struct ObjectResult {
    object: String,
    throws: Vec<&'static str>,
    trials: usize,
    caught: usize,
    wilson95: [f64; 2],
    /// Throws that the arm could not have caught, by the oracle.
    out_of_reach: usize,
    /// The same interval among the others.
    wilson95_within_reach: [f64; 2],
    /// Throws that the brain refused though they were within reach.
    refused_within_reach: usize,
    limit_violations: usize,
    /// Why throws within reach were not caught.
    reasons: BTreeMap<Reason, usize>,
}

/// Runs all steps, each into a folder of its own, and prints the table.
///
/// # Errors
/// As `eval`.
pub fn run(arguments: &EvalArguments) -> anyhow::Result<()> {
    if !arguments.throw.is_empty() {
        let expected = "no throw: every step of the ladder has its own";
        return Err(InputError::new(COMMAND_LINE, "--throw", arguments.throw.join(", "), expected).into());
    }
    let objects: Vec<String> = if arguments.object.is_empty() {
        Kind::Object.names().into_iter().map(str::to_owned).collect()
    } else {
        arguments.object.clone()
    };
    let steps = ladder::steps()?;
    let mut results = Vec::new();
    for step in &steps {
        let rows = rows_of(arguments, step, &objects)?;
        results.push(StepResult {
            step: step.name.clone(),
            removes: step.removes,
            objects: objects.iter().map(|object| summary(step, object, &rows)).collect(),
        });
        if !arguments.json {
            print(results.last().into_iter())?;
        }
    }
    if arguments.json {
        let (seed, first) = (arguments.seed, arguments.first);
        return screen::json(&Document { version: VERSION, seed, first, steps: results });
    }
    screen::line("")?;
    Ok(print(results.iter())?)
}

/// The trials of a step, those that are missing in its folder being run. The trials are shared among its throws.
fn rows_of(arguments: &EvalArguments, step: &Step, objects: &[String]) -> anyhow::Result<Vec<Row>> {
    let mut cells = Vec::new();
    for object in objects {
        for throw in step.throws {
            cells.push(Cell::new(step.setup(arguments.choice.robot(), object, throw)?));
        }
    }
    let trials = arguments.trials.div_ceil(step.throws.len() as u64);
    let evaluation = Evaluation { cells, seed: arguments.seed, first: arguments.first, trials };
    let folder = arguments.out.join(&step.name);
    let (mut file, mut rows) = Results::open(&folder, &evaluation, arguments.resume)?;
    let threads = arguments.threads.or_else(|| thread::available_parallelism().ok()).map_or(1, NonZero::get);
    let bar = screen::progress_bar(evaluation.len(), &step.name);
    bar.set_position(rows.len() as u64);
    evaluation
        .run(rows.len(), threads, &mut |row, _| {
            file.add(&row)?;
            bar.inc(1);
            rows.push(row);
            Ok(())
        })
        .with_context(|| folder.display().to_string())?;
    bar.finish_and_clear();
    rows.truncate(evaluation.len());
    file.finish(&rows)?;
    Ok(rows)
}

fn summary(step: &Step, object: &str, rows: &[Row]) -> ObjectResult {
    // A file is named by its path, its rows by its name.
    let name = std::path::Path::new(object).file_stem().map_or(object.into(), |it| it.to_string_lossy());
    let rows: Vec<&Row> = rows.iter().filter(|row| row.scene.object == name).collect();
    let caught = rows.iter().filter(|row| row.verdict.caught).count();
    let misses = || rows.iter().filter(|row| !row.verdict.caught);
    let out_of_reach = misses().filter(|row| row.verdict.is_out_of_reach()).count();
    let mut reasons = BTreeMap::new();
    for reason in misses().filter(|row| !row.verdict.is_out_of_reach()).filter_map(|row| row.verdict.reason) {
        *reasons.entry(reason).or_insert(0) += 1;
    }
    ObjectResult {
        object: name.into_owned(),
        throws: step.throws.to_vec(),
        trials: rows.len(),
        caught,
        wilson95: wilson95(caught, rows.len()),
        out_of_reach,
        wilson95_within_reach: wilson95(caught, rows.len() - out_of_reach),
        refused_within_reach: reasons.get(&Reason::OutOfReach).copied().unwrap_or(0),
        limit_violations: rows.iter().map(|row| row.verdict.limit_violations).sum(),
        reasons,
    }
}

fn print<'a>(results: impl Iterator<Item = &'a StepResult>) -> io::Result<()> {
    let mut table = Table::new();
    table.load_preset(presets::UTF8_HORIZONTAL_ONLY).set_content_arrangement(ContentArrangement::Disabled);
    table.remove_style(TableComponent::HorizontalLines).remove_style(TableComponent::MiddleIntersections);
    table.set_header([
        "step",
        "object",
        "trials",
        "caught",
        "95 %",
        "out of reach",
        "of the rest",
        "95 %",
        "misses within reach",
    ]);
    for column in 2..8 {
        if let Some(column) = table.column_mut(column) {
            column.set_cell_alignment(CellAlignment::Right);
        }
    }
    let percent = |value: f64| format!("{:.1}", value * 100.0);
    let range = |[low, high]: [f64; 2]| format!("{} – {} %", percent(low), percent(high));
    for StepResult { step, removes, objects } in results {
        screen::line(&format!("  {STRONG}{step}{STRONG:#}  {FAINT}removes {removes}{FAINT:#}"))?;
        for it in objects {
            let share = |of: usize| format!("{} %", percent(it.caught as f64 / of.max(1) as f64));
            let reasons: Vec<String> = it.reasons.iter().map(|(reason, count)| format!("{count}× {reason}")).collect();
            table.add_row([
                step.clone(),
                it.object.clone(),
                it.trials.to_string(),
                share(it.trials),
                range(it.wilson95),
                it.out_of_reach.to_string(),
                share(it.trials - it.out_of_reach),
                range(it.wilson95_within_reach),
                reasons.join(", "),
            ]);
        }
    }
    screen::line(&table.trim_fmt())
}
