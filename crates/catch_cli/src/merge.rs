//! `catchingbot eval --merge`: parts of an evaluation become one.

use std::{
    collections::BTreeMap,
    path::{Path, PathBuf},
};

use catch_body::InputError;
use catch_lab::{
    evaluation::{
        Identity, Row,
        results::{self, REPORT_FILE},
        summary_table,
        trial_table::PARQUET_FILE,
    },
    study::{Outline, StepSummary},
    trial::stopwatch::Stopwatch,
};
use catch_recording::whole_file::{self, COMMAND_LINE};
use catch_view::pages::report_page::{self, Report};

use super::{
    eval::{self, EvalArguments, Outcome},
    study,
};
use crate::screen;

/// Default folder of the whole.
const FOLDER: &str = "out/merged";

/// Puts the parts together.
///
/// # Errors
/// Parts that do not belong together; a folder that cannot be written.
pub fn run(arguments: &EvalArguments) -> anyhow::Result<()> {
    let (parts, out) = (&arguments.merge, &arguments.out.clone().unwrap_or_else(|| FOLDER.into()));
    if parts.iter().any(|part| Outline::is_in(part)) {
        return run_study(arguments, out);
    }
    let (identity, rows) = merged(parts, out)?;
    let cells = identity.summarize(&rows);
    if arguments.json {
        return screen::json(&Outcome::new(&identity, &cells, &rows, out));
    }
    if arguments.markdown {
        return Ok(screen::text(&summary_table::markdown(&identity, &cells))?);
    }
    screen::line("")?;
    screen::line(&eval::table(&cells).trim_fmt())?;
    screen::line("")?;
    screen::fact("report", &screen::command(&["view", &out.to_string_lossy()]))?;
    Ok(screen::fact("results", &out.join(PARQUET_FILE).display().to_string())?)
}

/// Puts parts of a study together, step by step.
fn run_study(arguments: &EvalArguments, out: &Path) -> anyhow::Result<()> {
    let EvalArguments { merge: parts, json, markdown, .. } = arguments;
    if *markdown {
        let expected = "no Markdown for a study; each of its steps has a table.md";
        return Err(InputError::new(COMMAND_LINE, "--markdown", "a study", expected).into());
    }
    results::check_holds_none(out)?;
    let outline = Outline::read(&parts[0])?;
    parts[1..].iter().try_for_each(|part| outline.check_same(part))?;
    let (mut steps, mut first) = (Vec::new(), 0);
    for head in &outline.steps {
        let parts: Vec<PathBuf> = parts.iter().map(|part| part.join(&head.name)).collect();
        let (identity, rows) = merged(&parts, &out.join(&head.name))?;
        first = identity.first;
        steps.push(StepSummary::of(head, outline.throw_grid.as_ref(), &identity, &rows));
    }
    outline.write(out)?;
    study::tell(&outline, &steps, first, *json, out)
}

/// The whole of the parts, in `out` with its report.
fn merged(parts: &[PathBuf], out: &Path) -> anyhow::Result<(Identity, Vec<Row>)> {
    let (identity, rows) = results::merge(parts, out)?;
    let cells = &identity.summarize(&rows);
    // Pages of misses and times are with the parts.
    let (scenario, seed) = (&identity.cells[0].name, identity.seed);
    let (stopwatch, pages) = (&Stopwatch::default(), &BTreeMap::new());
    let page = report_page::page(&Report { scenario, seed, cells, rows: &rows, stopwatch, pages });
    let report = out.join(REPORT_FILE);
    whole_file::write(&report, page)?;
    Ok((identity, rows))
}
