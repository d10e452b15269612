//! The state that the fit looks for, as a vector of parameters.

use nalgebra::{SMatrix, SVector, UnitQuaternion, Vector3};

use super::super::{Config, FlightTrajectory, LEAST_DRAG_PER_M, LocalFlight};

/// Number of parameters: position, velocity, drag constant, orientation, angular velocity, decay of the spin.
pub const N: usize = 14;
pub const DRAG: usize = 6;
pub const TURN: usize = 7;
pub const SPIN: usize = 10;
pub const DECAY: usize = 13;
/// Parameters from the orientation on.
pub const ROTATION: usize = N - TURN;

/// No spin decays faster.
const MOST_DECAY_PER_S: f64 = 10.0;

/// State that is being fitted.
#[derive(Debug, Clone, Copy)]
pub struct State {
    pub p: Vector3<f64>,
    pub v: Vector3<f64>,
    pub drag_per_m: f64,
    pub R_WO: UnitQuaternion<f64>,
    pub w: Vector3<f64>,
    pub decay_per_s: f64,
}

impl State {
    /// State of a flight at `time_s`. The decay of the spin is the flight's if it is estimated, else the
    /// configured one.
    pub fn of(flight: &FlightTrajectory, time_s: f64, config: &Config) -> Self {
        let LocalFlight { X_WO, V_WO, .. } = flight.local_flight_at(time_s);
        let decays = config.aerodynamics.spin_decay_sd_per_s > 0.0;
        Self {
            p: X_WO.translation.vector,
            v: V_WO.linear,
            drag_per_m: flight.drag_per_m,
            R_WO: X_WO.rotation,
            w: V_WO.angular,
            decay_per_s: if decays { flight.spin_decay_per_s } else { config.aerodynamics.spin_decay_per_s },
        }
    }

    /// State after a step.
    pub fn moved(&self, step: &SVector<f64, N>, config: &Config) -> Self {
        let turn = step.fixed_rows::<3>(TURN).into_owned();
        // Drag never accelerates; half the prior's width below zero is left to noise. One that is known stays
        // as it is.
        let least = (-0.5 * config.drag_sd_per_m()).max(LEAST_DRAG_PER_M);
        let drag_step = if config.drag_sd_per_m() > 0.0 { step[DRAG] } else { 0.0 };
        // Nor does air speed up a spin.
        let (expected, decay_sd) = (config.aerodynamics.spin_decay_per_s, config.aerodynamics.spin_decay_sd_per_s);
        let (least_decay, decay_step) = (-0.5 * decay_sd, if decay_sd > 0.0 { step[DECAY] } else { 0.0 });
        Self {
            p: self.p + step.fixed_rows::<3>(0),
            v: self.v + step.fixed_rows::<3>(3),
            drag_per_m: (self.drag_per_m + drag_step).clamp(least.min(config.drag_per_m()), config.most_drag_per_m()),
            R_WO: UnitQuaternion::from_scaled_axis(turn * (0.5 / turn.norm()).min(1.0)) * self.R_WO,
            w: self.w + step.fixed_rows::<3>(SPIN),
            decay_per_s: (self.decay_per_s + decay_step)
                .clamp(least_decay.min(expected), MOST_DECAY_PER_S.max(expected)),
        }
    }

    /// The step that led here.
    pub fn since(&self, before: &Self) -> SVector<f64, N> {
        let mut step = SVector::<f64, N>::zeros();
        step.fixed_rows_mut::<3>(0).copy_from(&(self.p - before.p));
        step.fixed_rows_mut::<3>(3).copy_from(&(self.v - before.v));
        step[DRAG] = self.drag_per_m - before.drag_per_m;
        step.fixed_rows_mut::<3>(TURN).copy_from(&(self.R_WO * before.R_WO.inverse()).scaled_axis());
        step.fixed_rows_mut::<3>(SPIN).copy_from(&(self.w - before.w));
        step[DECAY] = self.decay_per_s - before.decay_per_s;
        step
    }
}

/// H⁻¹·B, H being the information on the parameters. A decay that is known has no part in it. Where
/// orientations are not seen, nothing ties the parameters of the rotation to any other.
pub fn solved<const C: usize>(
    H: &SMatrix<f64, N, N>,
    B: &SMatrix<f64, N, C>,
    turns: bool,
    config: &Config,
) -> Option<SMatrix<f64, N, C>> {
    let free = if config.aerodynamics.spin_decay_sd_per_s > 0.0 { N } else { DECAY };
    match (turns, free) {
        (true, N) => Some(H.cholesky()?.solve(B)),
        (true, _) => solved_first::<DECAY, C>(H, B),
        (false, _) => {
            let mut found = solved_first::<TURN, C>(H, B)?;
            (TURN..free).for_each(|i| found.set_row(i, &(B.row(i) / H[(i, i)])));
            Some(found)
        }
    }
}

/// H⁻¹·B for the first `M` parameters alone; the rows of the others are zero.
fn solved_first<const M: usize, const C: usize>(
    H: &SMatrix<f64, N, N>,
    B: &SMatrix<f64, N, C>,
) -> Option<SMatrix<f64, N, C>> {
    let mut found = SMatrix::<f64, N, C>::zeros();
    let factor = H.fixed_view::<M, M>(0, 0).into_owned().cholesky()?;
    found.fixed_view_mut::<M, C>(0, 0).copy_from(&factor.solve(&B.fixed_view::<M, C>(0, 0)));
    Some(found)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::trajectory_prediction::AerodynamicPrior;

    /// Compares with the whole matrix, where orientations are seen or not, and the decay is known or not.
    #[test]
    fn parameters_without_a_part_are_left_out() {
        let all = SMatrix::<f64, 20, N>::from_fn(|i, j| libm::sin(((1 + i) * (2 + j)) as f64));
        for (turns, decay_sd) in [(true, 0.2), (true, 0.0), (false, 0.2), (false, 0.0)] {
            let aerodynamics = AerodynamicPrior { spin_decay_sd_per_s: decay_sd, ..AerodynamicPrior::default() };
            let config = Config { aerodynamics, ..Config::default() };
            let mut H = all.transpose() * all + SMatrix::<f64, N, N>::identity();
            let tied =
                |i: usize, j: usize| i == j || (turns || i.max(j) < TURN) && (decay_sd > 0.0 || i.max(j) < DECAY);
            for (i, j) in (0..N).flat_map(|i| (0..N).map(move |j| (i, j))).filter(|(i, j)| !tied(*i, *j)) {
                H[(i, j)] = 0.0;
            }
            let mut expected = H.try_inverse().unwrap();
            if decay_sd == 0.0 {
                expected[(DECAY, DECAY)] = 0.0;
            }
            let found = solved(&H, &SMatrix::<f64, N, N>::identity(), turns, &config).unwrap();
            assert!((found - expected).amax() < 1e-12 * expected.amax(), "{turns} {decay_sd}: {found} {expected}");
        }
    }
}
