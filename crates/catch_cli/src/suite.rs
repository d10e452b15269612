//! `catchingbot suite`: frozen benchmarks.

use std::{
    fmt::Write,
    fs, io,
    path::{Path, PathBuf},
    time::Instant,
};

use anyhow::Context;
use catch_body::InputError;
use catch_body::statistics::wilson95;
use catch_lab::{
    VERSION,
    evaluation::{MOST_THREADS, Row, cell_summary::CellSummary, summary_table::plain},
    suite::{Catcher, Suite, rows_sha256},
};
use catch_recording::{
    bounded_file::FileKind,
    brain::Method,
    whole_file::{self, COMMAND_LINE},
};
use clap::{Args, Subcommand, ValueEnum};
use serde::{Deserialize, Serialize};

use super::{
    eval::{self, Pace},
    whole,
};
use crate::screen::{self, FAINT, STRONG};

/// Arguments of `suite`.
#[derive(Debug, Args)]
pub struct SuiteArguments {
    #[command(subcommand)]
    command: SuiteCommand,
}

#[derive(Debug, Subcommand)]
enum SuiteCommand {
    /// The throws of a suite: a table, a row per trial on disk, and the hash of all rows
    Run(RunArguments),
    /// The results of several brains in a folder as one table in Markdown
    Table(TableArguments),
    /// The suites that there are
    List,
}

/// Arguments of `suite run`.
#[derive(Debug, Args)]
struct RunArguments {
    /// Name of the suite
    #[arg(value_name = "NAME")]
    name: String,
    /// Brain that catches
    #[arg(long, value_enum, default_value = "ours")]
    brain: BrainArgument,
    /// Throws per object and throw at most, for a part of the suite
    #[arg(long, value_name = "N", allow_negative_numbers = true, value_parser = whole(1, 10_000_000))]
    trials: Option<u64>,
    /// Trials that run at the same time [default: the number of cores]
    #[arg(long, value_name = "N", allow_negative_numbers = true, value_parser = whole(1, MOST_THREADS as u64))]
    threads: Option<u64>,
    /// Folder for the results
    #[arg(long, value_name = "DIR", default_value = "out/suite")]
    out: PathBuf,
    /// Go on with the results that are in the folder
    #[arg(long)]
    resume: bool,
    /// Print one JSON document instead of the table
    #[arg(long)]
    json: bool,
}

/// Arguments of `suite table`.
#[derive(Debug, Args)]
struct TableArguments {
    /// Name of the suite
    #[arg(value_name = "NAME")]
    name: String,
    /// Folder of the results
    #[arg(long, value_name = "DIR", default_value = "out/suite")]
    out: PathBuf,
}

/// Brain that catches.
#[derive(Debug, Clone, Copy, ValueEnum)]
enum BrainArgument {
    /// The brain of this project
    Ours,
    /// The paper's own method
    Paper,
    /// A brain that does nothing
    Idle,
}

impl BrainArgument {
    fn name(self) -> &'static str {
        match self {
            Self::Ours => "ours",
            Self::Paper => "paper",
            Self::Idle => "idle",
        }
    }

    fn catcher(self) -> Catcher {
        match self {
            Self::Ours => Catcher::Method(Method::Ours),
            Self::Paper => Catcher::Method(Method::Paper),
            Self::Idle => Catcher::idle(),
        }
    }
}

/// The JSON document, which is written beside the rows, too.
#[derive(Serialize)]
struct Document<'a> {
    version: &'static str,
    suite: &'a str,
    content_sha256: &'a str,
    brain: &'static str,
    /// True if all throws of the suite were thrown.
    complete: bool,
    conditions: &'a [Condition],
    trials: usize,
    caught: usize,
    rows_sha256: &'a str,
    wall_s: f64,
}

/// An object with a throw in a scenario.
#[derive(Serialize)]
struct Condition {
    scenario: String,
    #[serde(flatten)]
    summary: CellSummary,
}

/// Runs a suite, or lists them.
///
/// # Errors
/// A suite that is not as it was frozen; results that cannot be written.
pub fn run(arguments: &SuiteArguments) -> anyhow::Result<()> {
    match &arguments.command {
        SuiteCommand::Run(arguments) => throw(arguments),
        SuiteCommand::Table(arguments) => table(arguments),
        SuiteCommand::List => list(),
    }
}

fn list() -> anyhow::Result<()> {
    for name in Suite::names() {
        let file = Suite::load(&name)?.file;
        screen::line(&format!("{STRONG}{name}{STRONG:#}  {FAINT}{}{FAINT:#}", file.description))?;
        let trials = |it: &catch_lab::suite::SuitePart| (it.objects.len() * it.throws.len()) as u64 * it.trials;
        let count: u64 = file.parts.iter().map(trials).sum();
        screen::line(&format!("  {count} throws, seed {}, content {}", file.seed, file.content_sha256))?;
    }
    Ok(())
}

