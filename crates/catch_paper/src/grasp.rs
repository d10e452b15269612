//! Grasp selection as in the paper (III-C): gripper poses from Darboux frames at random points of the
//! reference cloud, filtered by thresholds on the three heuristics, the cheapest taken.

use std::collections::BTreeMap;

use catch_body::{Gripper, Pose};
use catch_bot::{
    grasp_selection::{
        Grasp,
        darboux::darboux_frame,
        fit::{held_box, overhang_m},
    },
    perception::ReferenceModel,
    trajectory_prediction::FlightTrajectory,
};
use nalgebra::{Matrix3, Point3, Rotation3, SymmetricEigen, Translation3, UnitQuaternion, Vector3};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;
use serde::{Deserialize, Serialize};

/// Settings of the paper's grasp selection.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Config {
    /// True if surface and normals are estimated from all points of the scan (code): their means in cubes of
    /// 2.5 mm, and the direction in which 30 neighbours extend least. Half of these normals point inwards,
    /// and no grasp comes from there. Else those of our own reference are taken.
    pub estimates_normals: bool,
}

// The figures of the authors' code.

/// Points that are drawn.
const SAMPLES: usize = 2000;
/// Neighbourhood of a Darboux frame, in metres. On a cloud of 2.5 mm spacing it holds few points, so that the
/// principal directions are those of noise; that, too, is the paper's method.
const DARBOUX_RADIUS_M: f64 = 0.002;
/// The gripper's origin is this far from the surface, in metres.
const STANDOFF_M: f64 = 0.05;
/// Distance of the gripper's origin from the surface of the banana, in metres. The code recognizes the banana
/// by its name; here an object longer than [`LONG_RADIUS_M`] counts as one.
const LONG_STANDOFF_M: f64 = 0.04;
/// Distance of the farthest point from the centre of mass, in metres, beyond which an object counts as long.
const LONG_RADIUS_M: f64 = 0.06;
/// "Strength": the centroid's largest distance from the gripper's y axis, in metres.
const MAX_STRENGTH_M: f64 = 0.03;
/// Largest 1 − "comfort".
const MAX_DISCOMFORT: f64 = 0.4;
/// Largest 1 − "catchability".
const MAX_MISALIGNMENT: f64 = 0.1;
/// Weight of "strength" in the cost, per metre. The text says that "catchability" weighs most, but the code
/// has this weight and 1 for both others; the code is followed.
const STRENGTH_WEIGHT: f64 = 10.0;
/// The part of the gap that must not be empty when the fingers close: halves along x and z, and its ends
/// along y, in metres (code).
const CLOSING_REGION_M: [f64; 4] = [0.05, 0.00625, 0.05, 0.1125];

/// The best grasp among the samples for an object that is caught at `catch_s`, `None` if none passes all
/// thresholds.
pub fn select(
    reference: &ReferenceModel,
    (gripper, base): (&Gripper, &Point3<f64>),
    (flight, catch_s): (&FlightTrajectory, f64),
    seed: u64,
    config: &Config,
) -> Option<Grasp> {
    let estimated = config.estimates_normals.then(|| estimated_surface(reference));
    let (points, normals) = estimated.as_ref().map_or((&reference.points, &reference.normals), |(p, n)| (p, n));
    if points.is_empty() {
        return None;
    }
    let X_WO = flight.pose_at(catch_s);
    let direction_W = flight.twist_at(catch_s).linear.try_normalize(1e-6)?;
    let centroid = Point3::from(points.iter().map(|point| point.coords).sum::<Vector3<f64>>() / points.len() as f64);
    let is_long = reference.radius_m > LONG_RADIUS_M;
    let standoff_m = if is_long { LONG_STANDOFF_M } else { STANDOFF_M };

    let mut rng = Pcg64::seed_from_u64(seed);
    let mut best: Option<(f64, Pose, f64)> = None;
    for _ in 0..SAMPLES {
        let index = rng.random_range(0..points.len());
        let frame = darboux_frame(points, normals, index, DARBOUX_RADIUS_M);
        // The gripper looks along the inward normal (y) and closes in the direction of most curvature (x);
        // the object passes along that of least curvature (z).
        let (x, y) = (frame.principal[1], -frame.normal);
        let R_OG = Rotation3::from_basis_unchecked(&[x, y, x.cross(&y)]);
        let origin = frame.point.coords + frame.normal * standoff_m;
        let X_OG = Pose::from_parts(Translation3::from(origin), UnitQuaternion::from_rotation_matrix(&R_OG));

        let X_WG = X_WO * X_OG;
        let strength_m = (centroid - frame.point).cross(&y).norm();
        let discomfort = 1.0 - comfort(&X_WG, base);
        let misalignment = 1.0 - direction_W.dot(&(X_WG * Vector3::z())).abs();
        if strength_m > MAX_STRENGTH_M || discomfort > MAX_DISCOMFORT || misalignment > MAX_MISALIGNMENT {
            continue;
        }
        let cost = STRENGTH_WEIGHT * strength_m + discomfort + misalignment;
        if best.as_ref().is_none_or(|(least, ..)| cost < *least) && fits(points, gripper, &X_OG) {
            best = Some((cost, X_OG, strength_m));
        }
    }
    let (_, X_OG, strength_m) = best?;
    // It opens as far as it can.
    let object_width_m = width_m(points, gripper, &X_OG);
    let X_GO = X_OG.inverse();
    let (overhang_m, held_G) = (overhang_m(&X_GO, gripper), held_box(points, &X_GO));
    Some(Grasp { X_OG, object_width_m, aperture_m: gripper.max_width_m, strength_m, overhang_m, held_G })
}

