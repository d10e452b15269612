//! The Python package `catchingbot`: throws, evaluations, predictions, registrations and plans, the arena
//! step by step, and the contract for cells of one's own.
//!
//! Every argument is checked before any work begins, and exceptions name it. The interpreter is detached
//! while the lab works, so that other Python threads go on. Arrays are copied in and out. Units are SI;
//! matrices are in monogram notation, as in the rest of the project.

mod arguments;
mod brain;
mod camera;
mod cell_state;
mod command;
mod equipment;
mod evaluation;
mod executor;
mod flight;
mod judge;
mod observation;
mod plan;
mod policy_actor;
mod policy_view;
mod python_brain;
mod python_stages;
mod recording;
mod registration;
mod setup;
mod steered_arena;
mod stepping;
mod trial;
mod viewing;

use pyo3::prelude::*;

/// The native part of the package; `catchingbot` shows all of it.
#[pymodule]
mod _catchingbot {
    #[pymodule_export]
    use crate::{
        brain::{Brain, Recorder},
        camera::Camera,
        cell_state::{ArmState, GripperState, Rejection},
        command::{Command, GripperMove, Trajectory},
        equipment::{Gripper, Robot},
        evaluation::{columns_of, parquet},
        executor::{Executor, GripperQueue},
        flight::{Flight, NoFlight, predict},
        judge::judge,
        observation::{DepthFrame, Observation},
        plan::Plan,
        python_stages::{ObjectPose, Situation},
        recording::Recording,
        registration::{RegisteredPose, register},
        setup::Setup,
        steered_arena::SteeredArena,
        stepping::Arena,
        trial::Trial,
        viewing::viewed,
    };
    use pyo3::prelude::*;

    #[pymodule_init]
    fn init(module: &Bound<'_, PyModule>) -> PyResult<()> {
        module.add("__version__", catch_lab::VERSION)
    }
}
