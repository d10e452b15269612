//! `catchingbot suite`: frozen benchmarks.

use std::{
    fmt::Write,
    fs,
    path::{Path, PathBuf},
    time::Instant,
};

use anyhow::Context;
use catch_lab::{
    VERSION,
    evaluation::{Row, cell_summary::CellSummary},
    scenario::brain::Method,
    suite::{Catcher, Suite, rows_sha256},
    whole_file,
};
use clap::{Args, Subcommand, ValueEnum};
use serde::Serialize;
use serde_json::Value;

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
    /// Who catches
    #[arg(long, value_enum, default_value = "ours")]
    brain: BrainArgument,
    /// Throws per object and throw at most, for a part of the suite
    #[arg(long, value_name = "N", allow_negative_numbers = true, value_parser = whole(1, 10_000_000))]
    trials: Option<u64>,
    /// Trials that run at the same time [default: the number of cores]
    #[arg(long, value_name = "N", allow_negative_numbers = true, value_parser = whole(1, 100_000))]
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

/// Who catches.
#[derive(Debug, Clone, Copy, ValueEnum)]
enum BrainArgument {
    /// This project's brain
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
    /// Whether all throws of the suite were thrown.
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

/// Where the document of a brain is.
fn document_path(out: &Path, suite: &str, brain: &str) -> PathBuf {
    out.join(format!("{suite}-{brain}.json"))
}

/// A line for each condition and brain, and the hashes.
fn table(TableArguments { name, out }: &TableArguments) -> anyhow::Result<()> {
    let (mut lines, mut hashes) = (String::new(), String::new());
    for brain in BrainArgument::value_variants() {
        let path = document_path(out, name, brain.name());
        let Ok(text) = fs::read_to_string(&path) else { continue };
        let document: Value = serde_json::from_str(&text).with_context(|| path.display().to_string())?;
        let text = |value: &Value| value.as_str().unwrap_or_default().to_owned();
        for it in document["conditions"].as_array().into_iter().flatten() {
            let count = |field: &str| it[field].as_u64().unwrap_or_default();
            let percent = |value: f64| format!("{:.1}", 100.0 * value);
            let rate = percent(count("caught") as f64 / count("trials").max(1) as f64);
            let ends = it["wilson95"].as_array().into_iter().flatten().filter_map(Value::as_f64).map(percent);
            let cells = [text(&it["scenario"]), text(&it["object"]), text(&it["throw"]), brain.name().to_owned()];
            let _ = writeln!(
                lines,
                "| {} | {} | {} | {rate} ({}) | {} |",
                cells.join(" | "),
                count("trials"),
                count("caught"),
                ends.collect::<Vec<_>>().join(" – "),
                count("out_of_reach"),
            );
        }
        let which = if document["complete"] == true { "all throws" } else { "a part of the throws" };
        let sums = ["trials", "caught"].map(|field| document[field].as_u64().unwrap_or_default());
        let row = [brain.name(), which, &sums[0].to_string(), &sums[1].to_string()].join(" | ");
        let _ = writeln!(hashes, "| {row} | `{}` |", text(&document["rows_sha256"]));
    }
    let heading = "| scenario | object | throw | brain | trials | caught | % (95 %) | out of reach |\n| --- | --- | --- | --- | --- | --- | --- | --- |\n";
    let rows = "| brain | | trials | caught | SHA-256 of the rows |\n| --- | --- | --- | --- | --- |\n";
    Ok(screen::text(&format!("{rows}{hashes}\n{heading}{lines}"))?)
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
