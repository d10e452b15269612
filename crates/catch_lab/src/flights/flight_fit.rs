//! The most probable flight through the sightings of one stretch: one least-squares problem over all that is
//! not known.
//!
//! Unknown are the state at the first sighting, the parameters of the body as mean + B·z with z of unit
//! covariance, and accelerations that disturb the motion, constant for a stretch of time each. Minimized by
//! Levenberg and Marquardt's method is
//!
//! ½·Σ (ν + 3)·ln(1 + |e|²/(ν·σ²)) + ½·|z|² + ½·Σ Δ·|a|²/q² + ½·Σ Δ·|α|²/q_α²
//!
//! with the errors e of positions and orientations, which have Student's t distribution with ν degrees of
//! freedom, and white noise of the densities q and q_α, averaged over the stretches of duration Δ. Noise σ of
//! the sightings and both densities are estimated meanwhile. The covariance is the inverse of the last normal
//! equations.

use catch_body::free_flight::{FreeState, N, PARAMETERS, POINT, Pushes};
use nalgebra::{DMatrix, DVector, SMatrix, UnitQuaternion, Vector3};

use super::{
    flight::{Flight, steps},
    flight_prior::Noise,
    flight_problem::{Equations, Guess, MEDIAN, MOST_SD, Problem, Scales},
    stretches::{LEAST_SIGHTINGS, Parabola, median_vector},
};
use catch_body::statistics::median_in_place;

/// Iterations at most, and those of them after which the noise stays as it is.
const ITERATIONS: usize = 30;
const NOISE_ITERATIONS: usize = 10;
/// Iterations after which the noise stays as it is, for a guess that is near.
const FIRST_NOISE_ITERATIONS: usize = 3;
/// The iterations end when a step promises less than this of the cost.
const SMALL_GAIN: f64 = 0.05;
/// Stretches of noise that the prior's density counts for.
const NOISE_DOF: f64 = 6.0;
/// Less noise than the errors have, until the last of these iterations: what is smooth is the motion's.
const ANNEALING: f64 = 0.5;
/// Time from the first sighting on that a track with orientations is fitted to first, and how much more each
/// fit after that has.
const FIRST_S: f64 = 0.12;
const LONGER_S: f64 = 0.08;
/// Noise in the meantime.
const FIRST_M: f64 = 2e-3;
const FIRST_RAD: f64 = 0.04;

