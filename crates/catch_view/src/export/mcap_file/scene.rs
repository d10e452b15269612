//! Arm, hand and object as shapes that move with their frames.

use catch_body::{Gripper, Pose, Robot, TriangleMesh, visual::Visual};
use nalgebra::Vector3;

use super::messages::{
    Color, CylinderPrimitive, SceneEntity, SizedPrimitive, TriangleListPrimitive, point, pose, time, vector,
};
use crate::export::urdf::segment;

/// The frame W.
pub const WORLD: &str = "world";
/// Frames of the fingers, each in the middle of its box.
pub const FINGERS: [&str; 2] = ["finger_left", "finger_right"];

const ARM: Color = Color { r: 0.75, g: 0.77, b: 0.80, a: 1.0 };
const HAND: Color = Color { r: 0.35, g: 0.37, b: 0.40, a: 1.0 };
const OBSTACLE: Color = Color { r: 0.60, g: 0.65, b: 0.71, a: 1.0 };
const OBJECT: Color = Color { r: 0.95, g: 0.55, b: 0.15, a: 1.0 };

/// The scene at `time_s`: visual shapes or capsules in the frames of the arm's `links`, the gripper in its
/// own, what stands around them in that of the world, and the object's surface where it is known.
pub fn entities(
    robot: &Robot,
    links: &[&str],
    gripper: &Gripper,
    object: Option<&TriangleMesh>,
    time_s: f64,
) -> Vec<SceneEntity> {
    let entity = |frame: &str, content: SceneEntity| SceneEntity {
        timestamp: time(time_s),
        frame_id: frame.to_owned(),
        id: frame.to_owned(),
        frame_locked: true,
        ..content
    };
    let triangles = |mesh: &TriangleMesh, color: Color| TriangleListPrimitive {
        pose: pose(&Pose::identity()),
        points: mesh.vertices.iter().map(point).collect(),
        color: Some(color),
        indices: mesh.triangles.iter().flatten().copied().collect(),
    };
    let of_triangles = |triangles| SceneEntity { triangles, ..SceneEntity::default() };
    let mut entities = Vec::new();
    for (i, link) in links.iter().enumerate() {
        let visual = robot.visuals.get(&i).and_then(Visual::mesh);
        let content = visual.map_or_else(|| capsules(robot, i), |mesh| of_triangles(vec![triangles(mesh, ARM)]));
        entities.push(entity(link, content));
    }
    let cuboid = |X_FB: &Pose, size: &Vector3<f64>| SceneEntity {
        cubes: vec![SizedPrimitive { pose: pose(X_FB), size: vector(size), color: Some(HAND) }],
        ..SceneEntity::default()
    };
    let body = gripper.body();
    let X_GB = Pose::translation(body.centre.x, body.centre.y, body.centre.z);
    let [housing, finger] = match &gripper.visuals {
        Some(_) => gripper.surfaces().map(|mesh| of_triangles(vec![triangles(&mesh, HAND)])),
        None => [cuboid(&X_GB, &body.size), cuboid(&Pose::identity(), &gripper.finger_size_m.into())],
    };
    entities.push(entity("gripper", housing));
    entities.extend(FINGERS.map(|name| entity(name, finger.clone())));
    if !robot.obstacles.is_empty() {
        let obstacles = robot.obstacles.iter().map(|obstacle| triangles(&obstacle.mesh(), OBSTACLE));
        entities.push(entity(WORLD, of_triangles(obstacles.collect())));
    }
    entities.extend(object.map(|mesh| entity("object", of_triangles(vec![triangles(mesh, OBJECT)]))));
    entities
}

/// The capsules of a link.
fn capsules(robot: &Robot, link: usize) -> SceneEntity {
    let mut content = SceneEntity::default();
    for (_, capsule) in robot.capsules.iter().filter(|(of, _)| *of == link) {
        let diameter = Vector3::repeat(2.0 * capsule.radius);
        content.spheres.extend([capsule.from, capsule.to].map(|end| SizedPrimitive {
            pose: pose(&Pose::translation(end.x, end.y, end.z)),
            size: vector(&diameter),
            color: Some(ARM),
        }));
        let (X_LS, length_m) = segment(capsule);
        content.cylinders.push(CylinderPrimitive {
            pose: pose(&X_LS),
            size: vector(&Vector3::new(diameter.x, diameter.y, length_m)),
            bottom_scale: 1.0,
            top_scale: 1.0,
            color: Some(ARM),
        });
    }
    content
}
