//! Normal equations of all cameras and what they have in common; what the pixels of an image have in common
//! is eliminated.

use nalgebra::{DMatrix, DVector};

/// Normal equations of one image: its own parameters, and last what its pixels have in common, whose prior is
/// N(0, 1).
#[derive(Debug, Clone)]
pub struct ImageEquations {
    size: usize,
    /// Upper triangle, row by row.
    information: Vec<f64>,
    pull: Vec<f64>,
}

impl ImageEquations {
    /// Equations of so many parameters, of which the last one is at `last` now.
    pub fn new(size: usize, last: f64) -> Self {
        let (mut information, mut pull) = (vec![0.0; size * size], vec![0.0; size]);
        (information[size * size - 1], pull[size - 1]) = (1.0, -last);
        Self { size, information, pull }
    }

    pub fn add(&mut self, row: &[f64], residual: f64, weight: f64) {
        for (i, entry) in row.iter().enumerate().filter(|(_, entry)| **entry != 0.0) {
            let scaled = entry * weight;
            self.pull[i] += scaled * residual;
            let from = i * self.size;
            for (sum, other) in self.information[from + i..from + self.size].iter_mut().zip(&row[i..]) {
                *sum += scaled * other;
            }
        }
    }

    /// Value of the last parameter that goes with a change of all others.
    pub fn last(&self, change: impl Fn(usize) -> f64) -> f64 {
        let last = self.size - 1;
        let coupled: f64 = (0..last).map(|i| self.information[i * self.size + last] * change(i)).sum();
        (self.pull[last] - coupled) / self.information[self.size * self.size - 1]
    }

    /// Variance of the last parameter, all others known.
    pub fn last_variance(&self) -> f64 {
        1.0 / self.information[self.size * self.size - 1]
    }

    /// Information and pull of all but the last parameter.
    pub fn eliminated(&self) -> (DMatrix<f64>, DVector<f64>) {
        let (size, last) = (self.size, self.size - 1);
        let (mut information, mut pull) = (DMatrix::zeros(last, last), DVector::zeros(last));
        let pivot = self.information[size * size - 1];
        for i in 0..last {
            let coupled = self.information[i * size + last] / pivot;
            pull[i] = self.pull[i] - coupled * self.pull[last];
            for j in i..last {
                let value = self.information[i * size + j] - coupled * self.information[j * size + last];
                (information[(i, j)], information[(j, i)]) = (value, value);
            }
        }
        (information, pull)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Elimination of one of three parameters agrees with the solution of the whole system.
    #[test]
    fn elimination_is_the_whole_systems_solution() {
        let rows = [[1.0, 0.5, 1.0], [0.2, 1.0, 1.0], [0.9, -0.4, 1.0], [0.1, 0.1, 1.0]];
        let residuals = [0.3, -0.2, 0.5, 0.1];
        let mut image = ImageEquations::new(3, 0.0);
        let (mut whole, mut whole_pull) = (DMatrix::zeros(3, 3), DVector::zeros(3));
        whole[(2, 2)] = 1.0;
        for (row, residual) in rows.iter().zip(residuals) {
            image.add(row, residual, 2.0);
            let column = DVector::from_row_slice(row);
            whole += &column * column.transpose() * 2.0;
            whole_pull += column * (2.0 * residual);
        }
        let expected = whole.cholesky().unwrap().solve(&whole_pull);
        let (information, pull) = image.eliminated();
        let found = information.cholesky().unwrap().solve(&pull);
        assert!((found - expected.rows(0, 2)).norm() < 1e-12);
        assert!((image.last(|i| expected[i]) - expected[2]).abs() < 1e-12);
    }
}
