//! The arena: a simulated cell in which things are thrown at an arm.
//!
//! [`Arena`] is a [`catch_cell::Cell`] like any other. Behind it stand the physics of arm, gripper and thrown
//! object ([`physics`]), the robot controller that follows the commanded trajectories and watches the limits
//! ([`servo`]), and the gripper's drive ([`gripper_drive`]). What really happened is in [`Truth`], which the
//! brain cannot reach: it is not part of the contract.
//!
//! A scene is a pure function of its files, its seed and its index; see [`random_streams`].
//!
//! Begin with [`Arena`] (the cell), [`ArenaConfig`] (the settings of a scenario's `[arena]`) and
//! [`FreeFlight`] (how an object flies between contacts):
//!
//! ```
//! use catch_body::JointVector;
//! use catch_cell::{Cell, Command};
//! use catch_sim::{Arena, Equipment, Release};
//!
//! /// How wide the gripper stands 0.1 s after the release of a throw, nothing being commanded.
//! fn width_after_a_moment(equipment: &Equipment, release: &Release, waiting: (&JointVector, f64)) -> f64 {
//!     let mut arena = Arena::new(equipment, release, waiting, 1, 0);
//!     loop {
//!         let Ok(observation) = arena.sense();
//!         let Ok(()) = arena.act(&Command::default());
//!         if observation.time_s > 0.1 {
//!             return observation.gripper.width_m;
//!         }
//!     }
//! }
//! ```

pub mod aerodynamics;
pub mod arena;
pub mod camera_faults;
pub mod cameras;
pub mod conditions;
pub mod config;
mod convert;
mod convex_parts;
pub mod depth_noise;
pub mod drawn;
pub mod encoders;
pub mod equipment;
pub mod free_flight;
pub mod gripper_drive;
mod link_surfaces;
pub mod object;
pub mod object_shape;
pub mod person;
pub mod physics;
pub mod random_streams;
mod sensors;
pub mod servo;
pub mod throw;
pub mod throw_conditions;
pub mod truth;

pub use arena::Arena;
pub use conditions::Conditions;
pub use config::{ArenaConfig, GripperDriveKind};
pub use equipment::Equipment;
pub use free_flight::FreeFlight;
pub use object::ThrownObject;
pub use throw::{Release, Throw};
pub use throw_conditions::{FlightConditions, ThrowConditions};
pub use truth::{Contact, ServoReport, Truth, TruthSample};
