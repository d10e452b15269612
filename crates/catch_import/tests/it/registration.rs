//! Clouds of a part of an object: whether the pose that a registration claims is the true one, as far as it
//! claims.

use catch_body::{Pose, TriangleMesh};
use catch_bot::perception::{ReferenceModel, Symmetry};
use catch_import::{
    cloud_file::{self, CloudFile},
    cloud_registration::{RegistrationStatus, reference_model, register},
};
use catch_lab::assets::{Asset, Kind};
use catch_sim::random_streams::{Draws, Stream};
use nalgebra::{Point3, UnitQuaternion, Vector3, Vector6};

/// Outcomes of the registrations of clouds of one object.
#[derive(Debug, Default)]
struct Tally {
    registered: usize,
    degenerate: usize,
    others: usize,
    /// Registered ones that are off by more than their claim's ellipsoid of 95 %, and by more than a tenth of
    /// the radius.
    outside_95: usize,
    wrong: usize,
}

/// A pose of no meaning.
fn anywhere(random: &mut Draws) -> Pose {
    let [shift, turn] = [1.0, 2.0].map(|scale| Vector3::from_fn(|_, _| scale * random.normal()));
    Pose::from_parts(shift.into(), UnitQuaternion::from_scaled_axis(turn))
}

fn noise(random: &mut Draws, sd_m: f64) -> Vector3<f64> {
    Vector3::from_fn(|_, _| sd_m * random.normal())
}

/// Points of a view from a random direction, cut to a patch of a random size around one of them.
fn patch(all: &CloudFile, random: &mut Draws, radius_m: f64, full: bool, noise_m: f64) -> Vec<Point3<f64>> {
    let direction = Vector3::from_fn(|_, _| random.normal()).normalize();
    let normals = all.normals.as_ref().unwrap();
    let seen: Vec<Point3<f64>> =
        all.points.iter().zip(normals).filter(|(_, n)| n.dot(&direction) > 0.15).map(|it| *it.0).collect();
    let middle = seen[(random.unit() * seen.len() as f64) as usize % seen.len()];
    let within_m = if full { 3.0 * radius_m } else { radius_m * (0.2 + 0.6 * random.unit()) };
    let cut: Vec<Point3<f64>> = seen.into_iter().filter(|it| nalgebra::distance(it, &middle) < within_m).collect();
    let step = cut.len().div_ceil(600).max(1);
    cut.into_iter().step_by(step).map(|it| it + noise(random, noise_m)).collect()
}

fn tally(reference: &ReferenceModel, all: &CloudFile, full: bool, trials: u64) -> Tally {
    let mut tally = Tally::default();
    let chi2_95 = match reference.symmetry {
        Symmetry::Finite { .. } => 12.6,
        Symmetry::Axis { .. } => 11.1,
        Symmetry::Sphere => 7.8,
    };
    for trial in 0..trials {
        let mut random = Draws::new(Stream::Sensors, trial, u64::from(full));
        let noise_m = [0.0001, 0.0005, 0.001, 0.002][trial as usize % 4];
        let points = patch(all, &mut random, reference.radius_m, full, noise_m);
        if points.len() < 30 {
            continue;
        }
        let X_CR = anywhere(&mut random);
        let points: Vec<Point3<f64>> = points.iter().map(|it| X_CR * it).collect();
        let found = register(&points, noise_m, reference);
        match (found.status, found.X_CR, found.information) {
            (RegistrationStatus::Registered, Some(pose), Some(information)) => {
                let (X_CO, true_X_CO) = (pose * reference.X_RO, X_CR * reference.X_RO);
                let turn = reference.symmetry.turn_between(&X_CO.rotation, &true_X_CO.rotation);
                let shift = true_X_CO.translation.vector - X_CO.translation.vector;
                let error = Vector6::new(turn.x, turn.y, turn.z, shift.x, shift.y, shift.z);
                tally.registered += 1;
                let chi2 = error.dot(&(information * error));
                let off_m = libm::hypot(shift.norm(), turn.norm() * reference.radius_m);
                tally.outside_95 += usize::from(chi2 > chi2_95);
                tally.wrong += usize::from(off_m > 0.1 * reference.radius_m && chi2 > 3.0 * chi2_95);
            }
            (RegistrationStatus::Degenerate, ..) => tally.degenerate += 1,
            _ => tally.others += 1,
        }
    }
    tally
}

/// A reference from the surface of a mesh.
fn model(mesh: &TriangleMesh) -> (CloudFile, ReferenceModel) {
    let all = cloud_file::on_surface(mesh);
    (all.clone(), reference_model(all, "a mesh").unwrap())
}

