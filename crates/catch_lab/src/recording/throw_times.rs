//! Wall times of one throw. They stand in a file beside the recording, which is the same bytes every time.

use std::{
    collections::BTreeMap,
    io::{self, Write},
    path::{Path, PathBuf},
};

use serde::{Deserialize, Serialize};

use crate::trial::{Trial, stopwatch::StageTimes};
use catch_recording::{bounded_file::FileKind, whole_file::Unfinished};

/// Wall times of one throw.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ThrowTimes {
    /// Median, 99th percentile and maximum per stage.
    pub stages: BTreeMap<String, StageTimes>,
    /// The ticks in which a stage ran.
    pub ticks: Vec<TickTimes>,
}

/// Wall times of one tick.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct TickTimes {
    /// Time on the cell's clock.
    pub time_s: f64,
    /// Duration of each stage in milliseconds, in the order of the pipeline.
    pub stage_ms: Vec<(String, f64)>,
}

impl ThrowTimes {
    /// The times of a trial.
    pub fn of(trial: &Trial) -> Self {
        let owned = |(stage, ms): &(&str, f64)| ((*stage).to_owned(), *ms);
        let ticks = trial.snapshots.iter().filter(|snapshot| !snapshot.stage_ms.is_empty()).map(|snapshot| TickTimes {
            time_s: snapshot.time_s,
            stage_ms: snapshot.stage_ms.iter().map(owned).collect(),
        });
        let stages = trial.stopwatch.summary().into_iter().map(|(stage, times)| (stage.to_owned(), times));
        Self { stages: stages.collect(), ticks: ticks.collect() }
    }

    /// The file beside a recording.
    pub fn path(recording: &Path) -> PathBuf {
        recording.with_extension("times.json")
    }

    /// Writes the file beside a recording.
    ///
    /// # Errors
    /// If it cannot be written.
    pub fn write(&self, recording: &Path) -> io::Result<()> {
        let path = Self::path(recording);
        let mut file = Unfinished::beside(&path)?;
        writeln!(file, "{}", serde_json::to_string(self)?)?;
        file.replace(&path)
    }

    /// Reads the file beside a recording; `None` where there is none or it is none.
    pub fn read(recording: &Path) -> Option<Self> {
        serde_json::from_str(&FileKind::text("wall times").read_text(&Self::path(recording)).ok()?).ok()
    }
}
