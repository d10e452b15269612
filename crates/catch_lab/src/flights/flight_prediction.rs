//! Where an object goes on to that was seen for a while, and whether that is what objects do.

use std::sync::Arc;

use catch_body::dynamics::gravity;
use nalgebra::{Unit, Vector3};
use serde::{Deserialize, Serialize};

use super::{
    flight::Flight,
    flight_fit::Problem,
    flight_prior::FlightPrior,
    stretches::{Parabola, axis, between_contacts, sighted, thinned},
    track_file::Sighting,
};
use crate::statistics::median_in_place;

/// What is known of an object's flights before one is seen.
#[derive(Debug, Clone, Default)]
pub enum Known {
    /// Nothing: a prior for everyday objects.
    #[default]
    Nothing,
    /// Isotropic drag: constant k of a = −k·|v|·v in 1/m, and its standard deviation.
    Drag([f64; 2]),
    /// What other throws of the object taught.
    Prior(Arc<FlightPrior>),
}

impl Known {
    /// The prior for a track with or without orientations.
    fn prior(self, oriented: bool) -> Arc<FlightPrior> {
        let any = || if oriented { FlightPrior::any_object() } else { FlightPrior::any_point() };
        match self {
            Self::Nothing => Arc::new(any()),
            Self::Drag([drag, sd]) => Arc::new(any().with_drag(drag, sd)),
            Self::Prior(prior) => prior,
        }
    }
}

pub use super::stretches::LEAST_SIGHTINGS;

/// Drag constant in 1/m and its standard deviation where one of them is not given.
pub const DRAG_PER_M: [f64; 2] = [0.05, 0.1];

/// Sightings that one fit looks at, at most; of more, every second, third … one. A stretch is found among as few more.
const MOST_SIGHTINGS: usize = 300;
const MOST_ROWS: usize = 1000;

/// What a track says of its flight.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum FlightStatus {
    /// There is a flight.
    Predicted,
    /// There is one, but the sightings are far from it.
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
    /// Whether there is a flight, and of what kind.
    pub status: FlightStatus,
    /// When a contact ended the flight; what follows it was not looked at.
    pub contact_s: Option<f64>,
    /// The flight.
    pub flight: Option<Flight>,
}

impl FlightPrediction {
    fn none(status: FlightStatus) -> Self {
        Self { status, contact_s: None, flight: None }
    }
}

/// With more noise than this, or fewer sightings that agree, something is wrong.
const MOST_NOISE_M: f64 = 0.02;
const LEAST_AGREEING: f64 = 0.5;
/// A force beyond gravity and drag that is looked into, in m/s²; more by spin, as a fraction of the speed per second.
const STRANGE_MPS2: f64 = 8.0;
const MOST_LIFT_PER_S: f64 = 6.0;
/// A disturbance of the first or last part of a flight that is a hand's or a floor's: in m/s², and in those of the other parts.
const TOUCH_MPS2: f64 = 3.0;
const TOUCH_TIMES: f64 = 4.0;
/// How much of the flight is then left out at a time.
const TOUCH_S: f64 = 0.025;
/// That many sightings in a row at an end that all lie further off than this are no outliers.
const TAIL: usize = 4;
const TAIL_SD: f64 = 12.0;
const TAIL_M: f64 = 0.01;
/// Logarithm of how much more probable another gravity has to be.
const SURELY: f64 = 10.0;

/// The first flight in the rows of a track, oldest first; `up` is the direction in the track's axes against which gravity pulls.
///
/// What precedes the flight, as in a hand, and what follows a contact is left out.
pub fn predict(rows: &[Sighting], up: &Unit<Vector3<f64>>, known: Known) -> FlightPrediction {
    let seen = sighted(rows);
    if seen.len() < LEAST_SIGHTINGS {
        let stands = rows.len() >= LEAST_SIGHTINGS && !seen.is_empty();
        let status = if stands { FlightStatus::NoGravity } else { FlightStatus::TooFewSightings };
        return FlightPrediction::none(status);
    }
    let prior = known.prior(seen.iter().any(|it| it.rotation.is_some()));
    let g = up.into_inner() * -gravity().norm();
    let seen = thinned(&seen, MOST_ROWS);
    let mut status = FlightStatus::NoGravity;
    for stretch in between_contacts(&g, &seen) {
        let rows = &seen[stretch];
        if rows.len() < LEAST_SIGHTINGS || !may_fall(rows, &g) {
            continue;
        }
        match untouched(rows, &g, &prior) {
            Ok(flight) => return judged(flight, &seen),
            Err(why) => status = why,
        }
    }
    FlightPrediction::none(status)
}

