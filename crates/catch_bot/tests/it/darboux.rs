//! Darboux frames.

use catch_bot::grasp_selection::darboux::darboux_frame;
use nalgebra::{Point3, Vector3};

#[test]
fn on_a_cylinder_the_axis_is_the_direction_of_least_curvature() {
    let (mut points, mut normals) = (Vec::new(), Vec::new());
    for ring in 0..20 {
        for step in 0..60 {
            let angle = f64::from(step) * std::f64::consts::TAU / 60.0;
            let normal = Vector3::new(libm::cos(angle), libm::sin(angle), 0.0);
            points.push(Point3::from(normal * 0.025 + Vector3::z() * (f64::from(ring) * 0.003)));
            normals.push(normal);
        }
    }
    let frame = darboux_frame(&points, &normals, 10 * 60 + 7, 0.008);
    assert!((frame.normal - normals[10 * 60 + 7]).norm() < 1e-6);
    assert!(frame.principal[0].z.abs() > 1.0 - 1e-6);
    assert!(frame.normal.cross(&frame.principal[0]).dot(&frame.principal[1]) > 1.0 - 1e-6);
}
