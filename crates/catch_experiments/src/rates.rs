//! Catch rates of a condition, of the throws within reach.

use std::{collections::BTreeMap, ops::Range};

use anyhow::Result;
use catch_lab::{
    evaluation::{Cell, Evaluation, Row},
    parallel,
    referee::{self, Verdict, reason::Reason},
    scenario::setup::{Choice, Setup},
    trial::{self, Trial},
};
use catch_recording::name_of;

use crate::{
    Options,
    results::Entry,
    spread::{percent, rate},
};

/// Figures of each condition.
pub const FIGURES: [&str; 5] = ["trials", "within reach, %", "caught, %", "limits broken", "misses within reach"];

/// The setup of a scenario with an object.
pub fn setup(scenario: &str, object: &str) -> Result<Setup> {
    Ok(Setup::load(&Choice { scenario: Some(scenario), object: Some(object), ..Choice::default() })?)
}

/// What is told of each of these trials.
pub fn judged<T: Send>(
    setup: &Setup,
    seed: u64,
    trials: Range<u64>,
    tell: impl Fn(&Trial, Verdict) -> T + Sync,
) -> Vec<T> {
    setup.prepare();
    parallel::map((trials.end - trials.start) as usize, |i| {
        let index = trials.start + i as u64;
        let trial = trial::run_unobserved(&mut setup.brain(seed, index), setup, seed, index);
        tell(&trial, referee::judge(setup, &trial))
    })
}

/// Summarizes the trials of a condition, one entry for each of [`FIGURES`].
pub fn figures(setups: Vec<Setup>, options: &Options) -> Result<Vec<Entry>> {
    setups.iter().for_each(Setup::prepare);
    let trials = options.trials.div_ceil(setups.len() as u64);
    let cells = setups.into_iter().map(Cell::new).collect();
    let evaluation = Evaluation { cells, seed: options.seed, first: 0, trials };
    let mut rows = Vec::new();
    evaluation.run(0, parallel::threads(), &mut |row, _| {
        rows.push(row);
        Ok(())
    })?;
    let within: Vec<&Row> = rows.iter().filter(|row| !row.verdict.is_out_of_reach()).collect();
    let caught = within.iter().filter(|row| row.verdict.caught).count();
    Ok(vec![
        Entry::Count(rows.len()),
        percent(within.len(), rows.len()),
        rate(caught, within.len()),
        Entry::Count(rows.iter().map(|row| row.verdict.limit_violations).sum()),
        misses(within.iter().filter_map(|row| row.verdict.reason)),
    ])
}

/// Misses of each reason by its name.
pub fn misses(reasons: impl Iterator<Item = Reason>) -> Entry {
    let mut counts = BTreeMap::new();
    for reason in reasons {
        *counts.entry(name_of(reason)).or_default() += 1;
    }
    Entry::Kinds(counts)
}