/// Whether the rows may be those of a falling object.
fn may_fall(rows: &[Sighting], g: &Vector3<f64>) -> bool {
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

/// How much of an acceleration the distance of the rows from a parabola may hide.
fn scatter(rows: &[Sighting], parabola: &Parabola) -> f64 {
    let duration_s = rows[rows.len() - 1].time_s - rows[0].time_s;
    100.0 * parabola.off_m / (duration_s * duration_s * (rows.len() as f64).sqrt())
}

/// The flight through a stretch between contacts, without the rows at its ends that something touched.
fn untouched(mut rows: &[Sighting], g: &Vector3<f64>, prior: &Arc<FlightPrior>) -> Result<Flight, FlightStatus> {
    loop {
        if rows.len() < LEAST_SIGHTINGS || !may_fall(rows, g) {
            return Err(FlightStatus::NoGravity);
        }
        let few = thinned(rows, MOST_SIGHTINGS);
        let flight = Problem::new(*g, prior, &few).solve().ok_or(FlightStatus::NotConverged)?;
        let Some([first_s, last_s]) = untouched_s(&flight, &few) else {
            return if is_against(&few, g, (prior, &flight)) { Err(FlightStatus::NoGravity) } else { Ok(flight) };
        };
        let first = rows.partition_point(|it| it.time_s < first_s);
        rows = &rows[first..rows.partition_point(|it| it.time_s <= last_s).max(first)];
    }
}

/// The time in which nothing touched the object, where something did at one of the ends.
fn untouched_s(flight: &Flight, rows: &[Sighting]) -> Option<[f64; 2]> {
    let pushes: Vec<f64> = flight.pushes.iter().map(|it| it.norm()).collect();
    let limit = TOUCH_MPS2 + TOUCH_TIMES * median_in_place(&mut pushes.clone());
    let part_s = TOUCH_S.min(0.2 * (flight.time_s - flight.start_s));
    let (first, last) = (pushes[0], pushes[pushes.len() - 1]);
    if pushes.len() > 2 && first.max(last) > limit {
        let at_first = first >= last;
        return Some(if at_first { [flight.start_s + part_s, flight.time_s] } else { [flight.start_s, flight.time_s - part_s] });
    }
    let far = |error: &&f64| **error > TAIL_M.max(TAIL_SD * flight.noise.position_sd_m);
    let head = flight.errors_m.iter().take_while(far).count();
    let tail = flight.errors_m.iter().rev().take_while(far).count();
    if head.max(tail) < TAIL || head + tail >= rows.len() {
        return None;
    }
    let cut = |count: usize| if count < TAIL { 0 } else { count };
    Some([rows[cut(head)].time_s, rows[rows.len() - 1 - cut(tail)].time_s])
}

/// Whether another direction of gravity, or none, explains the rows better: looked at where there are strong forces.
fn is_against(rows: &[Sighting], g: &Vector3<f64>, (prior, flight): (&Arc<FlightPrior>, &Flight)) -> bool {
    if Parabola::through(rows).is_none_or(|it| (it.a - g).norm() < STRANGE_MPS2) {
        return false;
    }
    (0..6)
        .map(|it| axis(it) * gravity().norm())
        .chain([Vector3::zeros()])
        .filter(|it| (it - g).norm() > 1.0)
        .filter_map(|it| Problem::new(it, prior, rows).solve())
        .any(|it| it.deviance + SURELY < flight.deviance)
}

fn judged(flight: Flight, seen: &[Sighting]) -> FlightPrediction {
    let is_implausible = flight.noise.position_sd_m > MOST_NOISE_M
        || (flight.inliers() as f64) < LEAST_AGREEING * flight.considered() as f64;
    let status = if is_implausible { FlightStatus::Implausible } else { FlightStatus::Predicted };
    let contact_s = seen.iter().map(|it| it.time_s).find(|it| *it > flight.time_s);
    FlightPrediction { status, contact_s, flight: Some(flight) }
}
