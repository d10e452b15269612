//! Refinement of a calibration by thrown objects: several cameras see one free flight, whose law is known.
//!
//! Cameras that were calibrated on one arm have its errors in common. Flights tell how the cameras stand to
//! each other, the time between their clocks, and where the vertical is; they tell nothing of a displacement
//! or a rotation about the vertical that all cameras have in common. The prior is therefore the joint
//! covariance of all cameras. The world, which is the arm's, may be tilted against gravity.
//!
//! Minimized are the sightings' residuals over their standard deviations and the priors, robustly: an object
//! at p(t) under gravity and quadratic drag is seen at (1 + s)·X_CW·p(t + o) + b by a camera with the depth
//! scale s and the time offset o. The registration of single images is off by b: by an offset in all flights
//! of a camera, and by another one in each flight, which add up. Every flight's own parameters are
//! eliminated.

mod equations;
#[cfg(test)]
mod tests;

use catch_body::statistics::median_in_place;
use nalgebra::{DMatrix, DVector, Matrix3, Matrix6, Vector3};
use serde::Serialize;

use super::{CAMERA_PARAMETERS, Calibration, CalibrationStatus, coarse::moved};
use equations::{
    CameraState, FlightEquations, FlightState, OF_CAMERA, OF_FLIGHT, OF_OFFSET, OF_TILT, Seen, inverse_variance,
};

/// Steps, at most.
const STEPS: usize = 40;
/// A step is the last one if it is shorter than this, in standard deviations; after so many steps this will
/// do.
const SMALL_SD: f64 = 1e-3;
const NOT_LARGE_SD: f64 = 0.1;
/// Standard deviation of the tilt of W against gravity about x and about y, in radians: 0.05°, what a good
/// level tells of the base.
pub const TILT_SD_RAD: f64 = 0.05_f64.to_radians();
/// Standard deviations of what the registration of a camera's images is off by in all flights, along x, y and
/// the line of sight, in metres.
pub const OFFSET_SD_M: [f64; 3] = [0.0002, 0.0002, 0.01];
/// Standard deviations of what the registration is off by beside that in each flight.
pub const FLIGHT_OFFSET_SD_M: [f64; 3] = [0.0003, 0.0003, 0.005];
/// Flights of fewer sightings do not count.
const LEAST_SIGHTINGS: usize = 8;
/// Median of the squared length of three normal residuals.
const MEDIAN_OF_SQUARES: f64 = 2.366;
/// Flights that tell how much they vary beyond what their sightings say.
const LEAST_FLIGHTS: usize = 5;
/// Flights that move the cameras by more than this, root mean square in standard deviations of the
/// calibration, contradict it.
const MOST_CHANGE_SD: f64 = 2.0;

/// Position of the object in one image.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sighting {
    /// Camera that took the image.
    pub camera: usize,
    /// Time stamp of the image, in seconds on the camera's clock.
    pub capture_s: f64,
    /// The object's centre of mass in C.
    pub p_C: Vector3<f64>,
    /// Covariance of that, in m².
    pub covariance_C: Matrix3<f64>,
}

/// Sightings of one throw.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Flight {
    /// Sightings, in any order.
    pub sightings: Vec<Sighting>,
}

/// Outcome of a refinement.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum FlightStatus {
    /// The calibration was refined.
    Refined,
    /// No flight has enough sightings, or no camera was calibrated.
    TooFewSightings,
    /// The last step was still a large one.
    NotConverged,
    /// The flights say that the cameras stand elsewhere than the calibration claims.
    Contradicting,
}

