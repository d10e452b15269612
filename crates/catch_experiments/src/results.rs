//! Pages and JSON documents of results, with all that is needed to measure them again.

use std::{
    collections::BTreeMap,
    fmt::Write,
    fs,
    path::{Path, PathBuf},
    process::Command,
    thread,
};

use anyhow::{Context, Result};
use catch_lab::VERSION;
use serde::{Deserialize, Serialize};

use crate::Options;

/// A table; its first columns say what the condition is.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Table {
    /// Title of the table.
    pub title: String,
    /// Names of the columns, with their units.
    pub columns: Vec<String>,
    /// One row per condition, one cell per column.
    pub rows: Vec<Vec<Entry>>,
    /// The last column of the condition: the page has a column for each of its words instead.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub across: Option<String>,
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
    /// A measured value with its interval, or with its 95 % quantile.
    Spread(Vec<f64>),
    /// Things of each kind, by its name.
    Kinds(BTreeMap<String, usize>),
}

impl Table {
    /// A table without rows.
    pub fn new(title: &str, columns: &[&str]) -> Self {
        let columns = columns.iter().map(|&it| it.to_owned()).collect();
        Self { title: title.to_owned(), columns, rows: Vec::new(), across: None }
    }

    /// Adds a row whose entries stand behind the names of their columns.
    pub fn add<'a>(&mut self, row: impl IntoIterator<Item = (&'a str, Entry)>) {
        let (columns, entries): (Vec<&str>, Vec<Entry>) = row.into_iter().unzip();
        self.columns = columns.into_iter().map(str::to_owned).collect();
        self.rows.push(entries);
    }

    /// The same with a column of the page for each word of this one, whose rows are neighbours.
    pub fn across(self, column: &str) -> Self {
        Self { across: Some(column.to_owned()), ..self }
    }

    fn markdown(&self) -> String {
        let mut notes = Vec::new();
        let table = self.pivoted(&mut notes);
        let (rows, columns) = (&table.rows, &table.columns);
        // Short tables are read as they are.
        let is_constant = |at: &usize| rows.len() > 3 && rows.iter().all(|row| row[*at] == rows[0][*at]);
        let (constant, shown): (Vec<usize>, Vec<usize>) = (0..columns.len()).partition(is_constant);
        let named = |&at: &usize| format!("{} {}", columns[at], rows[0][at].markdown());
        notes.push(("In all rows", constant.iter().map(named).collect()));
        notes.retain(|(_, it): &(&str, Vec<String>)| !it.is_empty());
        let notes: Vec<String> = notes.into_iter().map(|(what, it)| format!("{what}: {}.", it.join("; "))).collect();
        let notes = if notes.is_empty() { String::new() } else { notes.join(" ") + "\n\n" };
        let line = |cell: &dyn Fn(usize) -> String| {
            shown.iter().map(|&at| format!("| {} ", cell(at))).collect::<String>() + "|\n"
        };
        let head = line(&|at| columns[at].clone()) + "|" + &"---|".repeat(shown.len());
        let rows: String = rows.iter().map(|row| line(&|at| row[at].markdown())).collect();
        format!("## {}\n\n{notes}{head}\n{rows}", self.title)
    }

    /// The table with the words of the column `across` as columns; notes tell what their cells have.
    fn pivoted(&self, notes: &mut Vec<(&str, Vec<String>)>) -> Self {
        let Some(at) = self.columns.iter().position(|it| Some(it) == self.across.as_ref()) else { return self.clone() };
        let groups: Vec<&[Vec<Entry>]> = self.rows.chunk_by(|a, b| a[..at] == b[..at]).collect();
        let (mut beside, mut inside, mut by_column) = (Vec::new(), Vec::new(), Vec::new());
        for column in at + 1..self.columns.len() {
            let are_kinds = self.rows.iter().any(|row| matches!(row[column], Entry::Kinds(_)));
            if are_kinds || groups.iter().all(|rows| rows.iter().all(|row| row[column] == rows[0][column])) {
                beside.push(column);
            } else if groups.iter().all(|rows| rows.iter().zip(groups[0]).all(|(a, b)| a[column] == b[column])) {
                let values: Vec<String> = groups[0].iter().map(|row| row[column].markdown()).collect();
                by_column.push(format!("{} {}", self.columns[column], values.join(", ")));
            } else {
                inside.push(column);
            }
        }
        let names = |columns: &[usize]| columns.iter().map(|&it| self.columns[it].clone()).collect::<Vec<_>>();
        notes.extend([("By column", by_column), ("In cells", names(&inside))]);
        let cell = |row: &Vec<Entry>| inside.iter().map(|&it| row[it].markdown()).collect::<Vec<_>>().join("; ");
        let row = |rows: &&[Vec<Entry>]| {
            let together = beside.iter().map(|&it| rows.iter().skip(1).fold(rows[0][it].clone(), |a, b| a.and(&b[it])));
            rows[0][..at].iter().cloned().chain(rows.iter().map(|row| Entry::Text(cell(row)))).chain(together).collect()
        };
        let words = groups.first().into_iter().flat_map(|rows| rows.iter().map(|row| row[at].markdown()));
        let columns = self.columns[..at].iter().cloned().chain(words).chain(names(&beside)).collect();
        Self { columns, rows: groups.iter().map(row).collect(), ..self.clone() }
    }
}

