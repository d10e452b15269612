//! Flights of real objects: aerodynamic forces that depend on the orientation, a tracked point beside the centre of mass, and
//! noise of the process for what no model knows.
//!
//! The motion obeys the equations of `dynamics.rs`, disturbed by white noise of the acceleration and of the angular
//! acceleration. Its parameters have a Gaussian prior, learned from other throws ([`FlightPrior`]). [`AerodynamicFit`] finds the
//! most probable motion and parameters of one throw; [`AerodynamicFlight`] is followed from there with its covariance.

mod dynamics;
mod smoother;
mod start;

use std::sync::Arc;

use nalgebra::{Matrix6, Point3, SMatrix, Unit, UnitQuaternion, Vector3};
use serde::{Deserialize, Serialize};

use super::track::TrackSample;
use catch_body::{InputError, dynamics::gravity, quantity};
use catch_bot::trajectory_prediction::PredictionStatus;
use dynamics::{Body, Covariance, POINT, State};
pub use dynamics::{PARAMETERS, ParameterVector};
use smoother::{Node, Problem, Sample};
pub use start::LEAST_SAMPLES;

/// Covariance of the parameters.
pub type ParameterCovariance = SMatrix<f64, PARAMETERS, PARAMETERS>;

/// What is known of an object's flights before one is seen.
///
/// The 16 parameters are in SI units, in this order. The tracked point from the centre of mass is in the body frame: x, y, z (m). The
/// symmetric drag matrix D of a = −|v|·D·v is in the body frame: xx, yy, zz, xy, xz, yz (1/m). Then come the Magnus coefficient k of
/// a = k·ω×v and the decay c of the spin in ω̇ = −c·ω (1/s). The last are those of the traceless matrix S, whose exponential is the
/// inertia tensor: xx, yy, xy, xz, yz.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FlightPrior {
    /// Where the numbers come from.
    pub source: String,
    /// Throws that they were learned from.
    pub throws: usize,
    /// Noise density of the acceleration, in m/s²/√Hz.
    #[serde(deserialize_with = "quantity::noise_density")]
    pub acceleration_noise: f64,
    /// Noise density of the angular acceleration, in rad/s²/√Hz.
    #[serde(deserialize_with = "quantity::noise_density")]
    pub angular_acceleration_noise: f64,
    /// Error in metres that neighbouring samples have in common, so that no number of them reduces it; part of every prediction.
    #[serde(deserialize_with = "quantity::error_m")]
    pub systematic_sd_m: f64,
    /// Least noise of a sample that is believed, however well the samples agree with each other.
    pub least_noise: Noise,
    /// Mean of the parameters.
    pub mean: [f64; PARAMETERS],
    /// Their covariance, row by row.
    pub covariance: [[f64; PARAMETERS]; PARAMETERS],
}

impl FlightPrior {
    /// Mean of the parameters.
    pub fn mean(&self) -> ParameterVector {
        ParameterVector::from(self.mean)
    }

    /// Covariance of the parameters.
    pub fn covariance(&self) -> ParameterCovariance {
        ParameterCovariance::from_fn(|i, j| self.covariance[i][j])
    }

    /// Whether it can be used; `file` names it in errors.
    ///
    /// # Errors
    /// A covariance that is none.
    pub fn check(&self, file: &str) -> Result<(), InputError> {
        let covariance = self.covariance();
        let is_covariance = (covariance - covariance.transpose()).amax() <= 1e-9 * covariance.amax()
            && (covariance + ParameterCovariance::identity() * 1e-12).cholesky().is_some();
        let expected = "a matrix that is symmetric and positive definite";
        if is_covariance { Ok(()) } else { Err(InputError::new(file, "covariance", "another matrix", expected)) }
    }

    /// This prior with other moments of the parameters.
    pub fn with_moments(&self, mean: &ParameterVector, covariance: &ParameterCovariance) -> Self {
        let rows = std::array::from_fn(|i| std::array::from_fn(|j| covariance[(i, j)]));
        Self { mean: (*mean).into(), covariance: rows, ..self.clone() }
    }
}

/// Standard deviations of a track's samples along and about each axis.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Noise {
    /// Of the position, in metres.
    #[serde(deserialize_with = "quantity::error_m")]
    pub position_sd_m: f64,
    /// Of the orientation, in radians.
    #[serde(deserialize_with = "quantity::error_rad")]
    pub orientation_sd_rad: f64,
}

/// Samples that one fit looks at, at most; of more, every second, third … one.
const MOST_SAMPLES: usize = 400;
/// Passes after which the noise of the samples stays as it is.
const NOISE_PASSES: usize = 4;
/// The noise of the samples before it is estimated.
const FIRST_NOISE: Noise = Noise { position_sd_m: 2e-3, orientation_sd_rad: 0.02 };
/// A sample agrees with the flight within this many standard deviations.
const INLIER_SD: f64 = 6.0;
/// That many samples at the end that all lie further than this off are a contact, not outliers.
const CONTACT_SAMPLES: usize = 4;
const CONTACT_SD: f64 = 12.0;
const CONTACT_M: f64 = 0.01;

