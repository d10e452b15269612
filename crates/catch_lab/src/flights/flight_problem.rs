//! The least-squares problem of a flight: its unknowns, its cost, and the equations of a step.

use std::sync::Arc;

use catch_body::free_flight::{
    FlyingBody, FreeState, OMEGA, PARAMETERS, POINT, ParameterVector, Pushes, THETA, Transition,
};
use nalgebra::{DMatrix, DVector, SVector, Vector3};

use super::{
    flight::steps,
    flight_prior::{FlightPrior, Noise},
    track_file::Sighting,
};
use catch_body::statistics::{quantile, sorted};

/// The median of the norm of three standard normal numbers.
pub(super) const MEDIAN: f64 = 1.538;
/// A tenth of such norms is smaller than this.
const TENTH: f64 = 0.764;
/// Degrees of freedom of the errors' distribution.
const STUDENT_DOF: f64 = 4.0;
/// Duration of the first and the last disturbance, and factor of its growth inwards: predictions depend most
/// on the motion at the end.
const FIRST_STRETCH_S: f64 = 0.03;
const LAST_STRETCH_S: f64 = 0.015;
const STRETCH_GROWTH: f64 = 1.25;
/// Density of the disturbances that comes with a Magnus force, in 1/√Hz.
const VARYING_LIFT: f64 = 0.01;
/// Largest element of z: that many standard deviations of the prior.
pub(super) const MOST_SD: f64 = 12.0;
/// Standard deviations of the unknowns' errors: of the sightings, and the densities of the disturbances.
#[derive(Debug, Clone, Copy)]
pub(super) struct Scales {
    pub noise: Noise,
    pub acceleration_noise: f64,
    pub angular_acceleration_noise: f64,
}

/// A point of the search.
#[derive(Debug, Clone)]
pub(super) struct Guess {
    pub start: FreeState,
    /// z, and the disturbances, those of a stretch together.
    pub rest: DVector<f64>,
}

/// Least-squares problem of a flight.
pub(super) struct Problem<'a> {
    pub g: Vector3<f64>,
    pub prior: &'a Arc<FlightPrior>,
    pub rows: &'a [Sighting],
    /// True if orientations were measured; without them the body frame is the world's and does not rotate.
    pub oriented: bool,
    pub mean: ParameterVector,
    pub basis: DMatrix<f64>,
    /// Least noise of the sightings: as neighbours have it.
    pub least: Noise,
    /// Times since the first sighting at which the disturbances end.
    pub ends_s: Vec<f64>,
}

/// The normal equations, and what they are from.
pub(super) struct Equations {
    pub information: DMatrix<f64>,
    pub pull: DVector<f64>,
    /// Derivatives of the last state with respect to the unknowns.
    pub last_by: DMatrix<f64>,
}

impl<'a> Problem<'a> {
    /// Creates the problem of sightings in the order of time, under gravity `g`.
    pub fn new(g: Vector3<f64>, prior: &'a Arc<FlightPrior>, rows: &'a [Sighting]) -> Self {
        let oriented = rows.iter().any(|it| it.rotation.is_some());
        let (mean, basis) = prior.whitened(oriented);
        let duration_s = rows.last().map_or(0.0, |it| it.time_s) - rows.first().map_or(0.0, |it| it.time_s);
        let local =
            Noise { position_sd_m: local_noise_m(rows).max(prior.least_noise.position_sd_m), ..prior.least_noise };
        Self { g, prior, rows, oriented, mean, basis, least: local, ends_s: stretch_ends_s(duration_s) }
    }

    /// Elements of the state, and of a disturbance.
    pub fn sizes(&self) -> (usize, usize) {
        if self.oriented { (12, 6) } else { (6, 3) }
    }

    pub fn unknowns(&self) -> usize {
        let (state, push) = self.sizes();
        state + self.basis.ncols() + push * self.ends_s.len()
    }

