//! Neighbour search: the points of a cloud near a position, by a grid of cells over the cloud's bounding box.

use std::collections::BTreeSet;

use nalgebra::{Point3, Vector3};

/// A cloud's points sorted into cubic cells.
#[derive(Debug, Clone)]
pub struct PointGrid {
    lowest: Point3<f64>,
    cell_m: f64,
    cells: [usize; 3],
    /// `points[starts[c]..starts[c + 1]]` are the indices of the points in cell c.
    starts: Vec<u32>,
    points: Vec<u32>,
}

/// Most cells along an axis, so that a stray point cannot cost memory without end.
const MAX_CELLS: f64 = 128.0;

impl PointGrid {
    /// Sorts `points` into cells of about `cell_m`.
    pub fn new(points: &[Point3<f64>], cell_m: f64) -> Self {
        let (lowest, highest) = bounds(points);
        let extent = highest - lowest;
        let cell_m = cell_m.max(extent.max() / MAX_CELLS).max(1e-9);
        let cells: [usize; 3] = std::array::from_fn(|axis| (extent[axis] / cell_m) as usize + 1);
        let mut grid = Self { lowest, cell_m, cells, starts: Vec::new(), points: vec![0; points.len()] };

        // Counting sort: numbers per cell, their running sum, and each point into its place.
        grid.starts = vec![0; cells.iter().product::<usize>() + 1];
        for point in points {
            let cell = grid.index(grid.cell(point));
            grid.starts[cell + 1] += 1;
        }
        for cell in 1..grid.starts.len() {
            grid.starts[cell] += grid.starts[cell - 1];
        }
        let mut next = grid.starts.clone();
        for (i, point) in points.iter().enumerate() {
            let cell = grid.index(grid.cell(point));
            grid.points[next[cell] as usize] = i as u32;
            next[cell] += 1;
        }
        grid
    }

    /// Calls `visit` with the index of every point that may lie within `radius_m` of `centre`, and of some
    /// beyond.
    pub fn near(&self, centre: &Point3<f64>, radius_m: f64, mut visit: impl FnMut(usize)) {
        let reach = Vector3::repeat(radius_m);
        let (from, to) = (self.cell(&(centre - reach)), self.cell(&(centre + reach)));
        for z in from[2]..=to[2] {
            for y in from[1]..=to[1] {
                let row = (z * self.cells[1] + y) * self.cells[0];
                let range = self.starts[row + from[0]] as usize..self.starts[row + to[0] + 1] as usize;
                for &point in &self.points[range] {
                    visit(point as usize);
                }
            }
        }
    }

    fn cell(&self, point: &Point3<f64>) -> [usize; 3] {
        std::array::from_fn(|axis| {
            (((point[axis] - self.lowest[axis]) / self.cell_m).max(0.0) as usize).min(self.cells[axis] - 1)
        })
    }

    fn index(&self, [x, y, z]: [usize; 3]) -> usize {
        (z * self.cells[1] + y) * self.cells[0] + x
    }
}

/// Indices of the first point, in the order given, of each cube of edge `edge_m` in metres.
pub fn first_in_cubes(points: &[Point3<f64>], edge_m: f64) -> impl Iterator<Item = usize> {
    let cube = move |i: &usize| <[i64; 3]>::from(points[*i].coords.map(|value| (value / edge_m).floor() as i64));
    let mut known = BTreeSet::new();
    (0..points.len()).filter(move |i| known.insert(cube(i)))
}

/// Lowest and highest coordinates of a cloud; the origin twice if it is empty.
pub fn bounds(points: &[Point3<f64>]) -> (Point3<f64>, Point3<f64>) {
    let Some(&first) = points.first() else { return (Point3::origin(), Point3::origin()) };
    points.iter().fold((first, first), |(low, high), point| (low.inf(point), high.sup(point)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn finds_every_point_within_the_radius() {
        let points: Vec<Point3<f64>> = (0..500)
            .map(|i| {
                let i = f64::from(i);
                Point3::new(libm::sin(i * 0.37), libm::cos(i * 0.71), libm::sin(i * 0.13)) * 0.1
            })
            .collect();
        let grid = PointGrid::new(&points, 0.01);
        for centre in &points {
            let mut found = 0;
            grid.near(centre, 0.03, |i| found += usize::from((points[i] - centre).norm() <= 0.03));
            assert_eq!(found, points.iter().filter(|point| (*point - centre).norm() <= 0.03).count());
        }
    }
}
