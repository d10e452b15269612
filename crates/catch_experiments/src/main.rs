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
mod reliability;
mod results;
mod spread;

use std::{collections::BTreeSet, path::PathBuf};

use anyhow::{Context, Result, bail};
use clap::Parser;

use results::Table;

/// An experiment.
struct Experiment {
    name: &'static str,
    /// Description of the experiment, in one line.
    about: &'static str,
    /// Trials per condition unless told otherwise.
    trials: u64,
    run: fn(&Options) -> Result<Findings>,
}

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

const EXPERIMENTS: &[Experiment] = &[
    Experiment {
        name: "catch-rates",
        about: "how often the built-in arm catches the built-in objects",
        trials: 600,
        run: catch_rates::run,
    },
    Experiment {
        name: "objects",
        about: "objects of public collections, imported by one command each and thrown in the scenario honest",
        trials: 100,
        run: objects::run,
    },
    Experiment {
        name: "grippers-and-arms",
        about: "how often arms with hands that laboratories own catch the built-in objects",
        trials: 100,
        run: grippers_and_arms::run,
    },
    Experiment {
        name: "cameras",
        about: "how often rigs of a few near cameras let the built-in arm catch, and how soon a pushed camera is noticed",
        trials: 200,
        run: cameras::run,
    },
    Experiment {
        name: "calibration-and-perception",
        about: "errors of near cameras that are calibrated on the arm, and of poses and predictions",
        trials: 20,
        run: calibration::run,
    },
    Experiment {
        name: "mistold",
        about: "what a wrong belief of the brain costs, one at a time, on the same throws",
        trials: 100,
        run: mistold::run,
    },
    Experiment {
        name: "reliability",
        about: "how many positions lie in the ellipsoids that predictions claim",
        trials: 60,
        run: reliability::run,
    },
    Experiment {
        name: "flights",
        about: "recorded throws, which --tracks names: predictions of their ends, and what is caught of them",
        trials: 60,
        run: flights::run,
    },
    Experiment {
        name: "as-published",
        about: "Table I by the paper's own method, what each of its assumptions was worth, and the method under the arm's limits",
        trials: 57,
        run: as_published::run,
    },
    Experiment {
        name: "peers",
        about: "other libraries at the same work, which benches/peers/run installs",
        trials: 50,
        run: peers::run,
    },
];

#[derive(Debug, Parser)]
#[command(about = "Measures and writes docs/results/NAME.md and NAME.json; `list` lists the experiments")]
struct Arguments {
    /// Name of an experiment, or `list`.
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
        for Experiment { name, about, trials, .. } in EXPERIMENTS {
            println!("{name:15} {about} ({trials} trials per condition)");
        }
        return Ok(());
    }
    let Some(experiment) = EXPERIMENTS.iter().find(|it| it.name == name) else {
        let names: BTreeSet<&str> = EXPERIMENTS.iter().map(|it| it.name).collect();
        bail!("there is no experiment `{name}`; expected `list` or one of {names:?}");
    };
    let options = Options { seed, trials: trials.unwrap_or(experiment.trials), tracks };
    let findings = (experiment.run)(&options).with_context(|| format!("experiment {name}"))?;
    let path = results::write(&out, experiment.name, experiment.about, &options, &findings)?;
    println!("{}", path.display());
    Ok(())
}
