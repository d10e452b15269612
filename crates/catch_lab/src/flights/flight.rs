//! A flight through a recorded track, in the axes and on the clock of the track.

use std::sync::Arc;

use catch_body::free_flight::{
    DRAG, FlyingBody, FreeState, N, OMEGA, PARAMETERS, POINT, ParameterVector, Pushes, THETA,
};
use catch_bot::trajectory_prediction::{AerodynamicForces, FlightTrajectory, ProcessNoise};
use nalgebra::{Matrix3, Matrix6, Point3, SMatrix, Vector3};

use super::flight_prior::{DRAG_AT, FlightPrior, Noise, ParameterCovariance};

/// Longest step of the integration, and most steps between two times.
const STEP_S: f64 = 0.01;
const MOST_STEPS: f64 = 1000.0;

/// A sighting agrees with the flight within this many standard deviations.
const INLIER_SD: f64 = 6.0;

/// A flight: the most probable motion at the sightings it was fitted to, and its covariance at the last of
/// them.
#[derive(Debug, Clone)]
pub struct Flight {
    /// Time of the first sighting of the flight.
    pub start_s: f64,
    /// Time of the last.
    pub time_s: f64,
    /// Noise of the sightings.
    pub noise: Noise,
    /// Noise density of the acceleration that was found, in m/s²/√Hz.
    pub acceleration_noise: f64,
    /// True if orientations were measured.
    pub oriented: bool,
    /// Accelerations that the equations of motion do not explain, in equal parts of the time, in m/s².
    pub pushes: Vec<Vector3<f64>>,
    /// Motion of the centre of mass at the time of each sighting.
    pub states: Vec<(f64, FreeState)>,
    /// Distance of each sighting from the flight.
    pub errors_m: Vec<f64>,
    /// Negative logarithm of its probability density, but for a constant.
    pub deviance: f64,
    /// Squares of the noise densities that the disturbances of this flight have: of the acceleration, beyond
    /// those of its Magnus force, and of the angular acceleration.
    pub disturbances: (f64, f64),
    pub(super) body: FlyingBody,
    /// Covariance of the error state at the last sighting.
    pub(super) covariance: SMatrix<f64, N, N>,
    pub(super) prior: Arc<FlightPrior>,
    pub(super) g: Vector3<f64>,
}

/// State of an object at one time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FlightState {
    /// Position of the tracked point in metres.
    pub position: Point3<f64>,
    /// Velocity in m/s.
    pub velocity: Vector3<f64>,
    /// Covariance of (position, velocity), in m² and m²/s².
    pub covariance: Matrix6<f64>,
}

impl FlightState {
    /// Returns whether all numbers are finite: backward through air the speed soon becomes infinite.
    pub fn is_finite(&self) -> bool {
        let Self { position, velocity, covariance, .. } = self;
        position.iter().chain(velocity).chain(covariance).all(|it| it.is_finite())
    }
}

impl Flight {
    /// The tracked point at a time: followed from the last sighting, with the noise of the process in
    /// between.
    pub fn at(&self, time_s: f64) -> FlightState {
        let (count, h) = steps(time_s - self.time_s);
        let pushes = Pushes { acceleration: self.g, angular: Vector3::zeros() };
        let (mut state, mut covariance) = (self.states[self.states.len() - 1].1, self.covariance);
        for _ in 0..count {
            let (next, transition) = self.body.step_with_derivatives(&pushes, &state, h);
            let mut whole = SMatrix::<f64, N, N>::identity();
            whole.fixed_rows_mut::<12>(0).copy_from(&transition);
            covariance = whole * covariance * whole.transpose();
            let mut add = |at: usize, density: f64| {
                let (t, q) = (h.abs(), density * density);
                for i in at..at + 3 {
                    covariance[(i, i)] += q * t.powi(3) / 3.0;
                    covariance[(i, i + 3)] += q * t * t / 2.0 * h.signum();
                    covariance[(i + 3, i)] += q * t * t / 2.0 * h.signum();
                    covariance[(i + 3, i + 3)] += q * t;
                }
            };
            add(0, self.acceleration_noise);
            if self.oriented {
                add(THETA, self.prior.angular_acceleration_noise);
            }
            state = next;
        }
        let (p, v) = self.body.tracked_point(&state);
        let by = self.body.tracked_point_by(&state);
        let mut covariance = by * covariance * by.transpose();
        for i in 0..3 {
            covariance[(i, i)] += self.prior.systematic_sd_m.powi(2);
        }
        FlightState { position: p.into(), velocity: v, covariance }
    }