/// The means of what is in cubes of the scan's frame with this edge make the surface, in metres (code).
const CUBE_M: f64 = 0.0025;
/// Neighbours of which a normal is estimated, and how far away they may be, in metres (code).
const NEIGHBOURS: (usize, f64) = (30, 0.05);

/// Points and normals as the code estimates them; a normal's sign is what the eigenvector happens to have.
fn estimated_surface(reference: &ReferenceModel) -> (Vec<Point3<f64>>, Vec<Vector3<f64>>) {
    let mut cubes = BTreeMap::new();
    for point in &reference.scanned {
        let p_R = reference.X_RO * point;
        let cube: [i64; 3] = (p_R.coords / CUBE_M).map(|it| it.floor() as i64).into();
        let (sum, count) = cubes.entry(cube).or_insert((Vector3::zeros(), 0.0));
        *sum += point.coords;
        *count += 1.0;
    }
    let points: Vec<Point3<f64>> = cubes.into_values().map(|(sum, count)| Point3::from(sum / count)).collect();
    let normal = |point: &Point3<f64>| {
        let squared = |other: &&Point3<f64>| (*other - point).norm_squared();
        let mut near: Vec<&Point3<f64>> =
            points.iter().filter(|other| squared(other) <= NEIGHBOURS.1 * NEIGHBOURS.1).collect();
        if near.len() > NEIGHBOURS.0 {
            near.select_nth_unstable_by(NEIGHBOURS.0, |a, b| squared(a).total_cmp(&squared(b)));
            near.truncate(NEIGHBOURS.0);
        }
        let mean = near.iter().map(|it| it.coords).sum::<Vector3<f64>>() / near.len() as f64;
        let spread: Matrix3<f64> = near.iter().map(|it| (it.coords - mean) * (it.coords - mean).transpose()).sum();
        let eigen = SymmetricEigen::new(spread);
        eigen.eigenvectors.column(eigen.eigenvalues.imin()).into_owned()
    };
    let normals = points.iter().map(normal).collect();
    (points, normals)
}

/// "Comfort": whether the gripper points away from the axis of the base. The text does not normalize the
/// vector to the gripper; the code's threshold only makes sense if it is.
fn comfort(X_WG: &Pose, base: &Point3<f64>) -> f64 {
    let outward = X_WG.translation.vector - base.coords;
    let outward = Vector3::new(outward.x, outward.y, 0.0).try_normalize(1e-6);
    outward.map_or(0.0, |outward| (X_WG * Vector3::y()).dot(&outward))
}

