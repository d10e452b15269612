//! Many throws in one life: one arena, one brain that knows all objects, and a thrower who waits until the
//! arm is ready.

mod throw_recorder;

use std::{
    fmt::{self, Display},
    io,
    path::{Path, PathBuf},
};

use catch_body::InputError;
use catch_bot::{
    Report,
    cycle::{CatchingCycle, HOLD_S, Phase},
};
use catch_cell::{Brain, Cell};
use catch_sim::{
    Arena, Truth,
    random_streams::{Draws, Stream},
};
use nalgebra::{Point3, Vector3};
use serde::{Deserialize, Serialize};

use crate::{
    referee::{
        self, HELD_UNTIL_S, Row,
        faulty_cameras::{FaultyCamera, faulty_cameras},
    },
    scenario::setup::Setup,
    trial::{EndWatch, StateSnapshot, Trial, stopwatch::Stopwatch},
};
use catch_recording::Tick;
use throw_recorder::ThrowRecorder;

/// Longest time until the arm is ready again before it counts as stuck, in seconds of the cell's clock; the
/// thrower's own pause does not count.
const STUCK_AFTER_S: f64 = 60.0;
/// An object has been put down if it is no farther from where the hand opens than this, seen from above, in
/// metres.
const PLACED_WITHIN_M: f64 = 0.4;
/// The hand holds an object for as long as the referee watches what is held.
const _: () = assert!(HOLD_S > HELD_UNTIL_S);

/// One throw of many.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct PlayRow {
    /// Result, as in a trial of its own.
    #[serde(flatten)]
    pub row: Row,
    /// Time of the throw on the cell's clock.
    pub thrown_s: f64,
    /// The object for which the brain took it; `None` if it took it for none.
    pub identified: Option<String>,
    /// Set if the hand left the object at the placing pose; `None` if the object was not caught.
    pub placed: Option<bool>,
    /// Cameras that the brain said were at fault.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub faulty_cameras: Vec<FaultyCamera>,
}

/// Reason why a life ended before its last throw was judged and the arm was ready again.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum EarlyEnd {
    /// The arm did not become ready again.
    Stuck,
    /// The physics diverged.
    SimulationDiverged,
}

impl Display for EarlyEnd {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Stuck => write!(f, "the arm did not become ready again within {STUCK_AFTER_S} s"),
            Self::SimulationDiverged => f.write_str("the simulation diverged"),
        }
    }
}

/// Result of a life.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Life {
    /// The throws, in their order.
    pub rows: Vec<PlayRow>,
    /// Duration on the cell's clock, in seconds.
    pub duration_s: f64,
    /// Limits that commands broke between the throws.
    pub violations_between: usize,
    /// Limits that the motion exceeded between the throws.
    pub excursions_between: usize,
    /// Reason of an early end, if any.
    pub ended_early: Option<EarlyEnd>,
}

/// Throws of several objects in random order, by one arm.
#[derive(Debug)]
pub struct Play {
    /// One for each object; all else is the same.
    pub setups: Vec<Setup>,
    /// Number of throws.
    pub throws: u64,
    /// Least interval between two of them, in seconds.
    pub every_s: f64,
    /// Seed of everything random.
    pub seed: u64,
    /// Folder for a recording of each throw, if they are wanted.
    pub folder: Option<PathBuf>,
}

impl Play {
    /// Returns the object of throw number `index`.
    pub fn object(&self, index: u64) -> usize {
        let count = self.setups.len();
        ((Draws::new(Stream::Object, self.seed, index).unit() * count as f64) as usize).min(count - 1)
    }

