//! One trial: an object is thrown, and the brain tries to catch it.

pub mod stopwatch;

use std::{convert::Infallible, io};

use catch_bot::Report;
use catch_cell::{Cell, Command, Observation};
use catch_sim::{Arena, Truth};

use crate::{
    scenario::{brain::ObservedBrain, setup::Setup},
    trial::stopwatch::Stopwatch,
};

/// From the first contact with the gripper on: how long until the world shakes.
const DISTURBANCE_AFTER_S: f64 = 1.0;
/// How long it shakes; then the trial ends.
const DISTURBANCE_FOR_S: f64 = 0.5;
/// When the paper looks where the object is: no trial ends before.
pub const PAPER_LOOKS_AT_S: f64 = 0.875;
/// How long a trial goes on after the object has met the floor.
const AFTER_FLOOR_S: f64 = 0.2;
/// When a trial ends in which nothing has touched the gripper.
const LONGEST_FLIGHT_S: f64 = 2.0;

/// One decision of the brain.
#[derive(Debug, Clone, Copy)]
pub struct Tick<'a> {
    /// What it saw.
    pub observation: &'a Observation,
    /// What it wants.
    pub command: &'a Command,
    /// What it tells of its state.
    pub report: Option<&'a Report>,
}

/// State snapshot of the brain at one time.
#[derive(Debug, Clone)]
pub struct StateSnapshot {
    /// When, on the cell's clock.
    pub time_s: f64,
    /// What, if it tells.
    pub report: Option<Report>,
    /// Wall time of each stage that ran, in milliseconds.
    pub stage_ms: Vec<(&'static str, f64)>,
}

/// All that happened in a trial.
#[derive(Debug, Clone)]
pub struct Trial {
    /// What really happened.
    pub truth: Truth,
    /// State snapshots of the brain, one for each tick.
    pub snapshots: Vec<StateSnapshot>,
    /// Wall time of the brain's stages.
    pub stopwatch: Stopwatch,
}

/// Runs one trial with the brain of the scenario. `observer` is shown every tick, with the truth up to then; it ends the trial by an error.
///
/// # Errors
/// Those of the observer.
pub fn run(
    setup: &Setup,
    seed: u64,
    index: u64,
    observer: &mut dyn FnMut(&Tick, &Truth) -> io::Result<()>,
) -> io::Result<Trial> {
    run_brain(&mut setup.brain(seed, index), setup, seed, index, observer)
}

/// The same with any brain that has seen nothing yet.
///
/// # Errors
/// Those of the observer.
pub fn run_brain<E>(
    brain: &mut dyn ObservedBrain,
    setup: &Setup,
    seed: u64,
    index: u64,
    observer: &mut dyn FnMut(&Tick, &Truth) -> Result<(), E>,
) -> Result<Trial, E> {
    let mut arena = setup.arena(seed, index);
    let mut stopwatch = Stopwatch::default();
    let mut snapshots = Vec::new();
    let mut watch = EndWatch::default();
    loop {
        let Ok(observation) = arena.sense();
        stopwatch.start();
        let command = brain.tick(&observation, &mut stopwatch);
        stopwatch.stop();
        let report = brain.report();
        observer(&Tick { observation: &observation, command: &command, report }, arena.truth())?;
        snapshots.push(StateSnapshot {
            time_s: observation.time_s,
            report: report.cloned(),
            stage_ms: stopwatch.last_tick_ms(),
        });
        let delay_s = setup.scenario.clock.delay_s(stopwatch.last_tick_s());
        arena.act_after(delay_s, &command);
        if watch.is_over(&mut arena) {
            return Ok(Trial { truth: arena.truth().clone(), snapshots, stopwatch });
        }
    }
}

/// The same with nobody watching.
pub fn run_unobserved(brain: &mut dyn ObservedBrain, setup: &Setup, seed: u64, index: u64) -> Trial {
    let Ok(trial) = run_brain::<Infallible>(brain, setup, seed, index, &mut |_, _| Ok(()));
    trial
}

/// Watches for the end of a trial, and shakes the world when it is time.
#[derive(Debug, Default)]
pub struct EndWatch {
    released_s: f64,
    samples_seen: usize,
    gripper_contact_s: Option<f64>,
    floor_contact_s: Option<f64>,
}

impl EndWatch {
    /// For an object that is released at `released_s`.
    pub fn from(released_s: f64) -> Self {
        Self { released_s, ..Self::default() }
    }

    /// Whether the trial is over.
    pub fn is_over(&mut self, arena: &mut Arena) -> bool {
        let truth = arena.truth();
        for sample in &truth.samples[self.samples_seen..] {
            let contact = &sample.contact;
            if contact.left_finger || contact.right_finger || contact.palm {
                self.gripper_contact_s.get_or_insert(sample.time_s);
            }
            if contact.floor {
                self.floor_contact_s.get_or_insert(sample.time_s);
            }
        }
        self.samples_seen = truth.samples.len();
        let now = truth.samples.last().map_or(0.0, |sample| sample.time_s);
        if truth.diverged_s.is_some() {
            return true;
        }
        if now < self.released_s + PAPER_LOOKS_AT_S {
            return false;
        }
        if self.floor_contact_s.is_some_and(|touched| now >= touched + AFTER_FLOOR_S) {
            return true;
        }
        let Some(touched) = self.gripper_contact_s else { return now >= self.released_s + LONGEST_FLIGHT_S };
        match truth.disturbed_since_s {
            Some(since) => now >= since + DISTURBANCE_FOR_S - 1e-9,
            None => {
                if now >= touched + DISTURBANCE_AFTER_S - 1e-9 {
                    arena.start_disturbance();
                }
                false
            }
        }
    }
}
