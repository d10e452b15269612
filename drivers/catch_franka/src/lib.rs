//! Driver of the arms of Franka Robotics: FR3 (protocol 10) and Panda (protocol 5), with the Franka Hand.
//!
//! A thread of its own answers each state of the robot within its millisecond ([`control`]) by the set-point
//! that [`setpoint::Cycle`] computes. Plans are checked in the brain's thread.

pub mod control;
pub mod franka_hand;
pub mod margin;
pub mod setpoint;

use std::sync::Arc;

use anyhow::Context;
use catch_body::{Robot as Arm, robot::ContactStop};
use catch_driver::{
    clock::Clock,
    control::Control,
    drive::{ConnectFingers, Driver},
    dry_run::NextState,
    enabling_key::EnablingKey,
    wsg50,
};
use catch_recording::drive_job::DriveJob;
use franka::{FrankaResult, RealtimeConfig, Robot};

/// Sets the thresholds above which the robot takes a contact for a collision, and stops, to those that
/// `robot.toml` states; without any the robot keeps its own. At the joints it is what the motors can give. An
/// object of 0.1 kg that loses 3 m/s within 5 ms pushes with 60 N, at half a metre from a joint with 30 N·m.
///
/// # Errors
/// If the robot does not take them.
pub fn allow_contact(robot: &Robot, arm: &Arm) -> FrankaResult<()> {
    let Some(ContactStop { force_n, moment_nm }) = arm.contact_stop else { return Ok(()) };
    let most_torque = std::array::from_fn(|i| arm.joints.get(i).map_or(0.0, |it| it.limits.torque));
    let most_at_hand = [force_n, force_n, force_n, moment_nm, moment_nm, moment_nm];
    robot.set_collision_behavior_simple(most_torque, most_torque, most_at_hand, most_at_hand)
}

/// The driver.
#[derive(Debug)]
pub struct Franka;

impl Driver for Franka {
    const HANDS: &'static [(&'static str, ConnectFingers)] =
        &[("franka_hand", franka_hand::connect), ("wsg50", wsg50::connect)];

    fn margin(longest_run: u64) -> Option<f64> {
        margin::acceleration_ratio(longest_run)
    }

    fn hold(job: &DriveJob, arm: &Arm, key: &EnablingKey) -> anyhow::Result<Control> {
        let robot = connect(job)?;
        // It clears what made the robot stop before, and does nothing else.
        let _ = robot.automatic_error_recovery();
        allow_contact(&robot, arm).context("the thresholds of collisions")?;
        Ok(control::begin(Arc::new(robot), arm.clone(), key.clone(), Clock::Host))
    }

    fn watch(job: &DriveJob, _: &Arm) -> anyhow::Result<NextState> {
        let robot = connect(job)?;
        Ok(Box::new(move || robot.read_once().map(drop).map_err(|fault| fault.to_string())))
    }
}

fn connect(job: &DriveJob) -> anyhow::Result<Robot> {
    let address = &job.links.arm.address;
    Robot::new(address, RealtimeConfig::Ignore).with_context(|| format!("the arm at {address}"))
}
