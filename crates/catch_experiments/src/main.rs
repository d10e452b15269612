//! Experiments: what is measured and asserted by no test, written to `docs/results/`.
//!
//! `cargo run --release -p catch_experiments -- NAME [--seed S] [--trials N]` runs one in the arena, with the
//! arena's own cameras, and writes `docs/results/NAME.md` and `docs/results/NAME.json`; `list` lists them.

mod as_published;
mod calibration;
mod cameras;
mod catch_rates;
mod flights;
mod grippers_and_arms;
mod kept;
mod mistold;
mod objects;
mod peers;
mod perception;
mod rates;
mod readme;
mod reliability;
mod results;
mod spread;

use std::{collections::BTreeSet, path::PathBuf};

use anyhow::{Context, Result, bail};
use clap::{Parser, ValueEnum};

use results::Table;

/// Options of an experiment.
#[derive(Debug, Clone)]
pub struct Options {
    /// Seed of everything random.
    pub seed: u64,
    /// Trials per condition.
    pub trials: u64,
    /// Folders of recorded tracks, of one object each.
    pub tracks: Vec<PathBuf>,
}

impl Options {
    /// The folders of recorded tracks, without which an experiment is none.
    fn tracks(&self, experiment: &str) -> Result<&[PathBuf]> {
        if self.tracks.is_empty() {
            bail!("--tracks: found nothing, expected a folder of recorded tracks for {experiment}, once or more");
        }
        Ok(&self.tracks)
    }
}

/// Results of an experiment.
pub struct Findings {
    /// Meaning of the columns, as Markdown.
    pub legend: String,
    /// The figures.
    pub tables: Vec<Table>,
}

/// An experiment; what is said of it is its description in one line.
#[derive(Debug, Clone, Copy, ValueEnum)]
enum Experiment {
    /// how often the built-in arm catches the built-in objects
    CatchRates,
    /// objects of public collections, imported by one command each and thrown in the scenario honest
    Objects,
    /// how often arms with hands that laboratories own catch the built-in objects
    GrippersAndArms,
    /// how often rigs of a few near cameras let the built-in arm catch, placed or not, and in a room
    Cameras,
    /// errors of near cameras that are calibrated on the arm, and of poses and predictions
    CalibrationAndPerception,
    /// what a wrong belief of the brain costs, one at a time, on the same throws
    Mistold,
    /// how many positions lie in the ellipsoids that predictions claim
    Reliability,
    /// recorded throws, which --tracks names: predictions of their ends, and what is caught of them
    Flights,
    /// Table I by the paper's own method, what each of its assumptions was worth, and the method under the
    /// arm's limits
    AsPublished,
    /// other libraries at the same work, which benches/peers/run installs
    Peers,
}

impl Experiment {
    /// Its name, and its description.
    fn said(self) -> (String, String) {
        let value = self.to_possible_value().expect("no experiment is hidden");
        (value.get_name().to_owned(), value.get_help().map(ToString::to_string).unwrap_or_default())
    }

    /// Trials per condition unless told otherwise, and what measures.
    fn plan(self) -> (u64, fn(&Options) -> Result<Findings>) {
        match self {
            Self::CatchRates => (400, catch_rates::run),
            Self::Objects => (100, objects::run),
            Self::GrippersAndArms => (100, grippers_and_arms::run),
            Self::Cameras => (200, cameras::run),
            Self::CalibrationAndPerception => (20, calibration::run),
            Self::Mistold => (60, mistold::run),
            Self::Reliability => (60, reliability::run),
            Self::Flights => (60, flights::run),
            Self::AsPublished => (57, as_published::run),
            Self::Peers => (50, peers::run),
        }
    }
}

#[derive(Debug, Parser)]
#[command(about = "Measures and writes docs/results/NAME.md and NAME.json; `list` lists the experiments")]
struct Arguments {
    /// Name of an experiment, `list`, or `readme` to bring its table up to date with the pages.
    name: String,
    /// Seed of everything random.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Trials per condition instead of the experiment's own number.
    #[arg(long, value_parser = clap::value_parser!(u64).range(1..))]
    trials: Option<u64>,
    /// Folder of recorded tracks of one object; may be repeated.
    #[arg(long, value_name = "DIR")]
    tracks: Vec<PathBuf>,
    /// Folder of the results.
    #[arg(long, default_value = "docs/results")]
    out: PathBuf,
}

#[expect(clippy::print_stdout, reason = "the list and where the results are is what was asked for")]
fn main() -> Result<()> {
    let Arguments { name, seed, trials, tracks, out } = Arguments::parse();
    if name == "list" {
        for experiment in Experiment::value_variants() {
            let ((name, about), (trials, _)) = (experiment.said(), experiment.plan());
            println!("{name:15} {about} ({trials} trials per condition)");
        }
        return Ok(());
    }
    if name == "readme" {
        return readme::update(&out);
    }
    let Ok(experiment) = Experiment::from_str(&name, false) else {
        let names: BTreeSet<String> = Experiment::value_variants().iter().map(|it| it.said().0).collect();
        bail!("there is no experiment `{name}`; expected `list`, `readme` or one of {names:?}");
    };
    let ((_, about), (usual, run)) = (experiment.said(), experiment.plan());
    let options = Options { seed, trials: trials.unwrap_or(usual), tracks };
    if results::is_of_today(&out, &name, &options) {
        println!("{name}: measured already; without {name}.json it is measured anew");
        return Ok(());
    }
    let findings = run(&options).with_context(|| format!("experiment {name}"))?;
    let path = results::write(&out, &name, &about, &options, &findings)?;
    println!("{}", path.display());
    Ok(())
}
