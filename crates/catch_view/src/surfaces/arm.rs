//! The look of an arm of which only capsules are known: joints and capsules say where its housings have
//! covers over axles, rings where two links meet, and flanges at its ends.
//!
//! Looked at along a joint's axis, the capsules of the two links are intervals. Where the surface passes from
//! one link to the other there is a ring. An end that is no longer housing going on along the axis is the end
//! of an axle, and has a cover.

use std::f64::consts::TAU;

use catch_body::{Gripper, Pose, Robot, TriangleMesh, shape::Capsule};
use nalgebra::{Point3, Translation3, Unit, UnitQuaternion, Vector3};

use super::paint::{COVER, Colour, DARK, METAL, RING, SHELL};

/// Flat strips around a body.
const SEGMENTS: u32 = 24;
/// Step along and away from an axis.
const STEP_M: f64 = 0.001;
/// Farthest from a joint that its housing ends.
const REACH_M: f64 = 0.32;
/// How far rings and covers stand out.
const RISE_M: f64 = 0.002;
/// A cover's radius over that of the housing.
const COVER_PART: f64 = 0.74;

/// A mesh in the frame of a link, and its colour.
pub type Piece = (usize, TriangleMesh, Colour);

/// All pieces of the arm but those of links with a visual shape.
pub fn pieces(robot: &Robot, gripper: &Gripper) -> Vec<Piece> {
    let is_bare = |link: usize| robot.visuals.get(&link).is_none_or(|it| it.mesh().is_none());
    let mut pieces: Vec<Piece> = robot.capsules.iter().map(|(link, it)| (*link, housing(*link, it), SHELL)).collect();
    pieces.extend((0..robot.dof()).flat_map(|joint| of_joint(robot, joint)));
    pieces.extend(stand(robot));
    pieces.extend(flange(robot, gripper));
    pieces.retain(|(link, ..)| is_bare(*link));
    pieces
}

/// A link's housing; that of the base ends where the arm stands.
fn housing(link: usize, capsule: &Capsule) -> TriangleMesh {
    let mut mesh = TriangleMesh::capsule(capsule, SEGMENTS);
    if link == 0 {
        mesh.vertices.iter_mut().for_each(|vertex| vertex.z = vertex.z.max(0.0));
    }
    mesh
}

/// The plate on which the arm stands.
fn stand(robot: &Robot) -> Option<Piece> {
    let base = capsules(robot, 0, &Pose::identity());
    let up = Axis { origin: Point3::new(0.0, 0.0, 0.03), along: Vector3::z_axis() };
    let r = up.radius(&base, 0.0)? + 0.012;
    Some((0, up.turned(&[[-0.03, r], [-0.016, r], [-0.014, r - 0.002]]), DARK))
}

/// What the gripper is mounted with: a disc from its housing to the last link.
fn flange(robot: &Robot, gripper: &Gripper) -> Option<Piece> {
    let (_, last) = robot.capsules.iter().rfind(|(link, _)| *link == robot.dof())?;
    let back = Axis {
        origin: robot.X_LG * Point3::new(0.0, -gripper.palm_y_m(), 0.0),
        along: robot.X_LG.rotation * Unit::new_unchecked(-Vector3::y()),
    };
    let depth_m = back.interval(&[*last]).map_or(0.03, |[from, _]| from.max(0.0) + 0.01);
    let r = (0.8 * last.radius).min(0.6 * gripper.body_size_m[0]);
    Some((robot.dof(), back.turned(&[[0.0, r], [depth_m, r], [depth_m + 0.02, 0.9 * r]]), METAL))
}

