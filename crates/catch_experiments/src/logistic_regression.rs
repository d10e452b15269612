//! Ridge logistic regression with bounds on the signs of its coefficients.

use nalgebra::{DMatrix, DVector};

/// Most Newton steps; separated data without a penalty would go on for ever.
const MOST_STEPS: usize = 100;
/// Most halvings of a step.
const MOST_HALVINGS: usize = 40;
/// Steps below this, in the largest coefficient, end the iteration.
const LEAST_STEP: f64 = 1e-10;
/// The fraction of the decrease by the gradient that a step has to bring (Armijo's condition).
const SUFFICIENT: f64 = 1e-4;

/// Logistic regression: minimizes over the coefficients β, for the rows xᵢ of `X` and the outcomes yᵢ of `y`,
/// 0 or 1:
///
/// Σᵢ (ln(1 + exp(xᵢ·β)) − yᵢ·xᵢ·β) + ½·Σⱼ λⱼ·βⱼ²,   βⱼ ≤ 0 for every j of `is_at_most_zero`
pub struct LogisticRegression<'a> {
    /// One row per observation.
    pub X: &'a DMatrix<f64>,
    /// Outcomes.
    pub y: &'a DVector<f64>,
    /// The ridge λⱼ of each coefficient.
    pub ridge: &'a DVector<f64>,
    /// Flags of the coefficients that may not be positive.
    pub is_at_most_zero: &'a [bool],
}

/// Coefficients, and their standard errors, none for those that their bound holds.
#[derive(Debug, Clone)]
pub struct Coefficients {
    /// The coefficients β.
    pub beta: DVector<f64>,
    /// Standard errors from the inverse of the Hessian over the coefficients that are free.
    pub standard_errors: Vec<Option<f64>>,
}

/// The logistic function.
pub fn logistic(z: f64) -> f64 {
    1.0 / (1.0 + libm::exp(-z))
}

impl LogisticRegression<'_> {
    /// Iteratively reweighted least squares, which are Newton's steps, projected onto the bounds (Bertsekas,
    /// Projected Newton methods for optimization problems with simple constraints, 1982). `None` if the
    /// Hessian is singular or the iteration does not end.
    pub fn fit(&self) -> Option<Coefficients> {
        let mut beta = DVector::zeros(self.X.ncols());
        for _ in 0..MOST_STEPS {
            let gradient = self.gradient(&beta);
            let free = self.free(&beta, &gradient);
            let inverse = self.hessian(&beta, &free).try_inverse()?;
            let of_free = DVector::from_iterator(free.len(), free.iter().map(|&j| gradient[j]));
            let mut direction = DVector::zeros(beta.len());
            free.iter().zip((-&inverse * of_free).iter()).for_each(|(&j, step)| direction[j] = *step);
            let next = self.along(&beta, &direction, &gradient);
            let step = (&next - &beta).amax();
            beta = next;
            if step < LEAST_STEP {
                let mut standard_errors = vec![None; beta.len()];
                free.iter().enumerate().for_each(|(i, &j)| standard_errors[j] = Some(inverse[(i, i)].sqrt()));
                return Some(Coefficients { beta, standard_errors });
            }
        }
        None
    }

    /// The first of the halved steps that brings enough, projected onto the bounds.
    fn along(&self, beta: &DVector<f64>, direction: &DVector<f64>, gradient: &DVector<f64>) -> DVector<f64> {
        let before = self.objective(beta);
        let projected = |halvings: usize| {
            let mut next = beta + direction * 0.5_f64.powi(halvings as i32);
            next.iter_mut()
                .zip(self.is_at_most_zero)
                .filter(|(_, bounded)| **bounded)
                .for_each(|(b, _)| *b = b.min(0.0));
            next
        };
        let brings_enough =
            |next: &DVector<f64>| self.objective(next) <= before + SUFFICIENT * gradient.dot(&(next - beta));
        (0..MOST_HALVINGS).map(projected).find(brings_enough).unwrap_or_else(|| beta.clone())
    }

    /// Coefficients that are not held by their bound.
    fn free(&self, beta: &DVector<f64>, gradient: &DVector<f64>) -> Vec<usize> {
        let is_held = |j: usize| self.is_at_most_zero[j] && beta[j] >= 0.0 && gradient[j] < 0.0;
        (0..beta.len()).filter(|&j| !is_held(j)).collect()
    }

    fn objective(&self, beta: &DVector<f64>) -> f64 {
        // ln(1 + exp(z)) without overflow.
        let softplus = |z: f64| z.max(0.0) + libm::log1p(libm::exp(-z.abs()));
        let z = self.X * beta;
        let loss: f64 = z.iter().zip(self.y.iter()).map(|(z, y)| softplus(*z) - y * z).sum();
        loss + 0.5 * beta.component_mul(beta).dot(self.ridge)
    }

    fn gradient(&self, beta: &DVector<f64>) -> DVector<f64> {
        self.X.transpose() * ((self.X * beta).map(logistic) - self.y) + self.ridge.component_mul(beta)
    }

    /// Hessian over the coefficients that are free.
    fn hessian(&self, beta: &DVector<f64>, free: &[usize]) -> DMatrix<f64> {
        let p = (self.X * beta).map(logistic);
        let X = self.X.select_columns(free);
        let weighted = DMatrix::from_fn(X.nrows(), X.ncols(), |i, j| X[(i, j)] * p[i] * (1.0 - p[i]));
        let ridge = DVector::from_iterator(free.len(), free.iter().map(|&j| self.ridge[j]));
        X.transpose() * weighted + DMatrix::from_diagonal(&ridge)
    }
}

