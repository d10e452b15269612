//! The signed distance from a cloud of oriented points, on a grid.
//!
//! Registering a cloud to a surface needs, for each point and iteration, its distance from the surface and
//! the direction of that distance. A grid answers with its eight nearest nodes, without searching for
//! neighbours.

use nalgebra::{Matrix3, Point3, Vector3};

use crate::neighbours::{PointGrid, bounds};

/// Signed distance, negative inside: fine near the surface, coarse around it.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct DistanceField {
    fine: Grid,
    coarse: Grid,
}

/// A cloud of oriented points, and how far apart its points are.
#[derive(Debug, Clone, Copy)]
pub struct OrientedPoints<'a> {
    /// Points on the surface.
    pub points: &'a [Point3<f64>],
    /// Outward unit normals, one per point.
    pub normals: &'a [Vector3<f64>],
    /// Width of the neighbourhood over which the surface is averaged, in metres.
    pub smoothing_m: f64,
}

/// Margin of the coarse grid around the cloud: registration still finds its way from 10 cm off.
const COARSE_MARGIN_M: f64 = 0.1;
/// Cells of a grid at most: those of a ball of 0.23 m at 2.5 mm.
const MOST_CELLS: f64 = 1e6;
/// Coarse nodes per metre of spacing: the surface's surroundings are smooth.
const COARSE_M: f64 = 0.01;
/// Nearer to the surface than this the nearest points are believed.
const LEAST_CLEARANCE_M: f64 = 1e-3;
/// Two neighbouring nodes whose distances from the surface add up to more than so many spacings are on the
/// same side of it.
const SAME_SIDE: f64 = 1.5;
/// Places of a region that are asked about at most.
const MOST_LOOKED_AT: usize = 2000;
/// Distance over which the state of a node is passed on to its neighbours, in metres.
const SPREAD_M: f64 = 0.01;
/// Within this distance of the cloud the surface is averaged over neighbours, beyond it the nearest point
/// suffices.
const BAND_M: f64 = 0.008;

impl DistanceField {
    /// The field of a cloud, `fine_m` between the nodes next to it.
    pub fn new(cloud: &OrientedPoints<'_>, fine_m: f64) -> Self {
        let grid = PointGrid::new(cloud.points, cloud.smoothing_m);
        Self {
            fine: Grid::around(cloud, &grid, fine_m, BAND_M + fine_m),
            coarse: Grid::around(cloud, &grid, COARSE_M, COARSE_MARGIN_M),
        }
    }

    /// Signed distance in metres and its gradient.
    #[inline]
    pub fn at(&self, point: &Point3<f64>) -> (f64, Vector3<f64>) {
        self.fine.at(point).or_else(|| self.coarse.at(point)).unwrap_or_else(|| self.coarse.beyond(point))
    }

    /// Distance by the coarse nodes alone, which are few enough to stay in the cache: for coarse decisions
    /// about points that are far from each other.
    #[inline]
    pub fn about_m(&self, point: &Point3<f64>) -> f64 {
        self.coarse.at(point).unwrap_or_else(|| self.coarse.beyond(point)).0
    }

    /// Turns inside out what is taken for the inside and is not: places that are free by `is_free`, which
    /// gets a place and its distance from the surface and may not know, and those that are nearer to them
    /// than to places which are not, within one surface.
    ///
    /// The nearest points alone decide wrongly at thin walls, in the openings of a surface, and before parts
    /// of it that nobody saw.
    pub fn clear(&mut self, is_free: &dyn Fn(&Point3<f64>, f64) -> Option<bool>) {
        self.fine.clear(is_free);
        self.coarse.clear(is_free);
    }

    /// Moves the field: what was at `point` is at `point + offset` afterwards.
    pub fn translate(&mut self, offset: &Vector3<f64>) {
        self.fine.lowest += offset;
        self.coarse.lowest += offset;
    }

    /// Depth of the deepest node below the surface, in metres.
    pub fn deepest_m(&self) -> f64 {
        self.fine.values.iter().map(|node| -f64::from(node[0])).fold(0.0, f64::max)
    }

