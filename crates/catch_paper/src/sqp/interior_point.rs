//! Dense convex quadratic programs of some hundred rows by a primal-dual interior-point method.
//!
//! ```text
//!     min  ½ xᵀH x + gᵀx      subject to   aᵢᵀx ≤ bᵢ
//!      x
//! ```
//! Mehrotra's predictor and corrector (Nocedal & Wright, Numerical Optimization, section 16.6). Unlike the
//! active-set method of [`quadratic_program`](catch_body::quadratic_program) its number of steps hardly
//! depends on how many rows bind.

use catch_body::quadratic_program::ProgramFailure;
use nalgebra::{Cholesky, DMatrix, DVector};

/// One row aᵀx ≤ b. Its entries stand together, but for one slack variable, which enters with −1.
#[derive(Debug, Clone, PartialEq)]
pub struct Row {
    /// The variable that the first entry belongs to.
    pub first: usize,
    /// Entries of a.
    pub a: Vec<f64>,
    /// The slack variable of a row that may be broken at a price.
    pub slack: Option<usize>,
    /// b.
    pub bound: f64,
}

impl Row {
    fn dot(&self, x: &DVector<f64>) -> f64 {
        let entries: f64 = self.a.iter().zip(&x.as_slice()[self.first..]).map(|(a, x)| a * x).sum();
        entries - self.slack.map_or(0.0, |slack| x[slack])
    }

    fn add_to(&self, y: &mut DVector<f64>, weight: f64) {
        for (entry, a) in y.as_mut_slice()[self.first..].iter_mut().zip(&self.a) {
            *entry += weight * a;
        }
        if let Some(slack) = self.slack {
            y[slack] -= weight;
        }
    }

    /// Adds weight·a·aᵀ to the lower triangle. Slacks come after all other variables.
    fn add_square_to(&self, matrix: &mut DMatrix<f64>, weight: f64) {
        for (j, a_j) in self.a.iter().enumerate().filter(|(_, a)| **a != 0.0) {
            let column = self.first + j;
            for (i, a_i) in self.a.iter().enumerate().skip(j) {
                matrix[(self.first + i, column)] += weight * a_i * a_j;
            }
            if let Some(slack) = self.slack {
                matrix[(slack, column)] -= weight * a_j;
            }
        }
        if let Some(slack) = self.slack {
            matrix[(slack, slack)] += weight;
        }
    }
}

/// A program; H must be positive definite.
#[derive(Debug, Clone)]
pub struct Program {
    /// H.
    pub hessian: DMatrix<f64>,
    /// g.
    pub gradient: DVector<f64>,
    /// The rows. All should be of about the same size.
    pub rows: Vec<Row>,
}

/// Steps at most; programs of splines take 10 to 25.
const STEPS: usize = 60;
/// Largest residual of the conditions of optimality at the end.
const TOLERANCE: f64 = 1e-9;
/// A step goes this fraction of the way to the boundary.
const TO_BOUNDARY: f64 = 0.995;

impl Program {
    /// The minimum, sought from `x`, which need not keep the rows.
    ///
    /// # Errors
    /// If it was not found: where no x keeps the rows, the steps come to their limit.
    pub fn minimize(&self, mut x: DVector<f64>) -> Result<DVector<f64>, ProgramFailure> {
        let rows = &self.rows;
        let count = rows.len() as f64;
        let mut s: Vec<f64> = rows.iter().map(|row| (row.bound - row.dot(&x)).max(1e-2)).collect();
        let mut z = vec![1.0; rows.len()];
        for _ in 0..STEPS {
            let mut r_dual = &self.hessian * &x + &self.gradient;
            for (row, z) in rows.iter().zip(&z) {
                row.add_to(&mut r_dual, *z);
            }
            let r_primal: Vec<f64> = rows.iter().zip(&s).map(|(row, s)| row.dot(&x) + s - row.bound).collect();
            let gap = s.iter().zip(&z).map(|(s, z)| s * z).sum::<f64>() / count;
            let broken = r_primal.iter().fold(0.0, |most: f64, r| most.max(r.abs()));
            if broken < TOLERANCE && gap < TOLERANCE && r_dual.amax() < 1e3 * TOLERANCE {
                return Ok(x);
            }

            let mut matrix = self.hessian.clone();
            for ((row, s), z) in rows.iter().zip(&s).zip(&z) {
                row.add_square_to(&mut matrix, z / s);
            }
            let factor = Cholesky::new(matrix).ok_or(ProgramFailure::Numerical)?;
            // Predictor: straight for the optimum. Corrector: toward the centre, as far as the predictor fell
            // short, and with the predictor's second-order error.
            let products: Vec<f64> = s.iter().zip(&z).map(|(s, z)| s * z).collect();
            let step = |r_gap: &[f64]| self.step(&factor, (&r_dual, &r_primal, r_gap), &s, &z);
            let (_, ds, dz) = step(&products);
            let (by_s, by_z) = (longest(&s, &ds), longest(&z, &dz));
            let ahead = s.iter().zip(&ds).zip(z.iter().zip(&dz));
            let gap_ahead = ahead.map(|((s, ds), (z, dz))| (s + by_s * ds) * (z + by_z * dz)).sum::<f64>() / count;
            let centre = (gap_ahead / gap).powi(3) * gap;
            let corrected: Vec<f64> =
                products.iter().zip(ds.iter().zip(&dz)).map(|(sz, (ds, dz))| sz + ds * dz - centre).collect();
            let (dx, ds, dz) = step(&corrected);
            // One length for both: the Hessian ties the dual residual to x.
            let by = TO_BOUNDARY * longest(&s, &ds).min(longest(&z, &dz));
            x.axpy(by, &dx, 1.0);
            for i in 0..rows.len() {
                s[i] += by * ds[i];
                z[i] += by * dz[i];
            }
            if !x.iter().all(|value| value.is_finite()) {
                return Err(ProgramFailure::Numerical);
            }
        }
        Err(ProgramFailure::IterationLimit)
    }

