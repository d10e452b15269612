//! Frozen benchmarks: scenarios, objects, throws and seeds that a hash keeps as they are.
//!
//! A suite is a folder of built-in files: `suite.toml` and the scenarios that it names. Whatever its throws
//! depend on but the brain goes into one SHA-256, which stands in that file and is compared when the suite is
//! loaded. Its rows are those of [evaluations](Evaluation), one for each part, and have one SHA-256, too:
//! that of the lines of JSON, condition by condition.

use catch_body::InputError;
use catch_bot::Report;
use catch_cell::{Brain, Command, Observation, Probe};
use serde::Deserialize;
use sha2::{Digest, Sha256};

use crate::{
    assets::{self, Kind, nearest},
    evaluation::{BrainFactory, Cell, Evaluation, Row},
    scenario::setup::{Choice, Setup},
};
use catch_recording::{
    brain::{Method, ObservedBrain},
    whole_file::COMMAND_LINE,
};

/// Folder of the suites among the built-in files.
const FOLDER: &str = "suites";
/// The field with the hash.
const HASH_FIELD: &str = "content_sha256";

/// A suite's file.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SuiteFile {
    /// Description of the suite, in a sentence.
    pub description: String,
    /// Seed of everything random.
    pub seed: u64,
    /// SHA-256 of all that its throws depend on.
    pub content_sha256: String,
    /// Parts of the suite.
    #[serde(rename = "part")]
    pub parts: Vec<SuitePart>,
}

/// Throws in one scenario.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SuitePart {
    /// The scenario: a file beside the suite's, without its ending.
    pub scenario: String,
    /// Objects that are thrown.
    pub objects: Vec<String>,
    /// Throws that are used.
    pub throws: Vec<String>,
    /// Throws of each object in each way.
    pub trials: u64,
}

/// Method or brain that catches.
#[derive(Debug, Clone)]
pub enum Catcher {
    /// A built-in method.
    Method(Method),
    /// A brain of one's own, or one that does nothing.
    Brain(BrainFactory),
}

impl Catcher {
    /// A brain that never sends a command: what hits the open gripper by chance.
    pub fn idle() -> Self {
        Self::Brain(BrainFactory::new(|_, _, _| Box::new(Idle)))
    }
}

struct Idle;

impl Brain for Idle {
    fn tick(&mut self, _: &Observation, _: &mut dyn Probe) -> Command {
        Command::default()
    }

    fn reset(&mut self) {}
}

impl ObservedBrain for Idle {
    fn report(&self) -> Option<&Report> {
        None
    }
}

/// A suite whose content is what it was when it was frozen.
#[derive(Debug)]
pub struct Suite {
    /// Name of the suite.
    pub name: String,
    /// Content of the suite's file.
    pub file: SuiteFile,
}

impl Suite {
    /// Names of all suites.
    pub fn names() -> Vec<String> {
        let files = assets::built_in_files(FOLDER);
        let name = |(path, _): &(String, &[u8])| Some(path.strip_suffix("/suite.toml")?.rsplit_once('/')?.1.to_owned());
        files.iter().filter_map(name).collect()
    }

    /// Reads a suite and compares its hash.
    ///
    /// # Errors
    /// A name that is none; a suite that is not as it was frozen.
    pub fn load(name: &str) -> Result<Self, InputError> {
        let names = Self::names();
        if !names.iter().any(|it| it == name) {
            let known: Vec<&str> = names.iter().map(String::as_str).collect();
            let hint = nearest(name, &known).map(|it| format!(" (did you mean `{it}`?)")).unwrap_or_default();
            let expected = format!("one of {}{hint}", known.join(", "));
            return Err(InputError::new(COMMAND_LINE, "NAME", format!("`{name}`"), expected));
        }
        let path = format!("{FOLDER}/{name}/suite.toml");
        let this = Self { name: name.to_owned(), file: InputError::parse_toml(&path, &text_of(&path))? };
        let hash = this.content_sha256()?;
        if hash == this.file.content_sha256 {
            return Ok(this);
        }
        let expected = format!("`{}`: a suite that has changed is another one", this.file.content_sha256);
        Err(InputError::new(&path, HASH_FIELD, format!("files and throws with the hash `{hash}`"), expected))
    }

