//! Data for the report of a study: its steps, and the results of the throws in each.

use std::path::Path;

use catch_body::InputError;
use serde::{Deserialize, Serialize};

use super::throw_grid::{GridPoint, ThrowGrid};
use crate::evaluation::{Identity, Row, cell_summary::CellSummary};
use catch_recording::{bounded_file::FileKind, whole_file};

/// A study without its scenarios, as it lies beside the folders of its steps; each of those has a description
/// of its own.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Outline {
    /// Version of the program.
    pub version: String,
    /// Name of the study.
    pub study: String,
    /// Description of the study, in a sentence.
    pub description: String,
    /// Seed of everything random.
    pub seed: u64,
    /// The grid of its throws, if it has one.
    pub throw_grid: Option<ThrowGrid>,
    /// The steps in their order.
    pub steps: Vec<StepHead>,
}

/// A step without its scenario.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct StepHead {
    /// Name, that of its folder.
    pub name: String,
    /// Description of the change, in words.
    pub about: String,
    /// True if its overlay is laid upon the scenario alone, without those before it.
    pub alone: bool,
}

/// Name of the file that says which study a folder is of.
const FILE: &str = "study.toml";

impl Outline {
    /// Returns whether a folder holds a study.
    pub fn is_in(folder: &Path) -> bool {
        folder.join(FILE).is_file()
    }

    /// Reads that of a folder.
    ///
    /// # Errors
    /// If there is none.
    pub fn read(folder: &Path) -> Result<Self, InputError> {
        let path = folder.join(FILE);
        let file = path.display().to_string();
        InputError::parse_toml(&file, &FileKind::text("a folder of results of a study").read_text(&path)?)
    }

    /// Writes it into a folder, where there may be one like it.
    ///
    /// # Errors
    /// If there is that of another study, or it cannot be written.
    pub fn write(&self, folder: &Path) -> Result<(), InputError> {
        let path = folder.join(FILE);
        let file = path.display().to_string();
        if Self::is_in(folder) {
            return self.check_same(folder);
        }
        let text = toml::to_string(self).map_err(|fault| {
            InputError::new(&file, "the study", fault, "a seed and steps that can be written as TOML")
        })?;
        whole_file::write(&path, text)
    }

    /// Checks that a folder holds results of the same study.
    ///
    /// # Errors
    /// If it does not.
    pub fn check_same(&self, folder: &Path) -> Result<(), InputError> {
        if Self::read(folder)? == *self {
            return Ok(());
        }
        let expected = "the same steps, seed and version; or another folder";
        Err(InputError::new(folder.join(FILE).display().to_string(), "the file", "results of another study", expected))
    }
}

/// Results of the throws of a step.
#[derive(Debug, Clone, Serialize)]
pub struct StepSummary {
    /// Name of the step.
    pub step: String,
    /// Description of the change, in words.
    pub about: String,
    /// True if its overlay is laid upon the scenario alone.
    #[serde(skip)]
    pub alone: bool,
    /// Each object, all its throws together.
    pub objects: Vec<ObjectSummary>,
}

/// Results of one object in a step.
#[derive(Debug, Clone, Serialize)]
pub struct ObjectSummary {
    /// All its throws together.
    #[serde(flatten)]
    pub all: CellSummary,
    /// Row by row of the distances of a grid of throws, one entry per speed; `None` where a throw at that
    /// speed does not get there.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub grid: Option<Vec<Vec<Option<GridPoint>>>>,
}

impl StepSummary {
    /// Counts the trials of a step.
    pub fn of(head: &StepHead, grid: Option<&ThrowGrid>, identity: &Identity, rows: &[Row]) -> Self {
        let mut objects: Vec<&str> = identity.cells.iter().map(|cell| cell.object.as_str()).collect();
        objects.dedup();
        let of_object = |object: &str| {
            let cells = identity.cells.iter().zip(&identity.throws_are_fixed).filter(|(cell, _)| cell.object == object);
            let throws: Vec<&str> = cells.clone().map(|(cell, _)| cell.throw.as_str()).collect();
            let is_fixed = cells.into_iter().all(|(_, is_fixed)| *is_fixed);
            let rows: Vec<&Row> = rows.iter().filter(|row| row.scene.object == object).collect();
            let throws = if grid.is_some() { "grid".to_owned() } else { throws.join(", ") };
            let all = CellSummary::of(object, &throws, &rows, is_fixed);
            ObjectSummary { all, grid: grid.map(|grid| grid.summarize(object, &rows, is_fixed)) }
        };
        let StepHead { name, about, alone } = head.clone();
        Self { step: name, about, alone, objects: objects.into_iter().map(of_object).collect() }
    }
}
