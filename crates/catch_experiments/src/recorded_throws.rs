//! Catch rates of throws that were recorded, repeated in the arena.

use std::path::Path;

use anyhow::{Context, Result};
use catch_lab::{
    assets::{Asset, Kind, Origin},
    scenario::setup::{Choice, Setup},
};

use crate::{
    Findings, Options,
    rates::{self, FIGURES},
    results::{Entry, Table},
};

const LEGEND: &str = "Recorded throws of real objects ([their source](flights.md)) are repeated in the scenario `honest-aero`, each turned about the \
vertical and moved past the arm. The built-in object of the recorded one's name stands for it, or else each of them. *Released*: it leaves the hand as recorded and flies by the \
arena's physics. *Recorded*: it moves along the recording until something touches it. Sensors *paper*: labels, exact depth, no image lost, no \
latency of the cameras; all else as in the scenario. The rate *caught* is of those within reach, with its interval (Wilson, 95 %).";

/// Exact cameras, as settings.
const PAPER: &[&str] =
    &["camera=perfect", "arena.labels=true", "arena.latency_s=0.0", "arena.depth={ model = \"perfect\" }"];

/// Every folder of recordings, object, flight and sensors.
pub fn run(options: &Options) -> Result<Findings> {
    let columns: Vec<&str> = ["recorded", "thrown", "flight", "sensors"].into_iter().chain(FIGURES).collect();
    let mut table = Table::new("Caught of the throws within reach", &columns);
    for folder in options.tracks("recorded-throws")? {
        let recorded = folder.file_name().map(|it| it.to_string_lossy().into_owned()).unwrap_or_default();
        let objects = Kind::Object.names();
        let itself = objects.iter().find(|it| **it == recorded);
        for object in itself.map_or(&objects[..], std::slice::from_ref) {
            for (sensors, settings) in [("paper", PAPER), ("honest", &[])] {
                let settings: Vec<String> = settings.iter().map(|&it| it.to_owned()).collect();
                let scenario = Some("honest-aero");
                let choice = Choice { scenario, object: Some(object), settings: &settings, ..Choice::default() };
                let setup = Setup::load(&choice)?;
                for flight in ["released", "recorded"] {
                    let setups = vec![thrown(&setup, folder, flight)?];
                    let condition = [recorded.as_str(), object, flight, sensors].map(Entry::text);
                    table.rows.push(condition.into_iter().chain(rates::figures(setups, options)?).collect());
                }
            }
        }
    }
    Ok(Findings { legend: LEGEND, tables: vec![table] })
}

/// Returns the setup with the throws that are recorded in a folder.
fn thrown(setup: &Setup, folder: &Path, flight: &str) -> Result<Setup> {
    let name = folder.file_name().context("a folder with a name")?.to_string_lossy().into_owned();
    let text = format!("[motion]\nkind = \"recorded\"\nflight = \"{flight}\"\n");
    let origin = Origin::Disk(folder.to_path_buf());
    let throw = Asset { name: name.clone(), file: folder.display().to_string(), text, origin }.throw()?;
    Ok(setup.with_throw(name, throw.for_arm(setup.robot.length_m())))
}
