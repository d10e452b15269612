//! Noise of the process: what no model of the flight knows.
//!
//! The acceleration and the angular acceleration are those of the model and white noise. Poses then tell the
//! less of the present state the older they are, and predictions become uncertain the sooner the farther
//! ahead they are.

use catch_body::quantity;
use nalgebra::{Cholesky, Matrix3, Matrix6, SMatrix, SVector, U3, Vector3};
use serde::{Deserialize, Serialize};

/// Densities of white noise. Both zero by default: the flight obeys its model.
#[quantity::checked(default, deny_unknown_fields)]
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct ProcessNoise {
    /// Noise density of the acceleration, in m/s²/√Hz.
    pub acceleration: quantity::noise_density,
    /// Noise density of the angular acceleration, in rad/s²/√Hz.
    pub angular_acceleration: quantity::noise_density,
}

impl ProcessNoise {
    /// Returns whether there is any noise.
    pub fn any(&self) -> bool {
        self.acceleration > 0.0 || self.angular_acceleration > 0.0
    }

    /// Covariance of (position, velocity) that the noise of the acceleration adds in `duration_s`.
    pub fn covariance(&self, duration_s: f64) -> Matrix6<f64> {
        let (q, t) = (self.acceleration.powi(2), duration_s.abs());
        let mut covariance = Matrix6::zeros();
        let unit = Matrix3::identity() * q;
        covariance.fixed_view_mut::<3, 3>(0, 0).copy_from(&(unit * (t.powi(3) / 3.0)));
        covariance.fixed_view_mut::<3, 3>(0, 3).copy_from(&(unit * (t * t / 2.0 * duration_s.signum())));
        covariance.fixed_view_mut::<3, 3>(3, 0).copy_from(&(unit * (t * t / 2.0 * duration_s.signum())));
        covariance.fixed_view_mut::<3, 3>(3, 3).copy_from(&(unit * t));
        covariance
    }
}

/// Normal equations H·x + g = 0 of the state now, before and after an impulse u with variance `variance` per
/// axis, which moved what they say of two blocks of x: x → x + Γ·u with Γ = `age_s`·1 on the block at `place`
/// and 1 on that at `rate`.
///
/// Minimizing over u: H − H·Γ·(ΓᵀHΓ + 1/σ²)⁻¹·ΓᵀH, and the same for g. Returns the gain H·Γ·(ΓᵀHΓ + 1/σ²)⁻¹.
pub(super) fn after_impulse<const N: usize>(
    H: &mut SMatrix<f64, N, N>,
    g: &mut SVector<f64, N>,
    [place, rate]: [usize; 2],
    age_s: f64,
    variance: f64,
) -> Option<SMatrix<f64, N, 3>> {
    let by_impulse = H.fixed_columns::<3>(place) * age_s + H.fixed_columns::<3>(rate);
    let slope = g.fixed_rows::<3>(place) * age_s + g.fixed_rows::<3>(rate);
    let inner = by_impulse.fixed_rows::<3>(place) * age_s + by_impulse.fixed_rows::<3>(rate);
    let factor = (inner + Matrix3::identity() / variance).cholesky()?;
    let gain = solved_right(&factor, &by_impulse);
    add_product(H, &-by_impulse, &gain);
    *g -= by_impulse * factor.solve(&slope);
    Some(gain)
}

/// B·(L·Lᵀ)⁻¹, row by row.
fn solved_right<const N: usize>(factor: &Cholesky<f64, U3>, B: &SMatrix<f64, N, 3>) -> SMatrix<f64, N, 3> {
    let L = factor.l_dirty();
    let mut solved = *B;
    let [first, second, third] = &mut solved.data.0;
    for ((first, second), third) in first.iter_mut().zip(second).zip(third) {
        let x = *first / L[(0, 0)];
        let y = (*second - x * L[(1, 0)]) / L[(1, 1)];
        let z = (*third - x * L[(2, 0)] - y * L[(2, 1)]) / L[(2, 2)];
        *third = z / L[(2, 2)];
        *second = (y - *third * L[(2, 1)]) / L[(1, 1)];
        *first = (x - (*second * L[(1, 0)] + *third * L[(2, 0)])) / L[(0, 0)];
    }
    solved
}

/// M + A·Bᵀ, column by column, without the product in between.
pub(super) fn add_product<const N: usize>(M: &mut SMatrix<f64, N, N>, A: &SMatrix<f64, N, 3>, B: &SMatrix<f64, N, 3>) {
    let [first, second, third] = &A.data.0;
    for (j, column) in M.data.0.iter_mut().enumerate() {
        let by = [0, 1, 2].map(|k| B[(j, k)]);
        for (((sum, first), second), third) in column.iter_mut().zip(first).zip(second).zip(third) {
            *sum += first * by[0] + second * by[1] + third * by[2];
        }
    }
}