impl Problem<'_> {
    /// Noise of the sightings by the median of their errors, and densities of the disturbances by their mean
    /// squares (expectation maximization under an inverse gamma prior).
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
        let (squares, angular) = self.disturbances(guess, &information.clone().cholesky()?.inverse());
        let count = 3.0 * self.ends_s.len() as f64;
        let density = |expected: f64, squares: f64| {
            ((NOISE_DOF * expected.powi(2) + squares * count) / (NOISE_DOF + count)).sqrt()
        };
        let expected = self.expected_scales(
            guess,
            Noise {
                position_sd_m: typical(&mut errors.iter().map(|it| it.0), least.position_sd_m),
                orientation_sd_rad: typical(&mut errors.iter().filter_map(|it| it.1), least.orientation_sd_rad),
            },
        );
        Some(Scales {
            acceleration_noise: density(expected.acceleration_noise, squares),
            angular_acceleration_noise: density(expected.angular_acceleration_noise, angular),
            ..expected
        })
    }

    /// The first guess: the parabola through most sightings, and the rotation that the first of them have in
    /// common.
    fn first_guess(&self) -> Option<(Guess, Scales)> {
        let parabola = Parabola::through(self.rows)?;
        let turned: Vec<(f64, UnitQuaternion<f64>)> = self
            .rows
            .iter()
            .filter_map(|it| Some((it.time_s - self.rows[0].time_s, it.rotation?)))
            .take_while(|it| it.0 <= FIRST_S)
            .collect();
        let rate =
            |it: &[(f64, UnitQuaternion<f64>)]| (it[0].1.inverse() * it[1].1).scaled_axis() / (it[1].0 - it[0].0);
        let w = median_vector(&turned.windows(2).map(rate).collect::<Vec<_>>());
        let back = |(t, R): &(f64, UnitQuaternion<f64>)| R * UnitQuaternion::from_scaled_axis(-w * *t);
        let begun: Vec<UnitQuaternion<f64>> = turned.iter().map(back).collect();
        let far =
            |R: &UnitQuaternion<f64>| median_in_place(&mut begun.iter().map(|it| it.angle_to(R)).collect::<Vec<_>>());
        let R = begun.iter().min_by(|a, b| far(a).total_cmp(&far(b))).copied().unwrap_or_default();
        let start = FreeState { p: parabola.p, v: parabola.v, R, w };
        let guess = Guess { start, rest: DVector::zeros(self.unknowns() - self.sizes().0) };
        let noise =
            Noise { position_sd_m: parabola.off_m.max(self.least.position_sd_m), orientation_sd_rad: FIRST_RAD };
        let scales = self.expected_scales(&guess, noise);
        Some((guess, scales))
    }

    /// The first guess, and where there are orientations what fits to more and more of the track lead to:
    /// they are periodic, and a rotation that is known for a while leads to that for a little longer.
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
    fn minimize(&self, guess: &mut Guess, scales: &mut Scales, noise_iterations: usize) -> Option<Equations> {
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
                return cost.is_finite().then(|| self.equations(guess, scales));
            }
        }
        Some(self.equations(guess, scales))
    }

    /// The flight, sought near another one if there is one; `None` where none fits.
    pub fn solve(&self, near: Option<&Flight>) -> Option<Flight> {
        let near = near.filter(|it| it.oriented == self.oriented && it.noise.orientation_sd_rad < FIRST_RAD);
        let (mut guess, mut scales) = near.map(|it| self.guess_near(it)).map_or_else(|| self.begun(), Some)?;
        let noise_iterations = if near.is_some() { FIRST_NOISE_ITERATIONS } else { NOISE_ITERATIONS };
        let equations = self.minimize(&mut guess, &mut scales, noise_iterations)?;
        self.flight(&guess, &scales, &equations)
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
        let scales = self.expected_scales(&guess, near.noise);
        (guess, scales)
    }

    fn flight(&self, guess: &Guess, scales: &Scales, equations: &Equations) -> Option<Flight> {
        let factor = equations.information.clone().cholesky()?;
        let covariance = factor.inverse();
        let ((state, size), z) = (self.sizes(), self.basis.ncols());
        let mut by = DMatrix::<f64>::zeros(N, self.unknowns());
        by.rows_mut(0, state).copy_from(&equations.last_by);
        by.view_mut((POINT, state), (PARAMETERS, z)).copy_from(&self.basis);
        let spread = &by * &covariance * by.transpose();
        let body = self.body(guess);
        let (cost, errors) = self.cost(guess, scales);
        let (position, turned) = (3.0 * errors.len() as f64, 3.0 * errors.iter().filter_map(|it| it.1).count() as f64);
        let mut disturbances = libm::log(scales.acceleration_noise.max(1e-6));
        if self.oriented {
            disturbances += libm::log(scales.angular_acceleration_noise.max(1e-6));
        }
        // Laplace's approximation of the evidence.
        let deviance = cost
            + factor.l_dirty().diagonal().map(libm::log).sum()
            + position * libm::log(scales.noise.position_sd_m)
            + turned * libm::log(scales.noise.orientation_sd_rad)
            + 3.0 * self.ends_s.len() as f64 * disturbances;
        let (squares, angular) = self.disturbances(guess, &covariance);
        let pushes = (0..self.ends_s.len()).map(|i| guess.rest.fixed_rows::<3>(z + size * i).into_owned()).collect();
        let flight = Flight {
            start_s: self.rows[0].time_s,
            time_s: self.rows[self.rows.len() - 1].time_s,
            noise: scales.noise,
            acceleration_noise: scales.acceleration_noise,
            oriented: self.oriented,
            pushes,
            deviance,
            disturbances: ((squares - self.varying_lift(guess).powi(2)).max(0.0), angular),
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