/// The convex polyhedron of faces by their corners, counterclockwise from outside, turned into an orientation
/// of no meaning.
fn polyhedron(corners: &[[f64; 3]], faces: &[&[u32]], half_m: f64) -> TriangleMesh {
    let R = UnitQuaternion::from_euler_angles(0.4, -0.7, 1.9);
    TriangleMesh {
        vertices: corners.iter().map(|it| R * Point3::from(*it) * half_m).collect(),
        triangles: faces.iter().flat_map(|it| (2..it.len()).map(|i| [it[0], it[i - 1], it[i]])).collect(),
    }
}

/// A box of these half lengths, in metres.
fn cuboid(half_m: [f64; 3]) -> TriangleMesh {
    let corner = |i: usize| [0, 1, 2].map(|axis| if i >> axis & 1 == 1 { half_m[axis] } else { -half_m[axis] });
    let corners: Vec<[f64; 3]> = (0..8).map(corner).collect();
    let faces: [&[u32]; 6] = [&[0, 4, 6, 2], &[1, 3, 7, 5], &[0, 1, 5, 4], &[2, 6, 7, 3], &[0, 2, 3, 1], &[4, 5, 7, 6]];
    polyhedron(&corners, &faces, 1.0)
}

/// A can of this radius and half length.
fn can(radius_m: f64, half_m: f64) -> TriangleMesh {
    let sides = 48;
    let rim = |i: u32, z: f64| {
        let (sin, cos) = libm::sincos(std::f64::consts::TAU * f64::from(i) / f64::from(sides));
        [radius_m * cos, radius_m * sin, z]
    };
    let corners: Vec<[f64; 3]> =
        (0..sides).map(|i| rim(i, -half_m)).chain((0..sides).map(|i| rim(i, half_m))).collect();
    let (bottom, top): (Vec<u32>, Vec<u32>) = ((0..sides).rev().collect(), (sides..2 * sides).collect());
    let side: Vec<[u32; 4]> = (0..sides).map(|i| [i, (i + 1) % sides, sides + (i + 1) % sides, sides + i]).collect();
    let faces: Vec<&[u32]> = [&bottom[..], &top[..]].into_iter().chain(side.iter().map(|it| &it[..])).collect();
    polyhedron(&corners, &faces, 1.0)
}

/// The faces of a PLY file count, as those of other meshes do; its eight corners alone would be no surface.
#[test]
fn a_mesh_of_corners_is_a_reference_in_every_format() {
    let mesh = cuboid([0.03, 0.045, 0.07]);
    let mut text = format!("ply\nformat ascii 1.0\nelement vertex {}\n", mesh.vertices.len());
    text += "property float x\nproperty float y\nproperty float z\n";
    text += &format!("element face {}\nproperty list uchar int vertex_indices\nend_header\n", mesh.triangles.len());
    mesh.vertices.iter().for_each(|it| text += &format!("{} {} {}\n", it.x, it.y, it.z));
    mesh.triangles.iter().for_each(|[a, b, c]| text += &format!("3 {a} {b} {c}\n"));
    let cloud = cloud_file::parse("corners.ply", text.as_bytes(), true).unwrap();
    assert!(cloud.points.len() > 10_000 && cloud.normals.is_some());
    assert_eq!(cloud_file::parse("corners.ply", text.as_bytes(), false).unwrap().points.len(), 8);
}

/// All rotations of regular solids, whose principal axes are arbitrary, are found.
#[test]
fn regular_solids_have_the_rotations_of_their_groups() {
    let octahedron =
        [[1.0, 0.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, 1.0], [0.0, 0.0, -1.0]];
    let eight: [&[u32]; 8] =
        [&[0, 2, 4], &[2, 1, 4], &[1, 3, 4], &[3, 0, 4], &[2, 0, 5], &[1, 2, 5], &[3, 1, 5], &[0, 3, 5]];
    let tetrahedron = [[1.0, 1.0, 1.0], [1.0, -1.0, -1.0], [-1.0, 1.0, -1.0], [-1.0, -1.0, 1.0]];
    let four: [&[u32]; 4] = [&[0, 1, 2], &[0, 2, 3], &[0, 3, 1], &[1, 3, 2]];
    for (mesh, order) in [
        (cuboid([0.03; 3]), 24),
        (polyhedron(&octahedron, &eight, 0.05), 24),
        (polyhedron(&tetrahedron, &four, 0.04), 12),
        (cuboid([0.03, 0.035, 0.04]), 4),
        (cuboid([0.03, 0.03, 0.06]), 8),
    ] {
        let Symmetry::Finite { group, .. } = model(&mesh).1.symmetry else { panic!("of order {order}: none") };
        assert_eq!(group.order(), order);
    }
}

