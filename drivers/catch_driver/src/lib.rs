//! What the drivers of real arms have in common: a [`Cell`](catch_cell::Cell) with the checks of its plans,
//! the sockets of cameras and hands, the enabling key, the recording of every run, and the measurement of the
//! links.
//!
//! A driver adds its arm's protocol ([`drive::Driver`]): a thread that holds the arm and executes checked
//! plans. All times are seconds on the arm's clock since the motion began.

#![allow(clippy::print_stdout, clippy::print_stderr)]

pub mod braking;
pub mod camera_socket;
pub mod cell;
pub mod checker;
pub mod clock;
pub mod control;
pub mod depth_noise;
pub mod doctor;
pub mod drive;
pub mod dry_run;
pub mod enabling_key;
pub mod hand;
pub mod motion;
pub mod program;
pub mod safe_box;
pub mod wsg50;
