//! Driver of the arms of Franka Robotics: a [`Cell`](catch_cell::Cell) on the control interface of FR3
//! (protocol 10) and Panda (protocol 5), with the Franka Hand.
//!
//! A thread of its own answers each state of the robot within its millisecond ([`control`]) by the set-point
//! that [`setpoint::Cycle`] computes. Plans are checked in the brain's thread ([`cell`]). All times are
//! seconds on the robot's clock since the motion began.

pub mod camera_socket;
pub mod cell;
pub mod clock;
pub mod control;
pub mod depth_noise;
pub mod doctor;
pub mod drive;
pub mod dry_run;
pub mod enabling_key;
pub mod hand;
pub mod margin;
pub mod motion;
pub mod safe_box;
pub mod setpoint;
