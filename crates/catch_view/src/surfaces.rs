//! The surfaces that pictures of a throw show, each in the frame that moves it.

use catch_body::{Gripper, Robot, TriangleMesh};
use serde::Serialize;

/// Flat strips around the capsules of links without a visual shape.
const SEGMENTS: u32 = 24;
/// A surface with more triangles is thinned: more would only make files large.
const MOST_TRIANGLES: usize = 4_000;

/// A surface.
#[derive(Debug, Clone)]
pub struct Surface {
    /// Part that the surface belongs to.
    pub of: Part,
    /// The number of the arm's link whose frame it is in; the gripper's parts are in G, the right finger
    /// around its own centre.
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
    let links = (0..=robot.dof()).map(|link| (link, robot.link_surface(link, SEGMENTS)));
    let mut surfaces: Vec<Surface> = links
        .filter(|(_, mesh)| !mesh.triangles.is_empty())
        .map(|(link, mesh)| Surface { of: Part::Link, link, mesh })
        .collect();
    let [housing, finger] = gripper.surfaces();
    let mut add = |of, mesh| surfaces.push(Surface { of, link: 0, mesh });
    add(Part::Housing, housing);
    add(Part::Finger, finger);
    for obstacle in &robot.obstacles {
        add(Part::Obstacle, obstacle.mesh());
    }
    if let Some(mesh) = object {
        add(Part::Object, thinned(mesh));
    }
    surfaces
}

/// The mesh with so few triangles that pages stay small.
pub fn thinned(mesh: &TriangleMesh) -> TriangleMesh {
    mesh.simplified(MOST_TRIANGLES).map_or_else(|| mesh.clone(), |(fewer, _)| fewer)
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