    /// Volume in m³, centre and second moment of the inside per volume, ∫ x·xᵀ dV / V about the centre.
    pub fn moments(&self) -> (f64, Point3<f64>, Matrix3<f64>) {
        let grid = &self.fine;
        let (mut cells, mut first, mut second) = (0.0, Vector3::zeros(), Matrix3::zeros());
        for (i, value) in grid.values.iter().enumerate() {
            // The fraction of a node's cell that is inside.
            let weight = (0.5 - f64::from(value[0]) / grid.spacing_m).clamp(0.0, 1.0);
            if weight > 0.0 {
                let point = grid.node(i);
                cells += weight;
                first += point.coords * weight;
                second += point.coords * point.coords.transpose() * weight;
            }
        }
        if cells <= 0.0 {
            return (0.0, Point3::origin(), Matrix3::zeros());
        }
        let centre = first / cells;
        (cells * grid.spacing_m.powi(3), Point3::from(centre), second / cells - centre * centre.transpose())
    }
}

/// Returns whether a value is that of a node inside, as far as the nearest points show it.
fn is_inside(value: f32) -> bool {
    f64::from(value) < -LEAST_CLEARANCE_M
}

/// Values and gradients on the nodes of a regular grid, x running fastest.
#[derive(Debug, Clone, PartialEq, Default)]
struct Grid {
    lowest: Point3<f64>,
    spacing_m: f64,
    /// Inverse of the spacing, in 1/m.
    per_m: f64,
    nodes: [usize; 3],
    /// Value and its change from node to node along each axis, in metres: all four are wanted together, and
    /// lie together.
    values: Vec<[f32; 4]>,
}

impl Grid {
    /// A grid over the cloud and a margin, `spacing_m` between its nodes, or more where there would be too
    /// many.
    fn around(cloud: &OrientedPoints<'_>, near: &PointGrid, spacing_m: f64, margin_m: f64) -> Self {
        let (low, high) = bounds(cloud.points);
        let lowest = low - Vector3::repeat(margin_m);
        let spacing_m = spacing_m.max(libm::cbrt((high - lowest).add_scalar(margin_m).product() / MOST_CELLS));
        let nodes = std::array::from_fn(|axis| ((high[axis] + margin_m - lowest[axis]) / spacing_m) as usize + 2);
        let mut grid = Self { lowest, spacing_m, per_m: 1.0 / spacing_m, nodes, values: Vec::new() };
        let nearest = grid.nearest_points(cloud.points);
        let distance = |(i, &nearest): (usize, &u32)| {
            let known = cloud.points.get(nearest as usize);
            known.map_or(1.0, |_| cloud.distance(near, &grid.node(i), nearest as usize) as f32)
        };
        let values: Vec<f32> = nearest.iter().enumerate().map(distance).collect();
        grid.set(&values);
        grid
    }

    /// Sets all values, and from them the changes from node to node.
    fn set(&mut self, values: &[f32]) {
        let nodes = self.nodes;
        let strides = [1, nodes[0], nodes[0] * nodes[1]];
        let with_changes = (0..values.len()).map(|i| {
            let change = |axis: usize| {
                // Between the two neighbours; at the ends of a row between the node and its only one.
                let along = i / strides[axis] % nodes[axis];
                let before = if along > 0 { i - strides[axis] } else { i };
                let after = if along + 1 < nodes[axis] { i + strides[axis] } else { i };
                (values[after] - values[before]) / ((after - before) / strides[axis]) as f32
            };
            [values[i], change(0), change(1), change(2)]
        });
        self.values = with_changes.collect();
    }

