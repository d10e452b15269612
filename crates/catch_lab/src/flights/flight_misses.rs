//! Predicted ends of recorded throws against where they ended.

use std::{
    path::{Path, PathBuf},
    sync::Arc,
};

use catch_body::InputError;
use nalgebra::{Matrix3, Unit, Vector3};
use serde::Serialize;

use super::{
    flight::Flight,
    flight_prediction::predict_near,
    flight_prior::FlightPrior,
    track_file::{self, Sighting},
};

/// A recorded throw.
#[derive(Debug, Clone)]
pub struct Throw {
    /// Samples in the order of time; two or more.
    pub samples: Vec<Sighting>,
    /// Direction against which gravity pulls.
    pub up: Unit<Vector3<f64>>,
}

impl Throw {
    /// The throws that are recorded in a folder, `least` or more, in the order of their names.
    ///
    /// # Errors
    /// Too few tracks, or one that cannot be read.
    pub fn read_folder(folder: &Path, up: Unit<Vector3<f64>>, least: usize) -> Result<Vec<Self>, InputError> {
        let read = |path: &PathBuf| {
            let (track, _) = track_file::read(path)?;
            Ok(Self { samples: track, up })
        };
        track_file::in_folder(folder, least)?.iter().map(read).collect()
    }
}

/// Seconds of a throw that are left when its end is predicted, for each error that is reported; `None` is
/// half of its time.
pub const HORIZONS_S: [Option<f64>; 4] = [None, Some(0.3), Some(0.2), Some(0.1)];

/// A predicted end against the recorded one.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Miss {
    /// Vector from the predicted position to the recorded one, in metres.
    pub error: Vector3<f64>,
    /// Covariance of the predicted position, in m².
    pub covariance: Matrix3<f64>,
}

impl Miss {
    /// Squared Mahalanobis distance and the logarithm of the covariance's determinant, with more variance
    /// along each axis; infinite where there is none.
    pub fn measures(&self, more_variance: f64) -> (f64, f64) {
        let covariance = self.covariance + Matrix3::identity() * more_variance;
        covariance.cholesky().map_or((f64::INFINITY, f64::INFINITY), |factor| {
            let log_determinant = 2.0 * factor.l().diagonal().map(libm::log).sum();
            (self.error.dot(&factor.solve(&self.error)), log_determinant)
        })
    }
}

/// Misses by how much was seen, in the order of [`HORIZONS_S`].
pub type Misses = [Vec<Option<Miss>>; 4];

/// The misses of objects by their names, and of all together if there are several.
pub fn with_all(names: impl IntoIterator<Item = String>, misses: Vec<Misses>) -> Vec<(String, Misses)> {
    let all = (misses.len() > 1)
        .then(|| std::array::from_fn(|at| misses.iter().flat_map(|it| it[at].iter().copied()).collect()));
    names.into_iter().zip(misses).chain(all.map(|it| ("all".to_owned(), it))).collect()
}

/// Quantiles of χ² with three degrees of freedom at the fractions that are reported.
pub const QUANTILES: [(f64, f64); 4] = [(0.5, 2.366), (0.8, 4.642), (0.95, 7.815), (0.99, 11.345)];

/// Quantile of χ² at one of these fractions.
pub fn quantile(fraction: f64) -> f64 {
    QUANTILES.iter().find(|it| it.0 >= fraction).map_or(f64::INFINITY, |it| it.1)
}

impl Throw {
    /// Predicts the end by how much was seen, each time near the flight that was found in `near` if there is
    /// one; `None` where there is no flight.
    pub fn flights(&self, known: Option<&Arc<FlightPrior>>, near: Option<&[Option<Flight>; 4]>) -> [Option<Flight>; 4] {
        std::array::from_fn(|at| {
            let (first, last) = (self.samples.first()?, self.samples.last()?);
            let half_s = f64::midpoint(first.time_s, last.time_s);
            let until_s = HORIZONS_S[at].map_or(half_s, |left_s| last.time_s - left_s);
            let seen = &self.samples[..self.samples.partition_point(|it| it.time_s <= until_s)];
            let near = near.and_then(|it| it[at].as_ref());
            predict_near(seen, &self.up, known.cloned(), near).flight
        })
    }

    /// Returns the error of a flight at the end of the throw.
    pub fn miss(&self, flight: &Flight) -> Option<Miss> {
        let last = self.samples.last()?;
        let end = flight.at(last.time_s);
        let covariance = end.covariance.fixed_view::<3, 3>(0, 0).into_owned();
        Some(Miss { error: last.p - end.position, covariance })
    }
}

/// Errors of predictions, and how many of the ends lay in the ellipsoids that were claimed.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Reliability {
    /// Throws, and those among them without a prediction.
    pub throws: usize,
    /// Throws without a prediction; they are in no other number.
    pub failed: usize,
    /// Median of the errors, in metres.
    pub median_m: f64,
    /// 95th percentile of the errors, in metres.
    pub p95_m: f64,
    /// Fractions of the ends in the ellipsoids of [`QUANTILES`].
    pub covered: [f64; 4],
}

impl Reliability {
    /// Computes the statistics of some predictions.
    pub fn of(misses: &[Option<Miss>]) -> Self {
        let made: Vec<&Miss> = misses.iter().flatten().collect();
        let mut errors: Vec<f64> = made.iter().map(|miss| miss.error.norm()).collect();
        errors.sort_by(f64::total_cmp);
        let at = |fraction: f64| {
            let index = (errors.len() as f64 * fraction) as usize;
            errors.get(index.min(errors.len().saturating_sub(1))).copied().unwrap_or(f64::NAN)
        };
        let mahalanobis2 = |miss: &Miss| miss.measures(0.0).0;
        let covered = QUANTILES.map(|(_, limit)| {
            made.iter().filter(|miss| mahalanobis2(miss) <= limit).count() as f64 / made.len() as f64
        });
        let (throws, failed) = (misses.len(), misses.len() - made.len());
        Self { throws, failed, median_m: at(0.5), p95_m: at(0.95), covered }
    }
}