    pub fn body(&self, guess: &Guess) -> FlyingBody {
        let z = guess.rest.rows(0, self.basis.ncols());
        let moved: DVector<f64> = &self.basis * z;
        FlyingBody::new(&(self.mean + ParameterVector::from_column_slice(moved.as_slice())))
    }

    /// Returns the accelerations of a disturbance, and the index of its elements among the unknowns after the
    /// state.
    pub fn pushes(&self, guess: &Guess, between_s: [f64; 2]) -> (Pushes, usize) {
        let (_, size) = self.sizes();
        let at = self.basis.ncols() + size * self.stretch(f64::midpoint(between_s[0], between_s[1]));
        let push = |from: usize| Vector3::from_fn(|i, _| guess.rest[at + from + i]);
        let angular = if self.oriented { push(3) } else { Vector3::zeros() };
        (Pushes { acceleration: self.g + push(0), angular }, at)
    }

    /// The stretch of a time.
    fn stretch(&self, time_s: f64) -> usize {
        let since_s = time_s - self.rows[0].time_s;
        self.ends_s.partition_point(|it| *it < since_s).min(self.ends_s.len() - 1)
    }

    /// The states at all sightings.
    pub fn states(&self, body: &FlyingBody, guess: &Guess) -> Vec<FreeState> {
        let mut states = vec![guess.start];
        for pair in self.rows.windows(2) {
            let (pushes, _) = self.pushes(guess, [pair[0].time_s, pair[1].time_s]);
            let (steps, h) = steps(pair[1].time_s - pair[0].time_s);
            let last = states[states.len() - 1];
            states.push((0..steps).fold(last, |state, _| body.step(&pushes, &state, h)));
        }
        states
    }

    /// Errors of position and, where there is one, of orientation.
    pub fn error(&self, body: &FlyingBody, state: &FreeState, row: &Sighting) -> (Vector3<f64>, Option<Vector3<f64>>) {
        let turn = row.rotation.map(|it| (state.R.inverse() * it).scaled_axis());
        (row.p.coords - body.tracked_point(state).0, turn)
    }

    /// The cost, and the norms of the errors.
    pub fn cost(&self, guess: &Guess, scales: &Scales) -> (f64, Vec<(f64, Option<f64>)>) {
        let body = self.body(guess);
        let errors: Vec<(f64, Option<f64>)> = self
            .states(&body, guess)
            .iter()
            .zip(self.rows)
            .map(|(state, row)| self.error(&body, state, row))
            .map(|(position, turn)| (position.norm(), turn.map(|it| it.norm())))
            .collect();
        let robust = |error: f64, sd: f64| 0.5 * (STUDENT_DOF + 3.0) * libm::log1p((error / sd).powi(2) / STUDENT_DOF);
        let Noise { position_sd_m, orientation_sd_rad } = scales.noise;
        let measured = errors
            .iter()
            .map(|(position, turn)| {
                robust(*position, position_sd_m) + turn.map_or(0.0, |it| robust(it, orientation_sd_rad))
            })
            .sum::<f64>();
        let weights = self.weights(scales);
        (measured + 0.5 * guess.rest.component_mul(&guess.rest).dot(&weights), errors)
    }

    /// Information of the prior about z and the disturbances.
    pub fn weights(&self, scales: &Scales) -> DVector<f64> {
        let (_, size) = self.sizes();
        let z = self.basis.ncols();
        DVector::from_fn(z + size * self.ends_s.len(), |i, _| {
            let Some(push) = i.checked_sub(z) else { return 1.0 };
            let linear = push % size < 3;
            let density = if linear { scales.acceleration_noise } else { scales.angular_acceleration_noise };
            self.duration_s(push / size) / density.max(1e-6).powi(2)
        })
    }

    /// Returns the duration of a disturbance.
    pub fn duration_s(&self, stretch: usize) -> f64 {
        self.ends_s[stretch] - stretch.checked_sub(1).map_or(0.0, |before| self.ends_s[before])
    }

