//! `catchingbot export`: throws in the formats of other tools.

use std::path::{Path, PathBuf};

use catch_lab::{VERSION, scenario::setup::Setup};
use catch_recording::whole_file;
use catch_view::export::{lerobot::LeRobotDataset, mjcf};
use clap::{ArgGroup, Args};
use serde::Serialize;

use super::{ChoiceArguments, MOST, whole};
use crate::screen;

/// Arguments of `export`.
#[derive(Debug, Args)]
#[command(group(ArgGroup::new("format").required(true)))]
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
    #[arg(long, value_name = "N", conflicts_with = "mjcf", default_value_t = 10, allow_negative_numbers = true, value_parser = whole(1, 1_000_000))]
    trials: u64,
    /// Number of the first throw
    #[arg(long, value_name = "N", default_value_t = 0, allow_negative_numbers = true, value_parser = whole(0, MOST / 2))]
    first: u64,
    /// A LeRobotDataset of version 3.0 in this folder, with depth images
    #[arg(long, value_name = "DIR", group = "format")]
    lerobot: Option<PathBuf>,
    /// The first throw's scene for MuJoCo in this folder, as scene.xml: arm, gripper, surroundings, cameras
    /// and the object just released, all with their nominal values
    #[arg(long, value_name = "DIR", group = "format")]
    mjcf: Option<PathBuf>,
    /// Print one JSON document
    #[arg(long)]
    json: bool,
}

/// The JSON document of a data set.
#[derive(Serialize)]
struct DatasetDocument<'a> {
    version: &'static str,
    lerobot: &'a Path,
    episodes: u64,
    caught: u64,
}

/// The JSON document of a scene.
#[derive(Serialize)]
struct SceneDocument<'a> {
    version: &'static str,
    mjcf: &'a Path,
}

/// Writes throws, or the scene of one.
///
/// # Errors
/// A fault of the input; a folder that cannot be written.
pub fn run(arguments: &ExportArguments) -> anyhow::Result<()> {
    let ExportArguments { choice, object, throw, seed, trials, first, lerobot, mjcf, json } = arguments;
    let setup = Setup::load(&choice.with(object.as_deref(), throw.as_deref()))?;
    if let Some(folder) = mjcf {
        setup.check_throw(*seed, *first)?;
        let file = folder.join("scene.xml");
        whole_file::write_new(&[(file.clone(), mjcf::scene(&setup, *seed, *first).into_bytes())], "--mjcf")?;
        if *json {
            return screen::json(&SceneDocument { version: VERSION, mjcf: &file });
        }
        screen::fact("scene", &format!("throw {first} of seed {seed}, in {}", file.display()))?;
    }
    if let Some(folder) = lerobot {
        let mut dataset = LeRobotDataset::create(folder, &setup)?;
        let bar = screen::progress_bar(*trials as usize, "episodes");
        let mut caught = 0;
        for index in *first..first + trials {
            caught += u64::from(dataset.throw(*seed, index)?);
            bar.inc(1);
        }
        bar.finish_and_clear();
        dataset.finish()?;
        if *json {
            return screen::json(&DatasetDocument { version: VERSION, lerobot: folder, episodes: *trials, caught });
        }
        screen::fact("dataset", &format!("{trials} episodes, {caught} of them catches, in {}", folder.display()))?;
    }
    Ok(())
}
