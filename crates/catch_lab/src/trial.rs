//! One trial: an object is thrown, and the brain tries to catch it.

pub mod steering;
pub mod stopwatch;

use std::{convert::Infallible, io};

use catch_bot::Report;
use catch_cell::{Cell, Command, Observation};
use catch_sim::{Arena, Truth, TruthSample};

use crate::{
    flights::flight_prediction::LONGEST_FLIGHT_S,
    scenario::{Clock, setup::Setup},
    trial::stopwatch::Stopwatch,
};
use catch_recording::{Tick, brain::ObservedBrain};

/// Time from the first contact with the gripper to the disturbance test, in seconds.
const DISTURBANCE_AFTER_S: f64 = 1.0;
/// Duration of the disturbance test, in seconds; then the trial ends.
const DISTURBANCE_FOR_S: f64 = 0.5;
/// Time at which the paper measures the object's position, in seconds: no trial ends before.
pub const PAPER_LOOKS_AT_S: f64 = 0.875;
/// Duration of a trial after the object has met the floor, in seconds.
const AFTER_FLOOR_S: f64 = 0.2;
/// Duration of a trial after the object has met the arm or an obstacle, in seconds: nothing is caught after
/// such a deflection.
const AFTER_DEFLECTION_S: f64 = 1.0;

/// State snapshot of the brain at one time.
#[derive(Debug, Clone)]
pub struct StateSnapshot {
    /// Time on the cell's clock.
    pub time_s: f64,
    /// State and plan of the brain, if it reports them.
    pub report: Option<Report>,
    /// Wall time of each stage that ran, in milliseconds.
    pub stage_ms: Vec<(&'static str, f64)>,
}

/// All that happened in a trial.
#[derive(Debug, Clone)]
pub struct Trial {
    /// True states of the throw.
    pub truth: Truth,
    /// State snapshots of the brain, one for each tick.
    pub snapshots: Vec<StateSnapshot>,
    /// Wall time of the brain's stages.
    pub stopwatch: Stopwatch,
}

/// Runs one trial with the brain of the scenario: throw number `index` of `seed`, from the release at 0 s on
/// the cell's clock until the referee has seen enough. `observer` is shown every tick, with the truth up to
/// then; it ends the trial by an error.
///
/// # Errors
/// Errors of the observer.
pub fn run(
    setup: &Setup,
    seed: u64,
    index: u64,
    observer: &mut dyn FnMut(&Tick, &Truth) -> io::Result<()>,
) -> io::Result<Trial> {
    run_brain(&mut setup.brain(seed, index), setup, seed, index, observer)
}

/// Runs a trial with any brain that has seen nothing yet.
///
/// # Errors
/// Errors of the observer.
pub fn run_brain<E>(
    brain: &mut dyn ObservedBrain,
    setup: &Setup,
    seed: u64,
    index: u64,
    observer: &mut dyn FnMut(&Tick, &Truth) -> Result<(), E>,
) -> Result<Trial, E> {
    let mut episode = Episode::new(setup, seed, index);
    let mut stopwatch = Stopwatch::default();
    while !episode.is_done() {
        let observation = episode.sense();
        stopwatch.start();
        let command = brain.tick(&observation, &mut stopwatch);
        stopwatch.stop();
        let report = brain.report();
        observer(&Tick { observation: &observation, command: &command, report }, episode.truth())?;
        let (report, stage_ms) = (report.cloned(), stopwatch.last_tick_ms());
        let snapshot = StateSnapshot { time_s: observation.time_s, report, stage_ms };
        episode.act(&command, snapshot, stopwatch.last_tick_s());
    }
    Ok(episode.into_trial(stopwatch))
}

/// Runs a trial with any brain, without an observer.
pub fn run_unobserved(brain: &mut dyn ObservedBrain, setup: &Setup, seed: u64, index: u64) -> Trial {
    let Ok(trial) = run_brain::<Infallible>(brain, setup, seed, index, &mut |_, _| Ok(()));
    trial
}

/// A trial step by step, for whoever decides elsewhere: what is sensed goes out, commands come in, until it
/// is done.
pub struct Episode {
    arena: Arena,
    clock: Clock,
    watch: EndWatch,
    snapshots: Vec<StateSnapshot>,
    is_done: bool,
}

impl Episode {
    /// Throw number `index` of `seed`, the object about to fly.
    pub fn new(setup: &Setup, seed: u64, index: u64) -> Self {
        let mut arena = setup.arena(seed, index);
        let watch = EndWatch::of_release(&mut arena);
        Self { arena, clock: setup.scenario.clock, watch, snapshots: Vec::new(), is_done: false }
    }