/// Fits flights to tracks; keeps its buffers from one to the next, and nothing else.
#[derive(Debug, Clone)]
pub struct AerodynamicFit {
    /// Passes of the smoother at most.
    pub most_passes: usize,
    /// A pass has changed nothing when its step is shorter than that many standard deviations.
    pub step_sd: f64,
    prior: Arc<FlightPrior>,
    samples: Vec<Sample>,
    nodes: Vec<Node>,
    start: start::Scratch,
    numbers: Vec<f64>,
}

/// A flight with aerodynamics: the most probable motion at the newest sample, and its covariance.
#[derive(Debug, Clone)]
pub struct AerodynamicFlight {
    /// Time of the newest sample of the flight.
    pub time_s: f64,
    /// Time of its first sample.
    pub start_s: f64,
    /// When a contact ended the flight.
    pub contact_s: Option<f64>,
    /// Noise of the samples.
    pub noise: Noise,
    /// Samples that agree with the flight, of those looked at.
    pub inliers: usize,
    /// Samples that were looked at.
    pub considered: usize,
    /// Whether the passes came to rest.
    pub converged: bool,
    state: State,
    body: Body,
    covariance: Covariance,
    oriented: bool,
    prior: Arc<FlightPrior>,
    g: Vector3<f64>,
}

/// The tracked point at some time, in the track's axes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TrackedPoint {
    /// Its position, in metres.
    pub position: Point3<f64>,
    /// Its velocity, in m/s.
    pub velocity: Vector3<f64>,
    /// Orientation of the object.
    pub orientation: UnitQuaternion<f64>,
    /// Covariance of (position, velocity), in m² and m²/s².
    pub covariance: Matrix6<f64>,
}

/// The motion at one sample of a track, given all samples of the flight; in the track's axes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SmoothedState {
    /// Time of the sample.
    pub time_s: f64,
    /// Position of the centre of mass, in metres.
    pub position: Point3<f64>,
    /// Its velocity, in m/s.
    pub velocity: Vector3<f64>,
    /// Orientation of the object.
    pub orientation: UnitQuaternion<f64>,
    /// Angular velocity in rad/s.
    pub angular_velocity: Vector3<f64>,
}

/// The first free flight in a track, in the order of time: the range of its samples, and when a contact ended it.
///
/// A contact changes the velocity by more than gravity, drag and tumbling do. Samples before the flight, in a hand, are left out.
pub fn free_flight(samples: &[TrackSample], up: &Unit<Vector3<f64>>) -> (std::ops::Range<usize>, Option<f64>) {
    let g = up.into_inner() * -gravity().norm();
    let rows: Vec<Sample> = samples.iter().filter_map(sample).collect();
    if rows.len() < samples.len() {
        return (0..samples.len(), None);
    }
    let (first, last, ended) = start::free_flight(&g, &rows, &mut start::Scratch::default());
    (first..last, ended.then(|| rows[last].time_s))
}

impl AerodynamicFit {
    /// With a prior of the parameters.
    pub fn new(prior: FlightPrior) -> Self {
        Self {
            most_passes: 12,
            step_sd: 0.02,
            prior: Arc::new(prior),
            samples: Vec::new(),
            nodes: Vec::new(),
            start: start::Scratch::default(),
            numbers: Vec::new(),
        }
    }

    /// The prior.
    pub fn prior(&self) -> &FlightPrior {
        &self.prior
    }

    /// Fits a flight to samples in the order of time. Samples with numbers that are none are passed over, and so are those
    /// before the flight and after a contact.
    ///
    /// `up` is the direction in the track's axes against which gravity pulls. The noise of the samples is estimated if it is
    /// not given; the standard deviations in the samples are not looked at.
    ///
    /// # Errors
    /// Too few samples, or none that agree on a flight.
    pub fn fit(
        &mut self,
        samples: &[TrackSample],
        up: &Unit<Vector3<f64>>,
        noise: Option<Noise>,
    ) -> Result<AerodynamicFlight, PredictionStatus> {
        let g = up.into_inner() * -gravity().norm();
        self.samples.clear();
        self.samples.extend(samples.iter().filter_map(sample));
        self.samples.dedup_by(|next, last| next.time_s <= last.time_s);
        // A flight is found among as few more.
        thin(&mut self.samples, 2 * MOST_SAMPLES);
        let (first, last, ended) = start::free_flight(&g, &self.samples, &mut self.start);
        let mut contact_s = ended.then(|| self.samples[last].time_s);
        self.samples.truncate(last);
        self.samples.drain(..first);
        thin(&mut self.samples, MOST_SAMPLES);
        loop {
            let flight = self.fit_free_flight(g, contact_s, noise)?;
            let far = |node: &&Node| node.error_m > CONTACT_M && node.error_m > CONTACT_SD * flight.noise.position_sd_m;
            let tail = self.nodes.iter().rev().take_while(far).count();
            if tail < CONTACT_SAMPLES || contact_s.is_some() || self.samples.len() - tail < LEAST_SAMPLES {
                return Ok(flight);
            }
            let last = self.samples.len() - tail;
            contact_s = Some(self.samples[last].time_s);
            self.samples.truncate(last);
        }
    }

