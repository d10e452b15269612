//! Flights through recorded tracks: where an object goes on to that was seen for a while.

use catch_bot::trajectory_prediction::{Config, Considered, PredictionStatus};
use nalgebra::{Matrix6, Point3, Unit, Vector3};
use serde::{Deserialize, Serialize};

use super::{
    aerodynamics::{AerodynamicFit, AerodynamicFlight, FlightPrior, free_flight},
    flight_learning,
    track::{Track, TrackSample},
    track_file::Sighting,
};

/// What is known of an object's flights before one is seen.
#[derive(Debug, Clone, Default)]
pub enum Known {
    /// Nothing: a track with orientations is fitted with a prior for any object, one without with [`DRAG_PER_M`].
    #[default]
    Nothing,
    /// Isotropic drag: constant k of a = −k·|v|·v in 1/m, and its standard deviation.
    Drag([f64; 2]),
    /// What other throws of the object taught.
    Prior(Box<FlightPrior>),
}

/// Drag constant that is expected without another, and its standard deviation.
pub const DRAG_PER_M: [f64; 2] = [0.05, 0.1];
/// Sightings that a flight needs.
pub const LEAST_SIGHTINGS: usize = 6;
/// Sightings at most that the fit with isotropic drag looks at.
const MOST_SIGHTINGS: usize = 2000;
/// Seed of the sampling; any will do.
const SEED: u64 = 1;

/// How the air acts upon the object.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum FlightModel {
    /// Drag by direction, Magnus force, decay of the spin.
    Aerodynamic,
    /// The same drag in all directions.
    IsotropicDrag,
}

/// Why there is no flight.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum NoFlight {
    /// The acceleration is not that of gravity, nor that and drag.
    NoGravity,
    /// No flight fits.
    #[serde(untagged)]
    Unfitted(PredictionStatus),
}

/// A flight in the axes and on the clock of its track.
#[derive(Debug, Clone)]
pub enum Flight {
    /// With drag by direction, Magnus force and decay of the spin.
    Aerodynamic(Box<AerodynamicFlight>),
    /// With the same drag in all directions.
    IsotropicDrag(Box<Track>),
}

/// Where an object is at one time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FlightState {
    /// Position in metres.
    pub position: Point3<f64>,
    /// Velocity in m/s.
    pub velocity: Vector3<f64>,
    /// Covariance of (position, velocity), in m² and m²/s².
    pub covariance: Matrix6<f64>,
}

impl FlightState {
    /// Whether all of its numbers are: backward through air a flight soon becomes infinitely fast.
    pub fn is_finite(&self) -> bool {
        let Self { position, velocity, covariance } = self;
        position.iter().chain(velocity).chain(covariance).all(|it| it.is_finite())
    }
}

impl Flight {
    /// Position, velocity and their covariance at a time.
    pub fn at(&self, time_s: f64) -> FlightState {
        match self {
            Self::Aerodynamic(flight) => {
                let point = flight.at(time_s);
                FlightState { position: point.position, velocity: point.velocity, covariance: point.covariance }
            }
            Self::IsotropicDrag(track) => FlightState {
                position: track.position_at(time_s),
                velocity: track.velocity_at(time_s),
                covariance: track.covariance_at(time_s),
            },
        }
    }

    /// Drag constant in 1/m, where it depends on the direction its mean, and its standard deviation.
    pub fn drag_per_m(&self) -> [f64; 2] {
        match self {
            Self::Aerodynamic(flight) => {
                let drag = Vector3::from_fn(|i, _| flight.parameters()[3 + i]).mean();
                let variance = flight.parameter_covariance().fixed_view::<3, 3>(3, 3).sum() / 9.0;
                [drag, variance.max(0.0).sqrt()]
            }
            Self::IsotropicDrag(track) => [track.drag_per_m(), track.flight.covariance[(6, 6)].max(0.0).sqrt()],
        }
    }

    /// Sightings that agree with it.
    pub fn inliers(&self) -> usize {
        match self {
            Self::Aerodynamic(flight) => flight.inliers,
            Self::IsotropicDrag(track) => track.flight.inliers,
        }
    }
}

/// What a track says of its flight.
#[derive(Debug, Clone)]
pub struct FlightPrediction {
    /// By which model.
    pub model: FlightModel,
    /// When a contact ended the flight; what follows it was not looked at.
    pub contact_s: Option<f64>,
    /// Noise of the sightings along each axis, in metres.
    pub noise_m: f64,
    /// The flight, or why there is none.
    pub flight: Result<Flight, NoFlight>,
}

