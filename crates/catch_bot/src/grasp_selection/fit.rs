//! Fitting the gripper to the object at one sampled frame: centred between the fingers, clear of palm and
//! fingers, closing on something that does not slip.

use catch_body::{DriveControl, Gripper, Pose, shape::Cuboid};
use nalgebra::{Point3, Translation3, UnitQuaternion, Vector3};

use super::{Config, Grasp};
use crate::perception::ReferenceModel;

/// Surface points this close to the outermost one count as touched by a finger.
const CONTACT_DEPTH_M: f64 = 0.003;

/// Free space between the object and the palm, in metres.
const PALM_MARGIN_M: f64 = 0.006;
/// "Strength": the grasp's axis may miss the centre of mass by this much (the paper's code).
const MAX_STRENGTH_M: f64 = 0.03;
/// The fingers' faces must meet the surface at most this far from its normal, in radians: the cone of a
/// friction coefficient of 0.4, the lowest that is expected.
const MAX_CONTACT_ANGLE_RAD: f64 = 0.38;

/// Reason for which a gripper cannot hold an object with one grasp candidate.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum GraspFailure {
    /// Nothing is between the fingers.
    NothingBetween,
    /// The object is wider there than the gripper opens, margins included.
    TooWide,
    /// The centre of mass is too far from the gripper's axis, or too far from the palm.
    OffCentre,
    /// The fingers would meet the surface at too steep an angle.
    Slanted,
    /// The open gripper would collide with the object.
    Collides,
}

impl std::fmt::Display for GraspFailure {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Self::NothingBetween => "nothing between the fingers",
            Self::TooWide => "wider than the gripper opens less its margins",
            Self::OffCentre => "centre of mass too far from the gripper's axis",
            Self::Slanted => "fingers would meet the surface at too steep an angle",
            Self::Collides => "the open gripper would collide with the object",
        })
    }
}

/// The gripper with orientation `R_OG` over the surface point `sample`, open by the finger margin on each
/// side if it opens that far, and by the approach margin at least.
///
/// # Errors
/// Why it cannot hold the object there.
pub fn fit_gripper(
    reference: &ReferenceModel,
    gripper: &Gripper,
    config: &Config,
    sample: &Point3<f64>,
    R_OG: UnitQuaternion<f64>,
) -> Result<Grasp, GraspFailure> {
    // Over the sample, with the centre of mass (the origin of O) level with the grasp centre.
    let lateral = sample.coords - (R_OG * Vector3::y()) * (R_OG * Vector3::y()).dot(&sample.coords);
    let place = |shift_G: Vector3<f64>| {
        let origin = lateral + R_OG * (shift_G - gripper.grasp_centre().coords);
        Pose::from_parts(Translation3::from(origin), R_OG)
    };
    let half_gap = gripper.finger_size_m[2] / 2.0;
    let reach = gripper.fingertip_y_m();

    // Back off until the palm is clear: nothing may come nearer to it than the margin.
    let half_housing = [gripper.body_size_m[0] / 2.0, gripper.body_size_m[2] / 2.0];
    let X_GO = place(Vector3::zeros()).inverse();
    let over_palm = |p: &Point3<f64>| p.x.abs() < half_housing[0] && p.z.abs() < half_housing[1] + PALM_MARGIN_M;
    let lowest =
        reference.points.iter().map(|point| X_GO * point).filter(over_palm).map(|p| p.y).fold(f64::INFINITY, f64::min);
    let backed_off = (gripper.palm_y_m() + PALM_MARGIN_M - lowest).max(0.0);

    // Points between the fingers, and their middle along the closing direction.
    let X_GO = place(Vector3::new(0.0, -backed_off, 0.0)).inverse();
    let between = || {
        reference.points.iter().map(|point| X_GO * point).filter(|p| p.z.abs() < half_gap && p.y > 0.0 && p.y < reach)
    };
    let low = between().map(|p| p.x).fold(f64::INFINITY, f64::min);
    let high = between().map(|p| p.x).fold(f64::NEG_INFINITY, f64::max);
    if low >= high {
        return Err(GraspFailure::NothingBetween);
    }
    let object_width_m = high - low;
    let (aperture_m, margin_m) = opening(gripper, config, object_width_m)?;
    let X_OG = place(Vector3::new((low + high) / 2.0, -backed_off, 0.0));
    let X_GO = X_OG.inverse();

    // "Strength" (paper, III-C): the gripper's axis points at the centre of mass.
    let centre = X_GO * Point3::origin();
    let strength_m = libm::hypot(centre.x, centre.z);
    let overhang_m = overhang_m(&X_GO, gripper);
    if strength_m > MAX_STRENGTH_M || overhang_m > config.max_overhang_m {
        return Err(GraspFailure::OffCentre);
    }

    // Both faces must meet the surface squarely enough for friction to hold.
    let squareness = |side: f64| squareness(reference, gripper, &X_GO, object_width_m, side);
    if squareness(1.0).min(squareness(-1.0)) < libm::cos(MAX_CONTACT_ANGLE_RAD) {
        return Err(GraspFailure::Slanted);
    }

    // The open fingers and the housing are clear of the object.
    let boxes = [gripper.fingers(aperture_m)[0], gripper.fingers(aperture_m)[1], gripper.body()];
    let collides =
        |p: Point3<f64>| boxes.iter().any(|it| ((p - it.centre).abs() - it.size / 2.0).max() < margin_m / 2.0);
    if reference.points.iter().any(|point| collides(X_GO * point)) {
        return Err(GraspFailure::Collides);
    }
    let held_G = held_box(&reference.points, &X_GO);
    Ok(Grasp { X_OG, object_width_m, aperture_m, strength_m, overhang_m, held_G })
}