    /// The equations of a Gauss–Newton step from a guess.
    pub fn equations(&self, guess: &Guess, scales: &Scales) -> Equations {
        let ((state_size, push_size), z) = (self.sizes(), self.basis.ncols());
        let (body, unknowns) = (self.body(guess), self.unknowns());
        let mut state = guess.start;
        let mut by = DMatrix::<f64>::zeros(state_size, unknowns);
        by.columns_mut(0, state_size).fill_with_identity();
        let per_row = if self.oriented { 6 } else { 3 };
        let mut jacobian = DMatrix::<f64>::zeros(per_row * self.rows.len(), unknowns);
        let mut errors = DVector::<f64>::zeros(per_row * self.rows.len());
        for (i, row) in self.rows.iter().enumerate() {
            if let Some(before) = i.checked_sub(1).map(|it| &self.rows[it]) {
                let (pushes, at) = self.pushes(guess, [before.time_s, row.time_s]);
                let (steps, h) = steps(row.time_s - before.time_s);
                for _ in 0..steps {
                    let (next, transition) = body.step_with_derivatives(&pushes, &state, h);
                    self.carry(&transition, &mut by, (state_size + at, h));
                    state = next;
                }
            }
            let (position, turn) = self.error(&body, &state, row);
            let Noise { position_sd_m, orientation_sd_rad } = scales.noise;
            let weight = |error: f64, sd: f64| ((STUDENT_DOF + 3.0) / (STUDENT_DOF + (error / sd).powi(2))).sqrt() / sd;
            let root = weight(position.norm(), position_sd_m);
            let point = body.tracked_point_by(&state);
            let of_state = point.fixed_view::<3, 12>(0, 0).columns(0, state_size) * root;
            let mut rows = jacobian.rows_mut(per_row * i, 3);
            rows.copy_from(&(of_state * &by));
            let mut of_parameters = rows.columns_mut(state_size, z);
            of_parameters += point.fixed_view::<3, PARAMETERS>(0, POINT) * &self.basis * root;
            errors.rows_mut(per_row * i, 3).copy_from(&(position * root));
            if let Some(turn) = turn {
                let root = weight(turn.norm(), orientation_sd_rad);
                jacobian.rows_mut(per_row * i + 3, 3).copy_from(&(by.rows(THETA, 3) * root));
                errors.rows_mut(per_row * i + 3, 3).copy_from(&(turn * root));
            }
        }
        let (mut information, mut pull) = (DMatrix::zeros(unknowns, unknowns), DVector::zeros(unknowns));
        let mut first = 0;
        for rows in self.rows.chunk_by(|one, next| self.stretch(one.time_s) == self.stretch(next.time_s)) {
            // Later disturbances change nothing here.
            let (count, known) =
                (per_row * rows.len(), state_size + z + push_size * (self.stretch(rows[0].time_s) + 1));
            let by = jacobian.view((first, 0), (count, known));
            information.view_mut((0, 0), (known, known)).gemm(1.0, &by.transpose(), &by, 1.0);
            pull.rows_mut(0, known).gemv_tr(1.0, &by, &errors.rows(first, count), 1.0);
            first += count;
        }
        let weights = self.weights(scales);
        for (i, weight) in weights.iter().enumerate() {
            information[(state_size + i, state_size + i)] += weight;
            pull[state_size + i] -= weight * guess.rest[i];
        }
        Equations { information, pull, last_by: by }
    }

    /// Derivatives of the state after a step with a disturbance at `at` among the unknowns.
    pub fn carry(&self, transition: &Transition, by: &mut DMatrix<f64>, (at, h): (usize, f64)) {
        let (size, push_size) = self.sizes();
        let mut next = transition.view((0, 0), (size, size)) * by.columns(0, at + push_size);
        let mut of_parameters = next.columns_mut(size, self.basis.ncols());
        of_parameters += transition.view((0, POINT), (size, PARAMETERS)) * &self.basis;
        for i in 0..3 {
            next[(i, at + i)] += h * h / 2.0;
            next[(3 + i, at + i)] += h;
            if self.oriented {
                next[(THETA + i, at + 3 + i)] += h * h / 2.0;
                next[(OMEGA + i, at + 3 + i)] += h;
            }
        }
        by.columns_mut(0, at + push_size).copy_from(&next);
    }

