//! The error that successive poses have in common.
//!
//! Cameras that are aligned on the arm place it rightly, and what is away from it the less rightly the
//! farther away it is: their rolls about their lines of sight are not seen. Such an error moves as slowly as
//! the object and looks like a velocity that the object does not have. Nothing in one flight tells it from
//! the motion, so that it is not estimated but considered (S. F. Schmidt, Application of state-space methods
//! to navigation problems, 1966): the flight stays that of independent errors, and its covariance counts what
//! such errors do to it.

use nalgebra::{SMatrix, Vector3};

use super::process_noise::add_product;

/// Correlation time τ of the errors, in seconds: they change as slowly as a thrown object comes nearer.
const CORRELATION_TIME_S: f64 = 0.1;

/// Contribution of correlated errors eᵢ of the positions, a first-order Gauss–Markov process along each axis,
/// to the right-hand side Σ Aᵢ·eᵢ of normal equations, Aᵢ = Jᵢᵀ·Wᵢ.
///
/// Its covariance is Σᵢⱼ σᵢ·σⱼ·e^(−|tᵢ − tⱼ|/τ)·Aᵢ·Aⱼᵀ. With Sᵢ = σᵢ·Aᵢ + e^(−|tᵢ − tᵢ₋₁|/τ)·Sᵢ₋₁ that is Σᵢ
/// (Sᵢ − ½·σᵢ·Aᵢ)·σᵢ·Aᵢᵀ and its transpose.
#[derive(Debug, Clone)]
pub(super) struct CorrelatedSums<const N: usize> {
    sd_per_m: f64,
    last_age_s: Option<f64>,
    /// S of the last pose.
    sum: SMatrix<f64, N, 3>,
    /// The covariance is this and its transpose.
    half: SMatrix<f64, N, N>,
}

impl<const N: usize> CorrelatedSums<N> {
    /// Sums to which poses can be added, of errors with this standard deviation for each metre from the
    /// origin; `None` if there is no such error.
    pub fn of(sd_per_m: Option<f64>) -> Option<Self> {
        let sd_per_m = sd_per_m.filter(|it| *it > 0.0)?;
        let (sum, half) = (SMatrix::zeros(), SMatrix::zeros());
        Some(Self { sd_per_m, last_age_s: None, sum, half })
    }

    /// Adds a pose at the position `p_W` with this A. Poses come in the order of their ages, up or down.
    pub fn add(&mut self, age_s: f64, p_W: &Vector3<f64>, A: &SMatrix<f64, N, 3>) {
        let since_s = self.last_age_s.replace(age_s).map_or(0.0, |last_s| (age_s - last_s).abs());
        self.sum *= libm::exp(-since_s / CORRELATION_TIME_S);
        let own = A * (self.sd_per_m * p_W.norm());
        add_product(&mut self.half, &(self.sum + own * 0.5), &own);
        self.sum += own;
    }

    /// Eliminates an impulse as [`after_impulse`](super::process_noise::after_impulse) does, which returned
    /// this gain.
    pub fn after_impulse(&mut self, gain: &SMatrix<f64, N, 3>, [place, rate]: [usize; 2], age_s: f64) {
        self.sum -= gain * (self.sum.fixed_rows::<3>(place) * age_s + self.sum.fixed_rows::<3>(rate));
        let rows = self.half.fixed_rows::<3>(place) * age_s + self.half.fixed_rows::<3>(rate);
        add_product(&mut self.half, &-gain, &rows.transpose());
        let columns = self.half.fixed_columns::<3>(place) * age_s + self.half.fixed_columns::<3>(rate);
        add_product(&mut self.half, &-columns, gain);
    }

    /// Contribution of these errors to the covariance of the solution, with H⁻¹ as `inverse`.
    pub fn covariance(&self, inverse: &SMatrix<f64, N, N>) -> SMatrix<f64, N, N> {
        inverse * (self.half + self.half.transpose()) * inverse
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::trajectory_prediction::process_noise::after_impulse;

    const N: usize = 8;
    fn sums<const N: usize>() -> CorrelatedSums<N> {
        CorrelatedSums::of(Some(0.02)).unwrap()
    }

    fn by_position(i: usize) -> SMatrix<f64, N, 3> {
        SMatrix::from_fn(|row, column| libm::sin((3 * i + 7 * row + 5 * column) as f64))
    }

    fn p_W(i: usize) -> Vector3<f64> {
        Vector3::new(1.0 + i as f64, 0.3, -0.5)
    }

    /// Compares with the sum over all pairs of poses.
    #[test]
    fn sums_are_those_over_all_pairs() {
        let ages_s = [0.5, 0.45, 0.3, 0.1, 0.0];
        let mut sums = sums::<N>();
        let mut expected = SMatrix::<f64, N, N>::zeros();
        for (i, first_s) in ages_s.into_iter().enumerate() {
            sums.add(first_s, &p_W(i), &by_position(i));
            for (j, second_s) in ages_s.into_iter().enumerate() {
                let correlation = libm::exp(-(first_s - second_s).abs() / CORRELATION_TIME_S);
                let variance = 0.02 * p_W(i).norm() * 0.02 * p_W(j).norm() * correlation;
                expected += by_position(i) * by_position(j).transpose() * variance;
            }
        }
        let covariance = sums.covariance(&SMatrix::identity());
        assert!((covariance - expected).amax() < 1e-12 * expected.amax(), "{covariance} {expected}");
    }

    /// Sums of some parameters are all there is if errors reach these alone.
    #[test]
    fn sums_of_some_parameters_are_those_of_all() {
        const FEW: usize = 5;
        let (mut all, mut few) = (sums::<N>(), sums::<FEW>());
        for (i, age_s) in [0.5, 0.45, 0.3, 0.1].into_iter().enumerate() {
            let mut A = by_position(i);
            A.fixed_rows_mut::<{ N - FEW }>(FEW).fill(0.0);
            all.add(age_s, &p_W(i), &A);
            few.add(age_s, &p_W(i), &A.fixed_rows::<FEW>(0).into_owned());
        }
        assert_eq!(all.half.fixed_view::<FEW, FEW>(0, 0).into_owned(), few.half);
        all.half.fixed_view_mut::<FEW, FEW>(0, 0).fill(0.0);
        assert_eq!(all.half, SMatrix::<f64, N, N>::zeros());
    }

    /// An error that both poses before an impulse have displaces the right-hand side as the elimination has
    /// it.
    #[test]
    fn an_impulse_is_eliminated_from_the_sums() {
        let (blocks, age_s, variance) = ([1, 5], 0.3, 0.07);
        let rows =
            SMatrix::<f64, 12, N>::from_fn(|i, j| libm::sin((3 * i + 7 * j) as f64) + f64::from(u8::from(i == j)));
        let mut sums = sums::<N>();
        (0..2).for_each(|i| sums.add(0.4, &p_W(i), &by_position(i)));
        let by_error = (0..2).map(|i| by_position(i) * (0.02 * p_W(i).norm())).sum::<SMatrix<f64, N, 3>>();
        let mut expected = SMatrix::<f64, N, N>::zeros();
        let mut gain = None;
        for axis in 0..3 {
            let (mut H, mut g) = (rows.transpose() * rows, by_error.column(axis).into_owned());
            gain = after_impulse(&mut H, &mut g, blocks, age_s, variance);
            expected += g * g.transpose();
        }
        sums.after_impulse(&gain.unwrap(), blocks, age_s);
        let covariance = sums.covariance(&SMatrix::identity());
        assert!((covariance - expected).amax() < 1e-9 * expected.amax(), "{covariance} {expected}");
    }
}