    /// Time passes until the next image; what is sensed then.
    pub fn sense(&mut self) -> Observation {
        let Ok(observation) = self.arena.sense();
        observation
    }

    /// Passes a command on. Computing it took `computed_s` in seconds of wall time, which counts where the
    /// scenario's clock charges it; the referee looks at `snapshot`.
    pub fn act(&mut self, command: &Command, snapshot: StateSnapshot, computed_s: f64) {
        self.snapshots.push(snapshot);
        self.arena.act_after(self.clock.delay_s(computed_s), command);
        self.is_done = self.watch.is_over(self.arena.truth());
    }

    /// Returns whether the trial is over.
    pub fn is_done(&self) -> bool {
        self.is_done
    }

    /// Returns the true states so far. No brain may see it.
    pub fn truth(&self) -> &Truth {
        self.arena.truth()
    }

    /// All that happened, for the referee.
    pub fn into_trial(self, stopwatch: Stopwatch) -> Trial {
        Trial { truth: self.arena.truth().clone(), snapshots: self.snapshots, stopwatch }
    }
}

/// Watches for the end of a trial: the flight is over, or what was touched has been shaken.
#[derive(Debug)]
pub struct EndWatch {
    released_s: f64,
    samples_seen: usize,
    /// First contacts with the gripper, with the floor, with arm or obstacles.
    gripper_s: Option<f64>,
    floor_s: Option<f64>,
    deflected_s: Option<f64>,
}

impl EndWatch {
    /// Creates the watch for the object that is being released, and schedules the arena's disturbance test.
    pub fn of_release(arena: &mut Arena) -> Self {
        arena.disturb_after_contact(DISTURBANCE_AFTER_S);
        Self { released_s: arena.time_s(), samples_seen: 0, gripper_s: None, floor_s: None, deflected_s: None }
    }

    /// Returns whether the trial is over.
    pub fn is_over(&mut self, truth: &Truth) -> bool {
        for TruthSample { time_s, contact, .. } in &truth.samples[self.samples_seen..] {
            for (touches, first_s) in [
                (contact.gripper(), &mut self.gripper_s),
                (contact.floor, &mut self.floor_s),
                (contact.arm || contact.obstacle, &mut self.deflected_s),
            ] {
                if touches {
                    first_s.get_or_insert(*time_s);
                }
            }
        }
        self.samples_seen = truth.samples.len();
        let now = truth.samples.last().map_or(0.0, |sample| sample.time_s);
        let has_passed = |since_s: Option<f64>, wait_s: f64| since_s.is_some_and(|it| now >= it + wait_s - 1e-9);
        if truth.diverged_s.is_some() {
            return true;
        }
        if now < self.released_s + PAPER_LOOKS_AT_S {
            return false;
        }
        if has_passed(self.floor_s, AFTER_FLOOR_S) {
            return true;
        }
        if self.gripper_s.is_some() {
            return has_passed(truth.disturbed_since_s, DISTURBANCE_FOR_S);
        }
        has_passed(self.deflected_s, AFTER_DEFLECTION_S) || has_passed(Some(self.released_s), LONGEST_FLIGHT_S)
    }
}
