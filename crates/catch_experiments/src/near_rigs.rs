//! What rigs of a few near cameras see of throws, the arm waiting between them.

use anyhow::Result;
use catch_cell::Cell;
use catch_lab::{
    assets::Kind,
    scenario::setup::{Choice, Setup},
};

use crate::{
    Findings, Options, parallel,
    results::{Entry, Table},
};

/// The built-in ones of near stereo cameras around the arm.
pub fn rigs() -> impl Iterator<Item = String> {
    (1..=4).map(|cameras| format!("d435_{cameras}"))
}

/// What near cameras change of the scenario honest: they run freely, without labels, calibrated to what calibration on the arm leaves. Where the
/// object flies is known late, so corrections take what reach single joints have left.
pub const SETTINGS: [&str; 8] = [
    "camera=d435",
    "arena.free_running_cameras=true",
    "arena.depth.model=\"near_stereo\"",
    "arena.depth.calibration_sd_m=0.0002",
    "arena.depth.calibration_sd_rad=0.0002",
    "brain.perception.camera_sd_rad=0.0",
    "brain.trajectory_prediction.systematic_sd_m=0.0003",
    "brain.trajectory_optimization.reach_fractions=[0.97, 0.9, 0.8]",
];

/// The scenario honest with one of them.
pub fn setup(rig: &str, object: &str, settings: &[&str]) -> Result<Setup> {
    let rig = format!("flight_rig=\"{rig}\"");
    let settings: Vec<String> =
        [rig.as_str()].iter().chain(&SETTINGS).chain(settings).map(|&it| it.to_owned()).collect();
    let choice = Choice { scenario: Some("honest"), object: Some(object), settings: &settings, ..Choice::default() };
    Ok(Setup::load(&choice)?)
}

/// Rigs of more cameras surround the throw, and see it anyway.
const MOST_CAMERAS: usize = 4;
/// Pixels of an object that say something about where it is.
const MIN_PIXELS: usize = 30;
/// The last images of a flight: 0.2 s.
const LAST: usize = 20;
/// When a flight is over that passes the base's axis nowhere before.
const LONGEST_S: f64 = 1.5;

const LEGEND: &str = "Images every 10 ms from the release until the object of the scenario is nearest to the base's axis. A camera \
sees it with 30 of its pixels or more. Mean over the throws, and in parentheses the least of any throw.";

/// In how many cameras each image of a throw shows the object.
fn seeing(setup: &Setup, seed: u64, index: u64) -> Vec<usize> {
    let mut arena = setup.arena(seed, index);
    let mut images: Vec<(f64, usize)> = Vec::new();
    loop {
        let Ok(observation) = arena.sense();
        let shown = |mask: &Vec<bool>| mask.iter().filter(|shown| **shown).count() >= MIN_PIXELS;
        let cameras = observation.frames.iter().filter(|it| it.mask.as_ref().is_some_and(shown)).count();
        let p_WO = arena.truth().samples.last().map_or(f64::INFINITY, |it| it.X_WO.translation.vector.xy().norm());
        let has_passed = images.last().is_some_and(|(before, _)| p_WO > *before);
        if has_passed || observation.time_s > LONGEST_S {
            return images.into_iter().map(|(_, cameras)| cameras).collect();
        }
        images.push((p_WO, cameras));
    }
}

/// Rigs by throws.
pub fn run(options: &Options) -> Result<Findings> {
    let columns = ["rig", "cameras", "throw", "throws", "one camera, %", "two, %", "last 0.2 s: one, %", "two, %"];
    let mut table = Table::new("Images that show the object", &columns);
    for rig in Kind::Rig.names() {
        let settings = [format!("flight_rig=\"{rig}\"")];
        let setup = Setup::load(&Choice { scenario: Some("paper"), settings: &settings, ..Choice::default() })?;
        if setup.cameras.len() > MOST_CAMERAS {
            continue;
        }
        for throw in Kind::Throw.names() {
            let setup = setup.thrown(throw)?;
            let throws = if setup.repeats_itself() { 1 } else { options.trials as usize };
            let flights = parallel::map(throws, |index| seeing(&setup, options.seed, index as u64));
            let percent = |least: usize, last: usize| {
                let fractions = flights.iter().map(|images| {
                    let images = &images[images.len().saturating_sub(last)..];
                    let seen = images.iter().filter(|cameras| **cameras >= least).count();
                    100.0 * seen as f64 / images.len().max(1) as f64
                });
                let all: Vec<f64> = fractions.collect();
                let least = all.iter().copied().fold(100.0, f64::min);
                Entry::text(format!("{:.0} ({least:.0})", all.iter().sum::<f64>() / all.len() as f64))
            };
            table.rows.push(vec![
                Entry::text(rig),
                Entry::Count(setup.cameras.len()),
                Entry::text(throw),
                Entry::Count(throws),
                percent(1, usize::MAX),
                percent(2, usize::MAX),
                percent(1, LAST),
                percent(2, LAST),
            ]);
        }
    }
    Ok(Findings { legend: LEGEND, tables: vec![table] })
}
