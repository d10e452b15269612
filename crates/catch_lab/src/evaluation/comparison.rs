//! Two evaluations of the same throws, compared throw by throw.

use std::{collections::HashMap, path::Path};

use catch_body::{InputError, statistics::paired95};
use serde::Serialize;

use crate::{
    evaluation::{Identity, Row, results},
    referee::reason::Reason,
    scenario::setup::Scene,
};
use catch_recording::whole_file::COMMAND_LINE;

/// Two evaluations, paired.
#[derive(Debug)]
pub struct Comparison {
    /// Identities of both.
    pub identities: [Identity; 2],
    /// Throws that both have.
    pub pairs: Vec<Pair>,
}

/// A throw in both evaluations.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Pair {
    /// Object thrown.
    pub object: String,
    /// Throw.
    pub throw: String,
    /// Number of the throw.
    pub index: u64,
    /// Outcome in each.
    pub caught: [bool; 2],
    /// Reason of the miss in each.
    pub reasons: [Option<Reason>; 2],
}

/// Counts of paired throws.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Counts {
    /// Throws that both have.
    pub trials: usize,
    /// Caught in both.
    pub both: usize,
    /// Caught in the first alone.
    pub only_a: usize,
    /// Caught in the second alone.
    pub only_b: usize,
    /// Caught in neither.
    pub neither: usize,
    /// Rate of the second less that of the first.
    pub difference: f64,
    /// Interval of the difference at 95 %, from the throws that differ.
    pub difference95: [f64; 2],
    /// Probability of a difference as large in throws that are as likely to change either way.
    pub mcnemar_p: f64,
}

impl Comparison {
    /// Reads two folders of results and pairs their throws by object, throw and number.
    ///
    /// # Errors
    /// Folders without complete results; different seeds; no throw that both have.
    pub fn read(folders: [&Path; 2]) -> Result<Self, InputError> {
        let [a, b] = folders.map(results::read);
        let ((identity_a, rows_a), (identity_b, rows_b)) = (a?, b?);
        if identity_a.seed != identity_b.seed {
            let found = format!("seeds {} and {}", identity_a.seed, identity_b.seed);
            return Err(InputError::new(COMMAND_LINE, "FILE", found, "two evaluations of one seed: the same throws"));
        }
        let key = |Scene { object, throw, index, .. }: &Scene| (object.clone(), throw.clone(), *index);
        let others: HashMap<_, &Row> = rows_b.iter().map(|row| (key(&row.scene), row)).collect();
        let pairs: Vec<Pair> =
            rows_a.iter().filter_map(|row| Some(Pair::of([row, others.get(&key(&row.scene))?]))).collect();
        if pairs.is_empty() {
            let expected = "two evaluations with an object and a throw in common";
            return Err(InputError::new(COMMAND_LINE, "FILE", "no throw that both have", expected));
        }
        Ok(Self { identities: [identity_a, identity_b], pairs })
    }

    /// Counts of each object and throw, and of all at the end.
    pub fn counts(&self) -> Vec<(String, Counts)> {
        let mut names: Vec<String> = Vec::new();
        for name in self.pairs.iter().map(Pair::name) {
            if !names.contains(&name) {
                names.push(name);
            }
        }
        let of = |name: &String| Counts::of(self.pairs.iter().filter(|pair| pair.name() == *name));
        let mut counts: Vec<(String, Counts)> = names.iter().map(|name| (name.clone(), of(name))).collect();
        if counts.len() > 1 {
            counts.push(("all".to_owned(), Counts::of(self.pairs.iter())));
        }
        counts
    }
}

impl Pair {
    fn of(rows: [&Row; 2]) -> Self {
        let Scene { object, throw, index, .. } = rows[0].scene.clone();
        let verdicts = rows.map(|row| &row.verdict);
        Self { object, throw, index, caught: verdicts.map(|it| it.caught), reasons: verdicts.map(|it| it.reason) }
    }

    /// Object and throw.
    pub fn name(&self) -> String {
        format!("{}, {}", self.object, self.throw)
    }
}

impl Counts {
    fn of<'a>(pairs: impl Iterator<Item = &'a Pair>) -> Self {
        let mut cells = [[0; 2]; 2];
        for pair in pairs {
            let [a, b] = pair.caught.map(usize::from);
            cells[a][b] += 1;
        }
        let [[neither, only_b], [only_a, both]] = cells;
        let trials = neither + only_b + only_a + both;
        Self {
            trials,
            both,
            only_a,
            only_b,
            neither,
            difference: (only_b as f64 - only_a as f64) / trials.max(1) as f64,
            difference95: paired95(only_b, only_a, trials),
            mcnemar_p: mcnemar_p(only_a, only_b),
        }
    }
}

/// The exact two-sided test: the probability of a split as uneven among the throws that changed.
///
/// (McNemar, Note on the sampling error of the difference between correlated proportions or percentages,
/// 1947.)
fn mcnemar_p(only_a: usize, only_b: usize) -> f64 {
    let (fewer, changed) = (only_a.min(only_b), only_a + only_b);
    // Binomial probabilities of one half, by their logarithms: those of many throws are below all numbers.
    let mut logarithm = -(changed as f64) * std::f64::consts::LN_2;
    let mut sum = libm::exp(logarithm);
    for k in 1..=fewer {
        logarithm += libm::log((changed - k + 1) as f64 / k as f64);
        sum += libm::exp(logarithm);
    }
    (2.0 * sum).min(1.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn pair(index: u64, caught: [bool; 2]) -> Pair {
        Pair { object: "ball".to_owned(), throw: "near".to_owned(), index, caught, reasons: [None; 2] }
    }

    #[test]
    fn counts_and_interval_come_from_the_throws_that_differ() {
        let outcomes = [[true, true], [true, false], [false, true], [false, true], [false, false]];
        let pairs: Vec<Pair> = (0..).zip(outcomes).map(|(index, caught)| pair(index, caught)).collect();
        let counts = Counts::of(pairs.iter());
        assert_eq!([counts.both, counts.only_a, counts.only_b, counts.neither], [1, 1, 2, 1]);
        assert!((counts.difference - 0.2).abs() < 1e-12);
        assert!(counts.difference95[0] < 0.2 && counts.difference95[1] > 0.2);
    }

    /// Values of R's `binom.test(fewer, changed)`.
    #[test]
    fn the_exact_test_agrees_with_published_values() {
        for (only_a, only_b, expected) in [(0, 0, 1.0), (0, 5, 0.0625), (3, 9, 0.145_996_093_75), (5, 5, 1.0)] {
            assert!((mcnemar_p(only_a, only_b) - expected).abs() < 1e-12, "{only_a} {only_b}");
        }
        assert!(mcnemar_p(100, 3_000) < 1e-300 && mcnemar_p(100, 3_000) >= 0.0);
    }
}
