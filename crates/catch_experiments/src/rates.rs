//! Catch rates of a condition, of the throws within reach.

use std::collections::BTreeMap;

use anyhow::Result;
use catch_body::statistics::wilson95;
use catch_lab::{
    evaluation::{Cell, Evaluation, Row},
    parallel,
    referee::reason::Reason,
    scenario::setup::Setup,
};

use crate::{Options, results::Entry, spread::percent};

/// Figures of each condition.
pub const FIGURES: [&str; 7] =
    ["trials", "within reach, %", "caught, %", "from, %", "to, %", "limits broken", "misses within reach"];

/// Sentence of a legend about the last of them.
pub const MISSES: &str = " [Statuses](../reference/statuses.md) explains the names of misses.";

/// The trials of a condition, the same number of each of its throws.
fn rows(setups: Vec<Setup>, options: &Options) -> Result<Vec<Row>> {
    setups.iter().for_each(Setup::prepare);
    let trials = options.trials.div_ceil(setups.len() as u64);
    let cells = setups.into_iter().map(Cell::new).collect();
    let evaluation = Evaluation { cells, seed: options.seed, first: 0, trials };
    let mut rows = Vec::new();
    evaluation.run(0, parallel::threads(), &mut |row, _| {
        rows.push(row);
        Ok(())
    })?;
    Ok(rows)
}

/// Summarizes the trials of a condition, one entry for each of [`FIGURES`].
pub fn figures(setups: Vec<Setup>, options: &Options) -> Result<Vec<Entry>> {
    let rows = rows(setups, options)?;
    let within: Vec<&Row> = rows.iter().filter(|row| !row.verdict.is_out_of_reach()).collect();
    let caught = within.iter().filter(|row| row.verdict.caught).count();
    let [low, high] = wilson95(caught, within.len());
    Ok(vec![
        Entry::Count(rows.len()),
        percent(within.len(), rows.len()),
        percent(caught, within.len()),
        Entry::Number(Some(100.0 * low)),
        Entry::Number(Some(100.0 * high)),
        Entry::Count(rows.iter().map(|row| row.verdict.limit_violations).sum()),
        misses(within.iter().filter_map(|row| row.verdict.reason)),
    ])
}

/// Misses of each reason by its name, the most frequent first.
pub fn misses(reasons: impl Iterator<Item = Reason>) -> Entry {
    let mut counts: BTreeMap<Reason, usize> = BTreeMap::new();
    reasons.for_each(|reason| *counts.entry(reason).or_default() += 1);
    let mut counts: Vec<(Reason, usize)> = counts.into_iter().collect();
    counts.sort_by_key(|(_, count)| std::cmp::Reverse(*count));
    let name = |reason: Reason| serde_json::to_string(&reason).unwrap_or_default().replace('"', "");
    Entry::text(
        counts.into_iter().map(|(reason, count)| format!("{count} {}", name(reason))).collect::<Vec<_>>().join(", "),
    )
}