    /// The motion that the last [`fit`](Self::fit) found, at each sample that it looked at; of no meaning where that failed.
    pub fn smoothed(&self) -> impl Iterator<Item = SmoothedState> {
        self.samples.iter().zip(&self.nodes).map(|(Sample { time_s, .. }, Node { state, .. })| SmoothedState {
            time_s: *time_s,
            position: state.p.into(),
            velocity: state.v,
            orientation: state.R,
            angular_velocity: state.R * state.w,
        })
    }

    fn fit_free_flight(
        &mut self,
        g: Vector3<f64>,
        contact_s: Option<f64>,
        noise: Option<Noise>,
    ) -> Result<AerodynamicFlight, PredictionStatus> {
        let Self { most_passes, step_sd, prior, samples, nodes, start, numbers } = self;
        let (Some(first), Some(newest)) = (samples.first(), samples.last()) else {
            return Err(PredictionStatus::TooFewPoses);
        };
        if samples.len() < LEAST_SAMPLES {
            return Err(PredictionStatus::TooFewPoses);
        }
        let oriented = samples.iter().any(|it| it.R.is_some());
        nodes.resize_with(samples.len(), Node::new);
        start::nodes(&g, samples, nodes, start);
        let problem = Problem { g, prior, samples, oriented };
        let mut body = problem.body();
        let mut sds = noise.unwrap_or(FIRST_NOISE);
        let mut converged = false;
        for pass in 0..*most_passes {
            let step = problem.pass(&mut body, nodes, &sds).ok_or(PredictionStatus::NotConverged)?;
            problem.weigh(&body, nodes, &sds);
            if pass < NOISE_PASSES && noise.is_none() {
                sds = problem.noise(nodes, numbers);
                problem.weigh(&body, nodes, &sds);
            } else if step < *step_sd {
                converged = true;
                break;
            }
        }
        let inliers = nodes.iter().filter(|node| node.error_m <= INLIER_SD * sds.position_sd_m).count();
        let last = &nodes[nodes.len() - 1];
        Ok(AerodynamicFlight {
            time_s: newest.time_s,
            start_s: first.time_s,
            contact_s,
            noise: sds,
            inliers,
            considered: nodes.len(),
            converged,
            state: last.state,
            body,
            covariance: *last.covariance(),
            oriented,
            prior: prior.clone(),
            g,
        })
    }
}

/// Leaves every second, third … sample, the newest among them, so that no more than `most` are left.
fn thin(samples: &mut Vec<Sample>, most: usize) {
    let every = samples.len().div_ceil(most).max(1);
    let mut left = samples.len();
    samples.retain(|_| {
        left -= 1;
        left.is_multiple_of(every)
    });
}

fn sample(sample: &TrackSample) -> Option<Sample> {
    let R = sample.orientation.filter(|it| it.coords.iter().all(|value| value.is_finite()));
    let finite = sample.time_s.is_finite() && sample.position.coords.iter().all(|value| value.is_finite());
    finite.then_some(Sample { time_s: sample.time_s, p: sample.position.coords, R })
}

impl AerodynamicFlight {
    /// The tracked point at a time.
    pub fn at(&self, time_s: f64) -> TrackedPoint {
        let problem = Problem { g: self.g, prior: &self.prior, samples: &[], oriented: self.oriented };
        let duration_s = time_s - self.time_s;
        let steps = (duration_s.abs() / smoother::STEP_S).ceil().clamp(1.0, 1000.0);
        let (mut state, mut covariance) = (self.state, self.covariance);
        for _ in 0..steps as usize {
            let (next, transition) = smoother::propagate(&self.body, &self.g, &state, duration_s / steps);
            problem.carry(&transition, &mut covariance, duration_s / steps);
            state = next;
        }
        let (p, v) = state.tracked_point(&self.body);
        let by = state.tracked_point_by(&self.body);
        let mut covariance = by * covariance * by.transpose();
        for i in 0..3 {
            covariance[(i, i)] += self.prior.systematic_sd_m.powi(2);
        }
        TrackedPoint { position: p.into(), velocity: v, orientation: state.R, covariance }
    }

    /// The parameters that were found.
    pub fn parameters(&self) -> ParameterVector {
        self.body.parameters
    }

    /// Their covariance.
    pub fn parameter_covariance(&self) -> ParameterCovariance {
        self.covariance.fixed_view::<PARAMETERS, PARAMETERS>(POINT, POINT).into_owned()
    }
}
