//! Pages that only list conditions: catch rates of each with every object.

use anyhow::{Context, Result};
use catch_lab::{
    assets::Kind,
    scenario::setup::{Choice, Setup},
};
use serde::Deserialize;

use crate::{
    Options,
    rates::{self, FIGURES},
    results::{Entry, Table},
};

/// Tables of a page.
#[derive(Deserialize)]
struct Page {
    table: Vec<Listed>,
}

/// A table; the columns of a condition are parts of it by their names.
#[derive(Deserialize)]
struct Listed {
    title: String,
    across: Option<String>,
    columns: Vec<String>,
    conditions: Vec<Vec<String>>,
    /// Parts that all conditions have in common.
    scenario: Option<String>,
    throws: Option<String>,
}

/// The tables of a page.
pub fn run(page: &str, options: &Options) -> Result<Vec<Table>> {
    let Page { table } = toml::from_str(page)?;
    table.iter().map(|listed| measured(listed, options)).collect()
}

fn measured(listed: &Listed, options: &Options) -> Result<Table> {
    let columns = listed.columns.iter().map(String::as_str).chain(["object"]).chain(FIGURES).collect::<Vec<_>>();
    let mut table = Table { across: listed.across.clone(), ..Table::new(&listed.title, &columns) };
    for condition in &listed.conditions {
        let part = |name: &str| listed.columns.iter().zip(condition).find(|it| it.0 == name).map(|it| it.1.as_str());
        let throws = part("throws").or(listed.throws.as_deref()).context("a page names its throws")?;
        for object in Kind::Object.names() {
            let load = |throw: &str| {
                Setup::load(&Choice {
                    scenario: part("scenario").or(listed.scenario.as_deref()),
                    robot: part("arm"),
                    gripper: part("gripper"),
                    workcell: part("workcell").filter(|it| *it != "–"),
                    object: Some(object),
                    throw: Some(throw),
                    ..Choice::default()
                })
            };
            let setups = throws.split(", ").map(load).collect::<Result<Vec<_>, _>>()?;
            let labels = condition.iter().map(String::as_str).chain([object]).map(Entry::text);
            table.rows.push(labels.chain(rates::figures(setups, options)?).collect());
        }
    }
    Ok(table)
}
