//! What each built-in arm catches of the throws that are within its reach, and how long it searches.

use std::collections::BTreeMap;

use anyhow::Result;
use catch_bot::{
    trajectory_optimization::{Incoming, Start},
    trajectory_prediction::FlightTrajectory,
};
use catch_cell::Setpoint;
use catch_lab::{
    assets::Kind,
    evaluation::{Cell, Evaluation, Row},
    referee::reason::Reason,
    scenario::setup::{Choice, Setup},
    statistics::wilson95,
};

use crate::{
    Findings, Options, parallel,
    results::{Entry, Table},
    spread::{percent, quantiles},
    stage_times::cpu_ms,
};

const LEGEND: &str = "Each arm waits in the ready pose of its own file, the one of a scenario in the scenario's. A throw is *within \
reach* if it was caught, or if the oracle finds it possible for an arm that begins to move 60 ms after the first image. The oracle knows \
neither the object's shape nor how fast the fingers are. The rate *caught* is of those within reach, with its interval (Wilson, 95 %). \
The *first search* is the CPU time of one thread for all passes that the bound on the work allows at the first estimate, 70 ms after the \
release. An arm's reach map is worked out beforehand.";

/// Scenarios, and the throws that are counted together.
const CONDITIONS: [(&str, &str, &[&str]); 3] = [
    ("paper", "near and far", &["near_sampled", "far_sampled"]),
    ("paper", "random", &["random"]),
    ("honest", "random", &["random"]),
];
/// When the brain usually has its first estimate.
const FIRST_ESTIMATE_S: f64 = 0.07;

/// Every arm, scenario and object.
pub fn run(options: &Options) -> Result<Findings> {
    let columns = [
        "arm",
        "scenario",
        "throws",
        "object",
        "trials",
        "within reach, %",
        "caught, %",
        "from, %",
        "to, %",
        "limits broken",
        "misses within reach",
    ];
    let mut caught = Table::new("Caught of the throws within reach", &columns);
    let columns = ["arm", "searches", "found, %", "p50, ms", "p99, ms", "max, ms"];
    let mut times = Table::new("First search", &columns);
    for robot in Kind::Robot.names() {
        let load = |scenario, object, throw| {
            Setup::load(&Choice {
                scenario: Some(scenario),
                robot: Some(robot),
                object: Some(object),
                throw: Some(throw),
                ..Choice::default()
            })
        };
        let mut searches = Vec::new();
        for (scenario, called, throws) in CONDITIONS {
            for object in Kind::Object.names() {
                let setups = throws.iter().map(|throw| load(scenario, object, throw));
                let setups = setups.collect::<Result<Vec<_>, _>>()?;
                if scenario == "paper" {
                    searches.extend(setups.iter().flat_map(|setup| first_searches(setup, options)));
                }
                let condition = [robot, scenario, called, object].map(Entry::text);
                let row = figures(&rows(setups, options)?);
                caught.rows.push(condition.into_iter().chain(row).collect());
            }
        }
        let found = searches.iter().filter(|(_, found)| *found).count();
        let times_ms: Vec<f64> = searches.iter().map(|(time_ms, _)| *time_ms).collect();
        let counts = [Entry::text(robot), Entry::Count(searches.len()), percent(found, searches.len())];
        times.rows.push(counts.into_iter().chain(quantiles(&times_ms, [0.5, 0.99, 1.0], 1.0)).collect());
    }
    Ok(Findings { legend: LEGEND, tables: vec![caught, times] })
}

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

/// What they say together.
fn figures(rows: &[Row]) -> Vec<Entry> {
    let within: Vec<&Row> = rows.iter().filter(|row| !row.verdict.is_out_of_reach()).collect();
    let caught = within.iter().filter(|row| row.verdict.caught).count();
    let mut reasons: BTreeMap<Reason, usize> = BTreeMap::new();
    for reason in within.iter().filter_map(|row| row.verdict.reason) {
        *reasons.entry(reason).or_default() += 1;
    }
    let mut reasons: Vec<(Reason, usize)> = reasons.into_iter().collect();
    reasons.sort_by_key(|(_, count)| std::cmp::Reverse(*count));
    let reasons: Vec<String> = reasons.iter().map(|(reason, count)| format!("{count}× {reason}")).collect();
    let [low, high] = wilson95(caught, within.len());
    vec![
        Entry::Count(rows.len()),
        percent(within.len(), rows.len()),
        percent(caught, within.len()),
        Entry::Number(Some(100.0 * low)),
        Entry::Number(Some(100.0 * high)),
        Entry::Count(rows.iter().map(|row| row.verdict.limit_violations).sum()),
        Entry::text(reasons.join(", ")),
    ]
}

/// The CPU time of the first search for each throw in ms, and whether it found a catch.
fn first_searches(setup: &Setup, options: &Options) -> Vec<(f64, bool)> {
    let (known, config) = (setup.known(), setup.brain_config(options.seed, 0).grasp_selection);
    let search = known.search();
    let start = Start { time_s: FIRST_ESTIMATE_S, state: Setpoint::at_rest(setup.robot.ready_q) };
    let timed = |index| {
        let release = setup.release(options.seed, index);
        let flight = FlightTrajectory {
            p_WO: release.p_WO,
            v_WO: release.v_WO,
            R_WO: release.q_WO,
            w_WO: release.omega_WO,
            ..FlightTrajectory::default()
        };
        let incoming = Incoming { flight: &flight, grasps: known.grasps(), config: &config };
        let before_ms = cpu_ms();
        let found = search.search_in_passes(&mut 0, &start, &incoming, search.departure_s(&start));
        (cpu_ms() - before_ms, found.is_ok())
    };
    (0..options.trials).map(timed).collect()
}