/// Gripper aperture for an object of this width, and the clearance that is then left on each side, in metres.
fn opening(gripper: &Gripper, config: &Config, object_width_m: f64) -> Result<(f64, f64), GraspFailure> {
    let roomy_m = object_width_m + 2.0 * config.finger_margin_m;
    let most_margin_m = (gripper.max_width_m - object_width_m) / 2.0;
    let margin_m = if roomy_m > gripper.max_width_m { most_margin_m } else { config.finger_margin_m };
    if margin_m < config.approach_margin_m.min(config.finger_margin_m) {
        return Err(GraspFailure::TooWide);
    }
    let aperture_m = match gripper.drive.control {
        DriveControl::TwoState => gripper.max_width_m,
        _ => roomy_m.min(gripper.max_width_m),
    };
    Ok((aperture_m, margin_m))
}

/// Squareness of the contact between the finger on one `side` (−1, 1) and an object of this width at `X_GO`:
/// the cosine of the angle between the finger's face and the mean normal of the surface that it touches, zero
/// where it touches nothing.
fn squareness(reference: &ReferenceModel, gripper: &Gripper, X_GO: &Pose, width_m: f64, side: f64) -> f64 {
    let (half_gap, reach) = (gripper.finger_size_m[2] / 2.0, gripper.fingertip_y_m());
    let (sum, count) = reference
        .points
        .iter()
        .zip(&reference.normals)
        .map(|(point, normal)| (X_GO * point, X_GO * normal))
        .filter(|(p, _)| {
            p.z.abs() < half_gap && p.y > 0.0 && p.y < reach && side * p.x > width_m / 2.0 - CONTACT_DEPTH_M
        })
        .fold((Vector3::zeros(), 0), |(sum, count), (_, normal)| (sum + normal, count + 1));
    if count == 0 { 0.0 } else { sum.normalize().x * side }
}

/// Distance by which an object's centre of mass is farther from the palm than the grasp centre, in metres.
pub fn overhang_m(X_GO: &Pose, gripper: &Gripper) -> f64 {
    (X_GO.translation.vector.y - gripper.grasp_centre_y_m).max(0.0)
}

/// The box in G around an object whose surface these points outline.
pub fn held_box(points: &[Point3<f64>], X_GO: &Pose) -> Cuboid {
    let corner = |sign: f64| {
        let farthest = |far: Vector3<f64>, point: &Point3<f64>| far.sup(&((X_GO * point).coords * sign));
        points.iter().fold(Vector3::repeat(f64::NEG_INFINITY), farthest) * sign
    };
    let (low, high) = (corner(-1.0), corner(1.0));
    Cuboid { centre: ((low + high) / 2.0).into(), size: high - low }
}
