//! Sums over residuals from which Gauss–Newton steps are taken.

use nalgebra::{Matrix3, Matrix6, Point3, Vector3, Vector6};

/// Standard deviations at which a residual's weight has fallen to a quarter (Geman–McClure): 98 % efficient
/// on normal noise.
pub(super) const OUTLIER_SD: f64 = 5.0;
/// Weighted mean square of normal residuals with these weights, in variances: E\[w·u²\]/E\[w\].
pub(super) const MEAN_SQUARE: f64 = 0.873;

/// Σ w·J·Jᵀ and Σ w·J·r over residuals r in standard deviations, J being the gradient of r with respect to a
/// small turn and shift of the object in O.
///
/// With R → R·exp(δθ) and t → t + R·δt, a distance f whose gradient is n at the point p, all in O, changes by
/// −(p × n)·δθ − n·δt.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct NormalEquations {
    /// Lower triangle, row by row.
    products: [f64; 21],
    gradient: [f64; 6],
}

impl NormalEquations {
    /// Adds a residual: the gradient of the distance at a point, the curvature by which it counts, and the
    /// slope of its cost.
    #[inline]
    pub fn add(&mut self, p_O: &Point3<f64>, n_O: &Vector3<f64>, curvature: f64, slope: f64) {
        self.add_row(&jacobian(p_O, n_O), curvature, slope);
    }

    /// Adds a residual whose gradient is given.
    #[inline]
    pub fn add_row(&mut self, J: &[f64; 6], curvature: f64, slope: f64) {
        let mut at = 0;
        for i in 0..6 {
            self.gradient[i] += slope * J[i];
            let weighted = curvature * J[i];
            for entry in &J[..=i] {
                self.products[at] += weighted * entry;
                at += 1;
            }
        }
    }

    /// Eliminates an error that residuals have in common, by the Schur complement.
    pub fn eliminate(&mut self, common: &CommonError) {
        let CommonError { with_pose, curvature, slope } = common;
        let mut at = 0;
        for i in 0..6 {
            let of_row = with_pose[i] / curvature;
            self.gradient[i] -= of_row * slope;
            for of_column in &with_pose[..=i] {
                self.products[at] -= of_row * of_column;
                at += 1;
            }
        }
    }

    /// Adds others, scaled.
    pub fn add_scaled(&mut self, other: &Self, scale: f64) {
        self.products.iter_mut().zip(&other.products).for_each(|(sum, value)| *sum += scale * value);
        self.gradient.iter_mut().zip(&other.gradient).for_each(|(sum, value)| *sum += scale * value);
    }

    /// Information and gradient, of turns only what `observable` leaves of them.
    pub fn projected(&self, observable: &Matrix3<f64>) -> (Matrix6<f64>, Vector6<f64>) {
        let mut information = Matrix6::zeros();
        let mut at = 0;
        for i in 0..6 {
            for j in 0..=i {
                information[(i, j)] = self.products[at];
                information[(j, i)] = self.products[at];
                at += 1;
            }
        }
        let mut projection = Matrix6::identity();
        projection.fixed_view_mut::<3, 3>(0, 0).copy_from(observable);
        (projection * information * projection, projection * Vector6::from(self.gradient))
    }
}

/// Gradient of the distance at a point with respect to a small turn and shift of the object.
#[inline]
fn jacobian(p_O: &Point3<f64>, n_O: &Vector3<f64>) -> [f64; 6] {
    let turn = n_O.cross(&p_O.coords);
    [turn.x, turn.y, turn.z, -n_O.x, -n_O.y, -n_O.z]
}

/// Σ w·k·J, Σ w·k² and Σ w·k·r over residuals r + k·e with a common error e in standard deviations, and the
/// prior on that.
#[derive(Debug, Clone, Copy)]
pub(super) struct CommonError {
    with_pose: [f64; 6],
    pub curvature: f64,
    pub slope: f64,
}

impl CommonError {
    /// An error that is believed to be `expected` standard deviations less than where it is.
    pub fn new(beyond_expected: f64) -> Self {
        Self { with_pose: [0.0; 6], curvature: 1.0, slope: beyond_expected }
    }

    /// Adds a residual as [`NormalEquations::add`] does, that changes by `effect` per standard deviation of
    /// the common error.
    #[inline]
    pub fn add(&mut self, p_O: &Point3<f64>, n_O: &Vector3<f64>, curvature: f64, slope: f64, effect: f64) {
        for (sum, J) in self.with_pose.iter_mut().zip(jacobian(p_O, n_O)) {
            *sum += curvature * effect * J;
        }
        self.curvature += curvature * effect * effect;
        self.slope += slope * effect;
    }
}

/// Weight of a residual in standard deviations after Geman and McClure, w = 1/(1 + (r/c)²)².
#[inline]
pub(super) fn weight(in_sd: f64, scale: f64) -> f64 {
    let beyond = in_sd / (OUTLIER_SD * scale);
    let root = 1.0 / (1.0 + beyond * beyond);
    root * root
}

/// Sums over one kind of residuals.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Sums {
    pub equations: NormalEquations,
    /// Σ w and Σ w·r², in standard deviations, and Σ w·r² in m².
    pub weight: f64,
    pub squares: f64,
    pub squares_m2: f64,
    /// Σ w·σ² in m².
    pub variances_m2: f64,
    /// Σ |r| in metres, without weights.
    pub distances_m: f64,
}

impl Sums {
    /// Counts a residual and returns its weight.
    #[inline]
    pub fn weigh(&mut self, distance_m: f64, sd_m: f64, scale: f64) -> f64 {
        let in_sd = distance_m / sd_m;
        let weight = weight(in_sd, scale);
        self.weight += weight;
        self.squares += weight * in_sd * in_sd;
        self.squares_m2 += weight * distance_m * distance_m;
        self.variances_m2 += weight * sd_m * sd_m;
        self.distances_m += distance_m.abs();
        weight
    }
}
