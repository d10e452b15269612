//! The object as the brain knows it, made once from a scan.

use catch_body::Pose;
use catch_cell::{DepthFrame, ReferenceScan};
use nalgebra::{Matrix3, Matrix6, Point3, SymmetricEigen, Translation3, UnitQuaternion, Vector3, Vector6};

use super::{
    Config,
    distance_field::{DistanceField, OrientedPoints},
    icp::NearestPoints,
    neighbours::PointGrid,
    symmetry::Symmetry,
};

/// The object as the brain knows it: its surface, its centre of mass and what it looks the same under.
///
/// All of it follows from the scan, under the assumption that the object is equally dense throughout.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct ReferenceModel {
    /// Points of the surface in O, metres, thinned.
    pub points: Vec<Point3<f64>>,
    /// Outward unit normals, one per point.
    pub normals: Vec<Vector3<f64>>,
    /// Pose of O in the frame R of the scan: moved to the centre of mass, not turned.
    pub X_RO: Pose,
    /// Radius of a sphere around the origin of O that holds the object.
    pub radius_m: f64,
    /// Radius of the largest ball that fits into the object.
    pub inner_radius_m: f64,
    /// Volume in m³.
    pub volume_m3: f64,
    /// Turns under which the object looks the same, and how it tumbles.
    pub symmetry: Symmetry,
    /// Signed distance from the surface, in O.
    pub distance: DistanceField,
    /// The points, to be searched for the nearest.
    pub(super) nearest: NearestPoints,
}

impl ReferenceModel {
    /// Builds the model from a scan.
    pub fn from_scan(scan: &ReferenceScan, config: &Config) -> Self {
        let (points, towards_camera) = scanned_points(scan);
        let (points, towards_camera) = thinned(&points, &towards_camera, config.reference_spacing_m);
        Self::from_points(&points, &towards_camera, config)
    }

    /// Builds the model from surface points in R and, for each, a direction in which it could be seen.
    pub fn from_points(points: &[Point3<f64>], towards_camera: &[Vector3<f64>], config: &Config) -> Self {
        if points.len() < MIN_NEIGHBOURS {
            return Self::default();
        }
        let spacing_m = typical_spacing(points);
        let (points, normals) = oriented(points, towards_camera, 2.5 * spacing_m);
        let cloud = OrientedPoints { points: &points, normals: &normals, smoothing_m: 1.5 * spacing_m };
        let mut distance = DistanceField::new(&cloud, config.distance_grid_m);

        let (volume_m3, centre, second_moment) = moments(&distance);
        let to_O = -centre.coords;
        distance.translate(&to_O);
        let points_O: Vec<Point3<f64>> = points.iter().map(|point| point + to_O).collect();
        let (points, normals) = thinned(&points_O, &normals, config.grasp_spacing_m);
        let radius_m = points_O.iter().map(|point| point.coords.norm()).fold(0.0, f64::max);
        let symmetry = Symmetry::find(&points, &distance, &second_moment, config.symmetry_tolerance_m);
        let X_RO = Pose::from_parts(Translation3::from(centre.coords), UnitQuaternion::identity());
        let nearest = NearestPoints::new(&points);
        let inner_radius_m = distance.deepest_m().max(1e-4);
        Self { points, normals, X_RO, radius_m, inner_radius_m, volume_m3, symmetry, distance, nearest }
    }
}

/// Fewer points than this do not make a surface.
const MIN_NEIGHBOURS: usize = 12;

/// Every masked pixel as a point in R, and the direction from it to its camera.
fn scanned_points(scan: &ReferenceScan) -> (Vec<Point3<f64>>, Vec<Vector3<f64>>) {
    let mut points = Vec::new();
    let mut towards_camera = Vec::new();
    for frame in &scan.frames {
        let Some(camera) = scan.cameras.get(frame.camera) else { continue };
        for (i, depth_m) in object_pixels(frame) {
            let p_R = camera.X_WC * camera.back_project(&frame.window.pixel_centre(i), depth_m);
            points.push(p_R);
            towards_camera.push((Point3::from(camera.X_WC.translation.vector) - p_R).normalize());
        }
    }
    (points, towards_camera)
}

/// Index and depth of the pixels with a measured depth that are the object's; without a mask all that are measured.
fn object_pixels(frame: &DepthFrame) -> impl Iterator<Item = (usize, f64)> {
    let masked = |i: usize| frame.mask.as_ref().is_none_or(|mask| mask.get(i).copied().unwrap_or(false));
    let depths = frame.depth_m.iter().take(frame.window.area()).enumerate();
    depths
        .filter(move |&(i, depth)| *depth > 0.0 && depth.is_finite() && masked(i))
        .map(|(i, depth)| (i, f64::from(*depth)))
}

/// One point, with what belongs to it, per cube of edge `spacing_m`: the first in the order given.
fn thinned(
    points: &[Point3<f64>],
    attributes: &[Vector3<f64>],
    spacing_m: f64,
) -> (Vec<Point3<f64>>, Vec<Vector3<f64>>) {
    let cell = |point: &Point3<f64>| point.coords.map(|value| (value / spacing_m).floor() as i64);
    let mut order: Vec<usize> = (0..points.len()).collect();
    order.sort_by_cached_key(|&i| (<[i64; 3]>::from(cell(&points[i])), i));
    order.dedup_by_key(|i| cell(&points[*i]));
    order.sort_unstable();
    order.into_iter().map(|i| (points[i], attributes[i])).unzip()
}

