//! Fewer triangles for a surface that has more than anything here can make use of.

use std::collections::HashMap;

use nalgebra::{Matrix3, Point3, Vector3};

use super::TriangleMesh;

/// A vertex stays this near to the middle of its cell where the planes around it leave it free, as a weight
/// against theirs.
const STAYS: f64 = 1e-2;
/// Edges of cells that are tried, each so much longer than the last.
const GROWTH: f64 = 1.25;
const MOST_TRIALS: usize = 20;

impl TriangleMesh {
    /// Simplifies a surface to at most `most` triangles; also returns the edge in metres of the cells in
    /// which vertices became one. `None` if the surface has no more triangles anyway.
    ///
    /// Vertices in one cube of a grid become one, where the squared distances from the planes of their
    /// triangles are least, so that sharp edges stay (Lindstrom, Out-of-core simplification of large
    /// polygonal models, 2000). A closed surface stays closed.
    pub fn simplified(&self, most: usize) -> Option<(Self, f64)> {
        if self.triangles.len() <= most {
            return None;
        }
        let area_m2: f64 = self.all_corners().map(|[a, b, c]| (b - a).cross(&(c - a)).norm() / 2.0).sum();
        // On a plane two triangles come on each square.
        let mut cell_m = (2.0 * area_m2 / most as f64).sqrt();
        for _ in 0..MOST_TRIALS {
            let fewer = clustered(self, cell_m);
            if fewer.triangles.len() <= most {
                return Some((fewer, cell_m));
            }
            cell_m *= GROWTH;
        }
        None
    }
}

/// Contents of a cell: its vertices' sum and number, and the planes of the triangles there.
#[derive(Clone, Default)]
struct Cell {
    sum: Vector3<f64>,
    count: f64,
    normals: Matrix3<f64>,
    offsets: Vector3<f64>,
}

fn clustered(mesh: &TriangleMesh, cell_m: f64) -> TriangleMesh {
    let low = mesh.aabb().centre - mesh.aabb().size / 2.0;
    let mut number: HashMap<[i32; 3], u32> = HashMap::new();
    let mut cells: Vec<Cell> = Vec::new();
    let of_vertex: Vec<u32> = mesh
        .vertices
        .iter()
        .map(|vertex| {
            let at = <[f64; 3]>::from((vertex - low) / cell_m).map(|it| it as i32);
            let cell = *number.entry(at).or_insert_with(|| {
                cells.push(Cell::default());
                cells.len() as u32 - 1
            });
            cells[cell as usize].sum += vertex.coords;
            cells[cell as usize].count += 1.0;
            cell
        })
        .collect();
    let middles: Vec<Point3<f64>> = cells.iter().map(|it| Point3::from(it.sum / it.count)).collect();
    for (corners, triangle) in mesh.all_corners().zip(&mesh.triangles) {
        let normal = (corners[1] - corners[0]).cross(&(corners[2] - corners[0]));
        let Some(unit) = normal.try_normalize(0.0) else { continue };
        let weight = normal.norm();
        for vertex in triangle {
            let cell = of_vertex[*vertex as usize] as usize;
            cells[cell].normals += unit * unit.transpose() * weight;
            cells[cell].offsets += unit * (unit.dot(&(corners[0] - middles[cell])) * weight);
        }
    }
    let vertices = cells.iter().zip(&middles).map(|(cell, middle)| {
        let stiffness = cell.normals + Matrix3::identity() * (STAYS * cell.normals.trace());
        let moved = stiffness.cholesky().map(|it| it.solve(&cell.offsets));
        middle + moved.filter(|it| it.norm() < cell_m).unwrap_or_default()
    });
    let corners = mesh.triangles.iter().map(|triangle| triangle.map(|vertex| of_vertex[vertex as usize]));
    let triangles = corners.filter(|[a, b, c]| a != b && b != c && c != a).collect();
    let mut fewer = TriangleMesh { vertices: vertices.collect(), triangles };
    fewer.drop_unused_vertices();
    fewer
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{mesh_file::welded, shape::Cuboid};

    #[test]
    fn a_simpler_surface_is_closed_and_keeps_its_volume() {
        let sphere = TriangleMesh::sphere(0.05, 6);
        let (fewer, cell_m) = sphere.simplified(10_000).unwrap();
        assert!(fewer.triangles.len() <= 10_000 && fewer.is_closed() && cell_m < 0.004);
        assert!((fewer.volume() / sphere.volume() - 1.0).abs() < 2e-3, "{}", fewer.volume() / sphere.volume());
        assert!(fewer.simplified(10_000).is_none());
    }

    #[test]
    fn edges_stay_sharp() {
        let size = Vector3::new(0.1, 0.07, 0.05);
        let mut block = TriangleMesh::cuboid(&Cuboid { centre: Point3::origin(), size });
        for _ in 0..6 {
            let mut finer = TriangleMesh::default();
            for [a, b, c] in block.all_corners() {
                let [ab, bc, ca] = [nalgebra::center(&a, &b), nalgebra::center(&b, &c), nalgebra::center(&c, &a)];
                let vertices = vec![a, b, c, ab, bc, ca];
                finer.merge(&TriangleMesh { vertices, triangles: vec![[0, 3, 5], [3, 1, 4], [5, 4, 2], [3, 4, 5]] });
            }
            block = finer;
        }
        let (fewer, _) = welded(&block, 1.0).simplified(6_000).unwrap();
        assert!(fewer.is_closed());
        assert!((fewer.aabb().size - size).amax() < 1e-4, "{}", fewer.aabb().size);
        assert!((fewer.volume() / size.product() - 1.0).abs() < 2e-3, "{}", fewer.volume() / size.product());
    }
}
