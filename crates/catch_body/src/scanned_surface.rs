//! The surface that a scanned cloud lies on: a normal for each point, and its place on the surface.

use nalgebra::{Matrix3, Matrix6, Point3, SymmetricEigen, Vector3, Vector6};

use crate::{distance_field::OrientedPoints, neighbours::PointGrid, pose::across, statistics::median_in_place};

/// Fewer points than this do not make a surface.
pub const MIN_NEIGHBOURS: usize = 12;

/// Surfaces that face each other, or away from each other, do so by this cosine at most.
const OPPOSITE_COSINE: f64 = -0.5;

/// Points of a neighbourhood, itself included, that share a normal at least.
const MIN_SHARING: usize = 5;
/// A point lies on a patch within so many of its root mean square errors.
const LIES_ON_SD: f64 = 3.0;
/// Another point's patch is better than one's own if its error is less than this fraction.
const BETTER: f64 = 0.5;
/// Errors of patches below this are nothing, in metres.
const LEAST_ERROR_M: f64 = 1e-5;

/// Viewing direction of a point of a scan.
#[derive(Debug, Clone, Copy)]
pub struct Seen {
    /// Direction to its camera.
    pub towards_camera: Vector3<f64>,
    /// Roughly where the surface faces there. It tells both sides of a thin wall apart.
    pub facing: Vector3<f64>,
}

/// Median distance from a point to its fourth nearest neighbour, divided by the square root of 4/π: the edge
/// of the square that a point of a random cloud has to itself.
pub fn typical_spacing(points: &[Point3<f64>]) -> f64 {
    let step = points.len().div_ceil(200).max(1);
    let mut fourth: Vec<f64> = points
        .iter()
        .step_by(step)
        .map(|from| {
            let mut squared: Vec<f64> = points.iter().map(|to| (to - from).norm_squared()).collect();
            let place = 4.min(squared.len() - 1);
            squared.select_nth_unstable_by(place, f64::total_cmp).1.sqrt()
        })
        .collect();
    median_in_place(&mut fourth) / (4.0 / std::f64::consts::PI).sqrt()
}

/// The surface around each point, through those neighbours that do not face the other way.
pub fn patches(points: &[Point3<f64>], seen: &[Seen], radius_m: f64) -> Vec<Patch> {
    let grid = PointGrid::new(points, radius_m);
    let mut neighbours = Vec::new();
    let through = |(point, own): (&Point3<f64>, &Seen)| {
        let mut radius_m = radius_m;
        for _ in 0..3 {
            neighbours.clear();
            grid.near(point, radius_m, |i| {
                let offset = points[i] - point;
                let is_opposite = seen[i].facing.dot(&own.facing) < OPPOSITE_COSINE;
                if offset.norm_squared() < radius_m * radius_m && !is_opposite {
                    neighbours.push(offset);
                }
            });
            if neighbours.len() >= MIN_NEIGHBOURS {
                break;
            }
            radius_m *= 1.5;
        }
        Patch::through(&neighbours, point, &own.towards_camera, radius_m)
    };
    points.iter().zip(seen).map(through).collect()
}

/// Gives each point the normal of the surface around it, and moves it onto that surface.
///
/// Near an edge no smooth surface runs through all neighbours. There a point takes the surface of the
/// neighbour whose own neighbours lie on one best, among those that it lies on itself.
pub fn oriented(
    points: &[Point3<f64>],
    seen: &[Seen],
    patches: &[Patch],
    radius_m: f64,
) -> (Vec<Point3<f64>>, Vec<Vector3<f64>>) {
    let grid = PointGrid::new(points, radius_m);
    let both = points.iter().zip(patches).zip(seen).map(|((point, own), seen)| {
        let mut best = (own, own.at(point));
        grid.near(point, radius_m, |i| {
            let (patch, (height, normal)) = (&patches[i], patches[i].at(point));
            let is_near = (points[i] - point).norm() < radius_m && normal.dot(&seen.towards_camera) > 0.0;
            let holds = height.abs() < LIES_ON_SD * patch.error_m && patch.error_m < BETTER * own.error_m;
            if is_near && holds && patch.error_m < best.0.error_m {
                best = (patch, (height, normal));
            }
        });
        let (height, normal) = best.1;
        (point - best.0.axis * height, normal)
    });
    let (points, normals): (Vec<_>, Vec<_>) = both.unzip();
    // A point whose normal hardly a neighbour shares lies on no surface.
    let grid = PointGrid::new(&points, radius_m);
    let cloud = OrientedPoints { points: &points, normals: &normals, smoothing_m: radius_m };
    let is_shared = |i: &usize| {
        let mut sharing = 0;
        grid.near(&points[*i], radius_m, |j| {
            sharing += usize::from((points[j] - points[*i]).norm() < radius_m && cloud.is_smooth(*i, j));
        });
        sharing >= MIN_SHARING
    };
    (0..points.len()).filter(is_shared).map(|i| (points[i], normals[i])).unzip()
}

