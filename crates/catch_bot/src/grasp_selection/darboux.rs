//! Darboux frames: the surface's normal and principal directions at a point (paper, III-C; ten Pas et al.,
//! Grasp pose detection in point clouds, 2017).

use nalgebra::{Matrix3, Point3, SymmetricEigen, Vector3};

/// A surface point's frame: outward normal and the two principal directions, right-handed in this order.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DarbouxFrame {
    /// The point.
    pub point: Point3<f64>,
    /// Outward normal.
    pub normal: Vector3<f64>,
    /// Direction of least curvature first.
    pub principal: [Vector3<f64>; 2],
}

/// The frame at point `index` from the normals of its neighbours within `radius_m`: the eigenvectors of Σ
/// n·nᵀ.
///
/// The eigenvector of the largest eigenvalue is the mean normal; the one of the smallest is the direction in
/// which normals change least.
pub fn darboux_frame(points: &[Point3<f64>], normals: &[Vector3<f64>], index: usize, radius_m: f64) -> DarbouxFrame {
    let centre = points[index];
    let scatter: Matrix3<f64> = points
        .iter()
        .zip(normals)
        .filter(|(point, _)| (*point - centre).norm_squared() <= radius_m * radius_m)
        .map(|(_, normal)| normal * normal.transpose())
        .sum();
    let eigen = SymmetricEigen::new(scatter);
    let mut order = [0, 1, 2];
    order.sort_by(|&a, &b| eigen.eigenvalues[b].total_cmp(&eigen.eigenvalues[a]));
    let column = |i: usize| eigen.eigenvectors.column(order[i]).into_owned();
    let normal = column(0) * if column(0).dot(&normals[index]) < 0.0 { -1.0 } else { 1.0 };
    let least = column(2);
    DarbouxFrame { point: centre, normal, principal: [least, normal.cross(&least)] }
}
