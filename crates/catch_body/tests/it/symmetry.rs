//! Symmetries of bodies.

use catch_body::symmetry::{RotationGroup, Symmetry};
use nalgebra::{Matrix3, UnitQuaternion, Vector3};

#[test]
fn the_nearest_alike_orientation_looks_the_same_and_does_not_turn_about_the_axis() {
    let axis = Vector3::z_axis();
    let symmetry = Symmetry::Axis { axis, reversible: false, axial_inertia: 1.0 };
    let R_WA = UnitQuaternion::from_euler_angles(0.4, -0.7, 1.9);
    let tilt = UnitQuaternion::from_euler_angles(0.02, 0.03, 0.0);
    // B looks like a slightly tilted A, but is spun by 2 rad about the axis.
    let R_WB = tilt * R_WA * UnitQuaternion::from_axis_angle(&axis, 2.0);
    let near = symmetry.nearest_alike(&R_WA, &R_WB);
    assert!((near * axis.into_inner() - R_WB * axis.into_inner()).norm() < 1e-12, "the axis points where B's does");
    assert!(near.angle_to(&R_WA) < 0.04 && R_WB.angle_to(&R_WA) > 1.9);

    let none = Symmetry::default();
    assert!(none.nearest_alike(&R_WA, &R_WB).angle_to(&R_WB) < 1e-7);
    assert_eq!(Symmetry::Sphere.nearest_alike(&R_WA, &R_WB), R_WA);
}

#[test]
fn rotations_that_cannot_be_seen_are_none() {
    let half = |axis| UnitQuaternion::from_axis_angle(&axis, std::f64::consts::PI);
    let boxes = RotationGroup::generated([half(Vector3::x_axis()), half(Vector3::y_axis())]);
    assert_eq!(boxes.order(), 4);
    let symmetry = Symmetry::Finite { group: boxes, inertia_per_kg: Matrix3::identity() };
    let R_WA = UnitQuaternion::from_euler_angles(0.4, -0.7, 1.9);
    let tilt = UnitQuaternion::from_euler_angles(0.02, 0.03, 0.01);
    for alike in [UnitQuaternion::identity(), half(Vector3::x_axis()), half(Vector3::y_axis()), half(Vector3::z_axis())]
    {
        let turn = symmetry.turn_between(&R_WA, &(tilt * R_WA * alike));
        assert!((turn - tilt.scaled_axis()).norm() < 1e-12);
    }
}

#[test]
fn groups_are_closed() {
    let turn = |axis, order: f64| UnitQuaternion::from_axis_angle(&axis, std::f64::consts::TAU / order);
    for (generators, order) in [
        (vec![], 1),
        (vec![turn(Vector3::z_axis(), 5.0)], 5),
        (vec![turn(Vector3::z_axis(), 6.0), turn(Vector3::x_axis(), 2.0)], 12),
        (vec![turn(Vector3::z_axis(), 4.0), turn(Vector3::x_axis(), 4.0)], 24),
    ] {
        let group = RotationGroup::generated(generators);
        assert_eq!(group.order(), order);
        for a in group.rotations() {
            for b in group.rotations() {
                let is_in = |it: &UnitQuaternion<f64>| it.angle_to(&(a * b)) < 1e-6;
                assert!((a * b).angle() < 1e-6 || group.rotations().iter().any(is_in));
            }
        }
    }
}
