//! Catch rates of the built-in arm for the built-in objects.

use anyhow::Result;
use catch_lab::{
    assets::Kind,
    scenario::setup::{Choice, Setup},
};

use crate::{
    Findings, Options,
    rates::{self, FIGURES},
    results::{Entry, Table},
};

const LEGEND: &str = "An object is *caught* if it is held from 0.5 s to 1.5 s after the first contact, the last 0.5 s shaken at ±5 m/s². \
No command may break a limit of the arm; *limits broken* counts those that commands broke. A throw is *within reach* if it was caught, or if the oracle finds it possible. \
The oracle's arm begins to move 30 ms after the first image. The rate *caught* is of throws within reach.";

/// Scenarios, workcells, and the throws that are counted together.
const CONDITIONS: [(&str, Option<&str>, &[&str]); 6] = [
    ("honest", None, &["random"]),
    ("honest-aero", None, &["random"]),
    ("lab", None, &["by_hand"]),
    ("paper", None, &["near_sampled", "far_sampled"]),
    ("paper", None, &["random_by_reach"]),
    ("paper", Some("table_and_fence"), &["near_sampled", "far_sampled"]),
];

/// Every scenario and object.
pub fn run(options: &Options) -> Result<Findings> {
    let columns: Vec<&str> = ["scenario", "workcell", "throws", "object"].into_iter().chain(FIGURES).collect();
    let mut caught = Table::new("Caught of the throws within reach", &columns);
    for (scenario, workcell, throws) in CONDITIONS {
        for object in Kind::Object.names() {
            let load = |throw: &&str| {
                let scenario = Some(scenario);
                Setup::load(&Choice {
                    scenario,
                    workcell,
                    object: Some(object),
                    throw: Some(throw),
                    ..Choice::default()
                })
            };
            let setups = throws.iter().map(load).collect::<Result<Vec<_>, _>>()?;
            let condition = [scenario, workcell.unwrap_or("–"), &throws.join(", "), object].map(Entry::text);
            caught.rows.push(condition.into_iter().chain(rates::figures(setups, options)?).collect());
        }
    }
    Ok(Findings { legend: [LEGEND, rates::MISSES].concat(), tables: vec![caught] })
}
