//! Recordings of a cell without ground truth: a real one, or one of one's own.

use std::{
    io,
    path::{Path, PathBuf},
};

use catch_bot::Report;
use catch_cell::{Command, Observation};

use crate::{
    recording::{Ending, RecordedCell, Recorder},
    tick::Tick,
    timeline::Timeline,
};

/// Records a run of [`catch_cell::run`], called from its recorder.
///
/// [`replay`](crate::replay) builds the brain again from the [`RecordedCell`], whose stages are those that
/// its settings choose.
pub struct CellRecorder {
    recorder: Recorder,
    timeline: Timeline,
}

impl CellRecorder {
    /// Begins the recording `name`, a file name without ending, in `folder`, which is made if it does not
    /// exist.
    ///
    /// # Errors
    /// If the name is not that of a file, or if folder or file cannot be written.
    pub fn create(folder: &Path, name: &str, cell: RecordedCell) -> io::Result<Self> {
        if Path::new(name).file_name() != Some(name.as_ref()) {
            let fault = format!("the recording's name: found {name:?}, expected the name of a file, without folders");
            return Err(io::Error::new(io::ErrorKind::InvalidInput, fault));
        }
        let title = name.replace('_', " ");
        Ok(Self { recorder: Recorder::begin::<()>(folder, name, title, cell, None)?, timeline: Timeline::default() })
    }

    /// Adds a tick. Without a report the brain is recorded as one that has seen nothing.
    ///
    /// # Errors
    /// If it cannot be written.
    pub fn tick(&mut self, observation: &Observation, command: &Command, report: Option<&Report>) -> io::Result<()> {
        let tick = Tick { observation, command, report };
        self.timeline.ticked(&tick);
        self.recorder.ticked(&tick)
    }

    /// Ends the recording and gives the file its name, which is returned; one that is dropped leaves nothing.
    /// A cell that failed ends a run, not its recording.
    ///
    /// # Errors
    /// If it cannot be written.
    pub fn finish(self) -> io::Result<PathBuf> {
        self.recorder.finish(&Ending::<()> { timeline: self.timeline.into_entries(), ground_truth: None })
    }
}