    /// Marks free nodes of this grid as outside, as [`DistanceField::clear`] does.
    fn clear(&mut self, is_free: &dyn Fn(&Point3<f64>, f64) -> Option<bool>) {
        let mut values: Vec<f32> = self.values.iter().map(|node| node[0]).collect();
        let mut is_seen = vec![false; values.len()];
        // Of each node whether it is free, as far as that is known.
        let mut free = vec![None; values.len()];
        for first in 0..values.len() {
            if is_seen[first] || !is_inside(values[first]) {
                continue;
            }
            is_seen[first] = true;
            let mut region = vec![first];
            let mut next = 0;
            while let Some(&node) = region.get(next) {
                next += 1;
                self.each_linked(&values, node, |other| {
                    if !std::mem::replace(&mut is_seen[other], true) {
                        region.push(other);
                    }
                });
            }
            // Known states spread from node to node, but not along a wall that is too thin.
            let looked_at = region.iter().step_by(region.len().div_ceil(MOST_LOOKED_AT));
            let mut known: Vec<(usize, f64)> = Vec::new();
            for &node in looked_at {
                free[node] = is_free(&self.node(node), -f64::from(values[node]));
                known.extend(free[node].map(|_| (node, 0.0)));
            }
            let mut next = 0;
            while let Some(&(node, spread_m)) = known.get(next) {
                next += 1;
                let spread_m = spread_m + self.spacing_m;
                self.each_linked(&values, node, |other| {
                    if free[other].is_none() && spread_m <= SPREAD_M {
                        free[other] = free[node];
                        known.push((other, spread_m));
                    }
                });
            }
        }
        if free.contains(&Some(true)) {
            let outside = values.iter_mut().zip(&free).filter(|(_, free)| **free == Some(true));
            outside.for_each(|(value, _)| *value = -*value);
            self.set(&values);
        }
    }

    /// Calls `visit` with the neighbours of a node inside that are on the same side of the surface: the two
    /// are farther from it together than from each other.
    fn each_linked(&self, values: &[f32], node: usize, mut visit: impl FnMut(usize)) {
        let [nx, ny, _] = self.nodes;
        for (axis, stride) in [1, nx, nx * ny].into_iter().enumerate() {
            let along = node / stride % self.nodes[axis];
            let before = (along > 0).then(|| node - stride);
            let after = (along + 1 < self.nodes[axis]).then(|| node + stride);
            for other in [before, after].into_iter().flatten().filter(|&it| is_inside(values[it])) {
                if -f64::from(values[node] + values[other]) > SAME_SIDE * self.spacing_m {
                    visit(other);
                }
            }
        }
    }

    /// Index of the nearest point for each node, found by passing candidates on from node to node (a vector
    /// distance transform: Danielsson, Euclidean Distance Mapping, 1980); off by a fraction of the points'
    /// spacing at most.
    fn nearest_points(&self, points: &[Point3<f64>]) -> Vec<u32> {
        let [nx, ny, nz] = self.nodes;
        let mut nearest = vec![u32::MAX; nx * ny * nz];
        let mut squared = vec![f64::INFINITY; nearest.len()];
        let mut offer = |nearest: &mut Vec<u32>, node: usize, candidate: u32| {
            if candidate == u32::MAX || candidate == nearest[node] {
                return;
            }
            let distance = (points[candidate as usize] - self.node(node)).norm_squared();
            if distance < squared[node] {
                squared[node] = distance;
                nearest[node] = candidate;
            }
        };
        for (candidate, point) in points.iter().enumerate() {
            let cell = (point - self.lowest) / self.spacing_m;
            let [x, y, z] = std::array::from_fn(|axis| (cell[axis].max(0.0) as usize).min(self.nodes[axis] - 2));
            for corner in 0..8 {
                let node = ((z + (corner >> 2)) * ny + y + (corner >> 1 & 1)) * nx + x + (corner & 1);
                offer(&mut nearest, node, candidate as u32);
            }
        }
        let strides = [1, nx, nx * ny];
        let count = nearest.len();
        for _ in 0..2 {
            for node in 0..count {
                for stride in strides.into_iter().filter(|&stride| node >= stride) {
                    let candidate = nearest[node - stride];
                    offer(&mut nearest, node, candidate);
                }
            }
            for node in (0..count).rev() {
                for stride in strides.into_iter().filter(|&stride| node + stride < count) {
                    let candidate = nearest[node + stride];
                    offer(&mut nearest, node, candidate);
                }
            }
        }
        nearest
    }

    fn node(&self, index: usize) -> Point3<f64> {
        let [nx, ny, _] = self.nodes;
        let [x, y, z] = [index % nx, index / nx % ny, index / (nx * ny)].map(|i| i as f64 * self.spacing_m);
        self.lowest + Vector3::new(x, y, z)
    }

