//! The surface where a signed distance is zero, by marching tetrahedra (Doi and Koide, An efficient method of
//! triangulating equi-valued surfaces by using tetrahedral cells, 1991).
//!
//! Each cube of a grid is cut into six tetrahedra around one diagonal, the same in all cubes, so that faces
//! of neighbours match and the surface is closed.

use std::collections::HashMap;

use nalgebra::{Point3, Vector3};

use catch_body::{TriangleMesh, shape::Cuboid};

/// Nodes of a grid at most: 256 along each axis.
const MOST_NODES: f64 = 1.7e7;
/// Nodes are no nearer to the surface than this fraction of the spacing, so that no triangle degenerates.
const LEAST_FRACTION: f64 = 1e-3;
/// Corners of a cube, bit by bit x, y and z, in the order in which each of its tetrahedra goes from 0 to 7.
const TETRAHEDRA: [[usize; 4]; 6] =
    [[0, 1, 3, 7], [0, 3, 2, 7], [0, 2, 6, 7], [0, 6, 4, 7], [0, 4, 5, 7], [0, 5, 1, 7]];

/// The surface in a box where `distance_m`, negative inside, is zero; `spacing_m` is the edge of the grid's
/// cubes, which is made coarser where there would be too many. Where the inside leaves the box the surface is
/// cut off there.
pub fn isosurface(bounds: &Cuboid, spacing_m: f64, distance_m: impl Fn(&Point3<f64>) -> f64) -> TriangleMesh {
    let cubes = bounds.size.map(|it| (it / spacing_m).ceil() + 3.0).product();
    let spacing_m = spacing_m * libm::cbrt(cubes / MOST_NODES).max(1.0);
    // A layer of nodes all around is outside whatever the distance says.
    let [nx, ny, nz] = <[usize; 3]>::from(bounds.size.map(|it| (it / spacing_m).ceil() as usize + 3));
    let lowest = bounds.centre - Vector3::new(nx as f64 - 1.0, ny as f64 - 1.0, nz as f64 - 1.0) * (spacing_m / 2.0);
    let place = |node: usize| {
        let [x, y, z] = [node % nx, node / nx % ny, node / (nx * ny)];
        (lowest + Vector3::new(x as f64, y as f64, z as f64) * spacing_m, [x, y, z])
    };
    let least_m = LEAST_FRACTION * spacing_m;
    let values: Vec<f64> = (0..nx * ny * nz)
        .map(|node| {
            let (at, [x, y, z]) = place(node);
            let is_edge = [(x, nx), (y, ny), (z, nz)].iter().any(|(i, count)| *i == 0 || i + 1 == *count);
            let value = distance_m(&at);
            if is_edge { value.abs().max(least_m) } else { value.abs().max(least_m).copysign(value) }
        })
        .collect();

    let mut mesh = TriangleMesh::default();
    let mut known: HashMap<(usize, usize), u32> = HashMap::new();
    let mut vertex = |mesh: &mut TriangleMesh, a: usize, b: usize| {
        *known.entry((a.min(b), a.max(b))).or_insert_with(|| {
            let (low, high) = (a.min(b), a.max(b));
            let fraction = values[low] / (values[low] - values[high]);
            let from = place(low).0;
            mesh.vertices.push(from + (place(high).0 - from) * fraction);
            mesh.vertices.len() as u32 - 1
        })
    };
    let stride = [1, nx, nx * ny];
    for first in 0..values.len() {
        let [x, y, z] = place(first).1;
        if x + 1 == nx || y + 1 == ny || z + 1 == nz {
            continue;
        }
        for corners in TETRAHEDRA {
            let nodes = corners.map(|it| first + (0..3).map(|axis| (it >> axis & 1) * stride[axis]).sum::<usize>());
            let inside: Vec<usize> = (0..4).filter(|i| values[nodes[*i]] < 0.0).collect();
            let outside: Vec<usize> = (0..4).filter(|i| values[nodes[*i]] >= 0.0).collect();
            let mut between = |i: usize, o: usize| vertex(&mut mesh, nodes[i], nodes[o]);
            let polygon = match (&inside[..], &outside[..]) {
                ([i], [a, b, c]) | ([a, b, c], [i]) => vec![between(*i, *a), between(*i, *b), between(*i, *c)],
                ([i, j], [a, b]) => vec![between(*i, *a), between(*i, *b), between(*j, *b), between(*j, *a)],
                _ => continue,
            };
            // Outwards is from the inside to the outside.
            let mean = |which: &[usize]| {
                which.iter().map(|i| place(nodes[*i]).0.coords).sum::<Vector3<f64>>() / which.len() as f64
            };
            let outwards = mean(&outside) - mean(&inside);
            let [p, q, r] = [0, 1, 2].map(|i| mesh.vertices[polygon[i] as usize]);
            let is_outward = (q - p).cross(&(r - p)).dot(&outwards) > 0.0;
            for i in 1..polygon.len() - 1 {
                let (one, two) = if is_outward { (i, i + 1) } else { (i + 1, i) };
                mesh.triangles.push([polygon[0], polygon[one], polygon[two]]);
            }
        }
    }
    mesh
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_surface_of_a_ball_is_closed_and_holds_its_volume() {
        let bounds = Cuboid { centre: Point3::new(0.01, 0.0, 0.0), size: Vector3::repeat(0.1) };
        let ball = isosurface(&bounds, 0.002, |p| (p - bounds.centre).norm() - 0.04);
        let volume = 4.0 / 3.0 * std::f64::consts::PI * 0.04_f64.powi(3);
        assert!(ball.is_closed() && (ball.volume() / volume - 1.0).abs() < 0.005, "{}", ball.volume() / volume);
        assert!(ball.vertices.iter().all(|it| ((it - bounds.centre).norm() - 0.04).abs() < 1e-4));
    }

    #[test]
    fn a_surface_that_leaves_the_box_is_cut_off() {
        let bounds = Cuboid { centre: Point3::origin(), size: Vector3::repeat(0.02) };
        let half = isosurface(&bounds, 0.002, |p| p.z);
        assert!(half.is_closed() && half.volume() > 0.0 && half.aabb().size.max() < 0.03);
    }
}
