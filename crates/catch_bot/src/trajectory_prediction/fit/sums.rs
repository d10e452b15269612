//! The normal equations of a fit.

use std::ops::{AddAssign, SubAssign};

use catch_body::symmetry::Symmetry;
use nalgebra::{Matrix3, SMatrix, SVector};

use super::{
    super::{correlated_error::CorrelatedSums, process_noise::after_impulse},
    Problem, Scratch,
    row::Row,
    state::{DECAY, DRAG, N, ROTATION, SPIN, State, TURN},
};

/// Error in scaled standard deviations per degree of freedom at which a pose's weight has fallen to a
/// quarter.
const OUTLIER_SD: f64 = 2.5;

/// Sums over all poses.
pub struct Sums {
    pub information: SMatrix<f64, N, N>,
    pub gradient: SVector<f64, N>,
    /// Σ w·eᵀWe and Σ w·(degrees of freedom).
    pub squares: f64,
    pub freedom: f64,
    pub inliers: usize,
}

impl Problem<'_> {
    /// Σ w·JᵀWJ and Σ w·JᵀWe. The noise of the process counts as for poses whose errors are scaled by
    /// `noise_scale`. To `correlated` is added what errors that poses have in common do to the gradient.
    ///
    /// With noise they are gathered from the oldest pose on: between two poses, Δt apart, impulses of
    /// variance q²·Δt have changed velocity and angular velocity. An impulse u of age τ is τ·u in the
    /// position now and u in the velocity; drag and tumbling are left out of that.
    pub fn sums<const M: usize>(
        &self,
        scale: f64,
        noise_scale: f64,
        mut correlated: Option<&mut CorrelatedSums<M>>,
        scratch: &Scratch,
    ) -> Sums {
        let (information, gradient) = (SMatrix::zeros(), SVector::zeros());
        let mut sums = Sums { information, gradient, squares: 0.0, freedom: 0.0, inliers: 0 };
        let noise = self.config.process_noise;
        if noise.any() {
            let mut older_s = None;
            for row in scratch.rows.iter().rev() {
                if let Some(older_s) = older_s.replace(row.age_s) {
                    self.lose_to_noise(&mut sums, correlated.as_deref_mut(), [older_s, row.age_s], noise_scale);
                }
                self.add(&mut sums, correlated.as_deref_mut(), row, scale);
            }
        } else {
            for row in &scratch.rows {
                self.add(&mut sums, correlated.as_deref_mut(), row, scale);
            }
        }
        sums.information.fill_lower_triangle_with_upper_triangle();
        sums
    }

    /// Reduces the information of the poses up to here by the process noise between two ages.
    fn lose_to_noise<const M: usize>(
        &self,
        sums: &mut Sums,
        mut correlated: Option<&mut CorrelatedSums<M>>,
        [older_s, age_s]: [f64; 2],
        noise_scale: f64,
    ) {
        let noise = self.config.process_noise;
        let middle_s = f64::midpoint(older_s, age_s);
        sums.information.fill_lower_triangle_with_upper_triangle();
        let spun = noise.angular_acceleration * f64::from(u8::from(self.turns()));
        for (blocks, density) in [([0, 3], noise.acceleration), ([TURN, SPIN], spun)] {
            let variance = density.powi(2) * (older_s - age_s) / noise_scale.powi(2);
            if variance > 0.0 {
                let gain = after_impulse(&mut sums.information, &mut sums.gradient, blocks, middle_s, variance);
                if let (Some(gain), Some(correlated)) = (gain, &mut correlated) {
                    correlated.after_impulse(&gain.fixed_rows::<M>(0).into_owned(), blocks, middle_s);
                }
            }
        }
    }

    /// Adds a row, block by block: J is [1, ∂shift] on position, velocity and drag, and ∂turn on the rest. Of
    /// the information, the upper triangle is filled.
    fn add<const M: usize>(&self, sums: &mut Sums, correlated: Option<&mut CorrelatedSums<M>>, row: &Row, scale: f64) {
        let turns = self.turns();
        let H = &mut sums.information;
        let in_sd = row.in_sd(self.freedom, scale);
        let weight = (1.0 + (in_sd / OUTLIER_SD).powi(2)).powi(-2);
        let shifts = row.shifts * weight;
        let by_motion = shifts * row.by_motion;
        H.fixed_view_mut::<3, 3>(0, 0).add_assign(&shifts);
        H.fixed_view_mut::<3, 4>(0, 3).add_assign(by_motion);
        H.fixed_view_mut::<4, 4>(3, 3).add_assign(row.by_motion.transpose() * by_motion);
        let mut push = shifts * row.shift;
        if turns {
            let mixed = row.mixed * weight;
            push += mixed.transpose() * row.turn;
            let by_rotation = row.by_rotation.transpose();
            let crossed = product(&mixed.transpose(), &row.by_rotation);
            H.fixed_view_mut::<3, ROTATION>(0, TURN).add_assign(crossed);
            H.fixed_view_mut::<4, ROTATION>(3, TURN).add_assign(row.by_motion.transpose() * crossed);
            H.fixed_view_mut::<ROTATION, ROTATION>(TURN, TURN)
                .add_assign(by_rotation * product(&(row.turns * weight), &row.by_rotation));
            sums.gradient
                .fixed_rows_mut::<ROTATION>(TURN)
                .sub_assign(by_rotation * (row.turns * row.turn * weight + mixed * row.shift));
        }
        sums.gradient.fixed_rows_mut::<3>(0).sub_assign(push);
        sums.gradient.fixed_rows_mut::<4>(3).sub_assign(row.by_motion.transpose() * push);
        sums.squares += weight * row.square;
        sums.freedom += weight * self.freedom;
        sums.inliers += usize::from(in_sd < OUTLIER_SD);
        if let Some(correlated) = correlated {
            correlated.add(row.age_s, &row.p_W, &(row.by_position() * weight));
        }
    }

    /// The normal equations with the priors on drag and spin, and a trace of one on everything, for what is
    /// not observed.
    pub fn with_priors(&self, sums: &Sums, state: &State, scale: f64) -> (SMatrix<f64, N, N>, SVector<f64, N>) {
        let mut information = sums.information / (scale * scale);
        let mut gradient = sums.gradient / (scale * scale);
        for i in 0..N {
            information[(i, i)] += if i < TURN { 1e-6 } else { 1e-3 };
        }
        // A drag that is known is held by a width of 10⁻⁷ 1/m.
        let drag = self.config.drag_sd_per_m().max(1e-7).powi(-2);
        information[(DRAG, DRAG)] += drag;
        gradient[DRAG] += drag * (state.drag_per_m - self.config.drag_per_m());
        let decay = self.config.aerodynamics.spin_decay_sd_per_s.max(1e-7).powi(-2);
        information[(DECAY, DECAY)] += decay;
        gradient[DECAY] += decay * (state.decay_per_s - self.config.aerodynamics.spin_decay_per_s);
        let mut spin = Matrix3::identity();
        if let Symmetry::Axis { axis, axial_inertia, .. } = self.symmetry {
            // The angular velocity across the axis is less than the spin about it.
            let axis_W = state.R_WO * axis.into_inner();
            spin += axis_W * axis_W.transpose() * (axial_inertia.powi(-2) - 1.0);
        }
        spin *= self.config.spin_prior_sd_radps.max(1e-6).powi(-2);
        information.fixed_view_mut::<3, 3>(SPIN, SPIN).add_assign(spin);
        gradient.fixed_rows_mut::<3>(SPIN).add_assign(spin * state.w);
        (information, gradient)
    }
}

/// A·B, column by column.
fn product(A: &Matrix3<f64>, B: &SMatrix<f64, 3, ROTATION>) -> SMatrix<f64, 3, ROTATION> {
    let mut product = *B;
    product.column_iter_mut().zip(B.column_iter()).for_each(|(mut to, from)| to.copy_from(&(A * from)));
    product
}
