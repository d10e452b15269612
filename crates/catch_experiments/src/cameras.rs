//! Catch rates with rigs of a few near cameras, and how soon such a camera is noticed that was pushed.

mod pushed;

use std::collections::BTreeMap;

use anyhow::Result;
use catch_body::statistics::wilson95;
use catch_lab::{
    assets::Kind,
    scenario::setup::{Choice, Setup},
};

use crate::{
    Findings, Options, rates,
    results::{Entry, Table},
    spread::percent,
};

const LEGEND: &str = "The scenario is honest, with random throws and one to four near stereo cameras. These run freely, without labels. Each throw draws \
the errors of their poses: 0.2 mm along and 0.2 mrad about each axis (standard deviations). That is about what \
[calibration on the arm](calibration-and-perception.md) leaves where the arm is as modelled. The rate *caught* is of all throws, also of those out of reach, with its interval (Wilson, 95 %).";

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
pub fn setup(rig: &str, object: &str, settings: &[&str]) -> Result<Setup> {
    let rig = format!("flight_rig=\"{rig}\"");
    let settings: Vec<String> =
        [rig.as_str()].iter().chain(&SETTINGS).chain(settings).map(|&it| it.to_owned()).collect();
    let choice = Choice { scenario: Some("honest"), object: Some(object), settings: &settings, ..Choice::default() };
    Ok(Setup::load(&choice)?)
}

/// Every rig with every object.
pub fn run(options: &Options) -> Result<Findings> {
    let columns =
        ["rig", "object", "throws", "caught, %", "from, %", "to, %", "out of reach, %", "limits broken", "misses"];
    let mut table = Table::new("Caught with near cameras", &columns);
    for rig in rigs() {
        for object in Kind::Object.names() {
            let rows = rates::rows(vec![setup(&rig, object, &[])?], options)?;
            let caught = rows.iter().filter(|row| row.verdict.caught).count();
            let mut reasons: BTreeMap<String, usize> = BTreeMap::new();
            for reason in rows.iter().filter_map(|row| row.verdict.reason) {
                *reasons.entry(reason.to_string()).or_default() += 1;
            }
            let mut reasons: Vec<(String, usize)> = reasons.into_iter().collect();
            reasons.sort_by_key(|(_, count)| std::cmp::Reverse(*count));
            let reasons: Vec<String> = reasons.iter().map(|(reason, count)| format!("{count}× {reason}")).collect();
            let [low, high] = wilson95(caught, rows.len());
            table.rows.push(vec![
                Entry::text(&rig),
                Entry::text(object),
                Entry::Count(rows.len()),
                percent(caught, rows.len()),
                Entry::Number(Some(100.0 * low)),
                Entry::Number(Some(100.0 * high)),
                percent(rows.iter().filter(|row| row.verdict.is_out_of_reach()).count(), rows.len()),
                Entry::Count(rows.iter().map(|row| row.verdict.limit_violations).sum()),
                Entry::text(reasons.join(", ")),
            ]);
        }
    }
    let pushed = pushed::tables(options)?;
    Ok(Findings { legend: [LEGEND, pushed::LEGEND].concat(), tables: [vec![table], pushed].concat() })
}
