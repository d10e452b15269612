//! Driver of the arms of Franka Robotics: a [`Cell`](catch_cell::Cell) on the control interface of FR3
//! (protocol 10) and Panda (protocol 5), with the Franka Hand.
//!
//! A thread of its own answers each state of the robot within its millisecond ([`control`]) by the set-point
//! that [`setpoint::Cycle`] computes. Plans are checked in the brain's thread ([`cell`]). All times are seconds
//! on the robot's clock since the connection began.

pub mod motion;
pub mod setpoint;
