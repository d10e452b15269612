//! Data of one tick for a recording.

use catch_bot::Report;
use catch_cell::{Command, Observation};

/// One decision of the brain.
#[derive(Debug, Clone, Copy)]
pub struct Tick<'a> {
    /// Observation that the brain was given.
    pub observation: &'a Observation,
    /// Command that the brain returned.
    pub command: &'a Command,
    /// State that the brain reports.
    pub report: Option<&'a Report>,
}
