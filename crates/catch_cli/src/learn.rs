//! `catchingbot learn`: what recorded throws teach about an object's flights.

use std::{
    fmt::Write,
    path::{Path, PathBuf},
};

use catch_body::InputError;
use catch_lab::{
    evaluation::summary_table::plain,
    flights::{
        flight_learning::{self, Lessons},
        flight_misses::{Misses, QUANTILES, Reliability, Seen, Throw, with_all},
        flight_prior::FlightPrior,
    },
};
use catch_recording::whole_file;
use clap::Args;
use serde::Serialize;

use super::predict::Up;
use crate::{screen, whole};

/// Arguments of `learn`.
#[derive(Debug, Args)]
#[command(after_help = "\
Each folder holds the throws of one object, a CSV file each, as for `predict`. With more than one
folder a prior for any object is learned, and tested on each object with one learned from the others.
Tables say how far predicted ends were off and how many lay in the ellipsoids that were claimed, for
throws that were not learned from.

Examples:
  catchingbot learn --tracks throws/gourd --up y --out gourd.toml
  catchingbot predict --track new.csv --up y --object gourd.toml")]
pub struct LearnArguments {
    /// Folder of recorded throws of one object; may be repeated
    #[arg(long, value_name = "DIR", required = true)]
    tracks: Vec<PathBuf>,
    /// Axis of the tracks that points up
    #[arg(long, value_enum, default_value_t = Up::Z, allow_hyphen_values = true)]
    up: Up,
    /// File for what was learned
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
    /// Source of the recordings, for the file
    #[arg(long, value_name = "TEXT", default_value = "own recordings")]
    source: String,
    /// Parts for the cross-validation
    #[arg(long, value_name = "N", default_value_t = 5, value_parser = whole(2, 100))]
    folds: u64,
    /// Print one JSON document
    #[arg(long)]
    json: bool,
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

#[derive(Debug, Serialize)]
struct Document {
    throws: usize,
    /// Each throw predicted by others of its object.
    cross_validated: Vec<Row>,
    /// Each object predicted by the others.
    other_objects: Vec<Row>,
}

/// Learns a prior, tests it, and writes it.
///
/// # Errors
/// Faults of the arguments and of the tracks' files, or throws from which nothing could be learned.
pub fn run(arguments: &LearnArguments) -> anyhow::Result<()> {
    let read = |folder: &PathBuf| Throw::read_folder(folder, arguments.up.direction(), LEAST_THROWS);
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
    let throws = objects.iter().map(Vec::len).sum();
    let prior = FlightPrior { source: format!("{}; {throws} throws", arguments.source), ..prior };
    whole_file::write_new(&[(arguments.out.clone(), prior.text()?.into_bytes())], "--out")?;
    let document = Document { throws, cross_validated: rows(arguments, own), other_objects: rows(arguments, others) };
    if arguments.json {
        return screen::document(&document);
    }
    screen::fact("throws", &throws.to_string())?;
    for (title, rows) in [(OWN, &document.cross_validated), (OTHERS, &document.other_objects)] {
        if !rows.is_empty() {
            screen::line("")?;
            screen::line(title)?;
            screen::text(&table(rows))?;
        }
    }
    screen::fact("written", &arguments.out.display().to_string())?;
    Ok(())
}

const OWN: &str = "Learned from other throws of the object (cross-validated)";
const OTHERS: &str = "Learned from the other objects";

/// Last part of a folder's path.
fn name(folder: &Path) -> String {
    folder.file_name().unwrap_or(folder.as_os_str()).to_string_lossy().into_owned()
}

/// Rows for each object by how much was seen, and for all together.
fn rows(arguments: &LearnArguments, misses: Vec<Misses>) -> Vec<Row> {
    let mut rows = Vec::new();
    for (object, misses) in with_all(arguments.tracks.iter().map(|it| name(it)), misses) {
        for (seen, misses) in Seen::ALL.into_iter().zip(&misses) {
            let seen = match seen {
                Seen::Half => "half".to_owned(),
                Seen::AllBut(left_s) => format!("{left_s} s to go"),
            };
            rows.push(Row { object: object.clone(), seen, reliability: Reliability::of(misses) });
        }
    }
    rows
}

/// The rows as a Markdown table.
fn table(rows: &[Row]) -> String {
    let mut text = String::from("| object | seen | throws | failed | median cm | p95 cm |");
    for (claimed, _) in QUANTILES {
        let _ = write!(text, " in {:.0} % |", claimed * 100.0);
    }
    text.push_str("\n|---|---|---|---|---|---|---|---|---|---|\n");
    for row in rows {
        let object = plain(&row.object);
        let Row { seen, reliability: Reliability { throws, failed, median_m, p95_m, covered }, .. } = row;
        let (median_cm, p95_cm) = (median_m * 100.0, p95_m * 100.0);
        let _ = write!(text, "| {object} | {seen} | {throws} | {failed} | {median_cm:.2} | {p95_cm:.1} |");
        for fraction in covered {
            let _ = write!(text, " {:.1} % |", fraction * 100.0);
        }
        text.push('\n');
    }
    text
}