    /// The guess after a step.
    pub fn moved(&self, guess: &Guess, step: &DVector<f64>) -> Guess {
        let (state, z) = (self.sizes().0, self.basis.ncols());
        let mut change = SVector::<f64, 12>::zeros();
        change.rows_mut(0, state).copy_from(&step.rows(0, state));
        let mut rest = &guess.rest + step.rows(state, step.len() - state);
        rest.rows_mut(0, z).apply(|it| *it = it.clamp(-MOST_SD, MOST_SD));
        Guess { start: guess.start.moved(&change), rest }
    }

    /// Density of the disturbances by a Magnus force: it varies with the speed and the spin, which decays.
    pub fn varying_lift(&self, guess: &Guess) -> f64 {
        VARYING_LIFT * self.body(guess).lift.cross(&guess.start.v).norm()
    }

    /// The scales that the prior expects, with that noise of the sightings.
    pub fn expected_scales(&self, guess: &Guess, noise: Noise) -> Scales {
        let acceleration_noise = libm::hypot(self.prior.acceleration_noise, self.varying_lift(guess));
        Scales { noise, acceleration_noise, angular_acceleration_noise: self.prior.angular_acceleration_noise }
    }

    /// Mean squares of the disturbances over the stretches, as squares of densities.
    pub fn disturbances(&self, guess: &Guess, covariance: &DMatrix<f64>) -> (f64, f64) {
        let ((state, size), z) = (self.sizes(), self.basis.ncols());
        let mut squares = [0.0, 0.0];
        for i in z..guess.rest.len() {
            let square = guess.rest[i].powi(2) + covariance[(state + i, state + i)];
            let part = square * self.duration_s((i - z) / size) / (3 * self.ends_s.len()) as f64;
            squares[usize::from((i - z) % size >= 3)] += part;
        }
        (squares[0], squares[1])
    }
}

/// Computes the end times of the disturbances of a flight of this duration.
fn stretch_ends_s(duration_s: f64) -> Vec<f64> {
    let (mut first_s, mut last_s, mut left_s) = (FIRST_STRETCH_S, LAST_STRETCH_S, duration_s);
    let (mut front, mut back) = (Vec::new(), Vec::new());
    while left_s > 1.5 * first_s.min(last_s) {
        let (side, next_s) = if first_s < last_s { (&mut front, &mut first_s) } else { (&mut back, &mut last_s) };
        side.push(*next_s);
        left_s -= *next_s;
        *next_s *= STRETCH_GROWTH;
    }
    let mut end_s = 0.0;
    let durations = front.into_iter().chain([left_s]).chain(back.into_iter().rev());
    durations
        .map(|it: f64| {
            end_s += it;
            end_s
        })
        .collect()
}

/// Noise of positions by how far each is from the parabola through three neighbours, in the nearest tenth: of
/// four rows none may be an outlier.
fn local_noise_m(rows: &[Sighting]) -> f64 {
    let off = |four: &[Sighting]| {
        let [a, b, c, d] = [0, 1, 2, 3].map(|i| four[i].time_s);
        // Lagrange's weights at the second time.
        let weights = [
            (b - c) * (b - d) / ((a - c) * (a - d)),
            (b - a) * (b - d) / ((c - a) * (c - d)),
            (b - a) * (b - c) / ((d - a) * (d - c)),
        ];
        let expected = four[0].p.coords * weights[0] + four[2].p.coords * weights[1] + four[3].p.coords * weights[2];
        let scale = (1.0 + weights.iter().map(|it| it * it).sum::<f64>()).sqrt();
        (four[1].p.coords - expected).norm() / scale
    };
    let distances = sorted(rows.windows(4).map(off));
    quantile(&distances, 0.1).unwrap_or_default() / TENTH
}
