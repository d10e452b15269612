//! `catchingbot export`: throws in the formats of other tools.

use std::path::PathBuf;

use catch_lab::{VERSION, scenario::setup::Setup};
use catch_view::export::lerobot::LeRobotDataset;
use clap::Args;
use serde::Serialize;

use super::{ChoiceArguments, MOST, whole};
use crate::screen;

/// Arguments of `export`.
#[derive(Debug, Args)]
pub struct ExportArguments {
    #[command(flatten)]
    choice: ChoiceArguments,
    /// Object: a built-in name or a file [default: the scenario's]
    #[arg(long, value_name = "NAME|FILE")]
    object: Option<String>,
    /// Throw: a built-in name or a file [default: the scenario's]
    #[arg(long, value_name = "NAME|FILE")]
    throw: Option<String>,
    /// Seed of everything random
    #[arg(long, value_name = "N", default_value_t = 1, allow_negative_numbers = true, value_parser = whole(0, MOST))]
    seed: u64,
    /// Throws, each an episode
    #[arg(long, value_name = "N", default_value_t = 10, allow_negative_numbers = true, value_parser = whole(1, 1_000_000))]
    trials: u64,
    /// Number of the first throw
    #[arg(long, value_name = "N", default_value_t = 0, allow_negative_numbers = true, value_parser = whole(0, MOST / 2))]
    first: u64,
    /// A LeRobotDataset of version 3.0 in this folder, with depth images
    #[arg(long, value_name = "DIR", required = true)]
    lerobot: PathBuf,
    /// Print one JSON document
    #[arg(long)]
    json: bool,
}

/// The JSON document.
#[derive(Serialize)]
struct Document<'a> {
    version: &'static str,
    lerobot: &'a PathBuf,
    episodes: u64,
    caught: u64,
}

/// Throws, and writes what was sensed and commanded.
///
/// # Errors
/// A fault of the input; a folder that cannot be written.
pub fn run(arguments: &ExportArguments) -> anyhow::Result<()> {
    let ExportArguments { choice, object, throw, seed, trials, first, lerobot, json } = arguments;
    let setup = Setup::load(&choice.with(object.as_deref(), throw.as_deref()))?;
    let mut dataset = LeRobotDataset::create(lerobot, &setup)?;
    let bar = screen::progress_bar(*trials as usize, "episodes");
    let mut caught = 0;
    for index in *first..first + trials {
        caught += u64::from(dataset.throw(*seed, index)?);
        bar.inc(1);
    }
    bar.finish_and_clear();
    dataset.finish()?;
    if *json {
        return screen::json(&Document { version: VERSION, lerobot, episodes: *trials, caught });
    }
    Ok(screen::fact("dataset", &format!("{trials} episodes, {caught} of them catches, in {}", lerobot.display()))?)
}