    /// Lets all of it happen; `on_row` is told of each throw as soon as the next one flies.
    ///
    /// # Errors
    /// If the scenario does not say where objects are put down; a throw that [cannot be
    /// thrown](Setup::check_throw); a recording that cannot be written.
    pub fn run(&self, on_row: &mut dyn FnMut(&PlayRow)) -> Result<Life, InputError> {
        let place_q = self.setups[0].place_q()?;
        (0..self.throws).try_for_each(|index| self.setups[self.object(index)].check_throw(self.seed, index))?;
        let bots = self.setups.iter().map(|setup| setup.brain(self.seed, 0)).collect();
        let brain = CatchingCycle::new(place_q, bots);
        let arena = self.setups[self.object(0)].arena(self.seed, 0);
        let mut cell = LivingCell { arena, brain, stopwatch: Stopwatch::default(), recorder: None };
        let place_W = {
            let Setup { robot, gripper, .. } = &self.setups[0];
            robot.gripper_pose(&place_q) * gripper.grasp_centre()
        };
        let mut life =
            Life { rows: Vec::new(), duration_s: 0.0, violations_between: 0, excursions_between: 0, ended_early: None };
        for index in 0..self.throws {
            let (row, ready) = self.throw(&mut cell, index, &place_W)?;
            life.violations_between += ready.violations;
            life.excursions_between += ready.excursions;
            life.ended_early = ready.ended_early;
            on_row(&row);
            life.rows.push(row);
            life.duration_s = cell.arena.time_s();
            if life.ended_early.is_some() {
                break;
            }
        }
        Ok(life)
    }

    /// One throw, until the arm is ready again.
    fn throw(&self, cell: &mut LivingCell, index: u64, place_W: &Point3<f64>) -> Result<(PlayRow, Ready), InputError> {
        let setup = &self.setups[self.object(index)];
        if index > 0 {
            cell.arena.throw_next(setup.equipment(), &setup.release(self.seed, index), self.seed, index);
        }
        setup.check_release(&cell.arena, self.seed, index)?;
        let unwritten = |fault: io::Error| {
            let folder = self.folder.as_deref().unwrap_or(Path::new("")).display();
            InputError::unwritten(folder, &fault, "a folder that can be written, with room in it")
        };
        let thrown_s = cell.arena.time_s();
        let begin = |folder: &PathBuf| ThrowRecorder::begin(folder, setup, (self.seed, index), thrown_s);
        cell.recorder = self.folder.as_ref().map(begin).transpose().map_err(unwritten)?;
        let (trial, identified) = cell.trial(setup, thrown_s).map_err(unwritten)?;
        let verdict = referee::judge(setup, &trial);
        if let Some(recorder) = &mut cell.recorder {
            recorder.judged(&verdict, &trial.truth);
        }
        let faulty_cameras = faulty_cameras(&trial.snapshots);
        let mut ready = cell.until_ready(setup, thrown_s + self.every_s).map_err(unwritten)?;
        // A world that has diverged stands still for good.
        ready.ended_early = trial.truth.diverged_s.map(|_| EarlyEnd::SimulationDiverged).or(ready.ended_early);
        let off_m = ready.left_W.map(|left_W| (left_W.xy() - place_W.coords.xy()).norm());
        let placed = verdict.caught.then(|| off_m.is_some_and(|off_m| off_m < PLACED_WITHIN_M));
        let row = PlayRow {
            row: Row::new(setup, self.seed, index, verdict),
            thrown_s,
            identified: identified.map(|object| self.setups[object].scenario.object.clone()),
            placed,
            faulty_cameras,
        };
        Ok((row, ready))
    }
}

/// The arena and the brain that lives in it.
struct LivingCell {
    arena: Arena,
    brain: CatchingCycle,
    stopwatch: Stopwatch,
    /// Recording of the present throw, until the arm waits again.
    recorder: Option<ThrowRecorder>,
}

/// Result of a wait for the arm.
struct Ready {
    /// Reason why the arm will not be ready, if any.
    ended_early: Option<EarlyEnd>,
    /// Limits broken by commands, and exceeded by the motion.
    violations: usize,
    excursions: usize,
    /// Position of the object when the hand retreated from it.
    left_W: Option<Vector3<f64>>,
}

impl LivingCell {
    fn tick(&mut self, setup: &Setup) -> io::Result<f64> {
        let Ok(observation) = self.arena.sense();
        self.stopwatch.start();
        let command = self.brain.tick(&observation, &mut self.stopwatch);
        self.stopwatch.stop();
        if let Some(recorder) = &mut self.recorder {
            let tick = Tick { observation: &observation, command: &command, report: self.brain.report() };
            recorder.ticked(&tick, self.arena.truth())?;
        }
        self.arena.act_after(setup.scenario.clock.delay_s(self.stopwatch.last_tick_s()), &command);
        Ok(observation.time_s)
    }