    /// Solves (H + Gᵀ(z/s)G)·Δx = −r_d + Gᵀ(r_c − z·r_p)/s, Δs = −r_p − G·Δx, Δz = (−r_c − z·Δs)/s.
    fn step(
        &self,
        factor: &Cholesky<f64, nalgebra::Dyn>,
        (r_dual, r_primal, r_gap): (&DVector<f64>, &[f64], &[f64]),
        s: &[f64],
        z: &[f64],
    ) -> (DVector<f64>, Vec<f64>, Vec<f64>) {
        let mut dx = -r_dual;
        for (i, row) in self.rows.iter().enumerate() {
            row.add_to(&mut dx, (r_gap[i] - z[i] * r_primal[i]) / s[i]);
        }
        factor.solve_mut(&mut dx);
        let ds: Vec<f64> = self.rows.iter().zip(r_primal).map(|(row, r)| -r - row.dot(&dx)).collect();
        let dz = (0..s.len()).map(|i| (-r_gap[i] - z[i] * ds[i]) / s[i]).collect();
        (dx, ds, dz)
    }
}

/// The longest step, up to 1, before a value that must stay positive vanishes.
fn longest(values: &[f64], steps: &[f64]) -> f64 {
    let each = values.iter().zip(steps).filter(|(_, step)| **step < 0.0).map(|(value, step)| -value / step);
    each.fold(1.0, f64::min)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn row(a: &[f64], bound: f64) -> Row {
        Row { first: 0, a: a.to_vec(), slack: None, bound }
    }

    #[test]
    fn a_corner_is_found() {
        // Nearest point to (2, 2) with x + y ≤ 1, x ≤ 0.2.
        let program = Program {
            hessian: DMatrix::identity(2, 2),
            gradient: DVector::from_vec(vec![-2.0, -2.0]),
            rows: vec![row(&[1.0, 1.0], 1.0), row(&[1.0, 0.0], 0.2)],
        };
        let x = program.minimize(DVector::zeros(2)).unwrap();
        assert!((x - DVector::from_vec(vec![0.2, 0.8])).amax() < 1e-7);
    }

    #[test]
    fn what_contradicts_itself_has_no_minimum() {
        let program = Program {
            hessian: DMatrix::identity(1, 1),
            gradient: DVector::zeros(1),
            rows: vec![row(&[1.0], -1.0), row(&[-1.0], -1.0)],
        };
        assert!(program.minimize(DVector::zeros(1)).is_err());
    }

    #[test]
    fn a_row_with_a_slack_is_broken_only_at_a_price() {
        // x ≥ 1 for 10 a unit against ½x² + 3x, whose slope at x = 1 is 4: it pays to keep it. For 2 a unit
        // it does not.
        for (price, expected) in [(10.0, 1.0), (2.0, -1.0)] {
            let program = Program {
                hessian: DMatrix::from_diagonal(&DVector::from_vec(vec![1.0, 1e-9])),
                gradient: DVector::from_vec(vec![3.0, price]),
                rows: vec![
                    Row { first: 0, a: vec![-1.0], slack: Some(1), bound: -1.0 },
                    Row { first: 0, a: vec![0.0], slack: Some(1), bound: 0.0 },
                ],
            };
            let x = program.minimize(DVector::zeros(2)).unwrap();
            assert!((x[0] - expected).abs() < 1e-6, "{x}");
        }
    }

    proptest! {
        /// No feasible point nearby is better (for convex programs a local minimum is the minimum).
        #[test]
        fn no_neighbour_is_better(
            g in prop::collection::vec(-2.0f64..2.0, 4),
            a in prop::collection::vec(-1.0f64..1.0, 24),
            toward in prop::collection::vec(-1.0f64..1.0, 4),
        ) {
            let program = Program {
                hessian: DMatrix::identity(4, 4),
                gradient: DVector::from_vec(g),
                rows: a.chunks(4).map(|a| row(a, 0.5)).collect(),
            };
            let cost = |x: &DVector<f64>| 0.5 * x.norm_squared() + program.gradient.dot(x);
            let x = program.minimize(DVector::zeros(4)).unwrap();
            prop_assert!(program.rows.iter().all(|row| row.dot(&x) <= row.bound + 1e-8));
            let other = &x + DVector::from_vec(toward) * 1e-2;
            if program.rows.iter().all(|row| row.dot(&other) <= row.bound) {
                prop_assert!(cost(&other) >= cost(&x) - 1e-7);
            }
        }
    }
}