    /// Returns the scenario's name for a condition of a part, as [`Setup::load`] reads it.
    fn scenario_of(&self, part: &SuitePart) -> String {
        format!("{}/{}", self.name, part.scenario)
    }

    /// Returns the conditions in their order: scenario, object, throw and number of throws, as
    /// [`Setup::load`] takes them.
    pub fn conditions(&self) -> Vec<(String, &str, &str, u64)> {
        let mut conditions = Vec::new();
        for part in &self.file.parts {
            for object in &part.objects {
                conditions.extend(part.throws.iter().map(|it| (self.scenario_of(part), &**object, &**it, part.trials)));
            }
        }
        conditions
    }

    /// The setups of a part, object by object, with a built-in method.
    ///
    /// # Errors
    /// As [`Setup::load`].
    pub fn setups(&self, part: &SuitePart, method: Option<Method>) -> Result<Vec<Setup>, InputError> {
        let (scenario, mut setups) = (self.scenario_of(part), Vec::new());
        for object in &part.objects {
            for throw in &part.throws {
                setups.push(Setup::load(&Choice {
                    scenario: Some(&scenario),
                    object: Some(object),
                    throw: Some(throw),
                    method,
                    ..Choice::default()
                })?);
            }
        }
        Ok(setups)
    }

    /// The evaluations of the parts, with at most `trials` throws per condition.
    ///
    /// # Errors
    /// As [`Setup::load`].
    pub fn evaluations(&self, catcher: &Catcher, trials: Option<u64>) -> Result<Vec<Evaluation>, InputError> {
        let of_part = |part: &SuitePart| {
            let (method, brain) = match catcher {
                Catcher::Method(method) => (Some(*method), BrainFactory::default()),
                Catcher::Brain(brain) => (None, brain.clone()),
            };
            let setups = self.setups(part, method)?;
            let cells = setups.into_iter().map(|it| Cell::with_brain(it, brain.clone())).collect();
            let trials = trials.unwrap_or(part.trials).min(part.trials);
            Ok(Evaluation { cells, seed: self.file.seed, first: 0, trials })
        };
        self.file.parts.iter().map(of_part).collect()
    }

    /// SHA-256 of the file without its own hash, of all files that the scenarios name, and of the releases of
    /// all objects.
    fn content_sha256(&self) -> Result<String, InputError> {
        let mut hash = Sha256::new();
        let mut add = |name: &str, content: &[u8]| {
            // With lengths: no file can pass for two.
            hash.update(format!("{name} {}\n", content.len()));
            hash.update(content);
        };
        let path = format!("{FOLDER}/{}/suite.toml", self.name);
        let text = text_of(&path);
        let kept: Vec<&str> = text.lines().filter(|line| !line.starts_with(HASH_FIELD)).collect();
        add(&path, kept.join("\n").as_bytes());
        for part in &self.file.parts {
            let path = format!("{FOLDER}/{}/{}.toml", self.name, part.scenario);
            add(&path, text_of(&path).as_bytes());
            for setup in self.setups(part, None)? {
                let scenario = &setup.scenario;
                for (kind, _, name) in scenario.parts() {
                    files_of(kind, name).iter().for_each(|(path, content)| add(path, content));
                }
                for index in 0..part.trials {
                    add("release", release(&setup, self.file.seed, index).as_bytes());
                }
            }
        }
        Ok(hex(&hash.finalize()))
    }
}