/// The flight through `seen`, oldest first; `up` is the direction in the track's axes against which gravity pulls.
pub fn predict(seen: &[Sighting], up: &Unit<Vector3<f64>>, known: Known) -> FlightPrediction {
    let is_oriented = seen.iter().any(|it| it.rotation.is_some());
    let prior = match known {
        Known::Nothing if is_oriented => Ok(flight_learning::any_object()),
        Known::Nothing => Err(DRAG_PER_M),
        Known::Drag(drag) => Err(drag),
        Known::Prior(prior) => Ok(*prior),
    };
    let model = if prior.is_ok() { FlightModel::Aerodynamic } else { FlightModel::IsotropicDrag };
    let none = |why| FlightPrediction { model, contact_s: None, noise_m: 0.0, flight: Err(why) };
    if seen.len() < LEAST_SIGHTINGS {
        return none(NoFlight::Unfitted(PredictionStatus::TooFewPoses));
    }
    if !falls(seen, up) {
        return none(NoFlight::NoGravity);
    }
    match prior {
        Err(drag) => isotropic_drag(seen, up, drag),
        Ok(prior) => {
            let samples: Vec<TrackSample> = seen.iter().map(|it| sample(it, 1.0)).collect();
            match AerodynamicFit::new(prior).fit(&samples, up, None) {
                Err(status) => none(NoFlight::Unfitted(status)),
                Ok(flight) => FlightPrediction {
                    model,
                    contact_s: flight.contact_s,
                    noise_m: flight.noise.position_sd_m,
                    flight: Ok(Flight::Aerodynamic(Box::new(flight))),
                },
            }
        }
    }
}

/// The flight by isotropic drag.
fn isotropic_drag(seen: &[Sighting], up: &Unit<Vector3<f64>>, drag: [f64; 2]) -> FlightPrediction {
    // More sightings than these tell nothing more.
    let every = seen.len().div_ceil(MOST_SIGHTINGS).max(1);
    let mut all: Vec<Sighting> = seen.iter().rev().step_by(every).copied().collect();
    all.reverse();
    let samples: Vec<TrackSample> = all.iter().map(|it| sample(it, 1.0)).collect();
    let (flying, contact_s) = free_flight(&samples, up);
    let (noise_m, fitted) = fit(&all[flying], up, drag);
    let flight = fitted.map(|track| Flight::IsotropicDrag(Box::new(track))).map_err(NoFlight::Unfitted);
    FlightPrediction { model: FlightModel::IsotropicDrag, contact_s, noise_m, flight }
}

/// A sighting with the track's noise; its orientation, if there is one, as good as a point 0.1 m off the centre would tell.
fn sample(sighting: &Sighting, noise_m: f64) -> TrackSample {
    const LEVER_M: f64 = 0.1;
    TrackSample {
        time_s: sighting.time_s,
        position: sighting.p,
        orientation: sighting.rotation,
        position_sd_m: noise_m,
        orientation_sd_rad: noise_m / LEVER_M,
    }
}

/// Noises that a track may have, in metres along each axis.
const NOISES_M: [f64; 6] = [5e-4, 2e-3, 8e-3, 0.03, 0.1, 0.5];
/// A flight that this fraction of the sightings agrees with is the one, for a noise that is as low as possible.
const AGREEING_FRACTION: f64 = 0.4;
/// How often the noise is then taken anew from how far those that agree are from the flight, at most.
const REFINEMENTS: usize = 4;
/// Noise below this is not believed, in metres.
const LEAST_NOISE_M: f64 = 1e-4;
/// Half of the sightings with normal noise along each axis are nearer than that many standard deviations: the median of χ with 3
/// degrees of freedom.
const MEDIAN: f64 = 1.538;

