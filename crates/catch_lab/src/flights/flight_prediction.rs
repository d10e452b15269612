//! Prediction of an object's path from a track, and a check that it is a free flight.

use std::sync::Arc;

use catch_body::dynamics::gravity;
use nalgebra::{Unit, Vector3};
use serde::{Deserialize, Serialize};

use super::{
    flight::Flight,
    flight_prior::FlightPrior,
    flight_problem::Problem,
    stretches::{Parabola, axis, between_contacts, sighted, thinned},
    track_file::Sighting,
};

/// The priors for a track with or without orientations, among which its evidence chooses: what is `known` of
/// the object from other throws, or those for everyday objects.
fn priors(known: Option<Arc<FlightPrior>>, oriented: bool) -> Vec<Arc<FlightPrior>> {
    match known {
        Some(prior) => vec![prior],
        None if oriented => vec![Arc::new(FlightPrior::any_object())],
        None => FlightPrior::any_points().into_iter().map(Arc::new).collect(),
    }
}

pub use super::stretches::LEAST_SIGHTINGS;

/// Sightings that one fit looks at, at most; of more, every second, third … one. A stretch is found among as
/// few more.
const MOST_SIGHTINGS: usize = 300;
const MOST_ROWS: usize = 1000;

/// Kind of flight that a track shows.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum FlightStatus {
    /// There is a flight.
    Predicted,
    /// There is a flight, but the sightings are far from it.
    Implausible,
    /// No part of the track falls as gravity and air have it.
    NoGravity,
    /// Fewer sightings than a flight needs.
    TooFewSightings,
    /// The fit came to nothing.
    NotConverged,
}

/// The flight in a track, or why there is none.
#[derive(Debug, Clone)]
pub struct FlightPrediction {
    /// Kind of flight, if any.
    pub status: FlightStatus,
    /// Time of the contact that ended the flight; later samples are not used.
    pub contact_s: Option<f64>,
    /// The flight.
    pub flight: Option<Flight>,
}

/// Longest flight, in seconds. A longer one is no throw, and no trial waits for it.
pub const LONGEST_FLIGHT_S: f64 = 5.0;
/// Largest noise, in metres, and least fraction of sightings that agree, of a plausible flight.
const MOST_NOISE_M: f64 = 0.02;
const LEAST_AGREEING: f64 = 0.5;
/// A force beyond gravity and drag that is looked into, in m/s²; more by spin, as a fraction of the speed per
/// second.
const STRANGE_MPS2: f64 = 8.0;
const MOST_LIFT_PER_S: f64 = 6.0;
/// A disturbance of the first or last part of a flight that may be a hand's or a floor's, in m/s².
const TOUCH_MPS2: f64 = 3.0;
/// Durations that are then left out of the flight, one after another, and the least that must be left, in
/// seconds.
const CUTS_S: [f64; 5] = [0.025, 0.05, 0.075, 0.1, 0.15];
/// Density of the disturbances without them, as a fraction.
const CALMER: f64 = 0.3;
const SHORTEST_S: f64 = 0.1;
/// Density of disturbances that is no flight's, in m/s²/√Hz.
const MOST_DENSITY: f64 = 2.0;
/// Noise of orientations that are not understood, in radians, and for how long a flight can be followed at
/// least, in seconds.
const MOST_RAD: f64 = 0.2;
const FOLLOWED_S: f64 = 0.5;
/// Number of consecutive sightings at an end that are no outliers if all of them lie further off than this.
const TAIL: usize = 4;
const TAIL_SD: f64 = 12.0;
const TAIL_M: f64 = 0.01;
/// Logarithm of how much more probable another gravity has to be.
const SURELY: f64 = 10.0;

/// The first flight in the rows of a track, oldest first; `up` is the direction in the track's axes against
/// which gravity pulls. `known` was learned from other throws of the object; without it a prior for everyday
/// objects serves.
///
/// What precedes the flight, as in a hand, and what follows a contact is left out.
pub fn predict(rows: &[Sighting], up: &Unit<Vector3<f64>>, known: Option<Arc<FlightPrior>>) -> FlightPrediction {
    predict_near(rows, up, known, None)
}