    /// The parameters that were found.
    pub fn parameters(&self) -> ParameterVector {
        self.body.parameters
    }

    /// Returns the covariance of the parameters.
    pub fn parameter_covariance(&self) -> ParameterCovariance {
        self.covariance.fixed_view::<PARAMETERS, PARAMETERS>(POINT, POINT).into_owned()
    }

    /// Drag constant in 1/m, where it depends on the direction its geometric mean, and its standard
    /// deviation.
    pub fn drag_per_m(&self) -> [f64; 2] {
        let drag = libm::exp(self.parameters().fixed_rows::<3>(DRAG_AT).mean());
        let variance = self.parameter_covariance().fixed_view::<3, 3>(DRAG_AT, DRAG_AT).sum() / 9.0;
        [drag, drag * variance.max(0.0).sqrt()]
    }

    /// Approximate deviance of a sighting that lies on the flight: the mean of the robust cost under normal
    /// errors is 1.7.
    pub(super) fn deviance_of_row(&self) -> f64 {
        let of = |sd: f64| 1.7 + 3.0 * libm::log(sd);
        of(self.noise.position_sd_m) + if self.oriented { of(self.noise.orientation_sd_rad) } else { 0.0 }
    }

    /// Sightings that it was fitted to.
    pub fn considered(&self) -> usize {
        self.errors_m.len()
    }

    /// Sightings that agree with it.
    pub fn inliers(&self) -> usize {
        self.errors_m.iter().filter(|it| **it <= INLIER_SD * self.noise.position_sd_m).count()
    }

    /// Returns the flight as a trajectory for the brain's planners, in axes whose z points up.
    pub fn trajectory(&self) -> FlightTrajectory {
        let (time_s, FreeState { p, v, R, w }) = self.states[self.states.len() - 1];
        let body = &self.body;
        let drag_per_m = body.drag.trace() / 3.0;
        // Derivatives of (p, v, k), of the centre of mass in O, and of (rotation vector, angular velocity) in
        // W.
        let mut point = SMatrix::<f64, 7, N>::zeros();
        point.fixed_view_mut::<6, 6>(0, 0).fill_with_identity();
        point.fixed_view_mut::<1, 3>(6, DRAG).fill(drag_per_m / 3.0);
        let mut com = SMatrix::<f64, 9, N>::zeros();
        com.fixed_view_mut::<6, 6>(0, 0).fill_with_identity();
        com.fixed_view_mut::<3, 3>(6, POINT).fill_diagonal(-1.0);
        let matrix = R.to_rotation_matrix().into_inner();
        let mut rotation = SMatrix::<f64, 6, N>::zeros();
        rotation.fixed_view_mut::<3, 3>(0, THETA).copy_from(&matrix);
        rotation.fixed_view_mut::<3, 3>(3, OMEGA).copy_from(&matrix);
        FlightTrajectory {
            time_s,
            p_WOcm: p.into(),
            v_WOcm: v,
            R_WO: R,
            w_WO: R * w,
            drag_per_m,
            spin_decay_per_s: body.decay,
            inertia_per_kg: self.oriented.then_some(body.inertia),
            covariance: point * self.covariance * point.transpose(),
            rotation_covariance: rotation * self.covariance * rotation.transpose(),
            systematic_sd_m: self.prior.systematic_sd_m,
            com_O: -body.r,
            com_covariance: com * self.covariance * com.fixed_rows::<3>(6).transpose(),
            forces: AerodynamicForces {
                drag_deviation_O: body.drag - Matrix3::identity() * drag_per_m,
                magnus: body.magnus,
                lift_W: body.lift,
                lift_O: Vector3::zeros(),
            },
            process_noise: ProcessNoise {
                acceleration: self.acceleration_noise,
                angular_acceleration: if self.oriented { self.prior.angular_acceleration_noise } else { 0.0 },
            },
            inliers: self.inliers(),
            considered: self.considered(),
            error_scale: 1.0,
            ..FlightTrajectory::default()
        }
    }
}

/// Steps for a duration, and how long each is.
pub(super) fn steps(duration_s: f64) -> (usize, f64) {
    let steps = (duration_s.abs() / STEP_S - 1e-6).ceil().clamp(1.0, MOST_STEPS);
    (steps as usize, duration_s / steps)
}
