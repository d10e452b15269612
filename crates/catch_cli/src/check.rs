//! `catchingbot check`: are these files right?

use std::path::{Path, PathBuf};

use catch_body::InputError;
use catch_import::check::{Checked, check};
use catch_recording::bounded_file::FileKind;
use clap::Args;
use serde_json::json;

use crate::{
    drive,
    failure::Failure,
    screen::{self, BAD, GOOD},
};

/// Arguments of `check`.
#[derive(Debug, Args)]
pub struct CheckArguments {
    /// Scenario, robot, gripper, workcell, object, throw, rig or cell files, or built-in names; a robot is
    /// its robot.toml or the folder that holds it
    #[arg(value_name = "NAME|FILE", required = true)]
    files: Vec<PathBuf>,
}

/// Checks a file of whatever kind, and names the kind. A cell's is known by its table `[arm]`.
fn checked(file: &Path) -> (Option<String>, Checked) {
    let text = FileKind::toml("a file").read_text(file).unwrap_or_default();
    if !text.lines().any(|it| it.trim_start().starts_with("[arm]")) {
        let checked = check(file);
        return (checked.kind.map(|it| it.to_string()), checked);
    }
    // A file is right wherever it is read; its driver may be on another machine.
    let notes = drive::setup(file, &[]).map(|(links, _)| {
        let missing = drive::program(file, &links).err().map(|it| format!("not on this machine: {it}"));
        std::iter::once(format!("driven by {}", links.arm.driver)).chain(missing).collect()
    });
    let (notes, faults) = notes.map_or_else(|fault| (Vec::new(), fault.all()), |notes| (notes, Vec::new()));
    (Some("cell".to_owned()), Checked { kind: None, faults, notes })
}

/// Checks files and lists their faults.
///
/// # Errors
/// If there are any.
pub fn run(arguments: &CheckArguments, json: bool) -> anyhow::Result<()> {
    let checked: Vec<_> = arguments.files.iter().map(|file| (file, checked(file))).collect();
    let faults: Vec<InputError> = checked.iter().flat_map(|(_, (_, it))| it.faults.clone()).collect();
    let error = format!("{} {} found", faults.len(), if faults.len() == 1 { "fault" } else { "faults" });
    let failure = (!faults.is_empty()).then(|| Failure::of_faults(error, faults));
    if json {
        let files = checked.iter().map(|(file, (kind, it))| {
            json!({ "file": file.to_string_lossy(), "kind": kind, "faults": it.faults, "notes": it.notes })
        });
        // Without a failure this is null, of which a first key makes an object.
        let mut document = json!(failure);
        document["files"] = files.collect();
        screen::document(&document)?;
    } else {
        for (file, (kind, Checked { faults, notes, .. })) in &checked {
            let kind = kind.as_deref().unwrap_or("file");
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
    failure.map_or(Ok(()), |failure| Err(failure.into()))
}
