//! Results of an evaluation on disk.
//!
//! While it runs there is a log, one line of JSON per trial, written as soon as it and all before it are
//! done, and a file beside it that says what is evaluated. What a run was killed in the middle of is gone;
//! everything before it stays. When all trials are done the log becomes a table ([`trial_table`]). The logs
//! of parts, one after the other, are the log of the whole. From it the same files are written as by one
//! evaluation, byte for byte.

use std::{
    collections::BTreeSet,
    fmt::Display,
    fs::{self, File, OpenOptions, TryLockError},
    io::{self, BufRead, BufReader, Read, Write},
    path::{Path, PathBuf},
};

use catch_body::InputError;
use serde_json::{Value, json};

use crate::{
    evaluation::{Evaluation, Identity, Row, trial_table},
    scenario::Scenario,
};
use catch_recording::{
    bounded_file::FileKind,
    replay::first_differing_value,
    whole_file::{self, COMMAND_LINE, make_writable},
};

/// Name of the file with one row per trial.
pub const TRIALS_FILE: &str = "trials.jsonl";
/// Name of the report in a folder of results.
pub const REPORT_FILE: &str = "report.html";
/// Name of the file that says what was evaluated.
const IDENTITY_FILE: &str = "evaluation.toml";

/// Kind of the file of rows.
const ROWS: FileKind = FileKind::recorded("a readable file of results");
/// Most bytes of a row.
const MOST_LINE_BYTES: u64 = 1 << 16;

/// Results that grow.
#[derive(Debug)]
pub struct Results {
    folder: PathBuf,
    identity: Identity,
    trials: File,
    /// Keeps others out of the folder.
    _lock: WorkLock,
}

impl Results {
    /// Opens a folder for the results of `evaluation`; returns the rows that are already there.
    ///
    /// # Errors
    /// A folder that cannot be written, that holds results though nothing is to be resumed, that holds
    /// results of something else or of nobody knows what, in which another process is at work, more trials
    /// than are asked for, or rows that are none. Throws that cannot be thrown, before there is a folder.
    pub fn open(folder: &Path, evaluation: &Evaluation, resume: bool) -> Result<(Self, Vec<Row>), InputError> {
        let identity = evaluation.identity();
        let identity_file = folder.join(IDENTITY_FILE);
        if !identity_file.exists() {
            evaluation.check_throws(0)?;
        }
        let lock = WorkLock::take(folder)?;
        if identity_file.exists() {
            if !resume {
                let found = format!("`{}`, which holds results", folder.display());
                let expected = "--resume to go on with them, or another folder";
                return Err(InputError::new(COMMAND_LINE, "--out", found, expected));
            }
            compare(&identity_file.display().to_string(), &read_identity(&identity_file)?, &identity)?;
        } else if let Some(file) = [TRIALS_FILE, REPORT_FILE].into_iter().find(|it| folder.join(it).exists()) {
            let found = format!("`{}`, which holds {file}", folder.display());
            let expected =
                format!("a folder that also has {IDENTITY_FILE}, which says what these rows are of, or an empty one");
            return Err(InputError::new(COMMAND_LINE, "--out", found, expected));
        } else {
            whole_file::write(&identity_file, identity_text(&identity)?)?;
        }
        let path = folder.join(TRIALS_FILE);
        let (rows, bytes) = read_rows(&path, &identity)?;
        if rows.len() > evaluation.total() {
            let there = rows.len().div_ceil(identity.cells.len().max(1));
            let expected = format!("at least the {there} that `{}` holds already", folder.display());
            return Err(InputError::new(COMMAND_LINE, "--trials", evaluation.trials, expected));
        }
        let unwritable = |fault: io::Error| InputError::unwritten(path.display(), &fault, "a file that can be written");
        let trials = OpenOptions::new().create(true).truncate(false).write(true).open(&path).map_err(unwritable)?;
        // A line that was cut off is written again.
        trials.set_len(bytes).map_err(unwritable)?;
        let mut results = Self { folder: folder.to_owned(), identity, trials, _lock: lock };
        io::Seek::seek(&mut results.trials, io::SeekFrom::End(0)).map_err(unwritable)?;
        Ok((results, rows))
    }

    /// Adds a row.
    ///
    /// # Errors
    /// If it cannot be written.
    pub fn add(&mut self, row: &Row) -> Result<(), InputError> {
        let line = serde_json::to_string(row).map_err(io::Error::from).map(|line| line + "\n");
        line.and_then(|line| self.trials.write_all(line.as_bytes())).map_err(|fault| {
            let expected = "room for more rows; --resume goes on where this stopped";
            InputError::unwritten(self.folder.join(TRIALS_FILE).display(), &fault, expected)
        })
    }

    /// Writes the table of all rows.
    ///
    /// # Errors
    /// If it cannot be written; the log stays.
    pub fn finish(&self, rows: &[Row]) -> Result<(), InputError> {
        let Self { folder, identity, .. } = self;
        trial_table::write(folder, rows, &identity_text(identity)?)
    }
}

/// Name of the file that says who is at work in a folder.
const LOCK_FILE: &str = ".at-work";

/// A folder in which this process alone writes results.
#[derive(Debug)]
struct WorkLock {
    path: PathBuf,
    /// Closing it unlocks it.
    _file: File,
}

