//! `catchingbot export`: the scene of a throw in the format of another tool.

use std::path::{Path, PathBuf};

use catch_lab::scenario::setup::Setup;
use catch_recording::whole_file;
use catch_view::export::mjcf;
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
    /// Number of the throw
    #[arg(long, value_name = "N", default_value_t = 0, allow_negative_numbers = true, value_parser = whole(0, MOST))]
    index: u64,
    /// The scene for MuJoCo in this folder, as scene.xml: arm, gripper, surroundings, cameras and the object
    /// just released, all with their nominal values
    #[arg(long, value_name = "DIR")]
    mjcf: PathBuf,
    /// Print one JSON document
    #[arg(long)]
    json: bool,
}

/// The JSON document.
#[derive(Serialize)]
struct Document<'a> {
    mjcf: &'a Path,
}

/// Writes the scene of a throw.
///
/// # Errors
/// A fault of the input; a folder that cannot be written.
pub fn run(arguments: &ExportArguments) -> anyhow::Result<()> {
    let ExportArguments { choice, object, throw, seed, index, mjcf, json } = arguments;
    let setup = Setup::load(&choice.with(object.as_deref(), throw.as_deref()))?;
    setup.check_throw(*seed, *index)?;
    let file = mjcf.join("scene.xml");
    whole_file::write_new(&[(file.clone(), mjcf::scene(&setup, *seed, *index).into_bytes())], "--mjcf")?;
    if *json {
        return screen::document(&Document { mjcf: &file });
    }
    Ok(screen::fact("scene", &format!("throw {index} of seed {seed}, in {}", file.display()))?)
}