/// Result of a refinement of a calibration by flights.
#[derive(Debug, Clone, PartialEq)]
pub struct Refinement {
    /// Outcome of the refinement. Unless it refined, the calibration is as it was before.
    pub status: FlightStatus,
    /// Cameras that did not converge before are as they were.
    pub calibration: Calibration,
    /// Flights that counted.
    pub flights: usize,
    /// Sightings of the flights that counted.
    pub sightings: usize,
    /// Fraction of the sightings that did not count, being outliers.
    pub outlier_fraction: f64,
    /// Ratio of the variance of the sightings to the one that they claim, one at least; the claimed
    /// covariance contains it.
    pub variance_factor: f64,
    /// Rotation about x and y of W that leads from its z to the vertical, in radians.
    pub tilt_rad: [f64; 2],
    /// Standard deviations of the tilt, in radians.
    pub tilt_sd_rad: [f64; 2],
    /// Root mean square of how far the cameras moved, in standard deviations of the calibration.
    pub change_sd: f64,
}

/// Refines the cameras of a calibration that converged by flights of which they have sightings.
pub fn refine(calibration: &Calibration, flights: &[Flight]) -> Refinement {
    let unchanged = Refinement {
        status: FlightStatus::TooFewSightings,
        calibration: calibration.clone(),
        flights: 0,
        sightings: 0,
        outlier_fraction: 0.0,
        variance_factor: 1.0,
        tilt_rad: [0.0; 2],
        tilt_sd_rad: [TILT_SD_RAD; 2],
        change_sd: 0.0,
    };
    let Some(mut problem) = Problem::new(calibration, flights) else { return unchanged };
    let sightings = problem.flights.iter().map(|it| it.seen.len()).sum();
    let unchanged = Refinement { flights: problem.flights.len(), sightings, ..unchanged };
    let Some(solution) = problem.solve() else {
        return Refinement { status: FlightStatus::NotConverged, ..unchanged };
    };
    let change_sd = problem.change_sd();
    let found = Refinement {
        outlier_fraction: solution.outliers as f64 / sightings as f64,
        variance_factor: problem.factor,
        change_sd,
        ..unchanged
    };
    if change_sd > MOST_CHANGE_SD {
        return Refinement { status: FlightStatus::Contradicting, ..found };
    }
    let tilt_at = OF_CAMERA * problem.cameras.len();
    Refinement {
        status: FlightStatus::Refined,
        calibration: problem.refined(calibration, &solution.covariance),
        tilt_rad: problem.tilt_rad,
        tilt_sd_rad: [0, 1].map(|i| solution.covariance[(tilt_at + i, tilt_at + i)].sqrt()),
        ..found
    }
}

/// Parameters that are estimated, and their priors.
struct Problem {
    /// Indices of the cameras that are refined.
    refined: Vec<usize>,
    calibrated: Vec<CameraState>,
    cameras: Vec<CameraState>,
    tilt_rad: [f64; 2],
    flights: Vec<FlightState>,
    prior: DMatrix<f64>,
    factor: f64,
}

struct Solution {
    covariance: DMatrix<f64>,
    outliers: usize,
}