fn throw(arguments: &RunArguments) -> anyhow::Result<()> {
    eval::tell_how_to_resume(&arguments.out);
    let started = Instant::now();
    let suite = Suite::load(&arguments.name)?;
    let (brain, catcher) = (arguments.brain.name(), arguments.brain.catcher());
    let pace = Pace::new(arguments.resume, arguments.threads);
    let (mut parts, mut conditions, mut complete) = (Vec::new(), Vec::new(), true);
    for (part, evaluation) in suite.file.parts.iter().zip(suite.evaluations(&catcher, arguments.trials)?) {
        complete &= evaluation.trials == part.trials;
        // Who catches is no part of what an evaluation is known by.
        let folder = arguments.out.join(format!("{}-{brain}-{}", suite.name, part.scenario));
        let done =
            eval::complete(&evaluation, &folder, pace, &part.scenario).with_context(|| folder.display().to_string())?;
        let summaries = evaluation.identity().summarize(&done.rows);
        conditions.extend(summaries.into_iter().map(|summary| Condition { scenario: part.scenario.clone(), summary }));
        parts.push((evaluation.cells.len(), done.rows));
    }
    let rows: Vec<(usize, &[Row])> = parts.iter().map(|(count, rows)| (*count, &rows[..])).collect();
    let hash = rows_sha256(&rows).context("the rows")?;
    let sum = |of: &dyn Fn(&CellSummary) -> usize| conditions.iter().map(|it| of(&it.summary)).sum::<usize>();
    let document = Document {
        version: VERSION,
        suite: &suite.name,
        content_sha256: &suite.file.content_sha256,
        brain,
        complete,
        conditions: &conditions,
        trials: sum(&|it| it.trials),
        caught: sum(&|it| it.caught),
        rows_sha256: &hash,
        wall_s: started.elapsed().as_secs_f64(),
    };
    let path = document_path(&arguments.out, &suite.name, brain);
    let text = serde_json::to_string_pretty(&document)? + "\n";
    whole_file::write(&path, text)?;
    if arguments.json { screen::json(&document) } else { Ok(print(&document)?) }
}

/// Returns the path of a brain's document.
fn document_path(out: &Path, suite: &str, brain: &str) -> PathBuf {
    out.join(format!("{suite}-{brain}.json"))
}

/// A document as it is read again.
#[derive(Deserialize)]
struct Read {
    version: String,
    suite: String,
    content_sha256: String,
    brain: String,
    complete: bool,
    conditions: Vec<ReadCondition>,
    trials: usize,
    caught: usize,
    rows_sha256: String,
}

/// Columns of the table for a condition.
#[derive(Deserialize)]
struct ReadCondition {
    scenario: String,
    object: String,
    throw: String,
    throw_is_fixed: bool,
    trials: usize,
    caught: usize,
    out_of_reach: Option<usize>,
}

impl Read {
    /// The document of a brain; none where it was not run.
    fn of(suite: &Suite, brain: &str, path: &Path) -> Result<Option<Self>, InputError> {
        const EXPECTED: &str = "results as `suite run` writes them";
        if fs::symlink_metadata(path).is_err_and(|it| it.kind() == io::ErrorKind::NotFound) {
            return Ok(None);
        }
        let file = path.display().to_string();
        let text = FileKind::text(EXPECTED).read_text(path)?;
        let mut deserializer = serde_json::Deserializer::from_str(&text);
        let read: Self = serde_path_to_error::deserialize(&mut deserializer).map_err(|it| {
            let (field, fault) = (it.path().to_string(), it.into_inner());
            let field = if field == "." { format!("line {}", fault.line()) } else { field };
            InputError::new(&file, field, fault, EXPECTED)
        })?;
        read.check(suite, brain, &file).map(|()| Some(read))
    }

