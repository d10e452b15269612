//! Catch rates with rigs of a few near cameras, placed well or anywhere, and in a room with people.

mod anywhere;
mod room;

use anyhow::Result;
use catch_lab::{
    assets::Kind,
    scenario::setup::{Choice, Setup},
};

use crate::{
    Options, kept, rates,
    results::{Entry, Table},
};

/// The built-in ones of near stereo cameras around the arm.
pub fn rigs() -> impl Iterator<Item = String> {
    (1..=4).map(|cameras| format!("d435_{cameras}"))
}

/// Settings of near cameras in the scenario honest: they run freely, without labels, calibrated as well as a
/// calibration on the arm achieves.
const SETTINGS: [&str; 7] = [
    "camera=d435",
    "arena.free_running_cameras=true",
    "arena.depth.model=\"near_stereo\"",
    "arena.depth.calibration_sd_m=0.0002",
    "arena.depth.calibration_sd_rad=0.0002",
    "brain.perception.camera_sd_rad=0.0",
    "brain.trajectory_prediction.systematic_sd_m=0.0003",
];

/// The scenario honest with one of them.
pub fn setup(rig: &str, object: &str) -> Result<Setup> {
    let rig = format!("flight_rig=\"{rig}\"");
    let settings: Vec<String> = [rig.as_str()].iter().chain(&SETTINGS).map(|&it| it.to_owned()).collect();
    let choice = Choice { scenario: Some("honest"), object: Some(object), settings: &settings, ..Choice::default() };
    Ok(Setup::load(&choice)?)
}

/// Every rig with every object.
fn placed(options: &Options) -> Result<Table> {
    let columns: Vec<&str> = ["rig", "object"].into_iter().chain(rates::FIGURES).collect();
    let mut table = Table::new("Caught with near cameras", &columns).across("object");
    for rig in rigs() {
        for object in Kind::Object.names() {
            let name = format!("{rig}-{object}-{}-{}", options.seed, options.trials);
            let figures = kept::part("placed", &name, || rates::figures(vec![setup(&rig, object)?], options))?;
            table.rows.push([vec![Entry::text(&rig), Entry::text(object)], figures].concat());
        }
    }
    Ok(table)
}

/// Rigs that were placed, others, and a room.
pub fn run(options: &Options) -> Result<Vec<Table>> {
    Ok([vec![placed(options)?], anywhere::tables(options)?, room::tables(options)?].concat())
}
