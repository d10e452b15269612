//! Parts of a long run, which go on where one was ended.

use std::{fs, path::PathBuf};

use anyhow::{Context, Result};
use serde::{Serialize, de::DeserializeOwned};

use crate::results::last_change;

/// The part of an experiment that an earlier run at the same commit kept under this name, or else a new one.
pub fn part<T: Serialize + DeserializeOwned>(
    experiment: &str,
    name: &str,
    make: impl FnOnce() -> Result<T>,
) -> Result<T> {
    let commit = last_change().replace([' ', ','], "_");
    let file = PathBuf::from("target").join(experiment).join(commit).join(name.replace([' ', '/'], "_") + ".json");
    if let Some(known) = fs::read(&file).ok().and_then(|it| serde_json::from_slice(&it).ok()) {
        return Ok(known);
    }
    let part = make()?;
    fs::create_dir_all(file.parent().context("a folder")?)?;
    fs::write(&file, serde_json::to_vec(&part)?)?;
    Ok(part)
}
