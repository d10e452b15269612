//! The most probable flight through the sightings of one stretch: one least-squares problem over all that is not known.
//!
//! Unknown are the state at the first sighting, the parameters of the body as mean + B·z with z of unit covariance, and accelerations
//! that disturb the motion, constant for a stretch of time each. Minimized by Levenberg and Marquardt's method is
//!
//! ½·Σ (ν + 3)·ln(1 + |e|²/(ν·σ²)) + ½·|z|² + ½·Σ Δ·|a|²/q² + ½·Σ Δ·|α|²/q_α²
//!
//! with the errors e of positions and orientations, which have Student's t distribution with ν degrees of freedom, and white noise of
//! the densities q and q_α, averaged over the stretches of duration Δ. Noise σ of the sightings and density q are estimated meanwhile.
//! The covariance is the inverse of the last normal equations.

use std::sync::Arc;

use catch_body::free_flight::{FlyingBody, FreeState, N, OMEGA, PARAMETERS, POINT, ParameterVector, Pushes, THETA, Transition};
use nalgebra::{DMatrix, DVector, SMatrix, SVector, UnitQuaternion, Vector3};

use super::{
    flight::{Flight, steps},
    flight_prior::{FlightPrior, Noise},
    stretches::{LEAST_SIGHTINGS, Parabola, median_vector},
    track_file::Sighting,
};
use crate::statistics::median_in_place;

/// Degrees of freedom of the errors' distribution.
const STUDENT_DOF: f64 = 4.0;
/// The median of the norm of three standard normal numbers.
const MEDIAN: f64 = 1.538;
/// How long the first and the last disturbance stay the same, and how much longer each further inwards does: what is predicted rests on
/// the motion at the end most.
const FIRST_STRETCH_S: f64 = 0.05;
const LAST_STRETCH_S: f64 = 0.025;
const STRETCH_GROWTH: f64 = 1.5;
/// Iterations at most, and those of them after which the noise stays as it is.
const ITERATIONS: usize = 30;
const NOISE_ITERATIONS: usize = 10;
/// The same for a guess that is near.
const FIRST_NOISE_ITERATIONS: usize = 3;
/// The iterations end when a step promises less than this of the cost.
const SMALL_GAIN: f64 = 0.05;
/// Stretches of noise that the prior's density counts for.
const NOISE_DOF: f64 = 6.0;
/// Less noise than the errors have, until the last of these iterations: what is smooth is the motion's.
const ANNEALING: f64 = 0.5;
/// Density of the disturbances that comes with a Magnus force, in 1/√Hz.
const VARYING_LIFT: f64 = 0.01;
/// Largest element of z: that many standard deviations of the prior.
const MOST_SD: f64 = 12.0;
/// Time from the first sighting on that a track with orientations is fitted to first, and how much more each fit after that has.
const FIRST_S: f64 = 0.12;
const LONGER_S: f64 = 0.08;
/// Noise in the meantime.
const FIRST_M: f64 = 2e-3;
const FIRST_RAD: f64 = 0.04;

/// Standard deviations of the unknowns' errors: of the sightings, and the density of the disturbances.
#[derive(Debug, Clone, Copy)]
struct Scales {
    noise: Noise,
    acceleration_noise: f64,
}

/// A point of the search.
#[derive(Debug, Clone)]
struct Guess {
    start: FreeState,
    /// z, and the disturbances, those of a stretch together.
    rest: DVector<f64>,
}

/// What is minimized.
pub(super) struct Problem<'a> {
    g: Vector3<f64>,
    prior: &'a Arc<FlightPrior>,
    rows: &'a [Sighting],
    /// Whether orientations were measured; without them the body frame is the world's and does not rotate.
    oriented: bool,
    mean: ParameterVector,
    basis: DMatrix<f64>,
    /// Least noise of the sightings: as neighbours have it.
    least: Noise,
    /// Times since the first sighting at which the disturbances end.
    ends_s: Vec<f64>,
}

/// The normal equations, and what they are from.
struct Equations {
    information: DMatrix<f64>,
    pull: DVector<f64>,
    /// Derivatives of the last state with respect to the unknowns.
    last_by: DMatrix<f64>,
}

/// How a minimization ended.
struct Rest {
    equations: Equations,
    converged: bool,
    iterations: usize,
}