/// [`predict`], begun with a flight through some of the rows.
pub fn predict_near(
    rows: &[Sighting],
    up: &Unit<Vector3<f64>>,
    known: Option<Arc<FlightPrior>>,
    near: Option<&Flight>,
) -> FlightPrediction {
    let seen = sighted(rows);
    if seen.len() < LEAST_SIGHTINGS {
        let stands = rows.len() >= LEAST_SIGHTINGS && !seen.is_empty();
        let status = if stands { FlightStatus::NoGravity } else { FlightStatus::TooFewSightings };
        return FlightPrediction { status, contact_s: None, flight: None };
    }
    let priors = priors(known, seen.iter().any(|it| it.rotation.is_some()));
    let g = up.into_inner() * -gravity().norm();
    let seen = thinned(&seen, MOST_ROWS);
    let mut status = FlightStatus::NoGravity;
    for stretch in between_contacts(&g, &seen) {
        let rows = &seen[stretch];
        if rows.len() < LEAST_SIGHTINGS || !may_fall(rows, &g) {
            continue;
        }
        match untouched(rows, &g, &priors, near) {
            Ok(flight) => return judged(flight, &seen),
            Err(why) => status = why,
        }
    }
    FlightPrediction { status, contact_s: None, flight: None }
}

/// Returns whether the rows may be those of a falling object.
fn may_fall(rows: &[Sighting], g: &Vector3<f64>) -> bool {
    if rows[rows.len() - 1].time_s - rows[0].time_s > LONGEST_FLIGHT_S {
        return false;
    }
    let oriented = rows.iter().any(|it| it.rotation.is_some());
    Parabola::through(rows).is_some_and(|it| {
        let (force, speed) = strange(rows, &it, g);
        force <= STRANGE_MPS2 + scatter(rows, &it) + if oriented { 0.0 } else { MOST_LIFT_PER_S * speed }
    })
}

/// Acceleration beyond gravity and what brakes the motion, and the speed, both in the middle of the rows.
fn strange(rows: &[Sighting], parabola: &Parabola, g: &Vector3<f64>) -> (f64, f64) {
    let middle_s = 0.5 * (rows[rows.len() - 1].time_s - rows[0].time_s);
    let velocity = parabola.v + parabola.a * middle_s;
    let mut force = parabola.a - g;
    if let Some(along) = velocity.try_normalize(1e-9) {
        force -= along * along.dot(&force).min(0.0);
    }
    (force.norm(), velocity.norm())
}

/// Returns the acceleration that the distance of the rows from a parabola may hide.
fn scatter(rows: &[Sighting], parabola: &Parabola) -> f64 {
    let duration_s = rows[rows.len() - 1].time_s - rows[0].time_s;
    100.0 * parabola.off_m / (duration_s * duration_s * (rows.len() as f64).sqrt())
}

/// The flight through a stretch between contacts, without the rows at its ends that something touched.
fn untouched(
    rows: &[Sighting],
    g: &Vector3<f64>,
    priors: &[Arc<FlightPrior>],
    near: Option<&Flight>,
) -> Result<Flight, FlightStatus> {
    let few = thinned(rows, MOST_SIGHTINGS);
    let mut rows = &few[..];
    let mut flight = most_probable(*g, priors, rows, near).ok_or(FlightStatus::NotConverged)?;
    while let Some((range, cut)) = less_touched(&flight, g, priors, rows) {
        (rows, flight) = (&rows[range], cut);
    }
    if flight.acceleration_noise > MOST_DENSITY || !may_fall(rows, g) || is_against(rows, g, (priors, &flight)) {
        return Err(FlightStatus::NoGravity);
    }
    Ok(flight)
}