    /// Checks that the document is of this suite and brain, and that its counts are possible.
    fn check(&self, suite: &Suite, brain: &str, file: &str) -> Result<(), InputError> {
        let Self { content_sha256, conditions, trials, caught, rows_sha256, .. } = self;
        let is_hash = rows_sha256.len() == 64 && rows_sha256.bytes().all(|it| it.is_ascii_hexdigit());
        let hash = if is_hash { rows_sha256 } else { "64 hexadecimal digits" };
        for (field, found, expected) in [
            ("suite", &self.suite, &*suite.name),
            ("brain", &self.brain, brain),
            ("content_sha256", content_sha256, &suite.file.content_sha256),
            ("rows_sha256", rows_sha256, hash),
        ] {
            if found != expected {
                return Err(InputError::new(file, field, found, expected));
            }
        }
        for (i, it) in conditions.iter().enumerate() {
            let missed = it.trials.checked_sub(it.caught);
            let within = |part: usize, whole: Option<usize>| whole.is_some_and(|whole| part <= whole);
            for (field, count, is_right) in [
                ("caught", it.caught, missed.is_some()),
                ("out_of_reach", it.out_of_reach.unwrap_or(0), within(it.out_of_reach.unwrap_or(0), missed)),
            ] {
                if !is_right {
                    let expected = format!("no more than there were of {} trials", it.trials);
                    return Err(InputError::new(file, format!("conditions[{i}].{field}"), count, expected));
                }
            }
        }
        let sum = |of: fn(&ReadCondition) -> usize| conditions.iter().map(of).fold(0, usize::saturating_add);
        for (field, found, sum) in [("trials", trials, sum(|it| it.trials)), ("caught", caught, sum(|it| it.caught))] {
            if *found != sum {
                return Err(InputError::new(file, field, found, format!("{sum}, the sum of all conditions")));
            }
        }
        Ok(())
    }

    /// Adds its lines to the table and its sums to the list of brains.
    fn add(&self, lines: &mut String, sums: &mut String) {
        let Self { brain, complete, trials, caught, rows_sha256, .. } = self;
        for it in &self.conditions {
            let percent = |value: f64| format!("{:.1}", 100.0 * value);
            let rate = percent(it.caught as f64 / it.trials.max(1) as f64);
            let interval = match it.throw_is_fixed || it.trials == 0 {
                true => "same throw".to_owned(),
                false => wilson95(it.caught, it.trials).map(percent).join(" – "),
            };
            let names = [&it.scenario, &it.object, &it.throw].map(|name| plain(name)).join(" | ");
            let out_of_reach = it.out_of_reach.map_or("–".to_owned(), |count| count.to_string());
            let counts = format!("{} | {} | {rate} ({interval}) | {out_of_reach}", it.trials, it.caught);
            let _ = writeln!(lines, "| {names} | {brain} | {counts} |");
        }
        let which = if *complete { "all throws" } else { "a part of the throws" };
        let _ = writeln!(sums, "| {brain} | {which} | {trials} | {caught} | `{rows_sha256}` |");
    }
}

/// A line for each condition and brain, and the hashes.
fn table(TableArguments { name, out }: &TableArguments) -> anyhow::Result<()> {
    let suite = Suite::load(name)?;
    let (mut lines, mut sums) = (String::new(), String::new());
    let mut version: Option<String> = None;
    for brain in BrainArgument::value_variants().iter().map(|it| it.name()) {
        let path = document_path(out, &suite.name, brain);
        let Some(read) = Read::of(&suite, brain, &path)? else { continue };
        let first = version.get_or_insert_with(|| read.version.clone());
        if read.version != *first {
            let expected = format!("{first}, as of the others: only results of one version compare");
            return Err(InputError::new(path.display(), "version", read.version, expected).into());
        }
        read.add(&mut lines, &mut sums);
    }
    if sums.is_empty() {
        let found = format!("`{}`, which has no results of {name}", out.display());
        let expected = format!("the --out of `suite run {name}`");
        return Err(InputError::new(COMMAND_LINE, "--out", found, expected).into());
    }
    let heading = "| scenario | object | throw | brain | trials | caught | % (95 %) | out of reach |\n| --- | --- | --- | --- | --- | --- | --- | --- |\n";
    let rows = "| brain | | trials | caught | SHA-256 of the rows |\n| --- | --- | --- | --- | --- |\n";
    Ok(screen::text(&format!("{rows}{sums}\n{heading}{lines}"))?)
}

fn print(document: &Document) -> std::io::Result<()> {
    let Document { suite, brain, complete, conditions, trials, caught, rows_sha256, wall_s, .. } = document;
    screen::line("")?;
    for scenario in conditions.chunk_by(|a, b| a.scenario == b.scenario) {
        let summaries: Vec<CellSummary> = scenario.iter().map(|it| it.summary.clone()).collect();
        screen::line(&format!("  {STRONG}{}{STRONG:#}", scenario[0].scenario))?;
        screen::line(&eval::table(&summaries).trim_fmt())?;
        screen::line("")?;
    }
    screen::line(&format!(
        "  {STRONG}{suite}, {brain}: {caught} of {trials} caught{STRONG:#}{FAINT} in {wall_s:.1} s{FAINT:#}"
    ))?;
    screen::fact("rows", &format!("SHA-256 {rows_sha256}"))?;
    if *complete { Ok(()) } else { screen::fact("part", "fewer throws than the suite has: no result to compare") }
}
