//! `catchingbot learn`: what recorded throws teach about an object's flights.

use std::path::{Path, PathBuf};

use catch_body::InputError;
use catch_lab::flights::{
    flight_learning::{self, Lessons},
    flight_misses::{HORIZONS_S, Misses, QUANTILES, Reliability, Throw, with_all},
    flight_prior::FlightPrior,
};
use catch_recording::whole_file;
use clap::Args;
use comfy_table::Table;
use nalgebra::{Unit, Vector3};
use serde::Serialize;
use serde_json::json;

use super::predict::up;
use crate::{screen, whole};

/// Learns a prior on an object's flights from recorded throws, for `predict`
///
/// Each folder holds the throws of one object, a CSV file each, as for `predict`. With more than one
/// folder a prior for any object is learned, and tested on each object with one learned from the others.
/// Tables say how far predicted ends were off and how many lay in the ellipsoids that were claimed, for
/// throws that were not learned from.
///
/// Examples:
///   catchingbot learn --tracks throws/gourd --up y --out gourd.toml
///   catchingbot predict --track new.csv --up y --object gourd.toml
#[derive(Debug, Args)]
#[command(verbatim_doc_comment)]
pub struct LearnArguments {
    /// Folder of recorded throws of one object; may be repeated
    #[arg(long, value_name = "DIR", required = true)]
    tracks: Vec<PathBuf>,
    /// Axis of the tracks that points up
    #[arg(long, value_parser = up(), default_value = "z", allow_hyphen_values = true)]
    up: Unit<Vector3<f64>>,
    /// File for what was learned
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
    /// Source of the recordings, for the file
    #[arg(long, value_name = "TEXT", default_value = "own recordings")]
    source: String,
    /// Parts for the cross-validation
    #[arg(long, value_name = "N", default_value_t = 5, value_parser = whole(2, 100))]
    folds: u64,
}

/// Throws that are needed for learning.
const LEAST_THROWS: usize = 5;

/// A line of a table.
#[derive(Debug, Serialize)]
struct Row {
    object: String,
    seen: String,
    #[serde(flatten)]
    reliability: Reliability,
}

/// Learns a prior, tests it, and writes it.
///
/// # Errors
/// Faults of the arguments and of the tracks' files, or throws from which nothing could be learned.
pub fn run(arguments: &LearnArguments, json: bool) -> anyhow::Result<()> {
    let read = |folder: &PathBuf| Throw::read_folder(folder, arguments.up, LEAST_THROWS);
    let objects = arguments.tracks.iter().map(read).collect::<Result<Vec<_>, _>>()?;
    whole_file::check_new([&arguments.out], "--out")?;
    let folds = usize::try_from(arguments.folds)?;
    let nothing = |folder: &Path| {
        let expected = "throws that fall as gravity has it: is --up right, are they metres and seconds?";
        InputError::new(folder.display().to_string(), "tracks", "no flight in any of them", expected)
    };
    let total = objects.len() * (folds + 1);
    let progress = screen::progress_bar(total, "parts");
    let learned = flight_learning::lessons(&objects, folds, || progress.inc(1));
    let Lessons { prior, own, others } = learned.map_err(|at| nothing(&arguments.tracks[at]))?;
    progress.finish_and_clear();
    let throws: usize = objects.iter().map(Vec::len).sum();
    let prior = FlightPrior { source: format!("{}; {throws} throws", arguments.source), ..prior };
    whole_file::write_new(&[(arguments.out.clone(), prior.text()?.into_bytes())], "--out")?;
    let (own, others) = (rows(arguments, own), rows(arguments, others));
    if json {
        return screen::document(&json!({ "throws": throws, "cross_validated": own, "other_objects": others }));
    }
    screen::fact("throws", &throws.to_string())?;
    for (title, rows) in [(OWN, &own), (OTHERS, &others)] {
        if !rows.is_empty() {
            screen::line(&format!("\n{title}\n{}", table(rows).trim_fmt()))?;
        }
    }
    screen::fact("written", &arguments.out.display().to_string())?;
    Ok(())
}

const OWN: &str = "Learned from other throws of the object (cross-validated)";
const OTHERS: &str = "Learned from the other objects";

/// Rows for each object by how much was seen, and for all together.
fn rows(arguments: &LearnArguments, misses: Vec<Misses>) -> Vec<Row> {
    let names =
        arguments.tracks.iter().map(|it| it.file_name().unwrap_or(it.as_os_str()).to_string_lossy().into_owned());
    let mut rows = Vec::new();
    for (object, misses) in with_all(names, misses) {
        for (left_s, misses) in HORIZONS_S.into_iter().zip(&misses) {
            let seen = left_s.map_or("half".to_owned(), |left_s| format!("{left_s} s to go"));
            rows.push(Row { object: object.clone(), seen, reliability: Reliability::of(misses) });
        }
    }
    rows
}

fn table(rows: &[Row]) -> Table {
    let headings = ["object", "seen", "throws", "failed", "median cm", "p95 cm"].map(str::to_owned).into_iter();
    let within = QUANTILES.iter().map(|(claimed, _)| format!("in {:.0} %", claimed * 100.0));
    let mut table = screen::table(headings.chain(within), 2..6 + QUANTILES.len());
    for Row { object, seen, reliability: Reliability { throws, failed, median_m, p95_m, covered } } in rows {
        let figures = [
            throws.to_string(),
            failed.to_string(),
            format!("{:.2}", median_m * 100.0),
            format!("{:.1}", p95_m * 100.0),
        ];
        let covered = covered.iter().map(|fraction| format!("{:.1} %", fraction * 100.0));
        table.add_row([object.clone(), seen.clone()].into_iter().chain(figures).chain(covered));
    }
    table
}