/// Returns whether the open gripper is clear of the object and something is between its fingers (code).
fn fits(points: &[Point3<f64>], gripper: &Gripper, X_OG: &Pose) -> bool {
    let [left, right] = gripper.fingers(gripper.max_width_m);
    let boxes = [left, right, gripper.body()];
    let [half_x, half_z, from_y, until_y] = CLOSING_REGION_M;
    let X_GO = X_OG.inverse();
    let mut is_empty = true;
    for p in points.iter().map(|point| X_GO * point) {
        if boxes.iter().any(|it| ((p - it.centre).abs() - it.size / 2.0).max() < 0.0) {
            return false;
        }
        is_empty &= !(p.x.abs() <= half_x && p.z.abs() <= half_z && (from_y..=until_y).contains(&p.y));
    }
    !is_empty
}

/// The width of what is between the fingers; the fingers stop at its outermost points.
fn width_m(points: &[Point3<f64>], gripper: &Gripper, X_OG: &Pose) -> f64 {
    let X_GO = X_OG.inverse();
    let half_gap = gripper.finger_size_m[2] / 2.0;
    let between = points.iter().map(|point| X_GO * point).filter(|p| p.z.abs() < half_gap);
    let (low, high) = between
        .filter(|p| (gripper.palm_y_m()..gripper.fingertip_y_m()).contains(&p.y))
        .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), p| (low.min(p.x), high.max(p.x)));
    (high - low).clamp(0.0, gripper.max_width_m)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Evenly spread directions.
    fn directions(count: u32) -> impl Iterator<Item = Vector3<f64>> {
        let golden = std::f64::consts::PI * (3.0 - 5.0_f64.sqrt());
        (0..count).map(move |i| {
            let z = 1.0 - (2.0 * f64::from(i) + 1.0) / f64::from(count);
            let (sin, cos) = libm::sincos(golden * f64::from(i));
            Vector3::new(cos * (1.0 - z * z).sqrt(), sin * (1.0 - z * z).sqrt(), z)
        })
    }

    /// A ball whose scan has points 0.5 mm apart.
    #[test]
    fn estimated_normals_are_those_of_the_surface_whatever_their_sign() {
        let scanned = directions(60_000).map(|it| Point3::from(it * 0.034)).collect();
        let (points, normals) = estimated_surface(&ReferenceModel { scanned, ..ReferenceModel::default() });
        // A cube's mean is up to 0.1 mm below the surface; its edge tells how many there are.
        assert!((3000..5000).contains(&points.len()), "{}", points.len());
        let (mut outward, mut worst) = (0, 1.0_f64);
        for (point, normal) in points.iter().zip(&normals) {
            assert!((point.coords.norm() - 0.034).abs() < 2e-4);
            let cosine = normal.dot(&point.coords.normalize());
            outward += usize::from(cosine > 0.0);
            worst = worst.min(cosine.abs());
        }
        assert!(worst > 0.98, "{worst}");
        assert!((points.len() / 4..points.len() * 3 / 4).contains(&outward), "{outward}");
    }

    /// A ball of 34 mm that flies past along −y.
    #[test]
    fn a_ball_is_held_across_its_way() {
        let mut reference = ReferenceModel::default();
        for normal in directions(2000) {
            reference.points.push(Point3::from(normal * 0.034));
            reference.normals.push(normal);
        }
        let flight = FlightTrajectory {
            time_s: 0.6,
            p_WOcm: Point3::new(0.6, 0.1, 0.5),
            v_WOcm: Vector3::new(0.0, -4.0, -1.0),
            ..FlightTrajectory::default()
        };
        let toml = include_str!("../../../assets/grippers/wsg50.toml");
        let gripper = Gripper::from_toml("wsg50.toml", toml).unwrap();
        let config = Config::default();
        let grasp = select(&reference, (&gripper, &Point3::origin()), (&flight, 0.6), 7, &config).unwrap();
        let X_WG = flight.pose_at(0.6) * grasp.X_OG;
        assert!((X_WG * Vector3::z()).dot(&flight.v_WOcm.normalize()).abs() > 0.9);
        assert!(comfort(&X_WG, &Point3::origin()) > 0.6);
        assert!((grasp.X_OG.translation.vector.norm() - 0.084).abs() < 1e-3);
        assert!((grasp.object_width_m - 0.067).abs() < 3e-3, "{}", grasp.object_width_m);
        // The same seed draws the same grasp.
        assert_eq!(select(&reference, (&gripper, &Point3::origin()), (&flight, 0.6), 7, &config), Some(grasp));
    }
}