impl Entry {
    /// A word.
    pub fn text(text: impl Into<String>) -> Self {
        Self::Text(text.into())
    }

    /// Kinds of both together; of other entries, which are the same, one.
    fn and(self, other: &Self) -> Self {
        let (Self::Kinds(mut all), Self::Kinds(more)) = (self.clone(), other) else { return self };
        more.iter().for_each(|(name, count)| *all.entry(name.clone()).or_default() += count);
        Self::Kinds(all)
    }

    /// Formats the entry with three digits, and intervals with tenths.
    pub fn markdown(&self) -> String {
        let digits = |value: &f64| {
            let digits = if *value == 0.0 { 0.0 } else { 2.0 - libm::log10(value.abs()).floor() };
            format!("{value:.*}", digits.clamp(0.0, 6.0) as usize)
        };
        let tenths = |value: &f64| format!("{:.*}", usize::from(value.abs() < 99.95), value);
        match self {
            Self::Text(text) => text.clone(),
            Self::Count(count) => count.to_string(),
            Self::Number(None) => "–".to_owned(),
            Self::Number(Some(value)) => digits(value),
            Self::Spread(values) => match &values[..] {
                [value, from, to] => {
                    let until = if *from < -0.05 { " to " } else { "–" };
                    format!("{} ({}{until}{})", tenths(value), tenths(from), tenths(to))
                }
                [value, quantile] => format!("{} ({})", digits(value), digits(quantile)),
                _ => "–".to_owned(),
            },
            Self::Kinds(counts) => {
                let mut counts: Vec<(&String, &usize)> = counts.iter().collect();
                counts.sort_by_key(|(_, count)| std::cmp::Reverse(**count));
                counts.into_iter().map(|(name, count)| format!("{count} {name}")).collect::<Vec<_>>().join(", ")
            }
        }
    }
}

#[derive(Debug, Serialize)]
struct Machine {
    cpu: String,
    cores: usize,
}

/// The results with their provenance: command, version, machine and seed.
#[derive(Debug, Serialize)]
struct Document<'a> {
    experiment: &'a str,
    about: &'a str,
    command: String,
    version: &'static str,
    commit: String,
    machine: Machine,
    seed: u64,
    trials: u64,
    tables: &'a [Table],
}

/// Writes what was found as a page and as JSON; returns the path of the page.
///
/// # Errors
/// If a file cannot be written.
pub fn write(folder: &Path, [name, about, legend]: [&str; 3], options: &Options, tables: &[Table]) -> Result<PathBuf> {
    let command = format!(
        "cargo run --release -p catch_experiments -- {name} --seed {} --trials {}",
        options.seed, options.trials
    );
    let document = Document {
        experiment: name,
        about,
        command,
        version: VERSION,
        commit: last_change(),
        machine: Machine { cpu: cpu(), cores: thread::available_parallelism().map_or(1, usize::from) },
        seed: options.seed,
        trials: options.trials,
        tables,
    };
    let Document { command, commit, machine, .. } = &document;
    let mut page = format!("# Results: {name}\n\nThis page is written by a command; changes by hand get lost.\n\n");
    let _ = write!(
        page,
        "What is measured: {about}.\n\n| | |\n|---|---|\n| command | `{command}` |\n| commit | {commit} |\n| machine | {}, {} cores |\n\n{legend}",
        machine.cpu, machine.cores
    );
    for table in tables {
        let _ = write!(page, "\n{}", table.markdown());
    }
    fs::create_dir_all(folder).with_context(|| format!("{}", folder.display()))?;
    let path = folder.join(format!("{name}.md"));
    for (path, text) in
        [(&path, page), (&folder.join(format!("{name}.json")), serde_json::to_string_pretty(&document)? + "\n")]
    {
        fs::write(path, text).with_context(|| format!("{}", path.display()))?;
    }
    Ok(path)
}

