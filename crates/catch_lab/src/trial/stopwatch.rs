//! Wall time of the brain's stages. The brain itself reads no clock; it only says when a stage has ended.

use std::{
    collections::BTreeMap,
    time::{Duration, Instant},
};

use catch_cell::Probe;
use serde::{Deserialize, Serialize};

/// Takes the time of every stage in every tick.
#[derive(Debug, Clone)]
pub struct Stopwatch {
    last: Instant,
    started: Instant,
    /// Stage by stage in the order of the pipeline: how often it took how many units.
    laps: Vec<(&'static str, Laps)>,
    /// Laps of the last tick.
    newest: Vec<(&'static str, u32)>,
    /// The whole of the last tick.
    whole: Duration,
}

/// Number of laps of each duration, in units of 0.1 µs. Evaluations measure millions, few of which differ
/// after rounding.
type Laps = BTreeMap<u32, usize>;

/// Name under which the time of whole ticks is kept.
const WHOLE_TICK: &str = "tick";

impl Default for Stopwatch {
    fn default() -> Self {
        let now = Instant::now();
        Self { last: now, started: now, laps: Vec::new(), newest: Vec::new(), whole: Duration::ZERO }
    }
}

impl Stopwatch {
    /// A tick begins.
    pub fn start(&mut self) {
        self.newest.clear();
        self.last = Instant::now();
        self.started = self.last;
    }

    /// A tick has ended.
    pub fn stop(&mut self) {
        let lap = self.started.elapsed();
        self.whole = lap;
        *self.laps_of(WHOLE_TICK).entry(units(lap)).or_default() += 1;
    }

    /// Returns the duration of the whole of the last tick, in seconds.
    pub fn last_tick_s(&self) -> f64 {
        self.whole.as_secs_f64()
    }

    /// Returns the duration of each stage in the last tick, in milliseconds, in the order of the pipeline.
    pub fn last_tick_ms(&self) -> Vec<(&'static str, f64)> {
        self.newest.iter().map(|&(stage, lap)| (stage, f64::from(lap) / 1e4)).collect()
    }

    /// Adds what another one has measured.
    pub fn merge(&mut self, other: Self) {
        for (stage, laps) in other.laps {
            let of_stage = self.laps_of(stage);
            for (lap, count) in laps {
                *of_stage.entry(lap).or_default() += count;
            }
        }
    }

    fn laps_of(&mut self, stage: &'static str) -> &mut Laps {
        let known = self.laps.iter().position(|(name, _)| *name == stage);
        let at = known.unwrap_or_else(|| {
            self.laps.push((stage, Laps::new()));
            self.laps.len() - 1
        });
        &mut self.laps[at].1
    }

    /// Each time that a stage took, in milliseconds, and how often it did; shorter ones first.
    pub fn laps_ms(&self, stage: &str) -> impl Iterator<Item = (f64, usize)> {
        let of_stage = self.laps.iter().filter(move |(name, _)| *name == stage);
        of_stage.flat_map(|(_, laps)| laps.iter().map(|(lap, count)| (f64::from(*lap) / 1e4, *count)))
    }

    /// Median, 99th percentile and maximum per stage, in the order of the pipeline.
    pub fn summary(&self) -> Vec<(&'static str, StageTimes)> {
        let mut summary: Vec<_> = self.laps.iter().map(|(stage, laps)| (*stage, StageTimes::of(laps))).collect();
        summary.sort_by_key(|(stage, _)| *stage == WHOLE_TICK);
        summary
    }
}

impl Probe for Stopwatch {
    fn stage_ended(&mut self, stage: &'static str) {
        let now = Instant::now();
        let lap = now - std::mem::replace(&mut self.last, now);
        *self.laps_of(stage).entry(units(lap)).or_default() += 1;
        self.newest.push((stage, units(lap)));
    }
}

/// A time in units of 0.1 µs to three digits, at most seven minutes.
fn units(lap: Duration) -> u32 {
    let units = u32::try_from(lap.as_nanos() / 100).unwrap_or(u32::MAX);
    let last_digit = 10u32.pow(units.checked_ilog10().unwrap_or(0).saturating_sub(2));
    units / last_digit * last_digit
}

/// Wall time of one stage, over all ticks in which it ran.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct StageTimes {
    /// Number of runs.
    pub count: usize,
    /// Median in milliseconds.
    pub p50_ms: f64,
    /// 99th percentile.
    pub p99_ms: f64,
    /// The longest.
    pub max_ms: f64,
}

impl StageTimes {
    fn of(laps: &Laps) -> Self {
        let total: usize = laps.values().sum();
        // The smallest value that the fraction of all values does not exceed.
        let quantile = |fraction: f64| {
            let rank = (fraction * total as f64).ceil().max(1.0) as usize;
            let mut seen = 0;
            let found = laps.iter().find(|(_, count)| {
                seen += **count;
                seen >= rank
            });
            found.map_or(0.0, |(lap, _)| f64::from(*lap) / 1e4)
        };
        Self { count: total, p50_ms: quantile(0.5), p99_ms: quantile(0.99), max_ms: quantile(1.0) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantiles_are_values_that_were_measured() {
        let of = |laps_ms: std::ops::RangeInclusive<u64>| {
            StageTimes::of(&laps_ms.map(|ms| (units(Duration::from_millis(ms)), 1)).collect())
        };
        assert_eq!(of(1..=100), StageTimes { count: 100, p50_ms: 50.0, p99_ms: 99.0, max_ms: 100.0 });
        assert_eq!(of(7..=7).p50_ms, 7.0);
    }

    #[test]
    fn laps_keep_three_digits_and_add_up() {
        assert_eq!(
            [0, 99, 100, 123_456, 99_999_900].map(|ns| units(Duration::from_nanos(ns))),
            [0, 0, 1, 1230, 999_000]
        );
        let mut both = Stopwatch::default();
        for _ in 0..2 {
            let mut one = Stopwatch::default();
            one.start();
            one.stop();
            both.merge(one);
        }
        assert_eq!(both.summary()[0].1.count, 2);
        assert_eq!(both.laps_ms(WHOLE_TICK).map(|(_, count)| count).sum::<usize>(), 2);
        assert_eq!(both.laps_ms("no stage").count(), 0);
    }
}
