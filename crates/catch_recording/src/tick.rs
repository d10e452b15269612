//! What a recording is told of each tick.

use catch_bot::Report;
use catch_cell::{Command, Observation};

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