/// Whether the throws of an experiment's document are those of this command, at this state of all that they
/// depend on. How it counts them, and which conditions it has, may have changed since.
pub fn is_of_today(folder: &Path, name: &str, options: &Options) -> bool {
    #[derive(Deserialize)]
    struct Measured {
        commit: String,
        seed: u64,
        trials: u64,
    }
    let text = fs::read(folder.join(format!("{name}.json"))).ok();
    let measured: Option<Measured> = text.and_then(|it| serde_json::from_slice(&it).ok());
    measured.is_some_and(|it| (it.commit, it.seed, it.trials) == (last_change(), options.seed, options.trials))
}

/// Sources that throws depend on.
const SOURCES: &[&str] = &[
    "assets",
    "crates/catch_body",
    "crates/catch_bot",
    "crates/catch_calibration",
    "crates/catch_cell",
    "crates/catch_import",
    "crates/catch_lab/src",
    "crates/catch_paper",
    "crates/catch_recording",
    "crates/catch_sim",
];

/// The last commit that changed anything there, marked if something is not committed; `unknown` outside of a
/// repository.
pub fn last_change() -> String {
    let git = |arguments: &[&str]| {
        let output = Command::new("git").args(arguments).output().ok().filter(|output| output.status.success());
        output.and_then(|it| String::from_utf8(it.stdout).ok()).map(|text| text.trim().to_owned())
    };
    let Some(commit) = git(&[&["log", "-1", "--format=%h", "--"], SOURCES].concat()) else {
        return "unknown".to_owned();
    };
    let status = git(&[&["status", "--porcelain", "--"], SOURCES].concat());
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
        let texts = ["example", "errors", "Errors are medians.\n"];
        let path = write(&folder, texts, &Options { seed: 7, trials: 9 }, &[table]).unwrap();
        let page = fs::read_to_string(&path).unwrap();
        let document: serde_json::Value =
            serde_json::from_str(&fs::read_to_string(path.with_extension("json")).unwrap()).unwrap();
        fs::remove_dir_all(&folder).unwrap();
        for part in [
            "-- example --seed 7 --trials 9`",
            "Errors are medians.",
            "In all rows: noise none; count 3.\n\n| error",
            "| 123 |",
            "| – |",
        ] {
            assert!(page.contains(part), "{part}: {page}");
        }
        assert_eq!((&document["seed"], &document["trials"]), (&7.into(), &9.into()));
        assert_eq!(document["tables"][0]["rows"][0][2], 0.012_345);
        assert!(document["machine"]["cores"].as_u64().unwrap() >= 1 && document["commit"].is_string());
    }

    #[test]
    fn words_of_a_column_become_columns() {
        let kinds = |count| Entry::Kinds(BTreeMap::from([("late".to_owned(), count), ("slipped_out".to_owned(), 2)]));
        let row = |arm: &str, object: &str, error: Vec<f64>, misses| {
            [arm, object].map(Entry::text).into_iter().chain([Entry::Spread(error), misses]).collect::<Vec<_>>()
        };
        let mut table = Table::new("By arm", &["arm", "object", "error", "misses"]).across("object");
        table.rows.push(row("iiwa", "ball", vec![-4.66, -9.01, -0.2], kinds(1)));
        table.rows.push(row("iiwa", "banana", vec![99.99, 92.86, 100.0], kinds(3)));
        table.rows.push(row("panda", "ball", vec![0.0123, 1.5], kinds(0)));
        table.rows.push(row("panda", "banana", Vec::new(), Entry::Kinds(BTreeMap::new())));
        let expected = "## By arm\n\nIn cells: error.\n\n| arm | ball | banana | misses |\n|---|---|---|---|\n\
            | iiwa | -4.7 (-9.0 to -0.2) | 100 (92.9–100) | 4 late, 4 slipped_out |\n\
            | panda | 0.0123 (1.50) | – | 2 slipped_out, 0 late |\n";
        assert_eq!(table.markdown(), expected);
    }
}
