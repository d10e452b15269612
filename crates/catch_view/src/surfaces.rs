//! The surfaces that pictures of a throw show, each in the frame that moves it.
//!
//! Where a file brings a visual shape, it is shown. Of built-in hands and objects only what they touch with
//! is known; their look is derived from it.

mod hand;
pub mod paint;
mod thing;

use catch_body::{Gripper, Pose, Robot, TriangleMesh};
use nalgebra::{Translation3, UnitQuaternion, Vector3};
use serde::Serialize;

use paint::{Colour, SHELL, SURROUNDINGS};

/// Flat strips around a link of which only capsules are known.
const SEGMENTS: u32 = 24;
/// A surface with more triangles is thinned: more would only make files large.
const MOST_TRIANGLES: usize = 4_000;

/// A surface.
#[derive(Debug, Clone)]
pub struct Surface {
    /// Part that the surface belongs to.
    pub of: Part,
    /// The number of the arm's link whose frame it is in; the gripper's parts are in G, the right finger
    /// around its own centre. The left finger is the same one after half a turn about y.
    pub link: usize,
    /// Triangles of the surface.
    pub mesh: TriangleMesh,
    /// Colour of the surface.
    pub colour: Colour,
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
    let mut surfaces: Vec<Surface> = Vec::new();
    let mut add = |of, link, mesh: TriangleMesh, colour| surfaces.push(Surface { of, link, mesh, colour });
    for link in 0..=robot.dof() {
        let mesh = robot.link_surface(link, SEGMENTS);
        if !mesh.triangles.is_empty() {
            add(Part::Link, link, mesh, SHELL);
        }
    }
    let hand = [(Part::Housing, hand::housing(gripper)), (Part::Finger, hand::finger(gripper))];
    for (of, (mesh, colour)) in hand.into_iter().flat_map(|(of, pieces)| pieces.into_iter().map(move |it| (of, it))) {
        add(of, 0, mesh, colour);
    }
    for obstacle in &robot.obstacles {
        add(Part::Obstacle, 0, obstacle.mesh(), SURROUNDINGS);
    }
    for (mesh, colour) in object.map(thinned).iter().flat_map(thing::pieces) {
        add(Part::Object, 0, mesh, colour);
    }
    surfaces
}

/// Poses in G of the left and the right finger's surface at an opening of `width_m`.
pub fn finger_poses(gripper: &Gripper, width_m: f64) -> [Pose; 2] {
    let [left, right] = gripper.fingers(width_m).map(|it| Pose::from(Translation3::from(it.centre.coords)));
    [left * UnitQuaternion::from_axis_angle(&Vector3::y_axis(), std::f64::consts::PI), right]
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