    /// Runs from the release to the end of the referee's test, with the clock set to zero at the release.
    /// Returns also the index of the object that the brain identified.
    fn trial(&mut self, setup: &Setup, released_s: f64) -> io::Result<(Trial, Option<usize>)> {
        let mut watch = EndWatch::of_release(&mut self.arena);
        let (mut snapshots, mut identified) = (Vec::new(), None);
        loop {
            let time_s = self.tick(setup)?;
            if self.brain.phase() != Phase::Waiting {
                identified.get_or_insert(self.brain.object());
                let report = self.brain.report().map(|report| since(report, released_s));
                snapshots.push(StateSnapshot { time_s: time_s - released_s, report, stage_ms: Vec::new() });
            }
            if watch.is_over(self.arena.truth()) {
                let truth = truth_since(self.arena.take_truth(), released_s, setup.scenario.arena.step_s);
                return Ok((Trial { truth, snapshots, stopwatch: Stopwatch::default() }, identified));
            }
        }
    }

    /// Runs until the arm waits again, and at least until `earliest_s`.
    fn until_ready(&mut self, setup: &Setup, earliest_s: f64) -> io::Result<Ready> {
        let mut ready = Ready { ended_early: None, violations: 0, excursions: 0, left_W: None };
        // Since when the arm has not been waiting.
        let mut busy_since_s = self.arena.time_s();
        loop {
            let truth = self.arena.take_truth();
            if let Some(recorder) = &mut self.recorder {
                recorder.moved(&truth.samples);
            }
            ready.violations += truth.servo.command_violations.len();
            ready.excursions += truth.servo.motion_violations.len();
            // Round things roll on: what counts is where the hand has left it.
            if self.brain.phase() == Phase::Returning && ready.left_W.is_none() {
                ready.left_W = truth.samples.last().map(|it| it.X_WO.translation.vector);
            }
            let now_s = self.arena.time_s();
            let is_waiting = self.brain.phase() == Phase::Waiting;
            if is_waiting {
                busy_since_s = now_s;
            }
            let ended_early = match truth.diverged_s {
                Some(_) => Some(EarlyEnd::SimulationDiverged),
                None => (now_s > busy_since_s + STUCK_AFTER_S).then_some(EarlyEnd::Stuck),
            };
            if is_waiting || ended_early.is_some() {
                self.recorder.take().map(|it| it.finish(setup)).transpose()?;
            }
            if ended_early.is_some() || is_waiting && now_s >= earliest_s - 1e-9 {
                return Ok(Ready { ended_early, ..ready });
            }
            self.tick(setup)?;
        }
    }
}

/// Shifts a brain's report so that the clock is zero at `zero_s`.
fn since(report: &Report, zero_s: f64) -> Report {
    let mut report = report.clone();
    if let Some(pose) = &mut report.pose {
        pose.capture_s -= zero_s;
    }
    if let Some(flight) = &mut report.flight {
        flight.time_s -= zero_s;
    }
    if let Some(plan) = &mut report.plan {
        plan.catch_s -= zero_s;
        plan.trajectory.knots_s.iter_mut().for_each(|knot_s| *knot_s -= zero_s);
    }
    if let Some(closing) = &mut report.closing {
        closing.start_s -= zero_s;
        closing.contact_s -= zero_s;
    }
    report
}

/// Shifts the truth so that the clock is zero at `zero_s`; whole steps stay whole.
fn truth_since(mut truth: Truth, zero_s: f64, step_s: f64) -> Truth {
    let shifted = |time_s: f64| ((time_s - zero_s) / step_s).round() * step_s;
    for sample in &mut truth.samples {
        sample.time_s = shifted(sample.time_s);
    }
    truth.disturbed_since_s = truth.disturbed_since_s.map(shifted);
    truth.diverged_s = truth.diverged_s.map(shifted);
    truth
}
