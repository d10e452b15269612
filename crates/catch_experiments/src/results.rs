//! Pages and JSON documents of results, with all that is needed to measure them again.

use std::{
    fmt::Write,
    fs,
    path::{Path, PathBuf},
    process::Command,
    thread,
};

use anyhow::{Context, Result};
use catch_lab::VERSION;
use serde::{Deserialize, Serialize};

use crate::{Findings, Options};

/// A table; its first columns say what the condition is.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Table {
    /// Title of the table.
    pub title: String,
    /// Names of the columns, with their units.
    pub columns: Vec<String>,
    /// One row per condition, one cell per column.
    pub rows: Vec<Vec<Entry>>,
}

/// Entry of a table.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(untagged)]
pub enum Entry {
    /// A word.
    Text(String),
    /// A number of things.
    Count(usize),
    /// A measured value; none where nothing was measured.
    Number(Option<f64>),
}

impl Table {
    /// A table without rows.
    pub fn new(title: &str, columns: &[&str]) -> Self {
        let columns = columns.iter().map(|&it| it.to_owned()).collect();
        Self { title: title.to_owned(), columns, rows: Vec::new() }
    }

    fn markdown(&self) -> String {
        let line = |cells: Vec<String>| format!("| {} |\n", cells.join(" | "));
        let mut text = format!("## {}\n\n", self.title);
        text += &line(self.columns.clone());
        text += &line(self.columns.iter().map(|_| "---".to_owned()).collect());
        for row in &self.rows {
            text += &line(row.iter().map(Entry::markdown).collect());
        }
        text
    }
}

impl Entry {
    /// A word.
    pub fn text(text: impl Into<String>) -> Self {
        Self::Text(text.into())
    }

    /// Formats the entry with three digits.
    fn markdown(&self) -> String {
        match self {
            Self::Text(text) => text.clone(),
            Self::Count(count) => count.to_string(),
            Self::Number(None) => "–".to_owned(),
            Self::Number(Some(value)) => {
                let digits = if *value == 0.0 { 0.0 } else { 2.0 - libm::log10(value.abs()).floor() };
                format!("{value:.*}", digits.clamp(0.0, 6.0) as usize)
            }
        }
    }
}

/// Provenance of the results: command, version, machine and seed.
#[derive(Debug, Serialize)]
struct Provenance {
    command: String,
    version: &'static str,
    commit: String,
    machine: Machine,
    seed: u64,
    trials: u64,
}

#[derive(Debug, Serialize)]
struct Machine {
    cpu: String,
    cores: usize,
}

#[derive(Debug, Serialize)]
struct Document<'a> {
    experiment: &'a str,
    about: &'a str,
    #[serde(flatten)]
    provenance: &'a Provenance,
    tables: &'a [Table],
}

/// Writes what was found as a page and as JSON; returns the path of the page.
///
/// # Errors
/// If a file cannot be written.
pub fn write(folder: &Path, name: &str, about: &str, options: &Options, findings: &Findings) -> Result<PathBuf> {
    let mut command = format!(
        "cargo run --release -p catch_experiments -- {name} --seed {} --trials {}",
        options.seed, options.trials
    );
    // The place of the folders is private.
    for folder in options.tracks.iter().filter_map(|it| it.file_name()) {
        let _ = write!(command, " --tracks {}", folder.display());
    }
    let provenance = Provenance {
        command,
        version: VERSION,
        commit: commit(),
        machine: Machine { cpu: cpu(), cores: thread::available_parallelism().map_or(1, usize::from) },
        seed: options.seed,
        trials: options.trials,
    };
    let Provenance { command, commit, machine, .. } = &provenance;
    let mut page = format!("# Results: {name}\n\nThis page is written by a command; changes by hand get lost.\n\n");
    let _ = write!(
        page,
        "What is measured: {about}.\n\n| | |\n|---|---|\n| command | `{command}` |\n| commit | {commit} |\n| machine | {}, {} cores |\n\n{}\n",
        machine.cpu, machine.cores, findings.legend
    );
    for table in &findings.tables {
        let _ = write!(page, "\n{}", table.markdown());
    }
    fs::create_dir_all(folder).with_context(|| format!("{}", folder.display()))?;
    let document = Document { experiment: name, about, provenance: &provenance, tables: &findings.tables };
    let path = folder.join(format!("{name}.md"));
    for (path, text) in
        [(&path, page), (&folder.join(format!("{name}.json")), serde_json::to_string_pretty(&document)? + "\n")]
    {
        fs::write(path, text).with_context(|| format!("{}", path.display()))?;
    }
    Ok(path)
}

/// The commit that is checked out, marked where sources differ from it; `unknown` outside of a repository.
fn commit() -> String {
    marked(&["rev-parse", "--short", "HEAD"], &["crates", "assets"])
}

/// The last commit that changed anything at these paths from the root of the repository, marked likewise.
pub fn last_change(paths: &[&str]) -> String {
    marked(&[&["log", "-1", "--format=%h", "--"], paths].concat(), paths)
}

/// The commit that git tells, marked if something at these paths is not committed.
fn marked(tells_commit: &[&str], paths: &[&str]) -> String {
    let git = |arguments: &[&str]| {
        let output = Command::new("git").args(arguments).output().ok().filter(|output| output.status.success());
        output.and_then(|it| String::from_utf8(it.stdout).ok()).map(|text| text.trim().to_owned())
    };
    let Some(commit) = git(tells_commit) else { return "unknown".to_owned() };
    let status = git(&[&["status", "--porcelain", "--"], paths].concat());
    if status.is_none_or(|text| !text.is_empty()) { commit + ", changed" } else { commit }
}

/// The model of the processor, where the system tells it.
fn cpu() -> String {
    let text = fs::read_to_string("/proc/cpuinfo").unwrap_or_default();
    let model = text.lines().find(|line| line.starts_with("model name")).and_then(|line| line.split(": ").nth(1));
    model.unwrap_or("unknown processor").trim().to_owned()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pages_and_documents_tell_how_to_measure_again() {
        let folder = std::env::temp_dir().join(format!("catch_experiments_{}", std::process::id()));
        let mut table = Table::new("By noise", &["noise", "count", "error, mm"]);
        for value in [Some(0.012_345), Some(123.4), Some(0.0), None] {
            table.rows.push(vec![Entry::text("none"), Entry::Count(3), Entry::Number(value)]);
        }
        let findings = Findings { legend: "Errors are medians.".to_owned(), tables: vec![table] };
        let path = write(&folder, "example", "errors", &Options { seed: 7, trials: 9, tracks: Vec::new() }, &findings)
            .unwrap();
        let page = fs::read_to_string(&path).unwrap();
        let document: serde_json::Value =
            serde_json::from_str(&fs::read_to_string(path.with_extension("json")).unwrap()).unwrap();
        fs::remove_dir_all(&folder).unwrap();
        for part in
            ["-- example --seed 7 --trials 9`", "Errors are medians.", "| none | 3 | 0.0123 |", "| 123 |", "| – |"]
        {
            assert!(page.contains(part), "{part}: {page}");
        }
        assert_eq!((&document["seed"], &document["trials"]), (&7.into(), &9.into()));
        assert_eq!(document["tables"][0]["rows"][0][2], 0.012_345);
        assert!(document["machine"]["cores"].as_u64().unwrap() >= 1 && document["commit"].is_string());
    }
}
