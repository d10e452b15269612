//! The object as the brain knows it, made once from a scan.

use catch_body::{
    Pose,
    distance_field::{DistanceField, OrientedPoints},
    neighbours::first_in_cubes,
    scanned_surface::{MIN_NEIGHBOURS, Seen, oriented, patches, typical_spacing},
};
use catch_cell::{CameraModel, DepthFrame, ReferenceScan};
use nalgebra::{Point3, Translation3, UnitQuaternion, Vector3};

use super::Symmetry;

/// Error of the model itself, in metres: a point is off by this even without noise.
pub const MODEL_SD_M: f64 = 0.0002;
/// Points of a scan closer than this to each other are thinned, in metres: nearly all points of a scan with
/// 200×150 pixels per camera are kept, and the work for denser ones is bounded.
const REFERENCE_SPACING_M: f64 = 0.0015;
/// Spacing of the points that are kept for choosing grasps, in metres: the voxels of the original.
const GRASP_SPACING_M: f64 = 0.0025;
/// Nodes of the signed distance field next to the surface, in metres.
pub(super) const DISTANCE_GRID_M: f64 = 0.0025;
/// Root mean square distance up to which a turned object counts as looking the same. Measured for turns by
/// any angle: ≤ 0.3 mm on symmetric objects, ≥ 8 mm on others.
const SYMMETRY_TOLERANCE_M: f64 = 0.0008;
/// Tolerance of single rotations, such as the quarter turns of a brick, as a fraction of the largest ball
/// that fits into the object, where that is more: smaller differences are confused from one image to the
/// next. Half of it counts for rotations by any angle, so that a can with beads is round and a hexagonal
/// prism is not.
const CONFUSED_FRACTION: f64 = 0.08;

/// The object as the brain knows it: its surface, its centre of mass and what it looks the same under.
///
/// All of it follows from the scan, under the assumption that the object is equally dense throughout.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct ReferenceModel {
    /// Points of the surface in O, metres, thinned.
    pub points: Vec<Point3<f64>>,
    /// Outward unit normals, one per point. At an edge they point away from it, between those of both sides:
    /// a gripper may come from there too.
    pub normals: Vec<Vector3<f64>>,
    /// All points of the scan as they were seen, in O.
    pub scanned: Vec<Point3<f64>>,
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
}

impl ReferenceModel {
    /// Builds the model from a scan.
    pub fn from_scan(scan: &ReferenceScan) -> Self {
        let (all, seen) = scanned_points(scan);
        let (points, seen) = thinned(&all, &seen, REFERENCE_SPACING_M);
        let mut model = Self::with_free_space(&points, &seen, &|p_R, clearance_m| is_free(scan, p_R, clearance_m));
        model.scanned = all.into_iter().map(|p_R| model.X_RO.inverse_transform_point(&p_R)).collect();
        model
    }

    /// Builds the model from surface points in R and, for each, a direction in which it could be seen.
    pub fn from_points(points: &[Point3<f64>], towards_camera: &[Vector3<f64>]) -> Self {
        let seen: Vec<Seen> = towards_camera.iter().map(|&it| Seen { towards_camera: it, facing: it }).collect();
        Self::with_free_space(points, &seen, &|_, _| None)
    }

    /// Builds the model as [`from_points`](Self::from_points) does; `is_free` decides whether a position in
    /// R, so far from any surface, is outside.
    fn with_free_space(
        points: &[Point3<f64>],
        seen: &[Seen],
        is_free: &dyn Fn(&Point3<f64>, f64) -> Option<bool>,
    ) -> Self {
        if points.len() < MIN_NEIGHBOURS {
            return Self::default();
        }
        let spacing_m = typical_spacing(points);
        let patches = patches(points, seen, 2.5 * spacing_m);
        let (sharp, normals) = oriented(points, seen, &patches, 2.5 * spacing_m);
        if sharp.len() < MIN_NEIGHBOURS {
            return Self::default();
        }
        let cloud = OrientedPoints { points: &sharp, normals: &normals, smoothing_m: 1.5 * spacing_m };
        let mut distance = DistanceField::new(&cloud, DISTANCE_GRID_M);
        distance.clear(is_free);

        let (volume_m3, centre, second_moment) = distance.moments();
        let to_O = -centre.coords;
        distance.translate(&to_O);
        let sharp_O: Vec<Point3<f64>> = sharp.iter().map(|point| point + to_O).collect();
        let smooth = points.iter().zip(&patches).map(|(point, patch)| {
            let (height, normal) = patch.at(point);
            (point - patch.axis * height + to_O, normal)
        });
        let (points_O, normals): (Vec<_>, Vec<_>) = smooth.unzip();
        let (points, normals) = bounded(&points_O, &normals, GRASP_SPACING_M);
        let radius_m = sharp_O.iter().map(|point| point.coords.norm()).fold(0.0, f64::max);
        let inner_radius_m = distance.deepest_m().max(1e-4);
        let confused_m = SYMMETRY_TOLERANCE_M.max(CONFUSED_FRACTION * inner_radius_m);
        let symmetry = Symmetry::find(&points, &distance, &second_moment, SYMMETRY_TOLERANCE_M, confused_m);
        let X_RO = Pose::from_parts(Translation3::from(centre.coords), UnitQuaternion::identity());
        let scanned = Vec::new();
        Self { points, normals, scanned, X_RO, radius_m, inner_radius_m, volume_m3, symmetry, distance }
    }
}