    /// Index of the lowest corner of the cell around a point, and where in the cell it lies; `None` outside.
    #[inline(always)]
    fn cell(&self, point: &Point3<f64>) -> Option<(usize, [f64; 3])> {
        let cell = (point - self.lowest) * self.per_m;
        let [nx, ny, nz] = self.nodes;
        let inside = |value: f64, nodes: usize| value >= 0.0 && value < nodes as f64 - 1.0;
        if self.values.is_empty() || !(inside(cell.x, nx) && inside(cell.y, ny) && inside(cell.z, nz)) {
            return None;
        }
        let [x, y, z] = [cell.x as usize, cell.y as usize, cell.z as usize];
        Some(((z * ny + y) * nx + x, [cell.x - x as f64, cell.y - y as f64, cell.z - z as f64]))
    }

    /// Value and gradient between the nodes; `None` outside.
    ///
    /// Axis by axis, values and gradients are blended linearly. Half of what the gradients at both ends
    /// disagree by is added to the value, ½·t·(1 − t)·(g₀ − g₁), which makes it exact for every quadratic
    /// function.
    #[inline]
    fn at(&self, point: &Point3<f64>) -> Option<(f64, Vector3<f64>)> {
        let (first, fraction) = self.cell(point)?;
        let [u, v, w] = fraction.map(|fraction| fraction as f32);
        let (row, layer) = (self.nodes[0], self.nodes[0] * self.nodes[1]);
        let nodes = &self.values[first..first + layer + row + 2];
        let [a, b] = [blend::<1>(&nodes[0], &nodes[1], u), blend::<1>(&nodes[row], &nodes[row + 1], u)];
        let nodes = &nodes[layer..];
        let [c, d] = [blend::<1>(&nodes[0], &nodes[1], u), blend::<1>(&nodes[row], &nodes[row + 1], u)];
        let [value, x, y, z] = blend::<3>(&blend::<2>(&a, &b, v), &blend::<2>(&c, &d, v), w);
        Some((f64::from(value), Vector3::new(f64::from(x), f64::from(y), f64::from(z)) * self.per_m))
    }

    /// Value and gradient outside: the distance from the box of the grid added to the value where the box is
    /// nearest.
    fn beyond(&self, point: &Point3<f64>) -> (f64, Vector3<f64>) {
        let high = Vector3::from_fn(|axis, _| (self.nodes[axis].max(2) as f64 - 1.0) * self.spacing_m * (1.0 - 1e-9));
        let nearest = point.sup(&self.lowest).inf(&(self.lowest + high));
        let away = point - nearest;
        let (value, _) = self.at(&nearest).unwrap_or((0.0, Vector3::zeros()));
        let distance = away.norm();
        (value + distance, if distance > 0.0 { away / distance } else { Vector3::zeros() })
    }
}

/// Interpolates between two nodes that are neighbours along the axis whose change is number `AXIS`.
#[inline(always)]
fn blend<const AXIS: usize>(a: &[f32; 4], b: &[f32; 4], t: f32) -> [f32; 4] {
    let mut between =
        [a[0] + t * (b[0] - a[0]), a[1] + t * (b[1] - a[1]), a[2] + t * (b[2] - a[2]), a[3] + t * (b[3] - a[3])];
    between[0] += 0.5 * t * (1.0 - t) * (a[AXIS] - b[AXIS]);
    between
}

/// Cosine of the angle by which normals within one neighbourhood differ at most where the surface is smooth:
/// 50°.
const SMOOTH_COSINE: f64 = 0.64;
/// Largest sine of the angle by which the line between two points on one smooth surface leaves the plane
/// across their normals.
const SMOOTH_SINE: f64 = 0.35;

