//! Two evaluations, compared throw by throw: `catchingbot view A B`.

use std::path::{Path, PathBuf};

use catch_lab::{
    evaluation::comparison::{Comparison, Counts},
    parallel,
};
use catch_recording::whole_file::{self, make_writable};
use catch_view::pages::compare_page;
use serde_json::json;

use crate::screen;

/// Default folder of the page.
pub const FOLDER: &str = "out/compared";
/// Name of the page.
const PAGE: &str = "compared.html";

/// Compares two folders of results; returns the page, in `folder`.
///
/// # Errors
/// Folders without complete results, or of other throws; a folder that cannot be written.
pub fn run(folders: [&PathBuf; 2], folder: &Path, json: bool) -> anyhow::Result<PathBuf> {
    let comparison = Comparison::read(folders.map(PathBuf::as_path))?;
    make_writable(folder, "--out")?;
    let names = folders.map(|it| it.file_name().unwrap_or_default().to_string_lossy().into_owned());
    let names = if names[0] == names[1] { ["A", "B"] } else { [&*names[0], &names[1]] };
    let pages = compare_page::record_pairs(&comparison, names, parallel::threads(), folder)?;
    let page = folder.join(PAGE);
    whole_file::write(&page, compare_page::page(&comparison, names, &pages))?;
    let cells = comparison.counts();
    if json {
        let cell = |(name, counts): &(String, Counts)| {
            let mut cell = json!(counts);
            cell["name"] = json!(name);
            cell
        };
        screen::document(&json!({
            "a": folders[0].to_string_lossy(),
            "b": folders[1].to_string_lossy(),
            "seed": comparison.identities[0].seed,
            "cells": cells.iter().map(cell).collect::<Vec<_>>(),
            "pairs": comparison.pairs,
            "page": page.to_string_lossy(),
        }))?;
        return Ok(page);
    }
    let (only_a, only_b) = (format!("only\n{}", names[0]), format!("only\n{}", names[1]));
    let headings = ["object, throw", "throws", "both", &only_a, &only_b, "neither", "difference", "95 %", "p"];
    let mut table = screen::table(headings.map(str::to_owned), 1..9);
    table.add_rows(cells.iter().map(|(name, it)| [name.clone()].into_iter().chain(compare_page::figures(it))));
    screen::line(&format!("\n{}\n", table.trim_fmt()))?;
    Ok(page)
}