/// Every masked pixel as a point in R, and how it was seen.
fn scanned_points(scan: &ReferenceScan) -> (Vec<Point3<f64>>, Vec<Seen>) {
    let (mut points, mut seen) = (Vec::new(), Vec::new());
    for frame in &scan.frames {
        let Some(camera) = scan.cameras.get(frame.camera) else { continue };
        for (i, depth_m) in object_pixels(frame) {
            let p_R = camera.X_WC * camera.back_project(&frame.window.pixel_centre(i), depth_m);
            let towards_camera = (Point3::from(camera.X_WC.translation.vector) - p_R).normalize();
            let facing = facing_C(camera, frame, i).map_or(towards_camera, |it| camera.X_WC.rotation * it);
            points.push(p_R);
            seen.push(Seen { towards_camera, facing });
        }
    }
    (points, seen)
}

/// Normal in C of the surface that a pixel and its neighbours show, of which in either direction the nearer
/// in depth counts; `None` where there are none.
fn facing_C(camera: &CameraModel, frame: &DepthFrame, pixel: usize) -> Option<Vector3<f64>> {
    let width = frame.window.width as usize;
    let is_object = |i: usize| frame.mask.as_ref().is_none_or(|mask| mask.get(i) == Some(&true));
    let depth_m = |i: usize| frame.depth_m.get(i).map(|it| f64::from(*it)).filter(|it| *it > 0.0 && is_object(i));
    let point = |i: usize, depth_m: f64| camera.back_project(&frame.window.pixel_centre(i), depth_m);
    let own_m = depth_m(pixel)?;
    let along = |before: Option<usize>, after: Option<usize>| {
        let jump = |i: Option<usize>| i.and_then(|i| Some((i, depth_m(i)?)));
        let ahead = jump(after).map(|it| (it, 1.0));
        let behind = jump(before).map(|it| (it, -1.0));
        let nearer = [ahead, behind].into_iter().flatten();
        let nearest = nearer.min_by(|a, b| (a.0.1 - own_m).abs().total_cmp(&(b.0.1 - own_m).abs()));
        nearest.map(|((i, other_m), sign)| (point(i, other_m) - point(pixel, own_m)) * sign)
    };
    let column = pixel % width;
    let across = along((column > 0).then(|| pixel - 1), (column + 1 < width).then_some(pixel + 1))?;
    let down = along(pixel.checked_sub(width), Some(pixel + width))?;
    // x to the right, y down and z ahead: the normal that looks at the camera.
    down.cross(&across).try_normalize(1e-12)
}

/// Returns whether some image of a scan shows that a position in R, which is `clearance_m` from any surface,
/// is outside of the object: the ray of the nearest pixel passes it and meets the surface behind it, or none.
/// `None` where pixels are too coarse to tell.
fn is_free(scan: &ReferenceScan, p_R: &Point3<f64>, clearance_m: f64) -> Option<bool> {
    let shown = scan.frames.iter().filter_map(|frame| {
        let camera = scan.cameras.get(frame.camera)?;
        let p_C = camera.X_WC.inverse_transform_point(p_R);
        // The ray of the nearest pixel is at most half a pixel's diagonal away.
        let is_near = clearance_m > PIXEL_REACH * p_C.z / camera.focal_px;
        let uv = camera.project(&p_C).filter(|_| is_near)?;
        let window = &frame.window;
        let (column, row) = (uv.x - f64::from(window.left), uv.y - f64::from(window.top));
        if !(0.0..f64::from(window.width)).contains(&column) || !(0.0..f64::from(window.height)).contains(&row) {
            return None;
        }
        let pixel = row as usize * window.width as usize + column as usize;
        let is_background = frame.mask.as_ref().is_some_and(|mask| mask.get(pixel) == Some(&false));
        Some(is_background || frame.depth_m.get(pixel).is_some_and(|depth| f64::from(*depth) > p_C.z))
    });
    shown.reduce(|one, other| one || other)
}

/// Half the diagonal of a pixel, and some more for the noise of a scan.
const PIXEL_REACH: f64 = 0.8;

/// Index and depth of the pixels with a measured depth that are the object's; without a mask all that are
/// measured.
fn object_pixels(frame: &DepthFrame) -> impl Iterator<Item = (usize, f64)> {
    let masked = |i: usize| frame.mask.as_ref().is_none_or(|mask| mask.get(i).copied().unwrap_or(false));
    let depths = frame.depth_m.iter().take(frame.window.area()).enumerate();
    depths
        .filter(move |&(i, depth)| *depth > 0.0 && depth.is_finite() && masked(i))
        .map(|(i, depth)| (i, f64::from(*depth)))
}

/// Points as [`thinned`] keeps them, about [`MOST_POINTS`] at most: they are wider apart on a large object,
/// whose grasps, compared with each of them, would else cost the fourth power of its size.
fn bounded<T: Copy>(points: &[Point3<f64>], attributes: &[T], spacing_m: f64) -> (Vec<Point3<f64>>, Vec<T>) {
    let all = thinned(points, attributes, spacing_m);
    let over = all.0.len() as f64 / MOST_POINTS as f64;
    if over > 1.0 { thinned(points, attributes, spacing_m * over.sqrt()) } else { all }
}

/// Points of the surface that grasps are compared with: those of a ball of 0.1 m at 2.5 mm.
const MOST_POINTS: usize = 8192;

/// One point, with what belongs to it, per cube of edge `spacing_m`: the first in the order given.
fn thinned<T: Copy>(points: &[Point3<f64>], attributes: &[T], spacing_m: f64) -> (Vec<Point3<f64>>, Vec<T>) {
    first_in_cubes(points, spacing_m).map(|i| (points[i], attributes[i])).unzip()
}
