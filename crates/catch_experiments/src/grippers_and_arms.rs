//! Catch rates of arms with hands, for throws past each arm where it can reach.

use anyhow::{Context, Result};
use catch_lab::{
    assets::Kind,
    scenario::setup::{Choice, Setup},
};
use serde::Deserialize;

use crate::{
    Findings, Options,
    rates::{self, FIGURES},
    results::{Entry, Table},
};

const LEGEND: &str = "Throws are past each arm where it can reach (`random_by_reach`). Each arm waits in the ready pose of its own file, the one of a \
scenario in the scenario's. `catchingbot check` lists for each gripper how wide and how fast objects may be. Misses are those of all three objects.";

/// Arms and hands of a scenario.
#[derive(Deserialize)]
struct Compared {
    scenario: Vec<Pairs>,
}

#[derive(Deserialize)]
struct Pairs {
    name: String,
    /// Arm and gripper.
    pairs: Vec<[String; 2]>,
}

/// Every pair and object, a table for each scenario.
pub fn run(options: &Options) -> Result<Findings> {
    let columns: Vec<&str> = ["arm", "gripper", "object"].into_iter().chain(FIGURES).collect();
    let compared: Compared =
        toml::from_str(include_str!("grippers_and_arms.toml")).context("grippers_and_arms.toml")?;
    let mut tables = Vec::new();
    for Pairs { name, pairs } in &compared.scenario {
        let mut table = Table::new(&format!("Caught of the throws within reach, `{name}`"), &columns).across("object");
        for [robot, gripper] in pairs {
            for object in Kind::Object.names() {
                let setup = Setup::load(&Choice {
                    scenario: Some(name),
                    robot: Some(robot),
                    gripper: Some(gripper),
                    object: Some(object),
                    throw: Some("random_by_reach"),
                    ..Choice::default()
                })?;
                let condition = [robot, gripper, object].map(Entry::text);
                table.rows.push(condition.into_iter().chain(rates::figures(vec![setup], options)?).collect());
            }
        }
        tables.push(table);
    }
    Ok(Findings { legend: [LEGEND, rates::DEFINED, rates::MISSES].concat(), tables })
}
