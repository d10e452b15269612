//! CPU time of whole trials.

use anyhow::Result;
use catch_lab::{
    scenario::setup::{Choice, Setup},
    trial,
};

use super::REPETITIONS;
use crate::{
    Options,
    results::{Entry, Table},
    spread::{cpu_ms, quantiles},
};

/// Trials of a condition.
const TRIALS: u64 = 5;

/// Whole trials, arena and brain, by scenario and by the method of the brain.
pub fn table(options: &Options) -> Result<Table> {
    let columns = ["scenario", "method", "trials", "trial, median s", "trial, max s"];
    let mut table = Table::new("Whole trials: arena, images and brain", &columns);
    for (scenario, method) in [("as-published", "paper"), ("paper", "paper"), ("paper", "ours"), ("honest", "ours")] {
        let settings = [format!("brain.method=\"{method}\"")];
        let setup = Setup::load(&Choice { scenario: Some(scenario), settings: &settings, ..Choice::default() })?;
        setup.prepare();
        let once = |index| {
            let before_ms = cpu_ms();
            trial::run_unobserved(&mut setup.brain(options.seed, index), &setup, options.seed, index);
            (cpu_ms() - before_ms) * 1e-3
        };
        let least = |index| (0..REPETITIONS).map(|_| once(index)).fold(f64::INFINITY, f64::min);
        let times: Vec<f64> = (0..TRIALS).map(least).collect();
        let labels = [Entry::text(scenario), Entry::text(method), Entry::Count(times.len())];
        table.rows.push(labels.into_iter().chain(quantiles(&times, [0.5, 1.0], 1.0)).collect());
    }
    Ok(table)
}
