//! Recorded tracks as throws: from a folder of CSV files to flights that the arena can repeat.

use std::path::Path;

use catch_body::{
    InputError,
    free_flight::FreeState,
    quantity::{self, Quantity},
};
use catch_sim::throw::{RecordedFlight, RecordedState};
use nalgebra::{Unit, UnitQuaternion, Vector3};

use super::{
    flight::Flight,
    flight_prediction::{FlightStatus, predict},
    stretches::{self, LEAST_SIGHTINGS, Parabola, sighted},
    track_file,
};

/// Free flight that a throw needs, in seconds.
const LEAST_FLIGHT_S: f64 = 0.3;
/// Longest time without a sighting.
const MOST_GAP_S: f64 = 0.1;

/// The flights that were recorded in a folder, a file each, in the order of their names; `up` is the
/// direction in their axes against which gravity pulls, that of the axis against which each accelerates if it
/// is not given.
///
/// # Errors
/// A folder without tracks, or the first track that cannot be thrown: with other units or no gravity in it,
/// too short or interrupted.
pub fn read(folder: &Path, up: Option<Vector3<f64>>) -> Result<Vec<RecordedFlight>, InputError> {
    track_file::in_folder(folder, 1)?.iter().map(|path| read_flight(path, up)).collect()
}

fn read_flight(path: &Path, up: Option<Vector3<f64>>) -> Result<RecordedFlight, InputError> {
    let (seen, _) = track_file::read(path)?;
    let file = path.display().to_string();
    let fault = |field: &str, found: String, expected: String| {
        InputError::new(&file, field, found, format!("{expected}; or a folder without this file"))
    };
    if seen.len() < LEAST_SIGHTINGS {
        return Err(fault(
            "rows",
            seen.len().to_string(),
            format!("{LEAST_SIGHTINGS} or more with numbers in all columns"),
        ));
    }
    let up = up.map_or_else(|| stretches::up(&sighted(&seen)), Unit::new_normalize);
    let found = predict(&seen, &up, None);
    if found.status == FlightStatus::NoGravity {
        let [x, y, z] = Parabola::through(&seen).map_or(Vector3::zeros(), |it| it.a).into();
        let expected =
            "gravity and air: 9.81 m/s² or so against the axis that points up, times in seconds and places in metres";
        return Err(fault("x, y, z", format!("an acceleration of [{x:.1}, {y:.1}, {z:.1}]"), expected.to_owned()));
    }
    let agreeing = found.flight.as_ref().map_or(0, Flight::inliers);
    let is_flight = found.status == FlightStatus::Predicted;
    let Some(flight) = found.flight.filter(|_| is_flight) else {
        let expected = "half of them or more that lie on one flight";
        return Err(fault("rows", format!("{agreeing} of {} on a flight", seen.len()), expected.to_owned()));
    };
    let states = &flight.states;
    let duration_s = flight.time_s - flight.start_s;
    if duration_s < LEAST_FLIGHT_S {
        let contact = found.contact_s.map(|it| format!(", until a contact at t = {it}")).unwrap_or_default();
        let expected = format!("{LEAST_FLIGHT_S} s or more");
        return Err(fault("t", format!("{duration_s:.3} s of free flight{contact}"), expected));
    }
    if let Some(pair) = states.windows(2).find(|pair| pair[1].0 - pair[0].0 > MOST_GAP_S) {
        let found = format!("none from {} to {}", pair[0].0, pair[1].0);
        return Err(fault("t", found, format!("a sighting at least every {MOST_GAP_S} s of the flight")));
    }
    let across = UnitQuaternion::from_axis_angle(&Vector3::x_axis(), std::f64::consts::PI);
    let R_WT = UnitQuaternion::rotation_between_axis(&up, &Vector3::z_axis()).unwrap_or(across);
    let (first_s, first) = states[0];
    let state = |(time_s, it): &(f64, FreeState)| RecordedState {
        time_s: time_s - first_s,
        position: (R_WT * (it.p - first.p)).into(),
        velocity: R_WT * it.v,
        rotation: flight.oriented.then(|| (R_WT * it.R, R_WT * it.R * it.w)),
    };
    let recorded: Vec<RecordedState> = states.iter().map(state).collect();
    for it in &recorded {
        let checked = |field: &str, range: Quantity, values: &Vector3<f64>| {
            values.iter().try_for_each(|value| range.check(&file, field, *value).map(drop))
        };
        checked("velocity", quantity::VELOCITY_MPS, &it.velocity)?;
        it.rotation.iter().try_for_each(|(_, spin)| checked("spin", quantity::SPIN_RADPS, spin))?;
    }
    let unordered = || fault("t", "times in disorder".to_owned(), "times that rise".to_owned());
    RecordedFlight::new(recorded).ok_or_else(unordered)
}