impl<'a> Problem<'a> {
    /// Of sightings in the order of time, under gravity `g`.
    pub fn new(g: Vector3<f64>, prior: &'a Arc<FlightPrior>, rows: &'a [Sighting]) -> Self {
        let oriented = rows.iter().any(|it| it.rotation.is_some());
        let (mean, basis) = prior.whitened(oriented);
        let duration_s = rows.last().map_or(0.0, |it| it.time_s) - rows.first().map_or(0.0, |it| it.time_s);
        let local = Noise { position_sd_m: local_noise_m(rows).max(prior.least_noise.position_sd_m), ..prior.least_noise };
        Self { g, prior, rows, oriented, mean, basis, least: local, ends_s: stretch_ends_s(duration_s) }
    }

    /// Elements of the state, and of a disturbance.
    fn sizes(&self) -> (usize, usize) {
        if self.oriented { (12, 6) } else { (6, 3) }
    }

    fn unknowns(&self) -> usize {
        let (state, push) = self.sizes();
        state + self.basis.ncols() + push * self.ends_s.len()
    }

    fn body(&self, guess: &Guess) -> FlyingBody {
        let z = guess.rest.rows(0, self.basis.ncols());
        let moved: DVector<f64> = &self.basis * z;
        FlyingBody::new(&(self.mean + ParameterVector::from_column_slice(moved.as_slice())))
    }

    /// What pushes during a disturbance, and where its elements stand among the unknowns after the state.
    fn pushes(&self, guess: &Guess, between_s: [f64; 2]) -> (Pushes, usize) {
        let middle_s = f64::midpoint(between_s[0], between_s[1]) - self.rows[0].time_s;
        let stretch = self.ends_s.partition_point(|it| *it < middle_s).min(self.ends_s.len() - 1);
        let (_, size) = self.sizes();
        let at = self.basis.ncols() + size * stretch;
        let push = |from: usize| Vector3::from_fn(|i, _| guess.rest[at + from + i]);
        let angular = if self.oriented { push(3) } else { Vector3::zeros() };
        (Pushes { acceleration: self.g + push(0), angular }, at)
    }