/// SHA-256 of the rows of all parts, each with its number of conditions: the lines of `trials.jsonl`,
/// condition by condition.
///
/// # Errors
/// A row that cannot be written.
pub fn rows_sha256(parts: &[(usize, &[Row])]) -> Result<String, serde_json::Error> {
    let mut hash = Sha256::new();
    for (conditions, rows) in parts {
        for condition in 0..*conditions {
            for row in rows.iter().skip(condition).step_by((*conditions).max(1)) {
                hash.update(serde_json::to_string(row)? + "\n");
            }
        }
    }
    Ok(hex(&hash.finalize()))
}

fn hex(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!("{byte:02x}")).collect()
}

/// The files of something built in: one, or all of its folder.
fn files_of(kind: Kind, name: &str) -> Vec<(String, &'static [u8])> {
    let mut files = assets::built_in_files(&format!("{}/{name}", kind.plural()));
    let file = format!("{}/{name}.toml", kind.plural());
    files.extend(assets::built_in_files(kind.plural()).into_iter().filter(|(path, _)| *path == file));
    files
}

fn text_of(path: &str) -> String {
    let folder = path.rsplit_once('/').map_or("", |(folder, _)| folder);
    let found = assets::built_in_files(folder).into_iter().find(|(it, _)| it == path);
    found.map(|(_, content)| String::from_utf8_lossy(content).into_owned()).unwrap_or_default()
}

/// Formats an object's release to a micrometre, a microradian and so on, so that other machines round it
/// alike.
fn release(setup: &Setup, seed: u64, index: u64) -> String {
    let release = setup.release(seed, index);
    let parts = [
        release.p_WO.coords.as_slice(),
        release.v_WO.as_slice(),
        release.q_WO.coords.as_slice(),
        release.omega_WO.as_slice(),
    ];
    let path = release.path.iter().flat_map(|it| it.states()).flat_map(|it| it.position.coords.data.0[0]);
    // Adding zero makes one zero of both.
    parts.concat().into_iter().chain(path).map(|value| format!("{:.6} ", (value * 1e6).round() / 1e6 + 0.0)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A suite whose content has changed is another suite: it gets another name, or the change goes.
    #[test]
    fn suites_are_as_they_were_frozen() {
        assert!(!Suite::names().is_empty());
        for name in Suite::names() {
            let suite = Suite::load(&name).unwrap();
            assert_eq!(suite.file.content_sha256.len(), 64);
            let evaluations = suite.evaluations(&Catcher::idle(), Some(2)).unwrap();
            assert!(evaluations.iter().all(|it| it.seed == suite.file.seed && it.trials == 2));
        }
        assert!(Suite::load("catch-2026.3").unwrap_err().to_string().contains("catch-2026.2"));
    }

    #[test]
    fn rows_are_hashed_condition_by_condition() {
        let suite = Suite::load("catch-2026.2").unwrap();
        let setups = suite.setups(&suite.file.parts[0], None).unwrap();
        let evaluate = |setups: &[Setup]| {
            let cells = setups.iter().map(|it| Cell::with_brain(it.clone(), idle())).collect();
            let (evaluation, mut rows) = (Evaluation { cells, seed: 1, first: 0, trials: 2 }, Vec::new());
            evaluation
                .run(0, 2, &mut |row, _| {
                    rows.push(row);
                    Ok(())
                })
                .unwrap();
            rows
        };
        let both = evaluate(&setups[..2]);
        let alone = [evaluate(&setups[..1]), evaluate(&setups[1..2])];
        let parts: Vec<(usize, &[Row])> = alone.iter().map(|rows| (1, &rows[..])).collect();
        let hash = rows_sha256(&[(2, &both)]).unwrap();
        assert_eq!(hash, rows_sha256(&parts).unwrap());
        assert_ne!(hash, rows_sha256(&parts[..1]).unwrap());
        assert_eq!(rows_sha256(&[]).unwrap()[..8], *"e3b0c442");
    }

    fn idle() -> BrainFactory {
        match Catcher::idle() {
            Catcher::Brain(brain) => brain,
            Catcher::Method(_) => BrainFactory::default(),
        }
    }
}
