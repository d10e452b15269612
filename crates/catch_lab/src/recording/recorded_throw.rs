//! One throw, recorded: what `catchingbot catch` does, as a function.

use std::{
    io,
    path::{Path, PathBuf},
};

use catch_sim::ThrowConditions;

use crate::{
    recording::{
        Ending, GroundTruth, Recorder,
        recorded_surface::RecordedSurface,
        throw_times::ThrowTimes,
        timeline::{Entry, Timeline},
    },
    referee::{self, Verdict},
    scenario::setup::Setup,
    trial::{self, stopwatch::Stopwatch},
};

/// A throw and its recording.
#[derive(Debug)]
pub struct RecordedThrow {
    /// The recording's file; the file of wall times lies beside it.
    pub recording: PathBuf,
    /// Its story.
    pub timeline: Vec<Entry>,
    /// The outcome.
    pub verdict: Verdict,
    /// What was drawn for it.
    pub conditions: Option<ThrowConditions>,
    /// Wall time of the brain's stages.
    pub stopwatch: Stopwatch,
}

/// Throws once, lets the brain try, judges, and keeps it all in `folder`. `tell` hears the story as it happens.
///
/// # Errors
/// Files that cannot be written; those of `tell`.
pub fn record(
    setup: &Setup,
    seed: u64,
    index: u64,
    folder: &Path,
    tell: &mut dyn FnMut(&Entry) -> io::Result<()>,
) -> io::Result<RecordedThrow> {
    let mut recorder = Recorder::create(folder, setup, &setup.scene(seed, index))?;
    let mut timeline = Timeline::default();
    let trial = trial::run(setup, seed, index, &mut |tick, truth| {
        recorder.ticked(tick)?;
        timeline.ticked(tick, Some(truth)).iter().try_for_each(&mut *tell)
    })?;
    let verdict = referee::judge(setup, &trial);
    let end_s = trial.truth.samples.last().map_or(0.0, |sample| sample.time_s);
    timeline.ended(&verdict, end_s).iter().try_for_each(&mut *tell)?;
    let times = ThrowTimes::of(&trial);
    let conditions = trial.truth.conditions.clone();
    let surface = RecordedSurface::from(&setup.object.mesh);
    let undisturbed_m =
        verdict.catch_time_s.and_then(|catch_s| referee::undisturbed_position(&trial.truth, &setup.object, catch_s));
    let com_O = referee::true_com_O(setup);
    let ground_truth =
        Some(GroundTruth { truth: trial.truth, verdict: verdict.clone(), surface, com_O, undisturbed_m });
    let timeline = timeline.entries().to_vec();
    let ending = Ending { timeline, ground_truth };
    let recording = recorder.finish(&ending)?;
    times.write(&recording)?;
    Ok(RecordedThrow { recording, timeline: ending.timeline, verdict, conditions, stopwatch: trial.stopwatch })
}