/// Rings and covers of a joint, on the moved link.
fn of_joint(robot: &Robot, joint: usize) -> Vec<Piece> {
    let moved = &robot.joints[joint];
    let axis = Axis { origin: Point3::origin(), along: moved.axis };
    let parent = capsules(robot, joint, &moved.X_PL.inverse());
    let child = capsules(robot, joint + 1, &Pose::identity());
    let (Some(of_parent), Some(of_child)) = (axis.interval(&parent), axis.interval(&child)) else { return Vec::new() };
    let both: Vec<Capsule> = parent.iter().chain(&child).copied().collect();
    let mut pieces = Vec::new();
    // The ends of the axle.
    for side in [-1.0, 1.0] {
        let end = |it: [f64; 2]| if side < 0.0 { -it[0] } else { it[1] };
        let (end_m, owners) =
            if end(of_parent) > end(of_child) { (end(of_parent), &parent) } else { (end(of_child), &child) };
        // The first joint's lower end is where the arm stands.
        let is_covered = owners.iter().any(|it| axis.goes_along(it)) || joint == 0 && end(of_parent) > end(of_child);
        let inward = 0.35 * end_m.abs().min(0.1);
        if let Some(r) = axis.radius(&both, side * (end_m - inward)).filter(|_| !is_covered) {
            let r = COVER_PART * r.min(0.1);
            let outer = end_m + RISE_M;
            let mut add = |profile: &[[f64; 2]], colour| {
                let profile: Vec<[f64; 2]> = profile.iter().map(|[z, r]| [side * z, *r]).collect();
                pieces.push((joint + 1, axis.turned(&profile), colour));
            };
            let near = end_m - inward;
            add(&[[0.0, r], [near, r]], SHELL);
            add(&[[near, r + 0.004], [near + 0.007, r + 0.004]], RING);
            add(&[[near + 0.007, r], [outer - 0.003, r], [outer, r - 0.003]], COVER);
        }
    }
    // Where the surface passes from one link to the other.
    let depth =
        |list: &[Capsule], z: f64| list.iter().map(|it| -it.distance_to_point(&axis.at(z))).fold(-1.0, f64::max);
    let leads = |z: f64| depth(&parent, z) > depth(&child, z);
    let from = of_parent[0].max(of_child[0]);
    let steps = ((of_parent[1].min(of_child[1]) - from) / STEP_M).max(0.0) as usize;
    let passes = (0..steps).map(|i| from + i as f64 * STEP_M).find(|&z| leads(z) != leads(z + STEP_M));
    if let Some((z, r)) = passes.and_then(|z| Some((z, axis.radius(&both, z)?))) {
        let profile = [[-0.006, r], [-0.004, r + RISE_M], [0.004, r + RISE_M], [0.006, r]];
        pieces.push((joint + 1, axis.turned(&profile.map(|[dz, r]| [z + dz, r])), RING));
    }
    pieces
}

/// A link's capsules in another frame.
fn capsules(robot: &Robot, link: usize, X_FL: &Pose) -> Vec<Capsule> {
    robot.capsules.iter().filter(|(of, _)| *of == link).map(|(_, it)| it.transformed(X_FL)).collect()
}

/// An axis in the frame of a link.
struct Axis {
    origin: Point3<f64>,
    along: Unit<Vector3<f64>>,
}

impl Axis {
    fn at(&self, z: f64) -> Point3<f64> {
        self.origin + self.along.into_inner() * z
    }

    /// The part of the axis within capsules, around its origin.
    fn interval(&self, capsules: &[Capsule]) -> Option<[f64; 2]> {
        let count = (REACH_M / STEP_M) as i32;
        let inside = (-count..=count)
            .map(|i| f64::from(i) * STEP_M)
            .filter(|z| capsules.iter().any(|it| it.distance_to_point(&self.at(*z)) < 0.0));
        inside.fold(None, |range, z| Some(range.map_or([z, z], |[from, _]: [f64; 2]| [from, z])))
    }

    /// Whether a housing goes on along the axis.
    fn goes_along(&self, capsule: &Capsule) -> bool {
        let along = capsule.to - capsule.from;
        along.dot(&self.along).abs() > 0.8 * along.norm() && along.norm() > 0.6 * capsule.radius
    }

    /// The distance of the capsules' surface from the axis: the middle one of several directions.
    fn radius(&self, capsules: &[Capsule], z: f64) -> Option<f64> {
        let turn = UnitQuaternion::rotation_between(&Vector3::z(), &self.along).unwrap_or_default();
        let way = |i: i32| {
            let (sin, cos) = libm::sincos(TAU * f64::from(i) / 12.0);
            turn * Vector3::new(cos, sin, 0.0)
        };
        let is_inside = |point: &Point3<f64>| capsules.iter().any(|it| it.distance_to_point(point) < 0.0);
        let reach = |i: i32| {
            let all = (0..200).map(|k| f64::from(k) * STEP_M);
            all.take_while(|r| is_inside(&(self.at(z) + way(i) * *r))).last()
        };
        let mut radii: Vec<f64> = (0..12).filter_map(reach).collect();
        radii.sort_by(f64::total_cmp);
        radii.get(radii.len() / 3).copied()
    }

    /// What a profile of points (z, r) sweeps around the axis.
    fn turned(&self, profile: &[[f64; 2]]) -> TriangleMesh {
        let half_turn = || UnitQuaternion::from_axis_angle(&Vector3::x_axis(), std::f64::consts::PI);
        let turn = UnitQuaternion::rotation_between(&Vector3::z(), &self.along).unwrap_or_else(half_turn);
        let X_LA = Pose::from_parts(Translation3::from(self.origin), turn);
        TriangleMesh::revolution(profile, SEGMENTS).transformed(&X_LA)
    }
}
