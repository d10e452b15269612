//! What stands in a cell before anything is thrown.

use std::sync::Arc;

use catch_body::{Gripper, Robot, clearance::ArmClearance};
use catch_cell::CameraModel;

use crate::{cameras::Renderer, config::ArenaConfig, object::ThrownObject, physics::FreeBody};

/// Arm, gripper, cameras and the object to be thrown, prepared once for any number of throws. Clones share it.
#[derive(Debug, Clone)]
pub struct Equipment {
    pub(crate) shared: Arc<Shared>,
}

/// What [`Equipment`] holds.
#[derive(Debug)]
pub(crate) struct Shared {
    pub config: ArenaConfig,
    /// Without the gripper's mass.
    pub robot: Robot,
    /// With it.
    pub robot_with_gripper: Robot,
    pub gripper: Gripper,
    pub object: ThrownObject,
    /// The object without contacts.
    pub body: FreeBody,
    pub renderer: Renderer,
    /// As calibrated.
    pub cameras: Vec<CameraModel>,
    pub clearance: ArmClearance,
}

impl Equipment {
    /// Prepares a cell. `robot` comes without the gripper's mass; `config` has been checked; `cameras` are as calibrated.
    pub fn new(
        config: ArenaConfig,
        mut robot: Robot,
        mut gripper: Gripper,
        object: ThrownObject,
        cameras: Vec<CameraModel>,
    ) -> Self {
        if config.published_gripper {
            gripper = gripper.as_published();
        }
        if !config.rotors {
            robot.joints.iter_mut().for_each(|joint| joint.rotor_inertia = 0.0);
        }
        let shared = Shared {
            renderer: Renderer::new(&robot, &gripper, &object.mesh, config.floor_visible),
            cameras,
            clearance: ArmClearance::new(&robot, &gripper),
            robot_with_gripper: robot.clone().carrying(&gripper),
            config,
            robot,
            gripper,
            body: FreeBody::of(&object),
            object,
        };
        Self { shared: Arc::new(shared) }
    }
}