#[cfg(test)]
mod tests {
    use catch_sim::random_streams::{Draws, Stream};
    use serde::Deserialize;

    use super::*;

    #[derive(Deserialize)]
    struct Golden {
        name: String,
        #[serde(rename = "X")]
        X: Vec<Vec<f64>>,
        y: Vec<f64>,
        ridge: Vec<f64>,
        is_at_most_zero: Vec<bool>,
        beta: Vec<f64>,
    }

    #[test]
    fn coefficients_are_those_of_scikit_learn_and_scipy() {
        let goldens: Vec<Golden> =
            serde_json::from_str(include_str!("../tests/golden/logistic_regression.json")).unwrap();
        let mut held = 0;
        for Golden { name, X, y, ridge, is_at_most_zero, beta } in goldens {
            let X = DMatrix::from_fn(X.len(), X[0].len(), |i, j| X[i][j]);
            let (y, ridge) = (DVector::from(y), DVector::from(ridge));
            let found =
                LogisticRegression { X: &X, y: &y, ridge: &ridge, is_at_most_zero: &is_at_most_zero }.fit().unwrap();
            for (j, expected) in beta.iter().enumerate() {
                assert!((found.beta[j] - expected).abs() < 1e-5, "{name}: {j}: {} {expected}", found.beta[j]);
                held += usize::from(found.standard_errors[j].is_none());
            }
        }
        assert!(held >= 2, "bounds that hold are tested, too");
    }

    #[test]
    fn coefficients_that_data_have_are_found_within_their_standard_errors() {
        let mut draws = Draws::new(Stream::Throw, 1, 0);
        let X = DMatrix::from_fn(20_000, 3, |_, j| if j == 2 { 1.0 } else { draws.between([-2.0, 2.0]) });
        let truth = DVector::from_column_slice(&[1.5, -0.7, 0.3]);
        let y = (&X * &truth).map(|z| f64::from(u8::from(draws.unit() < logistic(z))));
        let ridge = DVector::repeat(3, 0.05);
        let found = LogisticRegression { X: &X, y: &y, ridge: &ridge, is_at_most_zero: &[false; 3] }.fit().unwrap();
        for i in 0..3 {
            let error = found.standard_errors[i].unwrap();
            assert!((found.beta[i] - truth[i]).abs() < 4.0 * error, "{found:?}");
            assert!(error < 0.04);
        }
    }

    #[test]
    fn outcomes_that_can_be_separated_have_finite_coefficients() {
        let X = DMatrix::from_column_slice(4, 1, &[-2.0, -1.0, 1.0, 2.0]);
        let y = DVector::from_column_slice(&[0.0, 0.0, 1.0, 1.0]);
        let ridge = DVector::repeat(1, 1e-3);
        let found = LogisticRegression { X: &X, y: &y, ridge: &ridge, is_at_most_zero: &[false] }.fit().unwrap();
        assert!(found.beta[0] > 1.0 && found.beta[0].is_finite());
        let held = LogisticRegression { X: &X, y: &y, ridge: &ridge, is_at_most_zero: &[true] }.fit().unwrap();
        assert_eq!((held.beta[0], held.standard_errors[0]), (0.0, None));
    }
}
