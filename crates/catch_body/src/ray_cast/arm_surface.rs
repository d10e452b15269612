//! The surface of an arm, its gripper and what stands around them, for ray casting.

use crate::{
    Gripper,
    kinematics::LinkPoses,
    mesh::TriangleMesh,
    pose::Pose,
    ray_cast::RayCaster,
    robot::{MAX_JOINTS, Robot},
};

/// Flat strips around a capsule: at 48 a link of 80 mm radius is 0.17 mm short between the edges.
const SEGMENTS: u32 = 48;

/// Body that a part of an [`ArmSurface`] belongs to.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SurfacePart {
    /// The link of this number, 0 being the base.
    Link(usize),
    /// The gripper: its housing, or a finger.
    Gripper,
    /// An obstacle around the arm.
    Obstacle,
}

/// The arm's links, the gripper's housing and fingers, and the obstacles, each prepared once in its own
/// frame, so that moving the arm only changes poses.
#[derive(Debug, Clone)]
pub struct ArmSurface {
    /// Links that have a surface, and that surface in the link's frame.
    links: Vec<(usize, RayCaster)>,
    housing: RayCaster,
    /// A finger around its own centre, of both.
    finger: RayCaster,
    /// Obstacles around the arm, in W.
    obstacles: Option<RayCaster>,
    gripper: Gripper,
    X_LG: Pose,
}

impl ArmSurface {
    /// Prepares what cameras see of `robot`, of its obstacles and of `gripper`.
    pub fn new(robot: &Robot, gripper: &Gripper) -> Self {
        let links = (0..=robot.dof()).filter_map(|link| {
            let mesh = robot.link_surface(link, SEGMENTS);
            (!mesh.triangles.is_empty()).then(|| (link, RayCaster::new(&mesh)))
        });
        let mut obstacles = TriangleMesh::default();
        robot.obstacles.iter().for_each(|obstacle| obstacles.merge(&obstacle.mesh()));
        let [housing, finger] = gripper.surfaces();
        Self {
            links: links.collect(),
            housing: RayCaster::new(&housing),
            finger: RayCaster::new(&finger),
            obstacles: (!obstacles.triangles.is_empty()).then(|| RayCaster::new(&obstacles)),
            gripper: gripper.clone(),
            X_LG: robot.X_LG,
        }
    }

    /// Every part with its pose X_WB in W, the gripper at an opening of `width_m`.
    pub fn parts(&self, X_WL: &LinkPoses, width_m: f64) -> impl Iterator<Item = (Pose, &RayCaster)> {
        self.named_parts(X_WL, width_m).map(|(_, X_WB, caster)| (X_WB, caster))
    }

    /// Every part with the body that it belongs to, and otherwise as of [`Self::parts`].
    pub fn named_parts(&self, X_WL: &LinkPoses, width_m: f64) -> impl Iterator<Item = (SurfacePart, Pose, &RayCaster)> {
        let X_WG = X_WL[MAX_JOINTS] * self.X_LG;
        let fingers = self.gripper.finger_poses(width_m);
        let fingers = fingers.map(|X_GF| (SurfacePart::Gripper, X_WG * X_GF, &self.finger));
        let links: [Pose; MAX_JOINTS + 1] = *X_WL;
        let links = self.links.iter().map(move |(link, caster)| (SurfacePart::Link(*link), links[*link], caster));
        let obstacles = self.obstacles.iter().map(|caster| (SurfacePart::Obstacle, Pose::identity(), caster));
        links.chain(std::iter::once((SurfacePart::Gripper, X_WG, &self.housing))).chain(fingers).chain(obstacles)
    }
}