/// Part of eᵀ·W·e that is explained by the noise that has displaced an object since a pose of this age: of
/// the information it leaves (W⁻¹ + Q)⁻¹ = W − W·(Q⁻¹ + W)⁻¹·W, with Q = q²·τ³/3.
pub(super) fn lost_square(W: &Matrix3<f64>, e: &Vector3<f64>, density: f64, age_s: f64) -> f64 {
    let variance = density.powi(2) * age_s.powi(3) / 3.0;
    if variance <= 0.0 {
        return 0.0;
    }
    let push = W * e;
    let factor = (W + Matrix3::identity() / variance).cholesky();
    factor.map_or(0.0, |factor| push.dot(&factor.solve(&push)))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Compares with the impulse as three more parameters, of which the least squares solution keeps the
    /// others.
    #[test]
    fn an_impulse_leaves_what_its_elimination_leaves() {
        const N: usize = 8;
        let rows =
            SMatrix::<f64, 12, N>::from_fn(|i, j| libm::sin((3 * i + 7 * j) as f64) + f64::from(u8::from(i == j)));
        let seen = SVector::<f64, 12>::from_fn(|i, _| libm::cos(5.0 * i as f64));
        let (age_s, variance) = (0.3, 0.07);
        let (mut H, mut g) = (rows.transpose() * rows, -rows.transpose() * seen);
        // The observations depend on x − Γ·u.
        let mut by_impulse = SMatrix::<f64, N, 3>::zeros();
        by_impulse.fixed_view_mut::<3, 3>(1, 0).fill_diagonal(age_s);
        by_impulse.fixed_view_mut::<3, 3>(5, 0).fill_diagonal(1.0);
        let mut all = SMatrix::<f64, 11, 11>::zeros();
        let crossed = -H * by_impulse;
        all.fixed_view_mut::<N, N>(0, 0).copy_from(&H);
        all.fixed_view_mut::<N, 3>(0, N).copy_from(&crossed);
        all.fixed_view_mut::<3, N>(N, 0).copy_from(&crossed.transpose());
        let own = by_impulse.transpose() * H * by_impulse + Matrix3::identity() / variance;
        all.fixed_view_mut::<3, 3>(N, N).copy_from(&own);
        let mut slope = SVector::<f64, 11>::zeros();
        slope.fixed_rows_mut::<N>(0).copy_from(&g);
        slope.fixed_rows_mut::<3>(N).copy_from(&(-by_impulse.transpose() * g));
        let expected = -all.try_inverse().unwrap() * slope;
        after_impulse(&mut H, &mut g, [1, 5], age_s, variance);
        let found = -H.try_inverse().unwrap() * g;
        assert!((found - expected.fixed_rows::<N>(0)).amax() < 1e-9, "{found} {expected}");
    }

    #[test]
    fn products_are_added_and_factors_solved_as_whole_matrices_are() {
        const N: usize = 7;
        let [A, B] = [1.0, 2.0].map(|k| SMatrix::<f64, N, 3>::from_fn(|i, j| libm::sin(k + (3 * i + 5 * j) as f64)));
        let mut M = SMatrix::<f64, N, N>::from_fn(|i, j| libm::cos((2 * i + 3 * j) as f64));
        let expected = M + A * B.transpose();
        add_product(&mut M, &A, &B);
        assert_eq!(M, expected);
        let factor = Matrix3::new(4.0, 1.0, 0.3, 1.0, 3.0, 0.5, 0.3, 0.5, 5.0).cholesky().unwrap();
        assert_eq!(solved_right(&factor, &A), factor.solve(&A.transpose()).transpose());
    }

    #[test]
    fn noise_leaves_the_information_of_the_sum_of_covariances() {
        let W = Matrix3::new(4.0, 1.0, 0.0, 1.0, 3.0, 0.5, 0.0, 0.5, 5.0);
        let (e, density, age_s) = (Vector3::new(0.3, -0.2, 0.5), 2.0, 0.6_f64);
        let noise = Matrix3::identity() * (density * density * age_s.powi(3) / 3.0);
        let expected = e.dot(&((W.try_inverse().unwrap() + noise).try_inverse().unwrap() * e));
        assert!((e.dot(&(W * e)) - lost_square(&W, &e, density, age_s) - expected).abs() < 1e-12);
    }
}
