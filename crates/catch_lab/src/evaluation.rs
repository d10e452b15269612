//! Evaluations: many throws of many objects, on all cores, with the same rows in the same order whatever the
//! number of threads.

pub mod cell_summary;
pub mod comparison;
pub mod published;
pub mod results;
pub mod summary_table;
pub mod trial_table;

use std::{
    fmt::{self, Debug, Write},
    sync::Arc,
};

use catch_body::InputError;
use serde::{Deserialize, Serialize};

use crate::{
    VERSION,
    evaluation::cell_summary::CellSummary,
    parallel,
    reachability::oracle::Oracle,
    referee::{self, Verdict},
    scenario::{
        Scenario,
        setup::{Scene, Setup},
    },
    trial::{self, stopwatch::Stopwatch},
};
use catch_recording::brain::ObservedBrain;

pub use crate::referee::Row;

/// Trials that run at the same time at most: more than the cores of any machine, and few enough to be
/// started.
pub const MOST_THREADS: usize = 1024;

/// Makes a brain that has seen nothing yet for each trial: of a setup, for a seed and the number of the
/// throw.
pub type BrainFactory = Arc<dyn Fn(&Setup, u64, u64) -> Box<dyn ObservedBrain> + Send + Sync>;

/// One object with one throw, many times.
pub struct Cell {
    /// All that its trials share.
    pub setup: Setup,
    /// Factory of the brain that catches.
    pub brain: BrainFactory,
}

impl Cell {
    /// A cell of trials that share a setup, with the brain of its scenario.
    pub fn new(setup: Setup) -> Self {
        Self { setup, brain: Arc::new(|setup, seed, index| Box::new(setup.brain(seed, index))) }
    }
}

/// The row of a judged trial: for a miss the verdict tells what was within reach, too.
pub fn row(setup: &Setup, seed: u64, index: u64, mut verdict: Verdict) -> Row {
    if !verdict.caught {
        verdict.reach = Some(Oracle::of(setup).reach(setup, seed, index));
    }
    Row::new(setup, seed, index, verdict)
}

/// Evaluation: cells, seed and range of trials. Trials are numbered throw by throw: first the first throw in
/// all cells, then the second.
pub struct Evaluation {
    /// Objects with their throws.
    pub cells: Vec<Cell>,
    /// Seed of everything random.
    pub seed: u64,
    /// Number of the first throw.
    pub first: u64,
    /// Throws per cell.
    pub trials: u64,
}

/// Identity of an evaluation: all that its rows depend on, except their number.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Identity {
    /// Version of the program.
    pub version: String,
    /// Seed of everything random.
    pub seed: u64,
    /// Number of the first throw.
    pub first: u64,
    /// Flags of the cells in which every trial has the same throw.
    pub throws_are_fixed: Vec<bool>,
    /// The scenario of each cell, all choices made.
    pub cells: Vec<Scenario>,
    /// Checksums of what the scenarios name, so that results of changed files do not mix.
    pub checksums: Vec<Checksums>,
}

/// Checksums (CRC-32) of the contents of what a scenario names.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct Checksums {
    /// Checksum of the files of arm, gripper and workcell, and of the room.
    pub robot_gripper_workcell: u32,
    /// Checksum of the cameras.
    pub flight_rig: u32,
    /// Checksum of the object, and of what is known of it.
    pub object: u32,
    /// Checksum of the throw.
    pub throw: u32,
}

impl Checksums {
    fn of(setup: &Setup) -> Self {
        Self {
            robot_gripper_workcell: checksum(&(&setup.sources, &setup.room)),
            flight_rig: checksum(&setup.cameras),
            object: checksum(&(&setup.object, &setup.known_object)),
            throw: checksum(&setup.throw),
        }
    }
}

/// The checksum of a value's text, which is never as a whole in memory: meshes make it long.
fn checksum(content: &dyn Debug) -> u32 {
    struct Sink(crc32fast::Hasher);
    impl fmt::Write for Sink {
        fn write_str(&mut self, text: &str) -> fmt::Result {
            self.0.update(text.as_bytes());
            Ok(())
        }
    }
    let mut sink = Sink(crc32fast::Hasher::new());
    let _ = write!(sink, "{content:?}");
    sink.0.finalize()
}

impl Identity {
    /// The scene of trial number `job`.
    pub fn scene(&self, job: usize) -> Scene {
        let Scenario { name, object, throw, .. } = &self.cells[job % self.cells.len()];
        let index = self.first + (job / self.cells.len()) as u64;
        Scene { scenario: name.clone(), object: object.clone(), throw: throw.clone(), seed: self.seed, index }
    }

    /// Sums up the rows cell by cell.
    pub fn summarize(&self, rows: &[Row]) -> Vec<CellSummary> {
        let of_cell = |(Scenario { object, throw, .. }, is_fixed): (&Scenario, &bool)| {
            let rows: Vec<&Row> =
                rows.iter().filter(|row| &row.scene.object == object && &row.scene.throw == throw).collect();
            CellSummary::of(object, throw, &rows, *is_fixed)
        };
        self.cells.iter().zip(&self.throws_are_fixed).map(of_cell).collect()
    }
}

impl Evaluation {
    /// Returns the identity of the evaluation.
    pub fn identity(&self) -> Identity {
        Identity {
            version: VERSION.to_owned(),
            seed: self.seed,
            first: self.first,
            cells: self.cells.iter().map(|cell| cell.setup.scenario.clone()).collect(),
            throws_are_fixed: self.cells.iter().map(|cell| cell.setup.repeats_itself()).collect(),
            checksums: self.cells.iter().map(|cell| Checksums::of(&cell.setup)).collect(),
        }
    }

    /// Number of trials in all cells.
    pub fn total(&self) -> usize {
        self.cells.len() * self.trials as usize
    }

    /// The cell and the number of the throw of trial number `job`.
    fn job(&self, job: usize) -> (&Cell, u64) {
        (&self.cells[job % self.cells.len()], self.first + (job / self.cells.len()) as u64)
    }

    /// Checks that all trials from number `from` on can be thrown.
    pub(crate) fn check_throws(&self, from: usize) -> Result<(), InputError> {
        (from..self.total()).try_for_each(|job| {
            let (cell, index) = self.job(job);
            cell.setup.check_throw(self.seed, index)
        })
    }

    fn trial(&self, job: usize) -> (Row, Stopwatch) {
        let (cell, index) = self.job(job);
        let mut brain = (cell.brain)(&cell.setup, self.seed, index);
        let trial = trial::run_unobserved(&mut *brain, &cell.setup, self.seed, index);
        (row(&cell.setup, self.seed, index, referee::judge(&cell.setup, &trial)), trial.stopwatch)
    }

    /// Runs the trials from number `from` on, on several threads or as many as the system allows, and hands
    /// over each row in the order of their numbers.
    ///
    /// # Errors
    /// A throw that [cannot be thrown](Setup::check_throw), before anything is; those of `row_done`: the
    /// trials that are running then are given up.
    pub fn run(
        &self,
        from: usize,
        threads: usize,
        row_done: &mut dyn FnMut(Row, Stopwatch) -> Result<(), InputError>,
    ) -> Result<(), InputError> {
        self.check_throws(from)?;
        let threads = threads.min(MOST_THREADS);
        parallel::in_order(threads, from..self.total(), |job| self.trial(job), &mut |(row, times)| row_done(row, times))
    }
}