/// A patch of one face slides in its plane, one of a can's side along its axis, and a mug whose handle is
/// hidden turns about its axis: none is registered.
#[test]
fn what_slides_is_degenerate() {
    type Shown = fn(Point3<f64>, Vector3<f64>) -> bool;
    let face: Shown = |p, n| n.z > 0.99 && p.xy().coords.norm() < 0.03;
    let side: Shown = |p, n| n.z.abs() < 0.1 && p.z.abs() < 0.02;
    let away: Shown = |_, n| n.dot(&Vector3::new(-1.0, 0.0, 0.3)) > 0.2;
    let R = UnitQuaternion::from_euler_angles(0.4, -0.7, 1.9);
    let mut mug = can(0.04, 0.05);
    mug.merge(&cuboid([0.012, 0.004, 0.03]).translated(&(R * Vector3::new(0.05, 0.0, 0.0))));
    for (mesh, shown) in [(cuboid([0.05, 0.07, 0.03]), face), (can(0.033, 0.06), side), (mug, away)] {
        let (all, reference) = model(&mesh);
        let points: Vec<Point3<f64>> = all
            .points
            .iter()
            .zip(all.normals.as_ref().unwrap())
            .filter(|(p, n)| shown(R.inverse() * *p, R.inverse() * *n))
            .map(|it| *it.0)
            .collect();
        for trial in 0..24 {
            let mut random = Draws::new(Stream::Sensors, trial, 0);
            let noise_m = [1e-5, 0.0005, 0.002][trial as usize % 3];
            let X_CR = anywhere(&mut random);
            let any = |random: &mut Draws| X_CR * points[(random.unit() * points.len() as f64) as usize % points.len()];
            let cloud: Vec<Point3<f64>> = (0..600).map(|_| any(&mut random) + noise(&mut random, noise_m)).collect();
            assert_eq!(register(&cloud, noise_m, &reference).status, RegistrationStatus::Degenerate, "{trial}");
        }
    }
}

/// A cloud whose handedness was lost on the way, of an object that differs from its mirror image.
#[test]
fn mirrored_clouds_are_not_registered() {
    let mut mesh = cuboid([0.02, 0.03, 0.05]);
    let R = UnitQuaternion::from_euler_angles(0.4, -0.7, 1.9);
    for (middle, half) in [([0.05, 0.0, -0.03], [0.03, 0.02, 0.02]), ([0.0, 0.06, 0.03], [0.015, 0.03, 0.015])] {
        let other = cuboid(half);
        let first = mesh.vertices.len() as u32;
        mesh.vertices.extend(other.vertices.iter().map(|it| it + R * Vector3::from(middle)));
        mesh.triangles.extend(other.triangles.iter().map(|it| it.map(|i| i + first)));
    }
    let (all, reference) = model(&mesh);
    let mut random = Draws::new(Stream::Sensors, 0, 0);
    for mirrored in [false, true] {
        let X_CR = anywhere(&mut random);
        let seen = all.points.iter().step_by(20).map(|it| if mirrored { Point3::new(-it.x, it.y, it.z) } else { *it });
        let cloud: Vec<Point3<f64>> = seen.map(|it| X_CR * it + noise(&mut random, 0.0005)).collect();
        let status = register(&cloud, 0.0005, &reference).status;
        assert_eq!(status == RegistrationStatus::Registered, !mirrored, "{status:?}");
    }
}

#[test]
fn patches_are_registered_as_well_as_claimed_or_not_at_all() {
    let trials = std::env::var("TRIALS").ok().and_then(|it| it.parse().ok()).unwrap_or(24);
    let (mut registered, mut outside) = (0, 0);
    for name in Kind::Object.names() {
        let asset = Asset::asked(Kind::Object, name, ("", "")).unwrap();
        let all = cloud_file::on_surface(&asset.thrown_object().unwrap().mesh);
        let reference = reference_model(all.clone(), name).unwrap();
        for full in [true, false] {
            let tally = tally(&reference, &all, full, trials);
            assert_eq!((tally.wrong, tally.others), (0, 0), "{name}: {tally:?}");
            assert!(!full || tally.registered as u64 > trials * 9 / 10, "{name}: {tally:?}");
            registered += tally.registered;
            outside += tally.outside_95;
        }
    }
    // Of the errors 5 % should lie outside of what holds 95 %.
    assert!(registered > 0 && 10 * outside <= registered, "{outside} of {registered}");
}
