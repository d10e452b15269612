//! Cuts a concave solid into convex parts, as which it collides.

use catch_body::TriangleMesh;
use nalgebra::Point3;
use parry3d_f64::{
    shape::ConvexPolyhedron,
    transformation::vhacd::{VHACD, VHACDParameters},
};

use crate::convert::{from_vector, to_vectors};

/// A solid whose convex hull has at most this times its volume collides as that.
const NEARLY_CONVEX: f64 = 1.02;

/// The convex parts of a closed mesh: its hull where it is convex, else an approximate decomposition (Mamou,
/// Volumetric hierarchical approximate convex decomposition, Game Engine Gems 3, 2016).
///
/// Each part is the convex hull of its points.
pub(crate) fn convex_parts(mesh: &TriangleMesh) -> Vec<Vec<Point3<f64>>> {
    let hull = || vec![mesh.vertices.clone()];
    if hull_volume_m3(&mesh.vertices) <= NEARLY_CONVEX * mesh.volume() {
        return hull();
    }
    let parameters =
        VHACDParameters { concavity: 0.005, resolution: 64, max_convex_hulls: 32, ..VHACDParameters::default() };
    let points = to_vectors(&mesh.vertices);
    let pieces = VHACD::decompose(&parameters, &points, &mesh.triangles, true)
        .compute_exact_convex_hulls(&points, &mesh.triangles);
    let parts = pieces.into_iter().map(|(points, _)| points.iter().map(|it| from_vector(*it).into()).collect());
    let parts: Vec<Vec<Point3<f64>>> = parts.filter(|points: &Vec<_>| hull_volume_m3(points) > 0.0).collect();
    if parts.is_empty() { hull() } else { parts }
}

/// Volume of the convex hull of points; zero where they span none.
pub(crate) fn hull_volume_m3(points: &[Point3<f64>]) -> f64 {
    hull(points).map_or(0.0, |it| it.volume().max(0.0))
}

/// Area of the convex hull of points; zero where they span no volume.
pub fn hull_area_m2(points: &[Point3<f64>]) -> f64 {
    let area = |[a, b, c]: [Point3<f64>; 3]| (b - a).cross(&(c - a)).norm() / 2.0;
    hull(points).map_or(0.0, |it| it.all_corners().map(area).sum())
}

/// The surface of the convex hull of points; `None` where they span no volume.
fn hull(points: &[Point3<f64>]) -> Option<TriangleMesh> {
    let (points, triangles) = ConvexPolyhedron::from_convex_hull(&to_vectors(points))?.to_trimesh();
    let vertices = points.iter().map(|it| from_vector(*it).into()).collect();
    Some(TriangleMesh { vertices, triangles })
}

#[cfg(test)]
mod tests {
    use super::*;
    use catch_body::{mesh::TubeRing, shape::Cuboid};
    use nalgebra::Vector3;

    /// A horseshoe: most of its convex hull is air.
    fn horseshoe() -> TriangleMesh {
        let rings: Vec<TubeRing> = (0..=40)
            .map(|i| {
                let (sin, cos) = libm::sincos(f64::from(i) / 40.0 * 4.0);
                let outwards = Vector3::new(cos, sin, 0.0);
                TubeRing { centre: (outwards * 0.05).into(), axes: [outwards, Vector3::z()], semi_axes_m: [0.008; 2] }
            })
            .collect();
        TriangleMesh::tube(&rings, 24)
    }

    #[test]
    fn a_concave_solid_is_cut_into_parts_that_fill_it_and_little_more() {
        let mesh = horseshoe();
        assert!(hull_volume_m3(&mesh.vertices) > 2.0 * mesh.volume());
        let parts = convex_parts(&mesh);
        let volume: f64 = parts.iter().map(|points| hull_volume_m3(points)).sum();
        let ratio = volume / mesh.volume();
        assert!((0.98..1.15).contains(&ratio) && (4..=32).contains(&parts.len()), "{} parts, {ratio}", parts.len());
        // Nothing fills the gap in the middle.
        assert!(!parts.iter().flatten().any(|point| point.coords.xy().norm() < 0.035));
    }

    #[test]
    fn a_convex_solid_stays_one_part() {
        let brick = TriangleMesh::cuboid(&Cuboid { centre: Point3::origin(), size: Vector3::new(0.1, 0.05, 0.02) });
        assert_eq!(convex_parts(&brick), std::slice::from_ref(&brick.vertices));
        assert!((hull_volume_m3(&brick.vertices) - 1e-4).abs() < 1e-12);
        assert_eq!(hull_volume_m3(&brick.vertices[..3]), 0.0);
    }
}
