//! Physics, servo and truth of the arena, against theory and against another engine.

mod aerodynamics;
mod allocation;
mod catch_table;
mod contacts;
mod energy;
mod free_motion;
mod free_rotation;
mod gripper;
mod published;
mod random_streams;
mod scenes;
mod servo;
mod setting;
