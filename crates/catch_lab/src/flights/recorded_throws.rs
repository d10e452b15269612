//! Recorded tracks as throws: from a folder of CSV files to flights that the arena can repeat.

use std::path::Path;

use catch_body::{
    InputError,
    quantity::{self, Quantity},
};
use catch_sim::throw::{RecordedFlight, RecordedState};
use nalgebra::{Unit, UnitQuaternion, Vector3};

use super::{
    aerodynamics::{AerodynamicFit, SmoothedState},
    flight_learning,
    flight_prediction::{LEAST_SIGHTINGS, falls, typical_motion},
    track::TrackSample,
    track_file::{self, Sighting},
};

/// Free flight that a throw needs, in seconds.
const LEAST_FLIGHT_S: f64 = 0.3;
/// Longest time without a sighting.
const MOST_GAP_S: f64 = 0.1;
/// Fraction of the sightings that must agree with the flight.
const LEAST_AGREEING: f64 = 0.5;

/// The flights that were recorded in a folder, a file each, in the order of their names; `up` is the direction in their axes against
/// which gravity pulls, that of the axis against which each accelerates if it is not given.
///
/// # Errors
/// A folder without tracks, or the first track that cannot be thrown: with other units or no gravity in it, too short or interrupted.
pub fn read(folder: &Path, up: Option<Vector3<f64>>) -> Result<Vec<RecordedFlight>, InputError> {
    let mut fit = AerodynamicFit::new(flight_learning::any_object());
    track_file::in_folder(folder, 1)?.iter().map(|path| read_flight(path, up, &mut fit)).collect()
}

fn read_flight(path: &Path, up: Option<Vector3<f64>>, fit: &mut AerodynamicFit) -> Result<RecordedFlight, InputError> {
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
    let [acceleration, ..] = typical_motion(&seen);
    let up = up.map_or_else(|| self::up(&seen), Unit::new_normalize);
    if !falls(&seen, &up) {
        let [x, y, z] = acceleration.into();
        let expected =
            "gravity and air: 9.81 m/s² or so against the axis that points up, times in seconds and places in metres";
        return Err(fault("x, y, z", format!("an acceleration of [{x:.1}, {y:.1}, {z:.1}]"), expected.to_owned()));
    }
    let samples: Vec<TrackSample> = seen.iter().map(Sighting::sample).collect();
    let flight = fit.fit(&samples, &up, None);
    let agreeing = flight.as_ref().map_or(0, |it| it.inliers);
    let Some(flight) = flight.ok().filter(|it| it.inliers as f64 >= LEAST_AGREEING * it.considered as f64) else {
        let expected = "half of them or more that lie on one flight";
        return Err(fault("rows", format!("{agreeing} of {} on a flight", seen.len()), expected.to_owned()));
    };
    let states: Vec<SmoothedState> = fit.smoothed().collect();
    let duration_s = flight.time_s - flight.start_s;
    if duration_s < LEAST_FLIGHT_S {
        let contact = flight.contact_s.map(|it| format!(", until a contact at t = {it}")).unwrap_or_default();
        let expected = format!("{LEAST_FLIGHT_S} s or more");
        return Err(fault("t", format!("{duration_s:.3} s of free flight{contact}"), expected));
    }
    if let Some(pair) = states.windows(2).find(|pair| pair[1].time_s - pair[0].time_s > MOST_GAP_S) {
        let found = format!("none from {} to {}", pair[0].time_s, pair[1].time_s);
        return Err(fault("t", found, format!("a sighting at least every {MOST_GAP_S} s of the flight")));
    }
    let is_oriented = seen.iter().any(|it| it.rotation.is_some());
    let across = UnitQuaternion::from_axis_angle(&Vector3::x_axis(), std::f64::consts::PI);
    let R_WT = UnitQuaternion::rotation_between_axis(&up, &Vector3::z_axis()).unwrap_or(across);
    let first = states[0];
    let state = |it: &SmoothedState| {
        let spin = R_WT * it.angular_velocity;
        RecordedState {
            time_s: it.time_s - first.time_s,
            position: (R_WT * (it.position - first.position)).into(),
            velocity: R_WT * it.velocity,
            rotation: is_oriented.then(|| (R_WT * it.orientation, spin)),
        }
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

/// The direction of the axis against which what was seen accelerates most.
pub fn up(seen: &[Sighting]) -> Unit<Vector3<f64>> {
    let [acceleration, ..] = typical_motion(seen);
    let mut up = Vector3::zeros();
    let axis = acceleration.iamax();
    up[axis] = -acceleration[axis].signum();
    Unit::new_normalize(up)
}