/// The surface through a point's neighbours: the quadric z = c₀ + c₁x + c₂y + c₃x² + c₄xy + c₅y² over the
/// plane of their principal components, by least squares, whose normal does not suffer from lopsided
/// neighbourhoods (Cazals and Pouget, Estimating differential quantities using polynomial fitting of
/// osculating jets, 2005).
#[derive(Debug, Clone)]
pub struct Patch {
    origin: Point3<f64>,
    x_axis: Vector3<f64>,
    y_axis: Vector3<f64>,
    /// Normal of the plane, outwards.
    pub axis: Vector3<f64>,
    /// Coefficients for coordinates in units of the neighbourhood's radius; zero where the neighbours
    /// determine no quadric or one whose curvature is too large to be believed.
    c: Vector6<f64>,
    radius_m: f64,
    /// Root mean square distance of the neighbours.
    error_m: f64,
}

impl Patch {
    fn through(
        neighbours: &[Vector3<f64>],
        origin: &Point3<f64>,
        towards_camera: &Vector3<f64>,
        radius_m: f64,
    ) -> Self {
        let mean = neighbours.iter().sum::<Vector3<f64>>() / neighbours.len() as f64;
        let spread: Matrix3<f64> = neighbours.iter().map(|offset| (offset - mean) * (offset - mean).transpose()).sum();
        let eigen = SymmetricEigen::new(spread);
        let plane_normal = eigen.eigenvectors.column(eigen.eigenvalues.imin()).into_owned();
        let axis = if plane_normal.dot(towards_camera) < 0.0 { -plane_normal } else { plane_normal };
        let x_axis = across(&axis);
        let y_axis = axis.cross(&x_axis);
        let mut patch =
            Self { origin: *origin, x_axis, y_axis, axis, c: Vector6::zeros(), radius_m, error_m: radius_m };
        let Some(c) = patch.quadric(neighbours) else { return patch };
        let slope = libm::hypot(c[1], c[2]);
        if slope < 0.5 && c[0].abs() < 0.2 {
            patch.c = c;
            let squares: f64 = neighbours.iter().map(|offset| patch.at(&(origin + offset)).0.powi(2)).sum();
            patch.error_m = (squares / neighbours.len() as f64).sqrt() + LEAST_ERROR_M;
        }
        patch
    }

    /// The least squares; `None` where the neighbours do not determine a quadric.
    fn quadric(&self, neighbours: &[Vector3<f64>]) -> Option<Vector6<f64>> {
        if neighbours.len() < MIN_NEIGHBOURS {
            return None;
        }
        let mut information = Matrix6::zeros();
        let mut right = Vector6::zeros();
        for offset in neighbours {
            let (row, z) = self.row(offset);
            let weight = (1.0 - offset.norm_squared() / (self.radius_m * self.radius_m)).max(0.0);
            information += row * row.transpose() * weight;
            right += row * (z * weight);
        }
        Some(information.cholesky()?.solve(&right))
    }

    /// Row of the linear problem at an offset from the origin: the factors of the coefficients, and z there.
    fn row(&self, offset: &Vector3<f64>) -> (Vector6<f64>, f64) {
        let [x, y, z] = [self.x_axis, self.y_axis, self.axis].map(|along| offset.dot(&along) / self.radius_m);
        (Vector6::new(1.0, x, y, x * x, x * y, y * y), z)
    }

    /// Height of a point over the surface along the axis, in metres, and the surface's normal below it.
    pub fn at(&self, point: &Point3<f64>) -> (f64, Vector3<f64>) {
        let (row, z) = self.row(&(point - self.origin));
        let (x, y, c) = (row[1], row[2], &self.c);
        let slopes = [c[1] + 2.0 * c[3] * x + c[4] * y, c[2] + c[4] * x + 2.0 * c[5] * y];
        let normal = self.axis - self.x_axis * slopes[0] - self.y_axis * slopes[1];
        ((z - row.dot(c)) * self.radius_m, normal.normalize())
    }
}
