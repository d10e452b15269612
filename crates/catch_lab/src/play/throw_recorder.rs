//! Recordings of many throws: one for each, from its release until the arm waits again.

use std::{
    io,
    path::{Path, PathBuf},
};

use catch_bot::Report;
use catch_cell::{Command, Observation};
use catch_recording::{Recorder, Tick};
use catch_sim::{Truth, TruthSample};

use super::{since, truth_since};
use crate::{
    recording::{self, recorded_throw, story::Story},
    referee::Verdict,
    scenario::setup::Setup,
};

/// Records one throw; its clock is zero at the release.
pub struct ThrowRecorder {
    recorder: Recorder,
    story: Story,
    released_s: f64,
    step_s: f64,
    /// The last report of the brain, which tells nothing once it has caught.
    report: Option<Report>,
    /// Outcome, and all true states up to now.
    outcome: Option<(Verdict, Truth)>,
}

impl ThrowRecorder {
    /// Begins the recording of throw number `index` of `seed`, which is released at `released_s` on the clock
    /// of the arena.
    ///
    /// # Errors
    /// If the file cannot be written.
    pub fn begin(folder: &Path, setup: &Setup, (seed, index): (u64, u64), released_s: f64) -> io::Result<Self> {
        let recorder = recording::begin(folder, setup, &setup.scene(seed, index), Some(released_s))?;
        let step_s = setup.scenario.arena.step_s;
        Ok(Self { recorder, story: Story::since(released_s), released_s, step_s, report: None, outcome: None })
    }

    /// Adds a tick.
    ///
    /// # Errors
    /// If it cannot be written.
    pub fn ticked(&mut self, tick: &Tick, truth: &Truth) -> io::Result<()> {
        if let Some(report) = tick.report {
            self.report = Some(since(report, self.released_s));
        }
        let (observation, command) = shifted(tick.observation, tick.command, self.released_s);
        let tick = Tick { observation: &observation, command: &command, report: self.report.as_ref() };
        if self.outcome.is_none() {
            self.story.ticked(&tick, truth);
        }
        self.recorder.ticked(&tick)
    }

    /// Takes note of the outcome; `truth` is on the clock of the recording.
    pub fn judged(&mut self, verdict: &Verdict, truth: &Truth) {
        self.story.ended(verdict, truth.samples.last().map_or(0.0, |it| it.time_s));
        self.outcome = Some((verdict.clone(), truth.clone()));
    }

    /// Adds true states after the outcome.
    pub fn moved(&mut self, samples: &[TruthSample]) {
        let truth = Truth { samples: samples.to_vec(), ..Truth::default() };
        if let Some((_, all)) = &mut self.outcome {
            all.samples.extend(truth_since(truth, self.released_s, self.step_s).samples);
        }
    }

    /// Ends the recording and returns its file; there is none without an outcome.
    ///
    /// # Errors
    /// If the file cannot be written.
    pub fn finish(self, setup: &Setup) -> io::Result<Option<PathBuf>> {
        let Some((verdict, truth)) = self.outcome else { return Ok(None) };
        recorded_throw::finish(self.recorder, self.story.into_entries(), setup, (truth, &verdict)).map(Some)
    }
}

/// Shifts what passes between cell and brain so that the clock is zero at `zero_s`.
fn shifted(observation: &Observation, command: &Command, zero_s: f64) -> (Observation, Command) {
    let (mut observation, mut command) = (observation.clone(), command.clone());
    observation.time_s -= zero_s;
    observation.arm.time_s -= zero_s;
    observation.frames.iter_mut().for_each(|frame| frame.capture_s -= zero_s);
    let knots_s = command.arm.iter_mut().flat_map(|it| &mut it.spline.knots_s);
    let starts_s = command.gripper.iter_mut().flatten().map(|it| &mut it.start_s);
    knots_s.chain(starts_s).for_each(|time_s| *time_s -= zero_s);
    (observation, command)
}
