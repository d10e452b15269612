//! Catch rates of a condition, of the throws within reach.

use std::collections::BTreeMap;

use anyhow::Result;
use catch_lab::{
    evaluation::{Cell, Evaluation, Row},
    parallel,
    referee::reason::Reason,
    scenario::setup::Setup,
};

use crate::{
    Options,
    results::Entry,
    spread::{percent, rate},
};

/// Figures of each condition.
pub const FIGURES: [&str; 5] = ["trials", "within reach, %", "caught, %", "limits broken", "misses within reach"];

/// Sentences of a legend about them.
pub const MISSES: &str =
    " Rates stand before their interval (Wilson, 95 %). [Statuses](../reference/statuses.md) explains misses.";
/// The same where another page defines them.
pub const DEFINED: &str = " [Catch rates](catch-rates.md) defines *caught*, *within reach* and *limits broken*.";

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
        let name = serde_json::to_string(&reason).unwrap_or_default().replace('"', "");
        *counts.entry(name).or_default() += 1;
    }
    Entry::Kinds(counts)
}
