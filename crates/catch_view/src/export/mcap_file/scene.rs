//! Arm, hand and object as shapes that move with their frames.

use catch_body::{Gripper, Pose, Robot, TriangleMesh};

use super::messages::{Color, SceneEntity, TriangleListPrimitive, point, pose, time};
use crate::surfaces::{Part, Surface, surfaces};

/// The frame W.
pub const WORLD: &str = "world";
/// Frames of the fingers, each in the middle of its box.
pub const FINGERS: [&str; 2] = ["finger_left", "finger_right"];

/// The scene at `time_s`: what moves with each of the arm's `links` in its frame, the gripper in its own,
/// what stands around them in that of the world, and the object's surface where it is known.
pub fn entities(
    robot: &Robot,
    links: &[&str],
    gripper: &Gripper,
    object: Option<&TriangleMesh>,
    time_s: f64,
) -> Vec<SceneEntity> {
    let mut entities: Vec<SceneEntity> = Vec::new();
    for surface in surfaces(robot, gripper, object) {
        let one = |frame| [Some(frame), None];
        let frames = match surface.of {
            Part::Link => one(links[surface.link]),
            Part::Housing => one("gripper"),
            Part::Finger => FINGERS.map(Some),
            Part::Object => one("object"),
            Part::Obstacle => one(WORLD),
        };
        for frame in frames.into_iter().flatten() {
            match entities.iter_mut().find(|it| it.frame_id == frame) {
                Some(entity) => entity.triangles.push(triangles(&surface)),
                None => entities.push(SceneEntity {
                    timestamp: time(time_s),
                    frame_id: frame.to_owned(),
                    id: frame.to_owned(),
                    frame_locked: true,
                    triangles: vec![triangles(&surface)],
                }),
            }
        }
    }
    entities
}

fn triangles(surface: &Surface) -> TriangleListPrimitive {
    let [r, g, b] = surface.colour;
    TriangleListPrimitive {
        pose: pose(&Pose::identity()),
        points: surface.mesh.vertices.iter().map(point).collect(),
        color: Some(Color { r, g, b, a: 1.0 }),
        indices: surface.mesh.triangles.iter().flatten().copied().collect(),
    }
}
