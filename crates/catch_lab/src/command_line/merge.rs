//! `catchingbot merge`: parts of an evaluation become one.

use std::path::PathBuf;

use catch_lab::{
    results::{self, SUMMARY_FILE},
    summary_table,
};
use clap::Args;

use super::eval;
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
    /// Print the table in Markdown
    #[arg(long)]
    markdown: bool,
}

/// Puts the parts together.
///
/// # Errors
/// Parts that do not belong together; a folder that cannot be written.
pub fn run(arguments: &MergeArguments) -> anyhow::Result<()> {
    let (identity, rows) = results::merge(&arguments.parts, &arguments.out)?;
    let cells = identity.summarize(&rows);
    if arguments.markdown {
        return Ok(screen::text(&summary_table::markdown(&identity, &cells))?);
    }
    screen::line("")?;
    screen::line(&eval::table(&cells).trim_fmt())?;
    screen::line("")?;
    Ok(screen::fact("results", &arguments.out.join(SUMMARY_FILE).display().to_string())?)
}
