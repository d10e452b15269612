//! Wall time of the brain's stages. The brain itself reads no clock; it only says when a stage has ended.

use std::time::{Duration, Instant};

use catch_cell::Probe;
use serde::{Deserialize, Serialize};

/// Takes the time of every stage in every tick.
#[derive(Debug, Clone)]
pub struct Stopwatch {
    last: Instant,
    started: Instant,
    /// Stage by stage in the order of the pipeline, in units of 0.1 µs, small because evaluations keep millions of them.
    laps: Vec<(&'static str, Vec<u32>)>,
    /// Those of the last tick.
    newest: Vec<(&'static str, u32)>,
    /// The whole of the last tick.
    whole: Duration,
}

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
        self.laps_of(WHOLE_TICK).push(units(lap));
    }

    /// What the whole of the last tick took, in seconds.
    pub fn last_tick_s(&self) -> f64 {
        self.whole.as_secs_f64()
    }

    /// What each stage took in the last tick, in milliseconds, in the order of the pipeline.
    pub fn last_tick_ms(&self) -> Vec<(&'static str, f64)> {
        self.newest.iter().map(|&(stage, lap)| (stage, f64::from(lap) / 1e4)).collect()
    }

    /// Adds what another one has measured.
    pub fn merge(&mut self, other: Self) {
        for (stage, laps) in other.laps {
            self.laps_of(stage).extend(laps);
        }
    }

    fn laps_of(&mut self, stage: &'static str) -> &mut Vec<u32> {
        let known = self.laps.iter().position(|(name, _)| *name == stage);
        let at = known.unwrap_or_else(|| {
            self.laps.push((stage, Vec::new()));
            self.laps.len() - 1
        });
        &mut self.laps[at].1
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
        self.laps_of(stage).push(units(lap));
        self.newest.push((stage, units(lap)));
    }
}

/// A time in units of 0.1 µs, at most seven minutes.
fn units(lap: Duration) -> u32 {
    u32::try_from(lap.as_nanos() / 100).unwrap_or(u32::MAX)
}

/// Wall time of one stage, over all ticks in which it ran.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct StageTimes {
    /// How often it ran.
    pub count: usize,
    /// Median in milliseconds.
    pub p50_ms: f64,
    /// 99th percentile.
    pub p99_ms: f64,
    /// The longest.
    pub max_ms: f64,
}

impl StageTimes {
    fn of(laps: &[u32]) -> Self {
        let mut sorted = laps.to_vec();
        sorted.sort_unstable();
        // The smallest value that the share of all values does not exceed.
        let quantile = |share: f64| {
            let rank = (share * sorted.len() as f64).ceil() as usize;
            sorted.get(rank.max(1) - 1).map_or(0.0, |&lap| f64::from(lap) / 1e4)
        };
        Self { count: laps.len(), p50_ms: quantile(0.5), p99_ms: quantile(0.99), max_ms: quantile(1.0) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantiles_are_values_that_were_measured() {
        let laps: Vec<u32> = (1..=100).rev().map(|ms| units(Duration::from_millis(ms))).collect();
        assert_eq!(StageTimes::of(&laps), StageTimes { count: 100, p50_ms: 50.0, p99_ms: 99.0, max_ms: 100.0 });
        assert_eq!(StageTimes::of(&laps[..1]).p50_ms, 100.0);
    }
}