impl Problem {
    /// `None` where no flight counts, or the calibration claims nothing.
    fn new(calibration: &Calibration, flights: &[Flight]) -> Option<Self> {
        let is_refined = |it: &usize| calibration.cameras[*it].status == CalibrationStatus::Converged;
        let refined: Vec<usize> = (0..calibration.cameras.len()).filter(is_refined).collect();
        let cameras: Vec<CameraState> = refined
            .iter()
            .map(|it| {
                let camera = &calibration.cameras[*it];
                let (depth_scale, time_offset_s) = (camera.depth_scale, camera.time_offset_s);
                CameraState { X_WC: camera.X_WC, depth_scale, time_offset_s, offset: Vector3::zeros() }
            })
            .collect();
        let flight = |it: &Flight| {
            let seen = it.sightings.iter().filter_map(|it| {
                let camera = refined.iter().position(|camera| *camera == it.camera)?;
                Seen::new(Sighting { camera, ..*it })
            });
            let seen: Vec<Seen> = seen.collect();
            if seen.len() < LEAST_SIGHTINGS { None } else { FlightState::new(seen, &cameras) }
        };
        let flights: Vec<FlightState> = flights.iter().filter_map(flight).collect();
        if flights.is_empty() {
            return None;
        }
        let place = |i: usize| CAMERA_PARAMETERS * refined[i / CAMERA_PARAMETERS] + i % CAMERA_PARAMETERS;
        let size = CAMERA_PARAMETERS * refined.len();
        let joint = DMatrix::from_fn(size, size, |i, j| calibration.covariance[(place(i), place(j))]);
        let joint = joint.iter().all(|it| it.is_finite()).then(|| joint.cholesky()).flatten()?.inverse();
        let common = OF_CAMERA * refined.len();
        let mut prior = DMatrix::zeros(common + OF_TILT, common + OF_TILT);
        let place = |i: usize| OF_CAMERA * (i / CAMERA_PARAMETERS) + i % CAMERA_PARAMETERS;
        for (i, j) in (0..size).flat_map(|j| (0..size).map(move |i| (i, j))) {
            prior[(place(i), place(j))] = joint[(i, j)];
        }
        for (camera, axis) in (0..refined.len()).flat_map(|camera| (0..OF_OFFSET).map(move |axis| (camera, axis))) {
            let at = OF_CAMERA * camera + CAMERA_PARAMETERS + axis;
            prior[(at, at)] = inverse_variance(OFFSET_SD_M[axis]);
        }
        (0..OF_TILT).for_each(|i| prior[(common + i, common + i)] = inverse_variance(TILT_SD_RAD));
        let (calibrated, tilt_rad) = (cameras.clone(), [0.0; 2]);
        Some(Self { refined, calibrated, cameras, tilt_rad, flights, prior, factor: 1.0 })
    }

    /// Deviations from their prior means of all parameters that flights have in common.
    fn deviation(&self) -> DVector<f64> {
        let mut all = Vec::with_capacity(self.prior.nrows());
        for (camera, before) in self.cameras.iter().zip(&self.calibrated) {
            let off = before.X_WC.inv_mul(&camera.X_WC);
            all.extend(off.rotation.scaled_axis().iter());
            all.extend(off.translation.vector.iter());
            all.extend([camera.depth_scale - before.depth_scale, camera.time_offset_s - before.time_offset_s]);
            all.extend(camera.offset.iter());
        }
        all.extend(self.tilt_rad);
        DVector::from_vec(all)
    }

    /// Root mean square of how far the cameras moved, over what the calibration claims, offsets and tilt
    /// being as they are.
    fn change_sd(&self) -> f64 {
        let deviation = self.deviation();
        let is_camera = |i: usize| i < OF_CAMERA * self.cameras.len() && i % OF_CAMERA < CAMERA_PARAMETERS;
        let moved = DVector::from_fn(deviation.len(), |i, _| if is_camera(i) { deviation[i] } else { 0.0 });
        (moved.dot(&(&self.prior * &moved)) / (CAMERA_PARAMETERS * self.cameras.len()) as f64).sqrt()
    }

    /// Gauss–Newton. Once it has converged the flights tell how much they vary, and it goes on with that.
    fn solve(&mut self) -> Option<Solution> {
        self.factor = self.variance_factor();
        self.converge(true)?;
        let (equations, information) = self.linearized()?;
        self.factor *= variation(&information, &equations)?.max(1.0);
        self.converge(false)?;
        let (equations, information) = self.linearized()?;
        let outliers = equations.iter().map(|it| it.outliers).sum();
        Some(Solution { covariance: information.cholesky()?.inverse(), outliers })
    }

    /// Steps until they are small; whether residuals tell the variance factor.
    fn converge(&mut self, with_factor: bool) -> Option<()> {
        let mut length_sd = f64::INFINITY;
        for _ in 0..STEPS {
            let (equations, information) = self.linearized()?;
            let pull = equations.iter().fold(-(&self.prior * self.deviation()), |sum, it| sum + &it.pull);
            let change = information.clone().cholesky()?.solve(&pull);
            let before = self.factor;
            self.step(&equations, &change);
            if with_factor {
                self.factor = self.variance_factor();
            }
            length_sd = change.dot(&(information * &change)).sqrt();
            if length_sd < SMALL_SD && (self.factor / before - 1.0).abs() < SMALL_SD {
                break;
            }
        }
        // Steps stay as large as these are if sightings alternate between counting and not.
        (length_sd < NOT_LARGE_SD).then_some(())
    }

