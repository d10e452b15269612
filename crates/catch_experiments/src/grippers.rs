//! Catch rates of the built-in grippers on two arms, and the reasons of their misses.

use anyhow::Result;
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

const LEGEND: &str = "Throws are past each arm where it can reach (`random_by_reach`), and within reach as on the page of the arms. The rate *caught* \
is of those, with its interval (Wilson, 95 %). In `paper` the fingers have no limit of speed: grippers differ by shape and force alone. In \
`honest` they have the limits of their files. `catchingbot check` tells for each gripper how wide and how fast objects may be.";

/// The file that names the arms.
const FILE: &str = include_str!("grippers.toml");

#[derive(Deserialize)]
struct Compared {
    arms: Vec<String>,
}

/// Every arm, gripper, scenario and object.
pub fn run(options: &Options) -> Result<Findings> {
    let columns: Vec<&str> = ["arm", "gripper", "scenario", "object"].into_iter().chain(FIGURES).collect();
    let mut table = Table::new("Caught of the throws within reach", &columns);
    for robot in &toml::from_str::<Compared>(FILE)?.arms {
        for gripper in Kind::Gripper.names() {
            for scenario in ["paper", "honest"] {
                for object in Kind::Object.names() {
                    let setup = Setup::load(&Choice {
                        scenario: Some(scenario),
                        robot: Some(robot),
                        gripper: Some(gripper),
                        object: Some(object),
                        throw: Some("random_by_reach"),
                        ..Choice::default()
                    })?;
                    let condition = [robot.as_str(), gripper, scenario, object].map(Entry::text);
                    table.rows.push(condition.into_iter().chain(rates::figures(vec![setup], options)?).collect());
                }
            }
        }
    }
    Ok(Findings { legend: LEGEND, tables: vec![table] })
}
