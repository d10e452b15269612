//! Normal equations of all cameras and what they have in common; what the pixels of an image have in common
//! is eliminated.

use nalgebra::{DMatrix, DVector};

/// Derivatives of a measurement by the parameters that it depends on, with their indices, in ascending order.
pub type Row = Vec<(usize, f64)>;

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

    /// Adds a measurement, whose derivatives by the parameters, in ascending order, are these.
    pub fn add(&mut self, row: &Row, residual: f64, weight: f64) {
        for (at, (i, entry)) in row.iter().enumerate() {
            let scaled = entry * weight;
            self.pull[*i] += scaled * residual;
            for (j, other) in &row[at..] {
                self.information[i * self.size + j] += scaled * other;
            }
        }
    }

    /// The equations of the parameters that the image depends on, without the last one.
    pub fn eliminated(&self) -> ImageInformation {
        let (size, last) = (self.size, self.size - 1);
        let places: Vec<usize> = (0..last).filter(|i| self.information[i * size + i] != 0.0).collect();
        let pivot = self.information[size * size - 1];
        let by_last: Vec<f64> = places.iter().map(|i| self.information[i * size + last]).collect();
        let (mut information, mut pull) = (DMatrix::zeros(places.len(), places.len()), DVector::zeros(places.len()));
        for (a, i) in places.iter().enumerate() {
            let coupled = by_last[a] / pivot;
            pull[a] = self.pull[*i] - coupled * self.pull[last];
            for (b, j) in places.iter().enumerate().skip(a) {
                let value = self.information[i * size + j] - coupled * by_last[b];
                (information[(a, b)], information[(b, a)]) = (value, value);
            }
        }
        let (coupling, common_pull) = (by_last, self.pull[last]);
        ImageInformation { places, information, pull, coupling, common_information: pivot, common_pull }
    }
}

/// Equations of one image, what its pixels have in common eliminated.
#[derive(Debug, Clone)]
pub struct ImageInformation {
    /// Indices of the parameters that it depends on among all.
    pub places: Vec<usize>,
    pub information: DMatrix<f64>,
    pub pull: DVector<f64>,
    /// Information that the eliminated parameter has in common with these, its own, and its pull.
    pub coupling: Vec<f64>,
    pub common_information: f64,
    pub common_pull: f64,
}

impl ImageInformation {
    /// Adds the information of the image, times a factor, to that of all parameters.
    pub fn add_to(&self, sum: &mut DMatrix<f64>, factor: f64) {
        for (column, j) in self.places.iter().enumerate() {
            for (row, i) in self.places.iter().enumerate() {
                sum[(*i, *j)] += factor * self.information[(row, column)];
            }
        }
    }

    /// Adds its pull to that of all parameters.
    pub fn add_pull_to(&self, sum: &mut DVector<f64>) {
        self.places.iter().zip(self.pull.iter()).for_each(|(at, pull)| sum[*at] += pull);
    }

    /// Its pull from where a change of all parameters leads.
    pub fn pull_after(&self, change: &DVector<f64>) -> DVector<f64> {
        &self.pull - &self.information * DVector::from_fn(self.pull.len(), |i, _| change[self.places[i]])
    }

    /// Change of the eliminated parameter that goes with a change of all others, and its variance where they
    /// are known.
    pub fn common_change(&self, change: &DVector<f64>) -> (f64, f64) {
        let coupled: f64 = self.places.iter().zip(&self.coupling).map(|(i, by)| by * change[*i]).sum();
        ((self.common_pull - coupled) / self.common_information, 1.0 / self.common_information)
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
            image.add(&row.iter().copied().enumerate().collect(), residual, 2.0);
            let column = DVector::from_row_slice(row);
            whole += &column * column.transpose() * 2.0;
            whole_pull += column * (2.0 * residual);
        }
        let expected = whole.cholesky().unwrap().solve(&whole_pull);
        let eliminated = image.eliminated();
        let found = eliminated.information.clone().cholesky().unwrap().solve(&eliminated.pull);
        assert!((found - expected.rows(0, 2)).norm() < 1e-12);
        assert!((eliminated.common_change(&expected).0 - expected[2]).abs() < 1e-12);
    }
}
