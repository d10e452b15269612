//! CPU time of the brain's stages.

use std::collections::BTreeMap;

use anyhow::Result;
use catch_cell::{Brain, Probe};
use catch_lab::assets::Kind;

use crate::{
    Findings, Options,
    flights::{Condition, look, noises_and_labels},
    near_rates,
    results::{Entry, Table},
    spread::quantiles,
};

const LEGEND: &str = "CPU time of one thread in ms, over the ticks of the first 200 ms of each throw, in which the stage ran. A *first pose* is perception in \
ticks that find the object without a prediction. An *update* is perception and prediction together in ticks that find it where it was predicted.";

/// Stages of an update of a tracked object.
const UPDATE: [&str; 2] = ["perception", "trajectory_prediction"];

/// CPU time of this thread in milliseconds, which other programs hardly disturb; not a number where it cannot
/// be told.
pub fn cpu_ms() -> f64 {
    #[cfg(unix)]
    let time = rustix::time::clock_gettime(rustix::time::ClockId::ThreadCPUTime);
    #[cfg(unix)]
    return time.tv_sec as f64 * 1e3 + time.tv_nsec as f64 * 1e-6;
    #[cfg(not(unix))]
    f64::NAN
}

/// Takes the CPU time of the stages of a tick.
struct CpuWatch {
    last_ms: f64,
    laps: Vec<(&'static str, f64)>,
}

impl Probe for CpuWatch {
    fn stage_ended(&mut self, stage: &'static str) {
        let now_ms = cpu_ms();
        self.laps.push((stage, now_ms - std::mem::replace(&mut self.last_ms, now_ms)));
    }
}

/// Two near cameras that run freely, without labels.
fn near() -> Condition {
    let settings = ["flight_rig=\"d435_2\""].into_iter().chain(near_rates::SETTINGS).collect();
    Condition { labels: vec!["two near cameras of 848×480", "no"], scenario: "honest", throws: &["random"], settings }
}

/// Each stage by depth noise, with labels and without; one throw after the other, so that none shares a core
/// with another.
pub fn run(options: &Options) -> Result<Findings> {
    let columns = ["noise", "labels", "object", "stage", "ticks", "p50, ms", "p99, ms", "max, ms"];
    let mut table = Table::new("By noise", &columns);
    for condition in noises_and_labels().into_iter().chain([near()]) {
        for object in Kind::Object.names() {
            let setups = condition.setups(object)?;
            let mut times: BTreeMap<&str, Vec<f64>> = BTreeMap::new();
            for index in 0..options.trials {
                let setup = &setups[index as usize % setups.len()];
                look(setup, options.seed, index, &mut |brain, observation| {
                    let mut watch = CpuWatch { last_ms: cpu_ms(), laps: Vec::new() };
                    let command = brain.tick(observation, &mut watch);
                    let pose = brain.report().pose;
                    let is_first = pose.is_some_and(|pose| pose.registered_globally);
                    // Perception and prediction of what is tracked.
                    if pose.is_some() && !is_first {
                        let lap_ms = watch.laps.iter().filter(|lap| UPDATE.contains(&lap.0)).map(|lap| lap.1).sum();
                        times.entry("update").or_default().push(lap_ms);
                    }
                    for (stage, lap_ms) in watch.laps {
                        let stage = if is_first && stage == "perception" { "first pose" } else { stage };
                        times.entry(stage).or_default().push(lap_ms);
                    }
                    command
                });
            }
            for (stage, times) in times {
                let labels = condition.labels.iter().copied().chain([object, stage]).map(Entry::text);
                let figures = quantiles(&times, [0.5, 0.99, 1.0], 1.0);
                table.rows.push(labels.chain([Entry::Count(times.len())]).chain(figures).collect());
            }
        }
    }
    Ok(Findings { legend: LEGEND, tables: vec![table] })
}
