//! `catchingbot eval --merge`: parts of an evaluation become one.

use std::{
    collections::BTreeMap,
    path::{Path, PathBuf},
};

use catch_lab::{
    evaluation::{
        Identity, Row,
        results::{self, REPORT_FILE},
        summary_table,
        trial_table::PARQUET_FILE,
    },
    trial::stopwatch::Stopwatch,
};
use catch_recording::whole_file;
use catch_view::pages::report_page::{self, Report};

use super::eval::{self, EvalArguments, Outcome};
use crate::screen;

/// Default folder of the whole.
const FOLDER: &str = "out/merged";

/// Puts the parts together.
///
/// # Errors
/// Parts that do not belong together; a folder that cannot be written.
pub fn run(arguments: &EvalArguments) -> anyhow::Result<()> {
    let (parts, out) = (&arguments.merge, &arguments.out.clone().unwrap_or_else(|| FOLDER.into()));
    let (identity, rows) = merged(parts, out)?;
    let cells = identity.summarize(&rows);
    if arguments.json {
        return screen::document(&Outcome::new(&identity, &cells, &rows, out));
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
