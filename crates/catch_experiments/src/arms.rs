//! Catch rate of each built-in arm for the throws within its reach, and its search times.

use anyhow::Result;
use catch_bot::{
    trajectory_optimization::{Incoming, Start, failure_counter::FailureCounter},
    trajectory_prediction::FlightTrajectory,
};
use catch_cell::Setpoint;
use catch_lab::{
    assets::Kind,
    scenario::setup::{Choice, Setup},
};

use crate::{
    Findings, Options,
    rates::{self, FIGURES},
    results::{Entry, Table},
    spread::{percent, quantiles},
    stage_times::cpu_ms,
};

const LEGEND: &str = "Each arm waits in the ready pose of its own file, the one of a scenario in the scenario's. A throw is *within reach* if it was \
caught. It also is if the oracle finds it possible for an arm that begins to move 60 ms after the first image. The oracle knows \
neither the object's shape nor how fast the fingers are. *Random by reach* are throws past each arm where it can reach. The rate \
*caught* is of those within reach, with its interval (Wilson, 95 %). The *first search* is the CPU time of one thread at the \
first estimate, 70 ms after the release. It has as many passes as the bound on the work allows. An arm's reach map is worked out \
beforehand.";

/// Scenarios, and the throws that are counted together.
const CONDITIONS: [(&str, &str, &[&str]); 3] = [
    ("paper", "near and far", &["near_sampled", "far_sampled"]),
    ("paper", "random by reach", &["random_by_reach"]),
    ("honest", "random by reach", &["random_by_reach"]),
];
/// Usual time of the brain's first estimate, in seconds.
const FIRST_ESTIMATE_S: f64 = 0.07;

/// Every arm, scenario and object.
pub fn run(options: &Options) -> Result<Findings> {
    let columns: Vec<&str> = ["arm", "scenario", "throws", "object"].into_iter().chain(FIGURES).collect();
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
                let row = rates::figures(setups, options)?;
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

/// The CPU time of the first search for each throw in ms, and whether it found a catch.
fn first_searches(setup: &Setup, options: &Options) -> Vec<(f64, bool)> {
    let (known, config) = (setup.known(), setup.brain_config(options.seed, 0).grasp_selection);
    let search = known.search();
    let start = Start { time_s: FIRST_ESTIMATE_S, state: Setpoint::at_rest(setup.robot.ready_q) };
    let timed = |index| {
        let release = setup.release(options.seed, index);
        let flight = FlightTrajectory {
            p_WOcm: release.p_WO,
            v_WOcm: release.v_WO,
            R_WO: release.q_WO,
            w_WO: release.omega_WO,
            ..FlightTrajectory::default()
        };
        let failures = FailureCounter::default();
        let incoming = Incoming { flight: &flight, grasps: known.grasps(), config: &config, failures: &failures };
        let before_ms = cpu_ms();
        let found = search.search_in_passes(&mut 0, &start, &incoming, search.departure_s(&start));
        (cpu_ms() - before_ms, found.is_ok())
    };
    (0..options.trials).map(timed).collect()
}
