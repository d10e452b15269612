//! `catchingbot check`: are these files right?

use std::{fmt, path::PathBuf};

use catch_lab::{
    VERSION,
    own_data::check::{Checked, check},
};
use clap::Args;
use serde::Serialize;

use crate::screen::{self, BAD, GOOD};

/// Arguments of `check`.
#[derive(Debug, Args)]
pub struct CheckArguments {
    /// Scenario, robot, gripper, workcell, object, throw, rig or study files; a robot is its robot.toml or the folder that holds it
    #[arg(value_name = "FILE", required = true)]
    files: Vec<PathBuf>,
    /// Print one JSON document
    #[arg(long)]
    json: bool,
}

/// Some file is not right; what is wrong has been said.
#[derive(Debug)]
pub struct Faulty {
    faults: usize,
}

impl fmt::Display for Faulty {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { faults } = self;
        write!(f, "{faults} {} found", if *faults == 1 { "fault" } else { "faults" })
    }
}

impl std::error::Error for Faulty {}

#[derive(Serialize)]
struct Document {
    version: &'static str,
    file: PathBuf,
    kind: Option<String>,
    faults: Vec<String>,
    notes: Vec<String>,
}

/// Checks files and lists their faults.
///
/// # Errors
/// If there are any.
pub fn run(arguments: &CheckArguments) -> anyhow::Result<()> {
    let checked: Vec<(&PathBuf, Checked)> = arguments.files.iter().map(|file| (file, check(file))).collect();
    let faults = checked.iter().map(|(_, checked)| checked.faults.len()).sum();
    if arguments.json {
        let documents: Vec<Document> = checked
            .into_iter()
            .map(|(file, Checked { kind, faults, notes })| Document {
                version: VERSION,
                file: file.clone(),
                kind: kind.map(|it| it.to_string()),
                faults: faults.iter().map(ToString::to_string).collect(),
                notes,
            })
            .collect();
        screen::json(&documents)?;
    } else {
        for (file, Checked { kind, faults, notes }) in &checked {
            let kind = kind.map_or("file".to_owned(), |it| it.to_string());
            match faults.len() {
                0 => screen::line(&format!("{GOOD}right{GOOD:#}  {kind} {}", file.display()))?,
                _ => screen::line(&format!("{BAD}wrong{BAD:#}  {kind} {}", file.display()))?,
            }
            for fault in faults {
                screen::line(&format!("       {fault}"))?;
            }
            for note in notes {
                screen::line(&format!("       {note}"))?;
            }
        }
    }
    if faults > 0 { Err(Faulty { faults }.into()) } else { Ok(()) }
}
