//! Results of an evaluation on disk: one line of JSON per trial, written as soon as it and all before it are done, and a file
//! beside it that says what was evaluated. What a run was killed in the middle of is gone; everything before it stays.

use std::{
    fs::{self, File, OpenOptions},
    io::{self, Write},
    path::{Path, PathBuf},
};

use catch_body::InputError;

use crate::{
    evaluation::{Evaluation, Identity, Row},
    setup::COMMAND_LINE,
};

/// Name of the file with one row per trial.
pub const TRIALS_FILE: &str = "trials.jsonl";
/// Name of the file that says what was evaluated.
const IDENTITY_FILE: &str = "evaluation.json";

/// Results that grow.
#[derive(Debug)]
pub struct Results {
    trials: File,
}

impl Results {
    /// Opens a folder for the results of `evaluation`; returns the rows that are already there.
    ///
    /// # Errors
    /// A folder that cannot be written, that holds results though nothing is to be resumed, that holds results of something
    /// else, or rows that are none.
    pub fn open(folder: &Path, evaluation: &Evaluation, resume: bool) -> Result<(Self, Vec<Row>), InputError> {
        let unwritable = |fault: io::Error| {
            let found = format!("`{}`: {fault}", folder.display());
            InputError::new(COMMAND_LINE, "--out", found, "a folder that can be written")
        };
        let (identity_path, path) = (folder.join(IDENTITY_FILE), folder.join(TRIALS_FILE));
        let identity = evaluation.identity();
        if identity_path.exists() {
            if !resume {
                let found = format!("`{}`, which holds results", folder.display());
                return Err(InputError::new(
                    COMMAND_LINE,
                    "--out",
                    found,
                    "--resume to go on with them, or another folder",
                ));
            }
            check_identity(&identity_path, &identity)?;
        } else {
            fs::create_dir_all(folder).map_err(unwritable)?;
            let text = serde_json::to_string_pretty(&identity).unwrap_or_default() + "\n";
            let unfinished = folder.join(format!(".{IDENTITY_FILE}.unfinished"));
            fs::write(&unfinished, text).and_then(|()| fs::rename(&unfinished, &identity_path)).map_err(unwritable)?;
        }
        let (rows, bytes) = read_rows(&path, evaluation)?;
        let trials = OpenOptions::new().create(true).truncate(false).write(true).open(&path).map_err(unwritable)?;
        // A line that was cut off is written again.
        trials.set_len(bytes).map_err(unwritable)?;
        let mut results = Self { trials };
        io::Seek::seek(&mut results.trials, io::SeekFrom::End(0)).map_err(unwritable)?;
        Ok((results, rows))
    }

    /// Adds a row.
    ///
    /// # Errors
    /// If it cannot be written.
    pub fn add(&mut self, row: &Row) -> io::Result<()> {
        let line = serde_json::to_string(row)? + "\n";
        self.trials.write_all(line.as_bytes())
    }
}

fn check_identity(path: &PathBuf, identity: &Identity) -> Result<(), InputError> {
    let file = path.display().to_string();
    let text =
        fs::read_to_string(path).map_err(|fault| InputError::new(&file, "the file", fault, "a readable file"))?;
    let found: Identity = serde_json::from_str(&text).map_err(|fault| {
        InputError::new(&file, format!("line {}", fault.line()), fault, "what an evaluation wrote here")
    })?;
    let differing = [
        ("version", found.version != identity.version),
        ("seed", found.seed != identity.seed),
        ("first", found.first != identity.first),
        ("cells", found.cells != identity.cells),
    ];
    match differing.iter().find(|(_, differs)| *differs) {
        None => Ok(()),
        Some((field, _)) => {
            let expected = "the same scenario, objects, throws, seed, first throw and version; or another --out";
            Err(InputError::new(&file, field, "results of another evaluation", expected))
        }
    }
}

/// The rows of a file that may not exist, and how many bytes they take.
fn read_rows(path: &Path, evaluation: &Evaluation) -> Result<(Vec<Row>, u64), InputError> {
    let file = path.display().to_string();
    let text = match fs::read_to_string(path) {
        Ok(text) => text,
        Err(fault) if fault.kind() == io::ErrorKind::NotFound => return Ok((Vec::new(), 0)),
        Err(fault) => return Err(InputError::new(&file, "the file", fault, "a readable file of results")),
    };
    let (mut rows, mut bytes) = (Vec::new(), 0);
    for line in text.split_inclusive('\n').filter(|line| line.ends_with('\n')) {
        let field = format!("line {}", rows.len() + 1);
        let row: Row = serde_json::from_str(line).map_err(|fault| {
            InputError::new(&file, &field, fault, "the row of a trial; take the folder away to begin anew")
        })?;
        if rows.len() < evaluation.len() && row.scene != evaluation.scene(rows.len()) {
            let (found, expected) = (format!("{:?}", row.scene), format!("{:?}", evaluation.scene(rows.len())));
            return Err(InputError::new(&file, &field, found, expected));
        }
        rows.push(row);
        bytes += line.len() as u64;
    }
    Ok((rows, bytes))
}