    /// Ratio of the variance of single sightings to the one that they claim, by the median of their
    /// residuals.
    fn variance_factor(&self) -> f64 {
        let rows = self.flights.iter().flat_map(|it| it.rows(&self.cameras, self.tilt_rad));
        let mut squares: Vec<f64> = rows.map(|it| it.residual.norm_squared()).collect();
        let count = 3.0 * squares.len() as f64;
        let estimated = (OF_FLIGHT * self.flights.len()) as f64;
        (median_in_place(&mut squares) / MEDIAN_OF_SQUARES * count / (count - estimated).max(1.0)).max(1.0)
    }

    fn linearized(&self) -> Option<(Vec<FlightEquations>, DMatrix<f64>)> {
        let of = |it: &FlightState| it.equations(&self.cameras, self.tilt_rad, self.factor);
        let equations = self.flights.iter().map(of).collect::<Option<Vec<FlightEquations>>>()?;
        let information = equations.iter().fold(self.prior.clone(), |sum, it| sum + &it.information);
        Some((equations, information))
    }

    fn step(&mut self, equations: &[FlightEquations], change: &DVector<f64>) {
        for (i, camera) in self.cameras.iter_mut().enumerate() {
            let three = |first: usize| change.fixed_rows::<3>(OF_CAMERA * i + first).into_owned();
            camera.X_WC *= moved(&three(3), &three(0));
            camera.depth_scale += change[OF_CAMERA * i + 6];
            camera.time_offset_s += change[OF_CAMERA * i + 7];
            camera.offset += three(CAMERA_PARAMETERS);
        }
        let tilt_at = OF_CAMERA * self.cameras.len();
        self.tilt_rad.iter_mut().enumerate().for_each(|(i, it)| *it += change[tilt_at + i]);
        self.flights.iter_mut().zip(equations).for_each(|(flight, it)| flight.step(it, change));
    }

    /// The calibration with cameras as they are refined, and their covariance.
    fn refined(&self, calibration: &Calibration, covariance: &DMatrix<f64>) -> Calibration {
        let mut all = calibration.clone();
        let place = |row: usize| {
            let i = self.refined.iter().position(|it| *it == row / CAMERA_PARAMETERS)?;
            Some(OF_CAMERA * i + row % CAMERA_PARAMETERS)
        };
        all.covariance =
            DMatrix::from_fn(all.covariance.nrows(), all.covariance.ncols(), |i, j| match (place(i), place(j)) {
                (Some(i), Some(j)) => covariance[(i, j)],
                (None, None) => calibration.covariance[(i, j)],
                _ => 0.0,
            });
        for (i, state) in self.refined.iter().zip(&self.cameras) {
            let first = CAMERA_PARAMETERS * i;
            let camera = &mut all.cameras[*i];
            camera.X_WC = state.X_WC;
            camera.covariance = Matrix6::from_fn(|row, column| all.covariance[(first + row, first + column)]);
            (camera.depth_scale, camera.time_offset_s) = (state.depth_scale, state.time_offset_s);
            camera.time_offset_sd_s = Some(all.covariance[(first + 7, first + 7)].sqrt());
        }
        all
    }
}

/// Ratio of the flights' variance to the one that their sightings claim: the jackknife's covariance over that
/// of independent residuals, both over the information of all (`covariance.rs`). One, where there are few
/// flights.
fn variation(information: &DMatrix<f64>, equations: &[FlightEquations]) -> Option<f64> {
    if equations.len() < LEAST_FLIGHTS {
        return Some(1.0);
    }
    let inverse = information.clone().cholesky()?.inverse();
    let (mut found, mut expected) = (0.0, 0.0);
    for flight in equations {
        let away = (information - &flight.information).cholesky()?.solve(&flight.pull);
        found += away.dot(&(information * &away));
        expected += (&flight.information * &inverse).trace();
    }
    Some(found / expected)
}
