//! Replays of recordings, with the outcome of the recorded trial.

use std::path::Path;

use catch_body::InputError;
use catch_recording::replay::{Difference, compare};
use serde::Serialize;

use crate::{VERSION, recording::LabReader, scenario::setup::Scene};

/// Result of a replay.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Replay {
    /// Version of the program that replayed.
    pub version: String,
    /// Version of the program that recorded.
    pub recorded_version: String,
    /// Title of the recording.
    pub title: String,
    /// Scene of the throw; `None` for a real cell.
    pub scene: Option<Scene>,
    /// Number of ticks that were compared.
    pub ticks: usize,
    /// Time of the first missing image, after which nothing can be compared; `None` where the recording has
    /// all.
    pub images_until_s: Option<f64>,
    /// True if all commands that were compared are identical.
    pub identical: bool,
    /// The first difference.
    pub difference: Option<Difference>,
    /// Outcome of the recorded trial; `None` where it is unknown.
    pub caught: Option<bool>,
}

/// Replays a recording.
///
/// # Errors
/// If the file cannot be read to its end, or is the recording of one throw of many.
pub fn replay(path: &Path) -> Result<Replay, InputError> {
    let mut reader = LabReader::open(path)?;
    if reader.header.simulation.as_ref().is_some_and(|it| it.thrown_s.is_some()) {
        let (found, expected) = ("a throw of many", "a throw of its own: this brain remembers earlier throws");
        return Err(InputError::new(path.display(), "simulation.thrown_s", found, expected));
    }
    let compared = compare(&mut reader)?;
    let header = reader.header;
    Ok(Replay {
        version: VERSION.to_owned(),
        recorded_version: header.version,
        title: header.title,
        scene: header.simulation.map(|it| it.scene),
        ticks: compared.ticks,
        images_until_s: compared.images_until_s,
        identical: compared.difference.is_none(),
        difference: compared.difference,
        caught: compared.ending.ground_truth.map(|it| it.verdict.caught),
    })
}
