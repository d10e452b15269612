//! Symmetries of references.

use catch_bot::perception::Symmetry;
use nalgebra::{Matrix3, UnitQuaternion, Vector3};

#[test]
fn the_nearest_alike_orientation_looks_the_same_and_does_not_turn_about_the_axis() {
    let axis = Vector3::z_axis();
    let symmetry = Symmetry::Axis { axis, reversible: false };
    let R_WA = UnitQuaternion::from_euler_angles(0.4, -0.7, 1.9);
    let tilt = UnitQuaternion::from_euler_angles(0.02, 0.03, 0.0);
    // The same looks as a slightly tilted A, but spun by 2 rad about the axis.
    let R_WB = tilt * R_WA * UnitQuaternion::from_axis_angle(&axis, 2.0);
    let near = symmetry.nearest_alike(&R_WA, &R_WB);
    assert!((near * axis.into_inner() - R_WB * axis.into_inner()).norm() < 1e-12, "the axis points where B's does");
    assert!(near.angle_to(&R_WA) < 0.04 && R_WB.angle_to(&R_WA) > 1.9);

    let none = Symmetry::default();
    assert!(none.nearest_alike(&R_WA, &R_WB).angle_to(&R_WB) < 1e-7);
    assert_eq!(Symmetry::Sphere.nearest_alike(&R_WA, &R_WB), R_WA);
}

#[test]
fn half_a_turn_that_cannot_be_seen_is_none() {
    let axis = Vector3::y_axis();
    let symmetry = Symmetry::None { half_turn: Some(axis), inertia_per_kg: Matrix3::identity() };
    let R_WA = UnitQuaternion::from_euler_angles(0.4, -0.7, 1.9);
    let tilt = UnitQuaternion::from_euler_angles(0.02, 0.03, 0.01);
    let half = UnitQuaternion::from_axis_angle(&axis, std::f64::consts::PI);
    for R_WB in [tilt * R_WA, tilt * R_WA * half] {
        assert!((symmetry.turn_between(&R_WA, &R_WB) - tilt.scaled_axis()).norm() < 1e-12);
    }
}
