//! `catchingbot replay`: the brain on recorded observations.

use std::path::PathBuf;

use catch_lab::recording::replay::{self, Replay};
use clap::Args;

use crate::screen::{self, BAD, GOOD};

/// Arguments of `replay`.
#[derive(Debug, Args)]
pub struct ReplayArguments {
    /// A recording (*.catch) of a simulated throw or of a real cell
    #[arg(value_name = "RECORDING")]
    recording: PathBuf,
}

/// Replays a recording and says whether the commands are the same.
///
/// # Errors
/// A file that is not a complete recording.
pub fn run(arguments: &ReplayArguments, json: bool) -> anyhow::Result<()> {
    let replay = replay::replay(&arguments.recording)?;
    if json {
        return screen::json(&replay);
    }
    let Replay { ticks, title, scene, caught, recorded_version, version, .. } = &replay;
    match &replay.difference {
        None => screen::line(&format!("{GOOD}Identical:{GOOD:#} {ticks} ticks, every command the same bit for bit."))?,
        Some(it) => {
            screen::line(&format!("{BAD}Different{BAD:#} from {:.3} s on: {}", it.time_s, it.field))?;
            screen::fact("recorded", &it.recorded.to_string())?;
            screen::fact("replayed", &it.replayed.to_string())?;
        }
    }
    if let Some(until_s) = replay.images_until_s {
        screen::fact("compared", &format!("until {until_s:.3} s, from where on images are missing in the recording"))?;
    }
    if recorded_version != version {
        screen::fact("versions", &format!("recorded with {recorded_version}, replayed with {version}"))?;
    }
    let outcome = match caught {
        Some(true) => "caught",
        Some(false) => "not caught",
        None => "outcome unknown",
    };
    let which = scene.as_ref().map_or_else(String::new, |it| format!(", seed {}, throw {}", it.seed, it.index));
    Ok(screen::fact("scene", &format!("{title}{which}: {outcome}"))?)
}
