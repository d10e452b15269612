//! Experiments: what is measured and asserted by no test, written to `docs/results/`.
//!
//! `cargo run --release -p catch_experiments -- NAME [--seed S] [--trials N]` runs one in the arena, with the
//! arena's own cameras, and writes `docs/results/NAME.md` and `docs/results/NAME.json`; `list` lists them.

mod ablation;
mod arms;
mod as_published;
mod calibration;
mod catch_rates;
mod figures;
mod finding;
mod flights;
mod grasp_weights;
mod grippers;
mod logistic_regression;
mod mistold;
mod near_rates;
mod objects;
mod peers;
mod pushed_cameras;
mod rates;
mod recorded_throws;
mod reliability;
mod results;
mod spread;
mod stage_times;

use std::{
    collections::BTreeSet,
    path::{Path, PathBuf},
};

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
    pub legend: &'static str,
    /// The figures.
    pub tables: Vec<Table>,
}

const EXPERIMENTS: &[Experiment] = &[
    Experiment {
        name: "perception",
        about: "errors of poses and predicted positions by depth noise, with labels and without",
        trials: 48,
        run: flights::perception,
    },
    Experiment {
        name: "spin-and-drag",
        about: "errors of poses and predicted positions for objects that spin through air, and in the scenario honest",
        trials: 48,
        run: flights::spin_and_drag,
    },
    Experiment {
        name: "paper-stages",
        about: "the paper's pose estimation and flight prediction beside ours, on the same throws",
        trials: 24,
        run: flights::paper_stages,
    },
    Experiment {
        name: "stage-times",
        about: "CPU time of each stage of the brain by depth noise, with labels and without",
        trials: 8,
        run: stage_times::run,
    },
    Experiment {
        name: "near-rates",
        about: "how often rigs of a few near cameras let the built-in arm catch",
        trials: 400,
        run: near_rates::run,
    },
    Experiment {
        name: "finding",
        about: "how soon near cameras find what flies, and whether they take a person who walks for it",
        trials: 100,
        run: finding::run,
    },
    Experiment {
        name: "pushed-cameras",
        about: "how soon a near camera that was pushed is noticed in a life of many throws",
        trials: 4,
        run: pushed_cameras::run,
    },
    Experiment {
        name: "calibration",
        about: "how well near cameras are calibrated on the arm, from 50 mm and 5° off",
        trials: 20,
        run: calibration::run,
    },
    Experiment {
        name: "catch-rates",
        about: "how often the built-in arm catches the built-in objects",
        trials: 400,
        run: catch_rates::run,
    },
    Experiment {
        name: "ablation",
        about: "what each assumption of the paper is worth, down to the scenario honest",
        trials: 100,
        run: ablation::run,
    },
    Experiment {
        name: "arms",
        about: "what each built-in arm catches of the throws within its reach, and how long it searches",
        trials: 100,
        run: arms::run,
    },
    Experiment {
        name: "grippers",
        about: "what each built-in gripper catches on two arms, and why it misses",
        trials: 40,
        run: grippers::run,
    },
    Experiment {
        name: "as-published",
        about: "Table I by the paper's own method, what each of its assumptions was worth, and the method under the arm's limits",
        trials: 57,
        run: as_published::run,
    },
    Experiment {
        name: "objects",
        about: "objects of public collections, imported by one command each and thrown in the scenario honest",
        trials: 20,
        run: objects::run,
    },
    Experiment {
        name: "reliability",
        about: "how many positions lie in the ellipsoids that predictions claim, simulated, and recorded with --tracks",
        trials: 60,
        run: reliability::run,
    },
    Experiment {
        name: "recorded-throws",
        about: "what is caught of recorded throws, which --tracks names, as the built-in objects",
        trials: 60,
        run: recorded_throws::run,
    },
    Experiment {
        name: "mistold",
        about: "what a wrong belief of the brain costs, one at a time, on the same throws of honest",
        trials: 150,
        run: mistold::honest,
    },
    Experiment { name: "mistold-lab", about: "the same in the scenario lab", trials: 60, run: mistold::lab },
    Experiment {
        name: "peers",
        about: "other libraries at the same work, which benches/peers/run installs",
        trials: 50,
        run: peers::run,
    },
    Experiment {
        name: "grasp-weights",
        about: "weights of the grasp choice, fitted on objects that are in no other experiment",
        trials: 100,
        run: grasp_weights::run,
    },
];

#[derive(Debug, Parser)]
#[command(about = "Measures and writes docs/results/NAME.md and NAME.json; `list` lists the experiments")]
struct Arguments {
    /// Name of an experiment, `list`, or `figures` for those of docs/pictures.
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
    if name == "figures" {
        return figures::write(Path::new("docs/pictures"));
    }
    let Some(experiment) = EXPERIMENTS.iter().find(|it| it.name == name) else {
        let names: BTreeSet<&str> = EXPERIMENTS.iter().map(|it| it.name).collect();
        bail!("there is no experiment `{name}`; expected `list`, `figures` or one of {names:?}");
    };
    let options = Options { seed, trials: trials.unwrap_or(experiment.trials), tracks };
    let findings = (experiment.run)(&options).with_context(|| format!("experiment {name}"))?;
    let path = results::write(&out, experiment.name, experiment.about, &options, &findings)?;
    println!("{}", path.display());
    Ok(())
}
