//! `catchingbot gripper-latency`: how long a gripper takes to begin a move.

use std::path::PathBuf;

use catch_lab::recording::gripper_latency::{self, GripperLatency, UnusedMoves};
use clap::Args;
use serde_json::json;

use crate::screen::{self, STRONG};

/// Moves that give a median that can be relied upon.
const RELIABLE: usize = 20;

/// Measures the delay of a gripper before a move, from recordings: the setting gripper_latency_s
///
/// It measures the time from the start of a commanded move until the fingers begin to move, from the
/// widths that were sensed then and the speed and acceleration of the fingers that the brain expects.
/// Moves whose command arrived after their start do not count, nor do those that began while the
/// fingers moved. Twenty moves or more give a median that can be relied upon.
///
/// Examples:
///   catchingbot gripper-latency out/*.catch
///   catchingbot gripper-latency --json out/*.catch | jq .median_s
#[derive(Debug, Args)]
#[command(verbatim_doc_comment)]
pub struct GripperLatencyArguments {
    /// Recordings (*.catch) of the same cell
    #[arg(value_name = "RECORDING", required = true)]
    recordings: Vec<PathBuf>,
}

/// Measures, and says what to write into a scenario.
///
/// # Errors
/// A file that is not a complete recording; recordings in which no move tells a latency.
pub fn run(arguments: &GripperLatencyArguments, json: bool) -> anyhow::Result<()> {
    let latency = gripper_latency::measure(&arguments.recordings)?;
    // A negative latency says that the fingers are faster than the brain expects; the setting cannot.
    let setting = format!("brain.control.gripper_latency_s = {:.4}", latency.median_s.max(0.0));
    if json {
        let mut document = serde_json::to_value(&latency)?;
        document["setting"] = json!(setting);
        return screen::document(&document);
    }
    let GripperLatency { median_s, quartiles_s: [low_s, high_s], moves, unused } = &latency;
    let UnusedMoves { late, not_at_rest, not_moved } = unused;
    screen::line(&format!(
        "{STRONG}{:.1} ms{STRONG:#} from the start of a move until the fingers move",
        median_s * 1e3
    ))?;
    screen::fact("half of the moves", &format!("{:.1} to {:.1} ms", low_s * 1e3, high_s * 1e3))?;
    screen::fact("moves", &format!("{} in {} recordings", moves.len(), arguments.recordings.len()))?;
    screen::fact(
        "unusable moves",
        &format!("{late} that arrived late, {not_at_rest} of moving fingers, {not_moved} in which no finger moved"),
    )?;
    if moves.len() < RELIABLE {
        screen::fact("few moves", &format!("{RELIABLE} or more give a median that can be relied upon"))?;
    }
    Ok(screen::fact("setting", &setting)?)
}