impl OrientedPoints<'_> {
    /// Signed distance of `at` from the surface, given the index of the nearest point.
    ///
    /// Next to an edge it is that from two surfaces, of which each is smooth: in front of a convex edge the
    /// distance from the edge itself, else from the one that is further out; at a concave one the other way
    /// round.
    fn distance(&self, near: &PointGrid, at: &Point3<f64>, nearest: usize) -> f64 {
        let (point, normal) = (self.points[nearest], self.normals[nearest]);
        let apart = at - point;
        let far = apart.norm();
        let one = if far < BAND_M { self.side(near, at, nearest) } else { None };
        let Some((one_m, n_1)) = one else {
            // All points around decide together on which side it is.
            let mut side = apart.dot(&normal) * 1e-6;
            near.near(&point, self.reach_m(), |i| {
                let fraction = 1.0 - (self.points[i] - point).norm_squared() / self.reach_m().powi(2);
                side += (at - self.points[i]).dot(&self.normals[i]) * fraction.max(0.0).powi(2);
            });
            return far.copysign(side);
        };
        let mut other: Option<(usize, f64)> = None;
        near.near(&point, self.reach_m(), |i| {
            let squared = (self.points[i] - at).norm_squared();
            let in_reach = (self.points[i] - point).norm_squared() < self.reach_m().powi(2);
            if in_reach && !self.is_smooth(nearest, i) && other.is_none_or(|(_, least)| squared < least) {
                other = Some((i, squared));
            }
        });
        let Some((two_m, n_2, p_2)) =
            other.and_then(|(i, _)| self.side(near, at, i).map(|(distance, n)| (distance, n, self.points[i])))
        else {
            return one_m;
        };
        let cosine = n_1.dot(&n_2);
        if !(-0.7..SMOOTH_COSINE).contains(&cosine) {
            return one_m;
        }
        // Either lies behind the other's surface at a convex edge.
        let bend = (p_2 - point).dot(&(n_1 - n_2));
        let sign = if bend < 0.0 { 1.0 } else { -1.0 };
        let (a, b) = (sign * one_m, sign * two_m);
        let [from_a, from_b] = [a - cosine * b, b - cosine * a];
        let outer_m = if a.max(b) > 0.0 && from_a > 0.0 && from_b > 0.0 {
            // |x|² of x with x·n₁ = a and x·n₂ = b in the plane of both normals.
            ((a * from_a + b * from_b) / (1.0 - cosine * cosine)).sqrt()
        } else {
            a.max(b)
        };
        sign * outer_m
    }

    fn reach_m(&self) -> f64 {
        1.5 * self.smoothing_m
    }

    /// Returns whether two points lie on one smooth surface.
    pub fn is_smooth(&self, i: usize, j: usize) -> bool {
        let (n_i, n_j) = (self.normals[i], self.normals[j]);
        let way = self.points[j] - self.points[i];
        n_i.dot(&n_j) > SMOOTH_COSINE && (way.dot(&(n_i + n_j)) * 0.5).abs() <= SMOOTH_SINE * way.norm()
    }

    /// Signed distance from the smooth surface around a point of the cloud, and its normal there.
    ///
    /// Each neighbour i of the point with its normal nᵢ, and the mean normal n̄ there, speak for a sphere
    /// that touches the neighbour's tangent plane: its distance is (x − pᵢ)·(nᵢ + n̄) / (1 + nᵢ·n̄), exact on
    /// planes and spheres (the mean of tangent-plane distances alone, as in implicit moving least squares, is
    /// too small by the curvature).
    fn side(&self, near: &PointGrid, at: &Point3<f64>, around: usize) -> Option<(f64, Vector3<f64>)> {
        let (point, normal) = (self.points[around], self.normals[around]);
        let across = (at - point) - normal * (at - point).dot(&normal);
        // Where the surface ends at an edge, the foot must not leave it.
        let foot = point + across * (self.smoothing_m / across.norm()).min(1.0);
        let reach_m = self.reach_m();
        let weight = |i: usize| {
            let squared = (self.points[i] - foot).norm_squared() / (reach_m * reach_m);
            if squared < 1.0 && self.is_smooth(around, i) { (1.0 - squared).powi(2) } else { 0.0 }
        };
        let mut mean_normal = Vector3::zeros();
        near.near(&foot, reach_m, |i| mean_normal += self.normals[i] * weight(i));
        let mean_normal = mean_normal.try_normalize(1e-9)?;
        let (mut sum, mut weights) = (0.0, 0.0);
        near.near(&foot, reach_m, |i| {
            let weight = weight(i);
            sum += (at - self.points[i]).dot(&(self.normals[i] + mean_normal)) * weight;
            weights += (1.0 + self.normals[i].dot(&mean_normal)) * weight;
        });
        (weights > 1e-9).then(|| (sum / weights, mean_normal))
    }
}
