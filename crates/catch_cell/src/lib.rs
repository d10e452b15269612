//! The contract: what crosses the wire between a brain that catches and the cell it catches in.
//!
//! A cell (a simulated arena, or the driver of a real robot) hands out [`Observation`]s and takes
//! [`Command`]s. A brain turns one into the other. Everything here is what a driver of a real arm, gripper
//! and set of depth cameras would need, and nothing else: no truth, no score, no simulator. All times are
//! seconds on the cell's clock.

//!
//! Begin with [`Cell`] (what a driver implements), [`Executor`] (how it carries out trajectories, in the
//! arena as with real drives) and [`run`] (the loop in which a cell and a brain meet):
//!
//! ```
//! use std::ops::ControlFlow;
//! use catch_cell::{Brain, Cell, run};
//!
//! /// Lets a brain act for a second; returns how many times it sent the arm a trajectory.
//! fn trajectories_in_a_second<C: Cell>(cell: &mut C, brain: &mut dyn Brain) -> Result<u32, catch_cell::RunError<C::Error>> {
//!     let mut sent = 0;
//!     run(cell, brain, |_, _, observation, command| {
//!         sent += u32::from(command.arm.is_some());
//!         if observation.time_s < 1.0 { ControlFlow::Continue(()) } else { ControlFlow::Break(sent) }
//!     })
//! }
//! ```

pub mod arm;
pub mod camera;
mod cell_fault;
pub mod cell_file;
pub mod executor;
pub mod gripper;
mod knowledge;
mod reference_scan;
mod rejection;
mod rig;
mod rig_calibration;
mod run;
pub mod sight;
pub mod spline;

pub use arm::{ArmState, ArmTrajectory, RejectedTrajectory, TrajectoryId};
pub use camera::{CameraModel, DepthFrame, PixelWindow, ReferenceScan};
pub use cell_fault::CellFault;
pub use executor::{Executor, ExecutorConfig, GripperQueue, LimitCheck};
pub use gripper::{GraspState, GripperMove, GripperState};
pub use knowledge::{DataSheet, KnownObject, ObjectFigures};
pub use reference_scan::reference_scan;
pub use rejection::{LimitKind, LimitViolation, Rejection};
pub use rig::rig_from_toml;
pub use rig_calibration::{RigCalibration, rig_to_toml};
pub use run::{RunError, run};
pub use spline::{BSpline, Setpoint};

use catch_body::quantity;
use serde::{Deserialize, Serialize};

/// Measurements of the cell's sensors at one instant.
#[quantity::checked]
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Observation {
    /// Time of the observation on the cell's clock, in seconds.
    pub time_s: quantity::clock_s,
    /// The arm as its encoders see it.
    pub arm: ArmState,
    /// The gripper as it reports itself.
    pub gripper: GripperState,
    /// Depth images that have arrived since the last observation: any number of them or none, in any order;
    /// the brain sorts them. Their capture times lie in the past by the sensors' latency.
    pub frames: Vec<DepthFrame>,
}

/// Command of the brain to the arm, the gripper and the cameras.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct Command {
    /// Replaces the executing trajectory from its start on; `None` changes nothing.
    pub arm: Option<ArmTrajectory>,
    /// Replaces all gripper moves that have not started, an empty list by none; `None` changes nothing.
    pub gripper: Option<Vec<GripperMove>>,
    /// The part of each camera's next images that the brain wants, one entry per camera; `None` means all
    /// that the cameras give by themselves: full images, or what shows the object where they tell it apart.
    pub windows: Option<Vec<PixelWindow>>,
}

/// A place where things are caught: a simulation or real hardware.
pub trait Cell {
    /// Failure of the cell: [`CellFault`] for real hardware, [`Infallible`](std::convert::Infallible) for a
    /// cell that cannot fail.
    type Error;

    /// Waits for the next sensor tick and returns what was sensed.
    ///
    /// # Errors
    /// If a device cannot be reached or has stopped.
    fn sense(&mut self) -> Result<Observation, Self::Error>;

    /// Passes a command on to arm, gripper and cameras. The next observations report what becomes of its
    /// trajectory.
    ///
    /// # Errors
    /// If a device cannot be reached or has stopped.
    fn act(&mut self, command: &Command) -> Result<(), Self::Error>;
}

/// Controller that decides what to do about what was sensed.
pub trait Brain {
    /// Makes one decision. It cannot fail: what is missing leads to a command that is empty or brings the arm
    /// to rest.
    ///
    /// `probe` is notified of every stage as it ends; it is how times are taken without the brain reading a
    /// clock.
    fn tick(&mut self, observation: &Observation, probe: &mut dyn Probe) -> Command;

    /// Forgets all that was seen and decided, for another throw in the same cell.
    fn reset(&mut self);
}

/// Observer that is notified when a stage of the brain ends.
pub trait Probe {
    /// Called at the end of the stage called `stage`.
    fn stage_ended(&mut self, stage: &'static str);
}

/// Takes no notice.
impl Probe for () {
    fn stage_ended(&mut self, _: &'static str) {}
}