/// How noisy a track is, and the flight fitted to it, with the drag constant that is expected and its standard deviation.
fn fit(
    seen: &[Sighting],
    up: &Unit<Vector3<f64>>,
    [drag, drag_sd]: [f64; 2],
) -> (f64, Result<Track, PredictionStatus>) {
    let with_noise = |noise_m: f64| {
        let samples: Vec<TrackSample> = seen.iter().map(|it| sample(it, noise_m)).collect();
        let config = Config {
            drag_prior_per_m: Some(drag),
            drag_prior_sd_per_m: Some(drag_sd),
            considered: Considered {
                first_after: LEAST_SIGHTINGS,
                window: samples.len(),
                fit_window: samples.len(),
                inlier_m: Considered::default().inlier_m.max(4.0 * noise_m),
            },
            ..Config::default()
        };
        Track::fit(&samples, up, &config, SEED)
    };
    let agreeing = |fitted: &Result<Track, _>| fitted.as_ref().map_or(0, |it: &Track| it.flight.inliers);
    let enough = (seen.len() as f64 * AGREEING_FRACTION) as usize;
    let [mut noise_m, ..] = NOISES_M;
    let mut fitted = with_noise(noise_m);
    for &next_m in &NOISES_M[1..] {
        if agreeing(&fitted) > enough {
            break;
        }
        (noise_m, fitted) = (next_m, with_noise(next_m));
    }
    for _ in 0..REFINEMENTS {
        let Ok(track) = &fitted else { break };
        let mut distances: Vec<f64> = seen.iter().map(|it| (it.p - track.position_at(it.time_s)).norm()).collect();
        distances.sort_by(f64::total_cmp);
        let next_m = (distances[track.flight.inliers / 2] / MEDIAN).max(LEAST_NOISE_M);
        let next = with_noise(next_m);
        // A flight that fewer agree with is another one.
        if !next_m.is_finite() || agreeing(&next) <= enough {
            break;
        }
        (noise_m, fitted) = (next_m, next);
    }
    (noise_m, fitted)
}

/// A change of velocity that gravity and air cannot explain, in m/s².
const STRANGE_MPS2: f64 = 8.0;

/// Whether the sightings fall as gravity has it, but for a force against the motion.
pub(super) fn falls(seen: &[Sighting], up: &Unit<Vector3<f64>>) -> bool {
    let [acceleration, velocity, scatter] = typical_motion(seen);
    let mut rest = acceleration + up.into_inner() * 9.81;
    if let Some(along) = velocity.try_normalize(1e-9) {
        rest -= along * along.dot(&rest).min(0.0);
    }
    rest.norm() <= STRANGE_MPS2 + 3.0 * scatter.x
}

/// Medians of the acceleration and the velocity between sightings a third of the track apart, and of the distance from the former.
pub(super) fn typical_motion(seen: &[Sighting]) -> [Vector3<f64>; 3] {
    let third = seen.len() / 3;
    let middle = |of: &dyn Fn(&Vector3<f64>) -> f64, all: &[Vector3<f64>]| {
        let mut values: Vec<f64> = all.iter().map(of).collect();
        values.sort_by(f64::total_cmp);
        values[values.len() / 2]
    };
    let (accelerations, velocities): (Vec<_>, Vec<_>) = seen
        .iter()
        .zip(&seen[third..])
        .zip(&seen[2 * third..])
        .map(|((a, b), c)| {
            let (before, after) = ((b.p - a.p) / (b.time_s - a.time_s), (c.p - b.p) / (c.time_s - b.time_s));
            ((after - before) * (2.0 / (c.time_s - a.time_s)), (c.p - a.p) / (c.time_s - a.time_s))
        })
        .unzip();
    let median = |all: &[Vector3<f64>]| Vector3::from_fn(|axis, _| middle(&|it| it[axis], all));
    let acceleration = median(&accelerations);
    let scatter = middle(&|it| (it - acceleration).norm(), &accelerations);
    [acceleration, median(&velocities), Vector3::repeat(scatter)]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::flights::track_file::parse;
    use nalgebra::Point3;
    use rand::{RngExt, SeedableRng};
    use rand_pcg::Pcg64;

    /// A flight with 2 mm of noise along each axis, of which a fraction lies elsewhere.
    fn track(outliers: f64, seed: u64) -> Vec<Sighting> {
        let mut rng = Pcg64::seed_from_u64(seed);
        let row = |i: u32| {
            let t = f64::from(i) * 0.01;
            let mut noise = || (0..12).map(|_| rng.random_range(-0.5..0.5)).sum::<f64>() * 0.002;
            let p = [t + noise(), noise(), t - 4.905 * t * t + noise()];
            let off = if rng.random_bool(outliers) { rng.random_range(0.05..1.0) } else { 0.0 };
            format!("{t},{},{},{}\n", p[0] + off, p[1] - off, p[2] + off)
        };
        parse("t.csv", &(0..60).map(row).collect::<String>()).unwrap().0
    }

    #[test]
    fn outliers_do_not_count() {
        for outliers in [0.0, 0.1, 0.2, 0.3, 0.4] {
            for seed in 0..20 {
                let (noise_m, fitted) = fit(&track(outliers, seed), &Vector3::z_axis(), [0.0, 0.0]);
                assert!(noise_m > 1e-3 && noise_m < 4e-3, "{outliers}: {noise_m}");
                let off = fitted.unwrap().position_at(0.8) - Point3::new(0.8, 0.0, 0.8 - 4.905 * 0.64);
                assert!(off.norm() < 0.02, "{outliers}: {off}");
            }
        }
    }
}
