//! `catchingbot eval --ladder`: the paper's assumptions, removed one by one.

use std::{fs, io};

use anyhow::Context;
use catch_body::InputError;
use catch_lab::{
    VERSION,
    assets::Kind,
    evaluation::{Cell, Evaluation},
    ladder::{self, Step, StepSummary},
    report_page::{self, MOST_MISSES_OF_A_STEP},
    results::{self, REPORT_FILE, Results},
    setup::COMMAND_LINE,
    stopwatch::Stopwatch,
};
use comfy_table::{CellAlignment, ContentArrangement, Table, TableComponent, presets};
use serde::Serialize;

use super::eval::{self, EvalArguments};
use crate::screen::{self, FAINT, STRONG};

/// The JSON document.
#[derive(Serialize)]
struct Document {
    version: &'static str,
    seed: u64,
    first: u64,
    steps: Vec<StepSummary>,
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
    results::check_holds_none(&arguments.out)?;
    let steps = ladder::steps()?;
    let mut results: Vec<StepSummary> = Vec::new();
    for step in &steps {
        results.push(summary_of(arguments, step, &objects)?);
    }
    let page = arguments.out.join(REPORT_FILE);
    let html = report_page::ladder_page(arguments.seed, &results, REPORT_FILE);
    fs::write(&page, html).with_context(|| page.display().to_string())?;
    if arguments.json {
        let (seed, first) = (arguments.seed, arguments.first);
        return screen::json(&Document { version: VERSION, seed, first, steps: results });
    }
    screen::line("")?;
    print(results.iter())?;
    Ok(screen::line(&format!("  {FAINT}report{FAINT:#}  {}", page.display()))?)
}

/// The trials of a step, summed up, those that are missing in its folder being run. They are shared among its throws.
fn summary_of(arguments: &EvalArguments, step: &Step, objects: &[String]) -> anyhow::Result<StepSummary> {
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
    let mut stopwatch = Stopwatch::default();
    let bar = screen::progress_bar(evaluation.len(), &step.name);
    bar.set_position(rows.len() as u64);
    evaluation
        .run(rows.len(), eval::threads(arguments), &mut |row, times| {
            file.add(&row)?;
            stopwatch.merge(times);
            bar.inc(1);
            rows.push(row);
            Ok(())
        })
        .with_context(|| folder.display().to_string())?;
    bar.finish_and_clear();
    file.finish(&rows)?;
    eval::write_report(&evaluation, &rows, &stopwatch, MOST_MISSES_OF_A_STEP, arguments.plots, &folder)?;
    Ok(StepSummary::of(step, &evaluation.cells, &rows))
}

fn print<'a>(results: impl Iterator<Item = &'a StepSummary>) -> io::Result<()> {
    let mut table = Table::new();
    table.load_preset(presets::UTF8_HORIZONTAL_ONLY).set_content_arrangement(ContentArrangement::Disabled);
    table.remove_style(TableComponent::HorizontalLines).remove_style(TableComponent::MiddleIntersections);
    table.set_header(["step", "object", "trials", "caught", "95 %", "out of\nreach", "of the\nrest", "95 %", "misses"]);
    for column in 2..8 {
        if let Some(column) = table.column_mut(column) {
            column.set_cell_alignment(CellAlignment::Right);
        }
    }
    let percent = |value: f64| format!("{:.1}", value * 100.0);
    let range = |interval: Option<[f64; 2]>| {
        interval.map_or("same throw".to_owned(), |[low, high]| format!("{} – {} %", percent(low), percent(high)))
    };
    for StepSummary { step, removes, objects } in results {
        screen::line(&format!("  {STRONG}{step}{STRONG:#}  {FAINT}removes {removes}{FAINT:#}"))?;
        for it in objects {
            let fraction = |of: usize| format!("{} %", percent(it.caught as f64 / of.max(1) as f64));
            let reasons: Vec<String> = it.reasons.iter().map(|(reason, count)| format!("{count}× {reason}")).collect();
            table.add_row([
                step.clone(),
                it.object.clone(),
                it.trials.to_string(),
                fraction(it.trials),
                range(it.wilson95),
                it.out_of_reach.map_or("–".to_owned(), |count| count.to_string()),
                it.within_reach().map_or("–".to_owned(), fraction),
                if it.out_of_reach.is_some() { range(it.wilson95_within_reach) } else { "–".to_owned() },
                reasons.join(", "),
            ]);
        }
    }
    screen::line(&table.trim_fmt())
}
