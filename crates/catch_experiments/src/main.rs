//! Experiments: what is measured and asserted by no test, written to `docs/results/`.
//!
//! `cargo run --release -p catch_experiments -- NAME [--seed S] [--trials N]` runs one in the arena, with the
//! arena's own cameras, and writes `docs/results/NAME.md` and `docs/results/NAME.json`; `--help` lists them.

mod as_published;
mod calibration;
mod cameras;
mod kept;
mod mistold;
mod objects;
mod pages;
mod peers;
mod perception;
mod rates;
mod readme;
mod reliability;
mod results;
mod spread;

use std::path::PathBuf;

use anyhow::{Context, Result};
use clap::{Parser, ValueEnum};

use results::Table;

/// Options of an experiment.
#[derive(Debug, Clone)]
pub struct Options {
    /// Seed of everything random.
    pub seed: u64,
    /// Trials per condition.
    pub trials: u64,
}

/// What measures the tables of an experiment.
type Run = fn(&Options) -> Result<Vec<Table>>;

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
    /// Table I by the paper's own method, what each of its assumptions was worth, and the method under the
    /// arm's limits
    AsPublished,
    /// other libraries at the same work, which benches/peers/run installs
    Peers,
    /// no experiment: brings the table of README up to date with the pages
    Readme,
}

impl Experiment {
    /// Its name, and its description.
    fn said(self) -> (String, String) {
        let value = self.to_possible_value().expect("no experiment is hidden");
        (value.get_name().to_owned(), value.get_help().map(ToString::to_string).unwrap_or_default())
    }

    /// Trials per condition unless told otherwise, meaning of the columns, and what measures.
    fn plan(self) -> Option<(u64, &'static str, Run)> {
        Some(match self {
            Self::CatchRates => {
                (400, include_str!("legends/catch-rates.md"), |it| pages::run(include_str!("catch_rates.toml"), it))
            }
            Self::Objects => (100, include_str!("legends/objects.md"), objects::run),
            Self::GrippersAndArms => (100, include_str!("legends/grippers-and-arms.md"), |it| {
                pages::run(include_str!("grippers_and_arms.toml"), it)
            }),
            Self::Cameras => (200, include_str!("legends/cameras.md"), cameras::run),
            Self::CalibrationAndPerception => {
                (20, include_str!("legends/calibration-and-perception.md"), calibration::run)
            }
            Self::Mistold => (60, include_str!("legends/mistold.md"), mistold::run),
            Self::Reliability => (60, include_str!("legends/reliability.md"), reliability::run),
            Self::AsPublished => (57, include_str!("legends/as-published.md"), as_published::run),
            Self::Peers => (50, include_str!("legends/peers.md"), peers::run),
            Self::Readme => return None,
        })
    }
}

#[derive(Debug, Parser)]
#[command(about = "Measures and writes docs/results/NAME.md and NAME.json")]
struct Arguments {
    /// What is measured.
    #[arg(value_name = "NAME")]
    experiment: Experiment,
    /// Seed of everything random.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Trials per condition instead of the experiment's own number.
    #[arg(long, value_parser = clap::value_parser!(u64).range(1..))]
    trials: Option<u64>,
    /// Folder of the results.
    #[arg(long, default_value = "docs/results")]
    out: PathBuf,
}

#[expect(clippy::print_stdout, reason = "where the results are is what was asked for")]
fn main() -> Result<()> {
    let Arguments { experiment, seed, trials, out } = Arguments::parse();
    let Some((usual, legend, run)) = experiment.plan() else { return readme::update(&out) };
    let (name, about) = experiment.said();
    let options = Options { seed, trials: trials.unwrap_or(usual) };
    if results::is_of_today(&out, &name, &options) {
        println!("{name}: measured already; without {name}.json it is measured anew");
        return Ok(());
    }
    let tables = run(&options).with_context(|| format!("experiment {name}"))?;
    let path = results::write(&out, [&name, &about, legend], &options, &tables)?;
    println!("{}", path.display());
    Ok(())
}