    /// The states at all sightings.
    fn states(&self, body: &FlyingBody, guess: &Guess) -> Vec<FreeState> {
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
    fn error(&self, body: &FlyingBody, state: &FreeState, row: &Sighting) -> (Vector3<f64>, Option<Vector3<f64>>) {
        let turn = row.rotation.map(|it| (state.R.inverse() * it).scaled_axis());
        (row.p.coords - body.tracked_point(state).0, turn)
    }

    /// The cost, and the norms of the errors.
    fn cost(&self, guess: &Guess, scales: &Scales) -> (f64, Vec<(f64, Option<f64>)>) {
        let body = self.body(guess);
        let errors: Vec<(f64, Option<f64>)> = self
            .states(&body, guess)
            .iter()
            .zip(self.rows)
            .map(|(state, row)| self.error(&body, state, row))
            .map(|(position, turn)| (position.norm(), turn.map(|it| it.norm())))
            .collect();
        let robust = |error: f64, sd: f64| 0.5 * (STUDENT_DOF + 3.0) * ((error / sd).powi(2) / STUDENT_DOF).ln_1p();
        let Noise { position_sd_m, orientation_sd_rad } = scales.noise;
        let measured = errors
            .iter()
            .map(|(position, turn)| robust(*position, position_sd_m) + turn.map_or(0.0, |it| robust(it, orientation_sd_rad)))
            .sum::<f64>();
        let weights = self.weights(scales);
        (measured + 0.5 * guess.rest.component_mul(&guess.rest).dot(&weights), errors)
    }

    /// Information of the prior about z and the disturbances.
    fn weights(&self, scales: &Scales) -> DVector<f64> {
        let (_, size) = self.sizes();
        let z = self.basis.ncols();
        DVector::from_fn(z + size * self.ends_s.len(), |i, _| {
            let Some(push) = i.checked_sub(z) else { return 1.0 };
            let linear = push % size < 3;
            let density = if linear { scales.acceleration_noise } else { self.prior.angular_acceleration_noise };
            self.duration_s(push / size) / density.max(1e-6).powi(2)
        })
    }

    /// How long a disturbance stays the same.
    fn duration_s(&self, stretch: usize) -> f64 {
        self.ends_s[stretch] - stretch.checked_sub(1).map_or(0.0, |before| self.ends_s[before])
    }

    /// The equations of a Gauss–Newton step from a guess.
    fn equations(&self, guess: &Guess, scales: &Scales) -> Equations {
        let (state_size, z) = (self.sizes().0, self.basis.ncols());
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
        let (mut information, mut pull) = (jacobian.transpose() * &jacobian, jacobian.tr_mul(&errors));
        let weights = self.weights(scales);
        for (i, weight) in weights.iter().enumerate() {
            information[(state_size + i, state_size + i)] += weight;
            pull[state_size + i] -= weight * guess.rest[i];
        }
        Equations { information, pull, last_by: by }
    }

    /// Derivatives of the state after a step with a disturbance at `at` among the unknowns.
    fn carry(&self, transition: &Transition, by: &mut DMatrix<f64>, (at, h): (usize, f64)) {
        let size = self.sizes().0;
        let mut next = transition.view((0, 0), (size, size)) * &*by;
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
        *by = next;
    }

    /// The guess after a step.
    fn moved(&self, guess: &Guess, step: &DVector<f64>) -> Guess {
        let (state, z) = (self.sizes().0, self.basis.ncols());
        let mut change = SVector::<f64, 12>::zeros();
        change.rows_mut(0, state).copy_from(&step.rows(0, state));
        let mut rest = &guess.rest + step.rows(state, step.len() - state);
        rest.rows_mut(0, z).apply(|it| *it = it.clamp(-MOST_SD, MOST_SD));
        Guess { start: guess.start.moved(&change), rest }
    }

    /// Noise of the sightings by the median of their errors, and density of the disturbances by their mean square (expectation
    /// maximization under an inverse gamma prior).
    fn scales(
        &self,
        guess: &Guess,
        errors: &[(f64, Option<f64>)],
        information: &DMatrix<f64>,
        factor: f64,
    ) -> Option<Scales> {
        let typical = |values: &mut dyn Iterator<Item = f64>, least: f64| {
            (factor * median_in_place(&mut values.collect::<Vec<_>>()) / MEDIAN).max(least)
        };
        let least = &self.least;
        let (squares, _) = self.disturbances(guess, &information.clone().cholesky()?.inverse());
        let count = 3.0 * self.ends_s.len() as f64;
        let variance = (NOISE_DOF * self.expected_noise(guess).powi(2) + squares * count) / (NOISE_DOF + count);
        Some(Scales {
            noise: Noise {
                position_sd_m: typical(&mut errors.iter().map(|it| it.0), least.position_sd_m),
                orientation_sd_rad: typical(&mut errors.iter().filter_map(|it| it.1), least.orientation_sd_rad),
            },
            acceleration_noise: variance.sqrt(),
        })
    }

    /// The density of the disturbances that the prior expects. A Magnus force varies with the speed and the spin, which decays.
    fn expected_noise(&self, guess: &Guess) -> f64 {
        let lift = self.body(guess).lift.cross(&guess.start.v).norm();
        self.prior.acceleration_noise.hypot(VARYING_LIFT * lift)
    }

    /// Mean squares of the disturbances over the stretches, as squares of densities.
    fn disturbances(&self, guess: &Guess, covariance: &DMatrix<f64>) -> (f64, f64) {
        let ((state, size), z) = (self.sizes(), self.basis.ncols());
        let mut squares = [0.0, 0.0];
        for i in z..guess.rest.len() {
            let square = guess.rest[i].powi(2) + covariance[(state + i, state + i)];
            let part = square * self.duration_s((i - z) / size) / (3 * self.ends_s.len()) as f64;
            squares[usize::from((i - z) % size >= 3)] += part;
        }
        (squares[0], squares[1])
    }

    /// The first guess: the parabola through most sightings, and the rotation that the first of them have in common.
    fn first_guess(&self) -> Option<(Guess, Scales)> {
        let parabola = Parabola::through(self.rows)?;
        let turned: Vec<(f64, UnitQuaternion<f64>)> = self
            .rows
            .iter()
            .filter_map(|it| Some((it.time_s - self.rows[0].time_s, it.rotation?)))
            .take_while(|it| it.0 <= FIRST_S)
            .collect();
        let rate = |it: &[(f64, UnitQuaternion<f64>)]| (it[0].1.inverse() * it[1].1).scaled_axis() / (it[1].0 - it[0].0);
        let w = median_vector(&turned.windows(2).map(rate).collect::<Vec<_>>());
        let back = |(t, R): &(f64, UnitQuaternion<f64>)| R * UnitQuaternion::from_scaled_axis(-w * *t);
        let begun: Vec<UnitQuaternion<f64>> = turned.iter().map(back).collect();
        let far = |R: &UnitQuaternion<f64>| median_in_place(&mut begun.iter().map(|it| it.angle_to(R)).collect::<Vec<_>>());
        let R = begun.iter().min_by(|a, b| far(a).total_cmp(&far(b))).copied().unwrap_or_default();
        let start = FreeState { p: parabola.p, v: parabola.v, R, w };
        let guess = Guess { start, rest: DVector::zeros(self.unknowns() - self.sizes().0) };
        let acceleration_noise = self.expected_noise(&guess);
        let noise = Noise { position_sd_m: parabola.off_m.max(self.least.position_sd_m), orientation_sd_rad: FIRST_RAD };
        Some((guess, Scales { noise, acceleration_noise }))
    }

    /// The first guess, and where there are orientations what fits to more and more of the track lead to: they are periodic, and a rotation
    /// that is known for a while leads to that for a little longer.
    fn begun(&self) -> Option<(Guess, Scales)> {
        let (mut guess, mut scales) = self.first_guess()?;
        let (z, start_s) = (self.basis.ncols(), self.rows[0].time_s);
        let mut end_s = start_s + FIRST_S;
        while self.oriented && end_s + LONGER_S < self.rows[self.rows.len() - 1].time_s {
            let known = self.rows.partition_point(|it| it.time_s <= end_s);
            end_s += LONGER_S;
            if known >= LEAST_SIGHTINGS {
                let part = Problem::new(self.g, self.prior, &self.rows[..known]);
                let mut begun = Guess { rest: DVector::zeros(part.unknowns() - part.sizes().0), ..guess.clone() };
                begun.rest.rows_mut(0, z).copy_from(&guess.rest.rows(0, z));
                scales.noise.position_sd_m = FIRST_M.max(self.least.position_sd_m);
                part.minimize(&mut begun, &mut scales, 0)?;
                guess.start = begun.start;
                guess.rest.rows_mut(0, z).copy_from(&begun.rest.rows(0, z));
            }
        }
        Some((guess, scales))
    }

    /// Minimizes the cost; `None` where a guess leads nowhere.
    fn minimize(&self, guess: &mut Guess, scales: &mut Scales, noise_iterations: usize) -> Option<Rest> {
        let mut damping = 1e-3;
        for iteration in 0..ITERATIONS {
            let equations = self.equations(guess, scales);
            let (cost, _) = self.cost(guess, scales);
            let mut gain = f64::INFINITY;
            loop {
                let mut damped = equations.information.clone();
                for i in 0..damped.nrows() {
                    damped[(i, i)] *= 1.0 + damping;
                }
                let step = damped.cholesky()?.solve(&equations.pull);
                gain = gain.min(step.dot(&equations.pull));
                let moved = self.moved(guess, &step);
                let (moved_cost, errors) = self.cost(&moved, scales);
                if moved_cost <= cost {
                    *guess = moved;
                    damping = (damping * 0.2).max(1e-9);
                    if iteration < noise_iterations {
                        let factor = if iteration + 1 < noise_iterations { ANNEALING } else { 1.0 };
                        *scales = self.scales(guess, &errors, &equations.information, factor)?;
                    }
                    break;
                }
                if gain < SMALL_GAIN || damping > 1e9 || !cost.is_finite() {
                    break;
                }
                damping *= 8.0;
            }
            if gain < SMALL_GAIN && iteration >= noise_iterations || damping > 1e9 {
                let converged = gain < SMALL_GAIN;
                return cost.is_finite().then(|| Rest { equations: self.equations(guess, scales), converged, iterations: iteration });
            }
        }
        Some(Rest { equations: self.equations(guess, scales), converged: false, iterations: ITERATIONS })
    }

    /// The flight, sought near another one if there is one; `None` where none fits.
    pub fn solve(&self, near: Option<&Flight>) -> Option<Flight> {
        let near = near.filter(|it| it.oriented == self.oriented && it.noise.orientation_sd_rad < FIRST_RAD);
        let (mut guess, mut scales) = near.map(|it| self.guess_near(it)).map_or_else(|| self.begun(), Some)?;
        let noise_iterations = if near.is_some() { FIRST_NOISE_ITERATIONS } else { NOISE_ITERATIONS };
        let rest = self.minimize(&mut guess, &mut scales, noise_iterations)?;
        self.flight(&guess, &scales, &rest)
    }

    /// The guess that another flight is.
    fn guess_near(&self, near: &Flight) -> (Guess, Scales) {
        let start_s = self.rows[0].time_s;
        let at = near.states.partition_point(|it| it.0 < start_s).min(near.states.len() - 1);
        let (time_s, state) = near.states[at];
        let (count, h) = steps(start_s - time_s);
        let pushes = Pushes { acceleration: self.g, angular: Vector3::zeros() };
        let start = (0..count).fold(state, |state, _| near.body.step(&pushes, &state, h));
        let off = near.parameters() - self.mean;
        let z = DVector::from_fn(self.basis.ncols(), |i, _| {
            let column = self.basis.column(i);
            (column.dot(&off) / column.norm_squared()).clamp(-MOST_SD, MOST_SD)
        });
        let mut rest = DVector::zeros(self.unknowns() - self.sizes().0);
        rest.rows_mut(0, z.len()).copy_from(&z);
        let guess = Guess { start, rest };
        let acceleration_noise = self.expected_noise(&guess);
        (guess, Scales { noise: near.noise, acceleration_noise })
    }

    fn flight(&self, guess: &Guess, scales: &Scales, rest: &Rest) -> Option<Flight> {
        let factor = rest.equations.information.clone().cholesky()?;
        let covariance = factor.inverse();
        let ((state, size), z) = (self.sizes(), self.basis.ncols());
        let mut by = DMatrix::<f64>::zeros(N, self.unknowns());
        by.rows_mut(0, state).copy_from(&rest.equations.last_by);
        by.view_mut((POINT, state), (PARAMETERS, z)).copy_from(&self.basis);
        let spread = &by * &covariance * by.transpose();
        let body = self.body(guess);
        let (cost, errors) = self.cost(guess, scales);
        let (position, turned) = (3.0 * errors.len() as f64, 3.0 * errors.iter().filter_map(|it| it.1).count() as f64);
        // Laplace's approximation of the evidence.
        let deviance = cost
            + factor.l_dirty().diagonal().map(f64::ln).sum()
            + position * scales.noise.position_sd_m.ln()
            + turned * scales.noise.orientation_sd_rad.ln()
            + 3.0 * self.ends_s.len() as f64 * scales.acceleration_noise.max(1e-6).ln();
        let pushes = (0..self.ends_s.len()).map(|i| guess.rest.fixed_rows::<3>(z + size * i).into_owned()).collect();
        let flight = Flight {
            start_s: self.rows[0].time_s,
            time_s: self.rows[self.rows.len() - 1].time_s,
            noise: scales.noise,
            acceleration_noise: scales.acceleration_noise,
            converged: rest.converged,
            iterations: rest.iterations,
            oriented: self.oriented,
            pushes,
            deviance,
            disturbances: self.disturbances(guess, &covariance),
            states: self.rows.iter().map(|it| it.time_s).zip(self.states(&body, guess)).collect(),
            errors_m: errors.iter().map(|it| it.0).collect(),
            body,
            covariance: SMatrix::from_iterator(spread.iter().copied()),
            prior: self.prior.clone(),
            g: self.g,
        };
        flight.covariance.iter().chain(&flight.body.parameters).all(|it| it.is_finite()).then_some(flight)
    }
}

/// When the disturbances of a flight of this duration end.
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
    durations.map(|it: f64| { end_s += it; end_s }).collect()
}

/// Noise of positions by how far each is from the parabola through three neighbours, in the median.
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
    median_in_place(&mut rows.windows(4).map(off).collect::<Vec<_>>()) / MEDIAN
}