/// Median distance from a point to its fourth nearest neighbour, divided by the square root of 4/π: the edge of the square
/// that a point of a random cloud has to itself.
fn typical_spacing(points: &[Point3<f64>]) -> f64 {
    let step = points.len().div_ceil(200);
    let mut fourth: Vec<f64> = points
        .iter()
        .step_by(step)
        .map(|from| {
            let mut squared: Vec<f64> = points.iter().map(|to| (to - from).norm_squared()).collect();
            let place = 4.min(squared.len() - 1);
            squared.select_nth_unstable_by(place, f64::total_cmp).1.sqrt()
        })
        .collect();
    let middle = fourth.len() / 2;
    *fourth.select_nth_unstable_by(middle, f64::total_cmp).1 / (4.0 / std::f64::consts::PI).sqrt()
}

/// Gives each point the normal of the surface through its neighbours, and moves it onto that surface.
///
/// The plane of the principal components of the neighbours first; then, in that plane's axes, the quadric
/// z = c₀ + c₁x + c₂y + c₃x² + c₄xy + c₅y² by least squares, whose normal at the origin does not suffer from lopsided
/// neighbourhoods (Cazals and Pouget, Estimating differential quantities using polynomial fitting of osculating jets, 2005).
fn oriented(
    points: &[Point3<f64>],
    towards_camera: &[Vector3<f64>],
    radius_m: f64,
) -> (Vec<Point3<f64>>, Vec<Vector3<f64>>) {
    let grid = PointGrid::new(points, radius_m);
    let mut neighbours = Vec::new();
    let both = points.iter().zip(towards_camera).map(|(point, towards_camera)| {
        let mut radius_m = radius_m;
        for _ in 0..3 {
            neighbours.clear();
            grid.near(point, radius_m, |i| {
                let offset = points[i] - point;
                if offset.norm_squared() < radius_m * radius_m {
                    neighbours.push(offset);
                }
            });
            if neighbours.len() >= MIN_NEIGHBOURS {
                break;
            }
            radius_m *= 1.5;
        }
        let mean = neighbours.iter().sum::<Vector3<f64>>() / neighbours.len() as f64;
        let spread: Matrix3<f64> = neighbours.iter().map(|offset| (offset - mean) * (offset - mean).transpose()).sum();
        let eigen = SymmetricEigen::new(spread);
        let plane_normal = eigen.eigenvectors.column(eigen.eigenvalues.imin()).into_owned();
        let facing = if plane_normal.dot(towards_camera) < 0.0 { -plane_normal } else { plane_normal };
        let Some((height, normal)) = quadric(&neighbours, &facing, radius_m) else { return (*point, facing) };
        (point + facing * height, normal)
    });
    both.unzip()
}

/// Height over the origin and normal there of the quadric through `neighbours`; `None` where they do not determine one or
/// where it bends too much to be believed.
fn quadric(neighbours: &[Vector3<f64>], axis: &Vector3<f64>, radius_m: f64) -> Option<(f64, Vector3<f64>)> {
    if neighbours.len() < MIN_NEIGHBOURS {
        return None;
    }
    let across = if axis.x.abs() < 0.7 { Vector3::x() } else { Vector3::y() };
    let x_axis = axis.cross(&across).normalize();
    let y_axis = axis.cross(&x_axis);
    let mut information = Matrix6::zeros();
    let mut right = Vector6::zeros();
    for offset in neighbours {
        let [x, y, z] = [x_axis, y_axis, *axis].map(|along| offset.dot(&along) / radius_m);
        let weight = (1.0 - offset.norm_squared() / (radius_m * radius_m)).max(0.0);
        let row = Vector6::new(1.0, x, y, x * x, x * y, y * y);
        information += row * row.transpose() * weight;
        right += row * (z * weight);
    }
    let c = information.cholesky()?.solve(&right);
    let slope = c[1].hypot(c[2]);
    (slope < 0.5 && c[0].abs() < 0.2).then(|| (c[0] * radius_m, (axis - x_axis * c[1] - y_axis * c[2]).normalize()))
}

/// Volume, centre and second moment of the inside per volume, ∫ x·xᵀ dV / V about the centre.
fn moments(distance: &DistanceField) -> (f64, Point3<f64>, Matrix3<f64>) {
    let (cells, cell_m3) = distance.inside();
    let (mut share, mut first, mut second) = (0.0, Vector3::zeros(), Matrix3::zeros());
    for (point, weight) in cells {
        share += weight;
        first += point.coords * weight;
        second += point.coords * point.coords.transpose() * weight;
    }
    if share <= 0.0 {
        return (0.0, Point3::origin(), Matrix3::zeros());
    }
    let centre = first / share;
    (share * cell_m3, Point3::from(centre), second / share - centre * centre.transpose())
}
