//! The surfaces that pictures of a throw show, each in the frame that moves it.

use std::collections::HashMap;

use catch_body::{Gripper, Robot, TriangleMesh, shape::Cuboid};
use nalgebra::Point3;
use serde::Serialize;

/// Flat strips around the arm's capsules.
const SEGMENTS: u32 = 24;
/// A surface with more triangles is thinned: more would only make files large.
const MOST_TRIANGLES: usize = 4_000;

/// A surface.
#[derive(Debug, Clone)]
pub struct Surface {
    /// Part that the surface belongs to.
    pub of: Part,
    /// The number of the arm's link whose frame it is in; the gripper's parts are in G, a finger around its
    /// own centre.
    pub link: usize,
    /// Triangles of the surface.
    pub mesh: TriangleMesh,
}

/// Part that a surface belongs to.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Part {
    /// A link of the arm.
    Link,
    /// The gripper's housing.
    Housing,
    /// Either finger.
    Finger,
    /// The thrown object.
    Object,
    /// A body around the arm, in W.
    Obstacle,
}

/// Arm, gripper, obstacles and, where its surface is known, object.
pub fn surfaces(robot: &Robot, gripper: &Gripper, object: Option<&TriangleMesh>) -> Vec<Surface> {
    let links = robot.capsules.iter();
    let mut surfaces: Vec<Surface> = links
        .map(|(link, capsule)| Surface { of: Part::Link, link: *link, mesh: TriangleMesh::capsule(capsule, SEGMENTS) })
        .collect();
    let finger = Cuboid { centre: Point3::origin(), size: gripper.finger_size_m.into() };
    let mut add = |of, mesh| surfaces.push(Surface { of, link: 0, mesh });
    add(Part::Housing, TriangleMesh::cuboid(&gripper.body()));
    add(Part::Finger, TriangleMesh::cuboid(&finger));
    for obstacle in &robot.obstacles {
        add(Part::Obstacle, obstacle.mesh());
    }
    if let Some(mesh) = object {
        add(Part::Object, thinned(mesh));
    }
    surfaces
}

/// The mesh with corners that share a box of a grid brought together, the grid as fine as the number of
/// triangles allows.
///
/// (Rossignac & Borrel, Multi-resolution 3D approximations for rendering complex scenes, 1993.)
pub fn thinned(mesh: &TriangleMesh) -> TriangleMesh {
    let mut boxes = 256.0;
    let mut thin = mesh.clone();
    while thin.triangles.len() > MOST_TRIANGLES || thin.vertices.len() > usize::from(u16::MAX) {
        thin = clustered(mesh, mesh.aabb().size.max() / boxes);
        boxes /= 1.5;
    }
    thin
}

fn clustered(mesh: &TriangleMesh, size_m: f64) -> TriangleMesh {
    let mut clusters: HashMap<[i64; 3], u32> = HashMap::new();
    let mut vertices = Vec::new();
    let index_of = |vertex: &Point3<f64>| {
        let key: [i64; 3] = vertex.coords.map(|value| (value / size_m).round() as i64).into();
        *clusters.entry(key).or_insert_with(|| {
            vertices.push(*vertex);
            (vertices.len() - 1) as u32
        })
    };
    let indices: Vec<u32> = mesh.vertices.iter().map(index_of).collect();
    let triangles = mesh.triangles.iter().map(|triangle| triangle.map(|vertex| indices[vertex as usize]));
    let triangles = triangles.filter(|[a, b, c]| a != b && b != c && c != a).collect();
    TriangleMesh { vertices, triangles }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fine_meshes_are_thinned_and_keep_their_shape() {
        let fine = TriangleMesh::sphere(0.1, 6);
        assert!(fine.triangles.len() > MOST_TRIANGLES);
        let thin = thinned(&fine);
        assert!(thin.triangles.len() <= MOST_TRIANGLES && thin.triangles.len() > 1_000, "{}", thin.triangles.len());
        assert!((thin.volume() / fine.volume() - 1.0).abs() < 0.03, "{}", thin.volume() / fine.volume());
        let coarse = TriangleMesh::sphere(0.1, 3);
        assert_eq!(thinned(&coarse), coarse);
    }
}
