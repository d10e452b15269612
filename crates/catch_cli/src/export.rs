//! `catchingbot export`: the scene of a throw in the format of another tool.

use std::{collections::BTreeMap, path::PathBuf};

use catch_recording::whole_file;
use catch_view::export::mjcf;
use clap::Args;

use super::ThrowArguments;
use crate::screen;

/// Arguments of `export`.
#[derive(Debug, Args)]
pub struct ExportArguments {
    #[command(flatten)]
    thrown: ThrowArguments,
    /// The scene for MuJoCo in this folder, as scene.xml: arm, gripper, surroundings, cameras and the object
    /// just released, all with their nominal values
    #[arg(long, value_name = "DIR")]
    mjcf: PathBuf,
}

/// Writes the scene of a throw.
///
/// # Errors
/// A fault of the input; a folder that cannot be written.
pub fn run(arguments: &ExportArguments, json: bool) -> anyhow::Result<()> {
    let ExportArguments { thrown: thrown @ ThrowArguments { seed, index, .. }, mjcf } = arguments;
    let setup = thrown.setup()?;
    let file = mjcf.join("scene.xml");
    whole_file::write_new(&[(file.clone(), mjcf::scene(&setup, *seed, *index).into_bytes())], "--mjcf")?;
    if json {
        return screen::document(&BTreeMap::from([("mjcf", file.to_string_lossy())]));
    }
    Ok(screen::fact("scene", &format!("throw {index} of seed {seed}, in {}", file.display()))?)
}
