//! Driver of the arms of ROS 2: a `joint_trajectory_controller` of `ros2_control` gets each plan as a
//! `trajectory_msgs/JointTrajectory`, and `sensor_msgs/JointState` says where the arm is. ROS itself is not
//! needed.
//!
//! The address of the arm in a cell's file is the name of the controller, such as
//! `/joint_trajectory_controller`; the domain is that of `ROS_DOMAIN_ID`.

pub mod control;
pub mod messages;

use catch_body::Robot as Arm;
use catch_driver::{
    clock::Clock,
    control::Control,
    drive::{ConnectFingers, Driver},
    dry_run::NextState,
    enabling_key::EnablingKey,
    wsg50,
};
use catch_recording::drive_job::DriveJob;

use crate::control::Controller;

/// The driver.
#[derive(Debug)]
pub struct Ros2;

impl Driver for Ros2 {
    const HANDS: &'static [(&'static str, ConnectFingers)] = &[("wsg50", wsg50::connect)];

    /// The controller follows a plan by itself: there are no answers to lose.
    fn margin(_: u64) -> Option<f64> {
        Some(1.0)
    }

    fn hold(job: &DriveJob, arm: &Arm, key: &EnablingKey) -> anyhow::Result<Control> {
        let controller = Controller::connect(&job.links.arm.address, arm)?;
        Ok(control::begin(controller, arm.clone(), key.clone(), Clock::Host))
    }

    fn watch(job: &DriveJob, arm: &Arm) -> anyhow::Result<NextState> {
        let controller = Controller::connect(&job.links.arm.address, arm)?;
        Ok(Box::new(move || controller.next_state(control::START).map(drop)))
    }
}
