//! Meshes of links for cameras: what of a maker's mesh can be seen, in few triangles.

use std::collections::HashSet;

use catch_body::{TriangleMesh, mesh_file::welded, ray_cast::RayCaster, visual::MOST_VISUAL_TRIANGLES};
use nalgebra::{Point3, Vector3};

use crate::capsule_fit::directions;

/// A mesh with more triangles is simplified before any ray is cast.
const MOST_BEFORE: usize = 40_000;
/// Rays begin so far before a triangle, in metres.
const BEFORE_M: f64 = 1e-5;
/// Directions all around in which a triangle may be seen.
const RAYS: usize = 32;

/// The part of a surface that can be seen from outside, each triangle facing there, in at most
/// [`MOST_VISUAL_TRIANGLES`]; with the edge in metres of the cells in which vertices became one.
pub(super) fn seen_from_outside(surface: &TriangleMesh) -> (TriangleMesh, f64) {
    let mut mesh = welded(surface, 1.0);
    let mut known = HashSet::new();
    mesh.triangles.retain(|triangle| {
        let mut corners = *triangle;
        corners.sort_unstable();
        known.insert(corners)
    });
    let (mesh, before_m) = mesh.simplified(MOST_BEFORE).unwrap_or((mesh, 0.0));
    let caster = RayCaster::new(&mesh);
    let rays: Vec<Vector3<f64>> = directions(RAYS).collect();
    let mut outer = TriangleMesh { vertices: caster.mesh.vertices.clone(), triangles: Vec::new() };
    for ([a, b, c], triangle) in caster.mesh.all_corners().zip(&caster.mesh.triangles) {
        let Some(normal) = (b - a).cross(&(c - a)).try_normalize(0.0) else { continue };
        let middle = Point3::from((a.coords + b.coords + c.coords) / 3.0);
        let free = |side: f64| {
            let outwards = normal * side;
            let leaves = |ray: &&Vector3<f64>| {
                ray.dot(&outwards) > 0.0 && caster.cast(&(middle + outwards * BEFORE_M), ray).is_none()
            };
            rays.iter().filter(leaves).count()
        };
        let [front, back] = [1.0, -1.0].map(free);
        let [a, b, c] = *triangle;
        if front + back > 0 {
            outer.triangles.push(if front >= back { [a, b, c] } else { [a, c, b] });
        }
    }
    outer.drop_unused_vertices();
    let (outer, after_m) = outer.simplified(MOST_VISUAL_TRIANGLES).unwrap_or((outer, 0.0));
    (outer, before_m.max(after_m))
}

#[cfg(test)]
mod tests {
    use super::*;
    use catch_body::shape::Cuboid;

    /// A shell with something inside, turned inside out, of many triangles.
    #[test]
    fn only_the_outside_stays_and_faces_there() {
        let mut mesh = TriangleMesh::sphere(0.1, 6);
        mesh.triangles.iter_mut().step_by(2).for_each(|it| it.swap(0, 1));
        let size = Vector3::repeat(0.05);
        mesh.merge(&TriangleMesh::cuboid(&Cuboid { centre: Point3::origin(), size }));
        let (outer, cell_m) = seen_from_outside(&mesh);
        let count = outer.triangles.len();
        assert!((1_000..=MOST_VISUAL_TRIANGLES).contains(&count) && cell_m > 0.0, "{count}, {cell_m}");
        let off_m = outer.vertices.iter().map(|it| (it.coords.norm() - 0.1).abs()).fold(0.0, f64::max);
        assert!(off_m < 2e-4, "{off_m}");
        assert!((outer.volume() / TriangleMesh::sphere(0.1, 6).volume() - 1.0).abs() < 5e-3, "{}", outer.volume());
    }
}