impl WorkLock {
    fn take(folder: &Path) -> Result<Self, InputError> {
        make_writable(folder, "--out")?;
        let path = folder.join(LOCK_FILE);
        let unwritable = |fault: io::Error| InputError::unwritten(path.display(), &fault, "a file that can be written");
        let options = OpenOptions::new().create(true).truncate(false).read(true).write(true).open(&path);
        let mut file = options.map_err(unwritable)?;
        // File systems that know no locks let everybody in.
        if matches!(file.try_lock(), Err(TryLockError::WouldBlock)) {
            let mut who = String::new();
            let _ = file.take(100).read_to_string(&mut who);
            let found = format!("`{}`, in which {} is at work", folder.display(), who.trim());
            return Err(InputError::new(COMMAND_LINE, "--out", found, "another folder, or patience"));
        }
        let who = format!("process {}\n", std::process::id());
        file.set_len(0).and_then(|()| file.write_all(who.as_bytes())).map_err(unwritable)?;
        Ok(Self { path, _file: file })
    }
}

impl Drop for WorkLock {
    fn drop(&mut self) {
        // A file that stays does no harm: only its lock counts.
        let _ = fs::remove_file(&self.path);
    }
}

/// Writes an evaluation's identity as TOML, the language of scenarios; unlike JSON it has infinity.
fn identity_text(identity: &Identity) -> Result<String, InputError> {
    toml::to_string(identity).map_err(|fault| {
        InputError::new(COMMAND_LINE, "the evaluation", fault, "a seed and a scenario that can be written as TOML")
    })
}

/// Reads complete results: what was evaluated, and all rows.
///
/// # Errors
/// A folder without results, or rows that are none or not complete.
pub fn read(folder: &Path) -> Result<(Identity, Vec<Row>), InputError> {
    let identity = read_identity(&folder.join(IDENTITY_FILE))?;
    let path = folder.join(TRIALS_FILE);
    let (rows, bytes) = read_rows(&path, &identity)?;
    let is_cut_off = fs::metadata(&path).is_ok_and(|it| it.len() != bytes);
    if rows.len() % identity.cells.len().max(1) != 0 || is_cut_off || rows.is_empty() {
        let found = format!("{} whole rows of {} cells", rows.len(), identity.cells.len());
        let expected = "complete results; --resume completes them";
        return Err(InputError::new(path.display().to_string(), "the file", found, expected));
    }
    Ok((identity, rows))
}

/// Returns whether a folder holds results of an evaluation.
pub fn is_in(folder: &Path) -> bool {
    folder.join(IDENTITY_FILE).is_file()
}

fn read_identity(path: &Path) -> Result<Identity, InputError> {
    let file = path.display().to_string();
    InputError::parse_toml(&file, &FileKind::text("a folder of results").read_text(path)?)
}

fn compare(file: &str, found: &Identity, identity: &Identity) -> Result<(), InputError> {
    if found == identity {
        return Ok(());
    }
    let (theirs, ours) = (in_words(found), in_words(identity));
    let mut pairs = theirs.iter().zip(&ours);
    let differing = pairs.find_map(|(theirs, ours)| first_differing_value("", theirs, ours));
    let (field, found, asked) = differing.unwrap_or_default();
    let [found, asked] = [found, asked].map(|it| if it.is_null() { "nothing".to_owned() } else { it.to_string() });
    let found = format!("results of another evaluation, with {found}");
    Err(InputError::new(file, field, found, format!("{asked}; or another folder")))
}

/// What an evaluation is of, in the fields in which one asks for it: those first from which others follow.
fn in_words(identity: &Identity) -> Vec<Value> {
    let Identity { version, seed, first, throws_are_fixed, cells, checksums } = identity;
    let each = |name: fn(&Scenario) -> &str| {
        let names: BTreeSet<&str> = cells.iter().map(name).collect();
        names.into_iter().collect::<Vec<_>>().join(", ")
    };
    let mut fields = vec![json!({ "version": version }), json!({ "seed": seed, "first": first })];
    fields.push(json!({ "scenario": each(|it| it.name.split('+').next().unwrap_or_default()) }));
    fields.push(json!({ "object": each(|it| &it.object), "throw": each(|it| &it.throw) }));
    for cell in cells {
        fields.push(cell.parts().into_iter().map(|(_, field, name)| (field, name)).collect());
        fields.push(json!(Scenario { name: String::new(), ..cell.clone() }));
        fields.push(json!({ "scenario": cell.name }));
    }
    fields.push(json!({ "throws_are_fixed": throws_are_fixed, "checksums": checksums }));
    fields
}

/// The rows of a file that may not exist, and how many bytes they take. A last line that was cut off does not
/// count.
fn read_rows(path: &Path, identity: &Identity) -> Result<(Vec<Row>, u64), InputError> {
    let file = path.display().to_string();
    if !path.exists() {
        return Ok((Vec::new(), 0));
    }
    let mut lines = BufReader::new(ROWS.open(path)?);
    let (mut rows, mut bytes, mut line) = (Vec::new(), 0, Vec::new());
    loop {
        line.clear();
        let field = format!("line {}", rows.len() + 1);
        let fault = |found: &dyn Display| {
            InputError::new(&file, &field, found, "the row of a trial; take the folder away to begin anew")
        };
        let read = lines.by_ref().take(MOST_LINE_BYTES).read_until(b'\n', &mut line).map_err(|it| fault(&it))?;
        if !line.ends_with(b"\n") {
            if read as u64 == MOST_LINE_BYTES {
                return Err(fault(&format!("more than {MOST_LINE_BYTES} bytes")));
            }
            return Ok((rows, bytes));
        }
        let row: Row = serde_json::from_slice(&line).map_err(|it| fault(&it))?;
        let expected = identity.scene(rows.len());
        if row.scene != expected {
            return Err(InputError::new(&file, &field, format!("{:?}", row.scene), format!("{expected:?}")));
        }
        rows.push(row);
        bytes += line.len() as u64;
    }
}
