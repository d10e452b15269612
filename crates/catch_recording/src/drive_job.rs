//! A driver's task: everything it needs to let a brain catch in a real cell, in one file.
//!
//! The program resolves names and files, so that a driver needs neither assets nor a simulator.

use std::{
    fs, io,
    path::{Path, PathBuf},
};

use catch_cell::cell_file::CellFile;
use serde::{Deserialize, Serialize};

use crate::{recording::RecordedCell, whole_file};

/// A driver's task.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct DriveJob {
    /// The cell's file, as errors name it.
    pub file: String,
    /// Links to the devices, and the bounds of the motion.
    pub links: CellFile,
    /// Cell that the brain is made from.
    pub cell: RecordedCell,
    /// Folder for the recordings.
    pub out: PathBuf,
    /// True if nothing may move.
    pub dry_run: bool,
}

impl DriveJob {
    /// Writes the task as MessagePack.
    ///
    /// # Errors
    /// If the file cannot be written.
    pub fn write(&self, path: &Path) -> io::Result<()> {
        let bytes = rmp_serde::to_vec_named(self).map_err(io::Error::other)?;
        whole_file::write(path, bytes).map_err(io::Error::other)
    }

    /// Reads a task.
    ///
    /// # Errors
    /// If the file cannot be read or is none.
    pub fn read(path: &Path) -> io::Result<Self> {
        rmp_serde::from_slice(&fs::read(path)?).map_err(io::Error::other)
    }
}
