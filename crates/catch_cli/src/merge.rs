//! `catchingbot merge`: parts of an evaluation become one.

use std::{collections::BTreeMap, fs, path::PathBuf};

use anyhow::Context;
use catch_lab::{
    evaluation::{
        results::{self, REPORT_FILE},
        summary_table,
        trial_table::PARQUET_FILE,
    },
    pages::report_page::{self, Report},
    trial::stopwatch::Stopwatch,
};
use clap::Args;

use super::eval::{self, Outcome};
use crate::screen;

/// Arguments of `merge`.
#[derive(Debug, Args)]
pub struct MergeArguments {
    /// Folders of the parts, in any order
    #[arg(value_name = "DIR", required = true)]
    parts: Vec<PathBuf>,
    /// Folder for the whole
    #[arg(long, value_name = "DIR", default_value = "out/merged")]
    out: PathBuf,
    /// Print one JSON document instead of the table
    #[arg(long)]
    json: bool,
    /// Print the table in Markdown
    #[arg(long, conflicts_with = "json")]
    markdown: bool,
}

/// Puts the parts together.
///
/// # Errors
/// Parts that do not belong together; a folder that cannot be written.
pub fn run(arguments: &MergeArguments) -> anyhow::Result<()> {
    let (identity, rows) = results::merge(&arguments.parts, &arguments.out)?;
    let cells = identity.summarize(&rows);
    // Pages of misses and times are with the parts.
    let (scenario, seed) = (&identity.cells[0].name, identity.seed);
    let (stopwatch, pages) = (&Stopwatch::default(), &BTreeMap::new());
    let page = report_page::page(&Report { scenario, seed, cells: &cells, rows: &rows, stopwatch, pages });
    let report = arguments.out.join(REPORT_FILE);
    fs::write(&report, page).with_context(|| report.display().to_string())?;
    if arguments.json {
        return screen::json(&Outcome::new(&identity, &cells, &rows, &arguments.out));
    }
    if arguments.markdown {
        return Ok(screen::text(&summary_table::markdown(&identity, &cells))?);
    }
    screen::line("")?;
    screen::line(&eval::table(&cells).trim_fmt())?;
    screen::line("")?;
    screen::fact("report", &format!("catchingbot view {}", arguments.out.display()))?;
    Ok(screen::fact("results", &arguments.out.join(PARQUET_FILE).display().to_string())?)
}
