//! Equipment of a cell before anything is thrown.

use std::sync::Arc;

use catch_body::{Gripper, JointVector, Robot, clearance::ArmClearance};
use catch_cell::CameraModel;

use crate::{cameras::Renderer, config::ArenaConfig, object::ThrownObject, throw::Release};

/// Arm, gripper, cameras and the object to be thrown, prepared once for any number of throws. Clones share
/// it.
#[derive(Debug, Clone)]
pub struct Equipment {
    pub(crate) shared: Arc<Shared>,
}

/// Contents of [`Equipment`].
#[derive(Debug)]
pub(crate) struct Shared {
    pub config: ArenaConfig,
    /// The arm without the gripper's mass.
    pub robot: Robot,
    /// The arm with the gripper's mass.
    pub robot_with_gripper: Robot,
    pub gripper: Gripper,
    pub object: ThrownObject,
    pub renderer: Renderer,
    /// Cameras as calibrated.
    pub cameras: Vec<CameraModel>,
    pub clearance: ArmClearance,
}

impl Equipment {
    /// Prepares a cell. `robot` comes without the gripper's mass; `config` has been checked; `cameras` are as
    /// calibrated.
    pub fn new(
        config: ArenaConfig,
        robot: Robot,
        mut gripper: Gripper,
        object: ThrownObject,
        cameras: Vec<CameraModel>,
    ) -> Self {
        gripper.is_published |= config.published_gripper;
        let robot = robot.with_mount_of(&gripper);
        let shared = Shared {
            renderer: Renderer::new(&robot, &gripper, &object.mesh, config.floor_visible),
            cameras,
            clearance: ArmClearance::new(&robot, &gripper),
            robot_with_gripper: robot.clone().carrying(&gripper),
            config,
            robot,
            gripper,
            object,
        };
        Self { shared: Arc::new(shared) }
    }

    /// Returns whether a released object is farther from floor, obstacles and the arm at `q` than it is
    /// large; quick, and `false` for some that are clear of them all the same.
    pub fn has_in_the_open(&self, release: &Release, q: &JointVector) -> bool {
        let Shared { robot, clearance, object, .. } = &*self.shared;
        let radius = object.bounding_radius_m;
        clearance.least_distance_to_ball(&robot.link_poses(q), &release.p_WO, radius).min(release.p_WO.z - radius) > 0.0
    }
}