/// A shorter flight that explains its rows so much better that something touched the others, if its ends look
/// like that.
fn less_touched(
    flight: &Flight,
    g: &Vector3<f64>,
    priors: &[Arc<FlightPrior>],
    rows: &[Sighting],
) -> Option<(std::ops::Range<usize>, Flight)> {
    let far = |error: &&f64| **error > TAIL_M.max(TAIL_SD * flight.noise.position_sd_m);
    let (head, tail) =
        (flight.errors_m.iter().take_while(far).count(), flight.errors_m.iter().rev().take_while(far).count());
    let pushed = |push: Option<&Vector3<f64>>| push.is_some_and(|it| it.norm() > TOUCH_MPS2);
    let at_start = head >= TAIL || pushed(flight.pushes.first());
    let at_end = tail >= TAIL || pushed(flight.pushes.last());
    let mut ranges = Vec::new();
    for cut_s in CUTS_S {
        if at_start {
            ranges.push(rows.partition_point(|it| it.time_s < flight.start_s + cut_s)..rows.len());
        }
        if at_end {
            ranges.push(0..rows.partition_point(|it| it.time_s <= flight.time_s - cut_s));
        }
    }
    ranges.retain(|it| it.len() >= LEAST_SIGHTINGS && rows[it.end - 1].time_s - rows[it.start].time_s > SHORTEST_S);
    let cut = |range: std::ops::Range<usize>| Some((range.clone(), most_probable(*g, priors, &rows[range], None)?));
    // An object that tumbles about its tracked point is disturbed throughout.
    let is_calm = |it: &Flight| it.acceleration_noise < flight.acceleration_noise * CALMER;
    let shortest = ranges.iter().rev().take(usize::from(at_start) + usize::from(at_end));
    if !shortest.cloned().filter_map(cut).any(|(_, it)| is_calm(&it)) {
        return None;
    }
    let cuts: Vec<_> = ranges.into_iter().filter_map(cut).collect();
    // A row that lies on the flight costs as much as it does in the best of them.
    let of_row = cuts.iter().map(|(_, it)| it.deviance_of_row()).fold(f64::INFINITY, f64::min);
    let score = |range: &std::ops::Range<usize>, it: &Flight| it.deviance + (rows.len() - range.len()) as f64 * of_row;
    let best = cuts.into_iter().min_by(|a, b| score(&a.0, &a.1).total_cmp(&score(&b.0, &b.1)))?;
    (score(&best.0, &best.1) + SURELY < flight.deviance).then_some(best)
}

/// The flight of most evidence. Orientations that are not understood are left out.
fn most_probable(
    g: Vector3<f64>,
    priors: &[Arc<FlightPrior>],
    rows: &[Sighting],
    near: Option<&Flight>,
) -> Option<Flight> {
    let of = |rows: &[Sighting]| {
        let flights = priors.iter().filter_map(|prior| Problem::new(g, prior, rows).solve(near));
        flights.min_by(|a, b| a.deviance.total_cmp(&b.deviance))
    };
    let flight =
        of(rows).filter(|it| it.noise.orientation_sd_rad < MOST_RAD && it.at(it.time_s + FOLLOWED_S).is_finite());
    if flight.is_some() || rows.iter().all(|it| it.rotation.is_none()) {
        return flight;
    }
    of(&rows.iter().map(|it| Sighting { rotation: None, ..*it }).collect::<Vec<_>>())
}

/// Returns whether another direction of gravity, or none, explains the rows better; checked where there are
/// strong forces.
fn is_against(rows: &[Sighting], g: &Vector3<f64>, (priors, flight): (&[Arc<FlightPrior>], &Flight)) -> bool {
    if Parabola::through(rows).is_none_or(|it| (it.a - g).norm() < STRANGE_MPS2) {
        return false;
    }
    (0..6)
        .map(|it| axis(it) * gravity().norm())
        .chain([Vector3::zeros()])
        .filter(|it| (it - g).norm() > 1.0)
        .filter_map(|it| most_probable(it, priors, rows, None))
        .any(|it| it.deviance + SURELY < flight.deviance)
}

fn judged(flight: Flight, seen: &[Sighting]) -> FlightPrediction {
    let is_implausible = flight.noise.position_sd_m > MOST_NOISE_M
        || (flight.inliers() as f64) < LEAST_AGREEING * flight.considered() as f64;
    let status = if is_implausible { FlightStatus::Implausible } else { FlightStatus::Predicted };
    let contact_s = seen.iter().map(|it| it.time_s).find(|it| *it > flight.time_s);
    FlightPrediction { status, contact_s, flight: Some(flight) }
}
