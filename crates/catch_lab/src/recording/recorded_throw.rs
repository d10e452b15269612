//! One throw, recorded: what `catchingbot catch` does, as a function.

use std::{
    io,
    path::{Path, PathBuf},
};

use catch_recording::{Ending, Recorder, timeline::Entry};
use catch_sim::{ThrowConditions, Truth, TruthSample};

use crate::{
    recording::{self, GroundTruth, recorded_surface::RecordedSurface, story::Story, throw_times::ThrowTimes},
    referee::{self, Verdict},
    scenario::setup::Setup,
    trial::{self, stopwatch::Stopwatch},
};

/// True states are recorded no nearer to each other than this, in seconds: steps of the physics may be much
/// shorter, and what is recorded of a throw may not be much larger for it.
const STATES_S: f64 = 5e-4;

/// A throw and its recording.
#[derive(Debug)]
pub struct RecordedThrow {
    /// The recording's file; the file of wall times lies beside it.
    pub recording: PathBuf,
    /// Timeline of the throw.
    pub timeline: Vec<Entry>,
    /// The outcome.
    pub verdict: Verdict,
    /// Conditions drawn for the throw.
    pub conditions: Option<ThrowConditions>,
    /// Wall time of the brain's stages.
    pub stopwatch: Stopwatch,
    /// Time of the first image that was left out of the recording, which has no room for more; `None` where
    /// it has all of them.
    pub images_until_s: Option<f64>,
}

/// Throws once, lets the brain try, judges, and keeps it all in `folder`. `tell` hears the story as it
/// happens.
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
    keep(recording::begin(folder, setup, &setup.scene(seed, index), None)?, setup, seed, index, tell)
}

/// Throws once, and ends a recording with what came of it.
fn keep(
    mut recorder: Recorder,
    setup: &Setup,
    seed: u64,
    index: u64,
    tell: &mut dyn FnMut(&Entry) -> io::Result<()>,
) -> io::Result<RecordedThrow> {
    let mut timeline = Story::default();
    let trial = trial::run(setup, seed, index, &mut |tick, truth| {
        recorder.ticked(tick)?;
        timeline.ticked(tick, truth).iter().try_for_each(&mut *tell)
    })?;
    let verdict = referee::judge(setup, &trial);
    let end_s = trial.truth.samples.last().map_or(0.0, |sample| sample.time_s);
    timeline.ended(&verdict, end_s).iter().try_for_each(&mut *tell)?;
    let times = ThrowTimes::of(&trial);
    let conditions = trial.truth.conditions.clone();
    let (timeline, images_until_s) = (timeline.into_entries(), recorder.images_until_s);
    let recording = finish(recorder, timeline.clone(), setup, (trial.truth, &verdict))?;
    times.write(&recording)?;
    Ok(RecordedThrow { recording, timeline, verdict, conditions, stopwatch: trial.stopwatch, images_until_s })
}

/// Ends a recording with its story and its outcome; returns its file.
///
/// # Errors
/// If the file cannot be written.
pub fn finish(
    recorder: Recorder,
    timeline: Vec<Entry>,
    setup: &Setup,
    (mut truth, verdict): (Truth, &Verdict),
) -> io::Result<PathBuf> {
    let surface = RecordedSurface::from(&setup.object.mesh);
    let undisturbed_m =
        verdict.catch_time_s.and_then(|catch_s| referee::undisturbed_position(&truth, &setup.object, catch_s));
    let com_O = referee::true_com_O(setup);
    thin(&mut truth.samples);
    let ground_truth = Some(GroundTruth { truth, verdict: verdict.clone(), surface, com_O, undisturbed_m });
    recorder.finish(&Ending { timeline, ground_truth })
}

/// Leaves out states that are nearer than [`STATES_S`] to the one before; never the last one.
fn thin(samples: &mut Vec<TruthSample>) {
    let last = samples.last().copied();
    samples.dedup_by(|next, kept| next.time_s < kept.time_s + 0.99 * STATES_S);
    samples.extend(last.filter(|last| samples.last() != Some(last)));
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        recording::{LabReader, replay::replay},
        scenario::setup::Choice,
    };
    use catch_recording::{Part, ROOM_WITHOUT_IMAGES, RecordedTick};
    use flate2::read::GzDecoder;
    use std::{fs::File, io::Read};

    /// An object that nobody sees is looked for in full images, of which a recording may have too many.
    #[test]
    fn what_is_written_can_be_read() {
        let folder = tempfile::tempdir().unwrap();
        let setup = Setup::load(&Choice::default()).unwrap();
        let mut recorder = recording::begin(folder.path(), &setup, &setup.scene(1, 0), None).unwrap();
        let room = recorder.leave_room(ROOM_WITHOUT_IMAGES + 1_000_000);
        let thrown = keep(recorder, &setup, 1, 0, &mut |_| Ok(())).unwrap();
        let until_s = thrown.images_until_s.unwrap();
        let mut unpacked = Vec::new();
        GzDecoder::new(File::open(&thrown.recording).unwrap()).read_to_end(&mut unpacked).unwrap();
        assert!(unpacked.len() as u64 <= room);
        let mut reader = LabReader::open(&thrown.recording).unwrap();
        let mut ticks: Vec<RecordedTick> = Vec::new();
        while let Part::Tick(tick) = reader.next_part().unwrap() {
            ticks.push(*tick);
        }
        let first = ticks.iter().find(|tick| tick.images_left_out).unwrap();
        assert_eq!(first.observation.time_s, until_s);
        assert!(first.observation.frames.is_empty() && !ticks[0].images_left_out);
        let replay = replay(&thrown.recording).unwrap();
        assert_eq!((replay.images_until_s, replay.identical), (Some(until_s), true));
        assert!(replay.ticks > 0 && replay.ticks < ticks.len(), "{}", replay.ticks);
    }

    #[test]
    fn states_of_short_steps_are_left_out() {
        let setup = Setup::load(&Choice::default()).unwrap();
        let samples = trial::run(&setup, 1, 0, &mut |_, _| Ok(())).unwrap().truth.samples;
        let recorded = |step_s: f64| {
            let mut samples = samples[..1002].to_vec();
            samples.iter_mut().enumerate().for_each(|(i, it)| it.time_s = step_s * i as f64);
            thin(&mut samples);
            (samples.len(), samples.last().unwrap().time_s)
        };
        assert_eq!(recorded(5e-4), (1002, 5e-4 * 1001.0));
        // 50 steps of 10 µs, twenty times, and the last step.
        assert_eq!(recorded(1e-5), (22, 1e-5 * 1001.0));
    }

    #[test]
    fn what_no_reader_would_take_is_not_written() {
        let folder = tempfile::tempdir().unwrap();
        let setup = Setup::load(&Choice::default()).unwrap();
        let mut recorder = recording::begin(folder.path(), &setup, &setup.scene(1, 0), None).unwrap();
        recorder.leave_room(10_000);
        let fault = keep(recorder, &setup, 1, 0, &mut |_| Ok(())).unwrap_err();
        assert_eq!(fault.kind(), io::ErrorKind::FileTooLarge);
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0);
    }
}
