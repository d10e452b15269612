//! Recorded throws: predictions of their ends, and catch rates where they are repeated in the arena.

use std::path::Path;

use anyhow::{Context, Result};
use catch_lab::{
    assets::{Asset, Kind, Origin},
    flights::{
        flight_learning::{self, Lessons},
        flight_misses::{Seen, Throw, with_all},
        stretches::up,
        track_file,
    },
    scenario::setup::{Choice, Setup},
};

use crate::{
    Findings, Options,
    rates::{self, FIGURES},
    reliability,
    results::{Entry, Table},
};

const LEGEND: &str = "The tracks are throws by hand that motion capture recorded at 120 Hz: a bamboo stick, a banana and a gourd, 60 throws each \
(`data/nae_paper_dataset/origin` of github.com/Ngochuy2137/nae_dynamic, Apache License 2.0). The end of each track is predicted from its first half, \
or from all but its last tenths of a second. An error is the distance from the predicted to the recorded end.";
const REPEATED: &str = "\n\nThe same throws are repeated in the scenario `honest-aero`, each turned about the vertical and moved past the arm. \
The built-in object of the recorded one's name stands for it, or else each of them. *Released*: the object leaves the hand as recorded and flies by the \
arena's physics. *Recorded*: the object moves along the recording until something touches it. Sensors *paper*: labels, exact depth, no image lost, no \
latency of the cameras.";

/// Recorded throws that are learned from at least, and parts of the cross-validation.
const LEAST_THROWS: usize = 5;
const FOLDS: usize = 5;
/// Exact cameras, as settings.
const PAPER: &[&str] =
    &["camera=perfect", "arena.labels=true", "arena.latency_s=0.0", "arena.depth={ model = \"perfect\" }"];

/// Every folder of recordings, object, flight and sensors.
pub fn run(options: &Options) -> Result<Findings> {
    let columns: Vec<&str> = ["recorded", "thrown", "sensors", "flight"].into_iter().chain(FIGURES).collect();
    let mut table = Table::new("Caught of the throws within reach", &columns).across("flight");
    for folder in options.tracks("flights")? {
        let recorded = name(folder);
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
                    let condition = [recorded.as_str(), object, sensors, flight].map(Entry::text);
                    table.rows.push(condition.into_iter().chain(rates::figures(setups, options)?).collect());
                }
            }
        }
    }
    let mut tables = predicted(options)?;
    tables.push(table);
    Ok(Findings { legend: [LEGEND, reliability::COVERED, REPEATED, rates::DEFINED, rates::MISSES].concat(), tables })
}

/// Each object's throws by what other throws taught, and by what the other objects taught.
fn predicted(options: &Options) -> Result<Vec<Table>> {
    let throws = options.tracks.iter().map(|it| read(it)).collect::<Result<Vec<_>>>()?;
    let learned = flight_learning::lessons(&throws, FOLDS, || ()).ok();
    let Lessons { own, others, .. } = learned.context("no flight in any of the tracks")?;
    let named = |misses| with_all(options.tracks.iter().map(|it| name(it)), misses);
    let seen = || {
        Seen::ALL.map(|seen| match seen {
            Seen::Half => "half of the throw".to_owned(),
            Seen::AllBut(to_go_s) => format!("{to_go_s} s to go"),
        })
    };
    let mut tables = vec![reliability::table("Ends, learned from other throws of the object", &seen(), named(own))];
    if !others.is_empty() {
        tables.push(reliability::table("Ends, learned from the other objects", &seen(), named(others)));
    }
    Ok(tables)
}

fn read(folder: &Path) -> Result<Vec<Throw>> {
    let first = track_file::in_folder(folder, LEAST_THROWS)?.swap_remove(0);
    let up = up(&track_file::read(&first)?.0);
    Ok(Throw::read_folder(folder, up, LEAST_THROWS)?)
}

fn name(folder: &Path) -> String {
    folder.file_name().unwrap_or(folder.as_os_str()).to_string_lossy().into_owned()
}

/// Returns the setup with the throws that are recorded in a folder.
fn thrown(setup: &Setup, folder: &Path, flight: &str) -> Result<Setup> {
    let name = name(folder);
    let text = format!("[motion]\nkind = \"recorded\"\nflight = \"{flight}\"\n");
    let origin = Origin::Disk(folder.to_path_buf());
    let throw = Asset { name: name.clone(), file: folder.display().to_string(), text, origin }.throw()?;
    Ok(setup.with_throw(name, throw.for_arm(setup.robot.length_m())))
}
