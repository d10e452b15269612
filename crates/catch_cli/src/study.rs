//! `catchingbot eval --study`: many variants of a scenario.

use std::{
    io,
    path::{Path, PathBuf},
};

use anyhow::Context;
use catch_body::InputError;
use catch_lab::{
    VERSION,
    evaluation::{
        Evaluation,
        results::{self, REPORT_FILE},
    },
    study::{
        ObjectSummary, Outline, Step, StepSummary, Study,
        throw_grid::{GridPoint, ThrowGrid},
    },
};
use catch_recording::whole_file::{self, COMMAND_LINE};
use catch_view::{
    export::plots,
    pages::report_page::{self, MOST_MISSES_OF_A_STEP},
};
use serde::Serialize;

use super::eval::{self, EvalArguments, Pace};
use crate::screen::{self, FAINT, STRONG};

/// The JSON document.
#[derive(Serialize)]
struct Document<'a> {
    version: &'static str,
    study: &'a str,
    seed: u64,
    first: u64,
    #[serde(flatten)]
    grid: Option<&'a ThrowGrid>,
    steps: &'a [StepSummary],
}

/// Runs all steps, each into a folder of its own, and tells what came of them.
///
/// # Errors
/// As `eval`.
pub fn run(arguments: &EvalArguments, name: &str) -> anyhow::Result<()> {
    if !arguments.throw.is_empty() {
        let expected = "no throw: a study names its own";
        return Err(InputError::new(COMMAND_LINE, "--throw", arguments.throw.join(", "), expected).into());
    }
    let study = Study::load(name, (COMMAND_LINE, "--study"))?;
    let out = &arguments.out.clone().unwrap_or_else(|| PathBuf::from(format!("out/study-{}", study.name)));
    eval::tell_how_to_resume(out);
    let objects = if arguments.object.is_empty() { study.objects() } else { arguments.object.clone() };
    results::check_holds_none(out)?;
    whole_file::make_writable(out, "--out")?;
    let outline = study.outline(arguments.seed);
    outline.write(out)?;
    let steps = study.steps.iter().map(|step| summary_of(arguments, &study, step, &objects, out));
    let steps = steps.collect::<anyhow::Result<Vec<StepSummary>>>()?;
    if let Some(grid) = outline.throw_grid.as_ref().filter(|_| arguments.plots) {
        steps.iter().try_for_each(|step| plot(grid, step, out))?;
    }
    tell(&outline, &steps, arguments.first, arguments.json, out)
}

/// The trials of a step, summed up, those that are missing in its folder being run. They are shared among its
/// throws.
fn summary_of(
    arguments: &EvalArguments,
    study: &Study,
    step: &Step,
    objects: &[String],
    out: &Path,
) -> anyhow::Result<StepSummary> {
    let cells = study.cells(step, &arguments.choice.equipment(), objects)?;
    let trials = arguments.trials.div_ceil(step.throws.len() as u64);
    let evaluation = Evaluation { cells, seed: arguments.seed, first: arguments.first, trials };
    let folder = out.join(&step.head.name);
    let pace = Pace::from(arguments);
    let done =
        eval::complete(&evaluation, &folder, pace, &step.head.name).with_context(|| folder.display().to_string())?;
    eval::write_report(&evaluation, &done, (MOST_MISSES_OF_A_STEP, pace.threads), arguments.plots, &folder)?;
    Ok(StepSummary::of(&step.head, study.file.throw_grid.as_ref(), &evaluation.identity(), &done.rows))
}

/// Writes the page of a study, and prints its steps as a table or as JSON.
///
/// # Errors
/// If the page cannot be written.
pub fn tell(outline: &Outline, steps: &[StepSummary], first: u64, json: bool, out: &Path) -> anyhow::Result<()> {
    let page = out.join(REPORT_FILE);
    let html = report_page::study_page(outline, steps, REPORT_FILE);
    whole_file::write(&page, html)?;
    let Outline { study, seed, throw_grid, .. } = outline;
    if json {
        let grid = throw_grid.as_ref();
        return screen::json(&Document { version: VERSION, study, seed: *seed, first, grid, steps });
    }
    screen::line("")?;
    match throw_grid {
        None => print(steps)?,
        Some(grid) => steps.iter().try_for_each(|step| print_grid(grid, step))?,
    }
    Ok(screen::line(&format!("  {FAINT}report{FAINT:#}  {}", page.display()))?)
}

/// A heat map of the catch rate for each object, in the folder of the step.
fn plot(grid: &ThrowGrid, step: &StepSummary, out: &Path) -> anyhow::Result<()> {
    for ObjectSummary { all, grid: points } in &step.objects {
        let path = out.join(&step.step).join(format!("grid-{}.svg", all.object));
        let rate = |row: usize, column: usize| {
            let point = points.as_ref()?.get(row)?.get(column)?.as_ref()?;
            Some(point.summary.caught as f64 / point.summary.trials.max(1) as f64)
        };
        plots::heat_map(&path, &grid.distances_m, &grid.speeds_mps, &rate)
            .map_err(|fault| anyhow::anyhow!("{fault}"))
            .with_context(|| path.display().to_string())?;
    }
    Ok(())
}

/// A table of distances and speeds for each object.
fn print_grid(grid: &ThrowGrid, step: &StepSummary) -> io::Result<()> {
    for ObjectSummary { all, grid: points } in &step.objects {
        let (name, object) = (&step.step, &all.object);
        screen::line(&format!(
            "  {STRONG}{name}{STRONG:#}, {object}: how many were caught, and how far off the object was in the hand"
        ))?;
        let speeds: Vec<String> =
            grid.speeds_mps.iter().map(|speed| format!("{:>16}", format!("{speed} m/s"))).collect();
        screen::line(&format!("  {:>8}{}", "", speeds.concat()))?;
        for (distance, row) in grid.distances_m.iter().zip(points.iter().flatten()) {
            let text = |GridPoint { summary, median_grasp_offset_m }: &GridPoint| {
                let off = median_grasp_offset_m.map_or("–".to_owned(), |it| format!("{:.0} mm", it * 1e3));
                format!("{} of {} · {off}", summary.caught, summary.trials)
            };
            let row = row.iter().map(|point| format!("{:>16}", point.as_ref().map_or("–".to_owned(), text)));
            screen::line(&format!("  {:>8}{}", format!("{distance} m"), row.collect::<String>()))?;
        }
        screen::line(&format!("  {FAINT}–: a throw at this speed does not get there{FAINT:#}\n"))?;
    }
    Ok(())
}

/// A line per step and object.
fn print(steps: &[StepSummary]) -> io::Result<()> {
    let headings = ["step", "object", "trials", "caught", "95 %", "out of\nreach", "of the\nrest", "95 %", "misses"];
    let mut table = screen::table(headings, 2..8);
    let percent = |value: f64| format!("{:.1}", value * 100.0);
    let range = |interval: Option<[f64; 2]>| {
        interval.map_or("same throw".to_owned(), |[low, high]| format!("{} – {} %", percent(low), percent(high)))
    };
    for StepSummary { step, about, objects, .. } in steps {
        screen::line(&format!("  {STRONG}{step}{STRONG:#}  {FAINT}{about}{FAINT:#}"))?;
        for ObjectSummary { all: it, .. } in objects {
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
