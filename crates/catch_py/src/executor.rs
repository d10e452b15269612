//! The executor of commands, for cells that are written in Python.

use std::sync::Mutex;

use catch_body::quantity;
use catch_cell::{Executor as CellExecutor, ExecutorConfig, GripperQueue as CellQueue, RejectedTrajectory};
use numpy::PyArray2;
use pyo3::prelude::*;

use crate::{
    arguments::{instance, joints, locked},
    cell_state::{ArmState, Rejection, quantity, setpoint_array},
    command::{GripperMove, Trajectory},
    equipment::{Gripper, Robot},
};

/// The trajectory queue of an arm: checks what arrives, splices each trajectory into the one before it, and
/// samples the set-point.
#[pyclass(frozen, module = "catchingbot")]
pub struct Executor {
    executor: Mutex<CellExecutor>,
    dof: usize,
}

#[pymethods]
impl Executor {
    /// Holds the arm at `q`, or where it waits. The limits of its torques count with the gripper's weight.
    #[new]
    #[pyo3(signature = (robot, gripper, q=None))]
    fn new(robot: &Robot, gripper: &Gripper, q: Option<&Bound<'_, PyAny>>) -> PyResult<Self> {
        let dof = robot.model.dof();
        let q = q.map_or(Ok(robot.model.ready_q), |it| joints("q", it, dof))?;
        let arm = robot.model.clone().carrying(&gripper.model);
        Ok(Self { executor: Mutex::new(CellExecutor::new(arm, q, ExecutorConfig::default())), dof })
    }

    /// Takes a trajectory that arrives at `now_s`: it replaces from its start on all that was queued. If it
    /// is not taken: why; the next `arm_state` tells the brain.
    fn receive(&self, trajectory: &Bound<'_, PyAny>, now_s: &Bound<'_, PyAny>) -> PyResult<Option<Rejection>> {
        let trajectory: &Trajectory = instance("trajectory", trajectory, "a Trajectory")?;
        let now_s = quantity("now_s", now_s, &quantity::CLOCK_S)?;
        let id = trajectory.sent.id;
        let rejected = |reason| Rejection { rejected: RejectedTrajectory { id, reason } };
        Ok(locked(&self.executor).receive(&trajectory.sent, now_s).err().map(rejected))
    }

    /// Position, velocity and acceleration of the joints that the arm should have at `time_s`, one a row. No
    /// earlier time is asked for afterwards.
    fn advance<'py>(&self, py: Python<'py>, time_s: &Bound<'py, PyAny>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let time_s = quantity("time_s", time_s, &quantity::CLOCK_S)?;
        setpoint_array(py, &locked(&self.executor).advance(time_s), self.dof)
    }

    /// The state that the brain is told, with what was rejected since the last call: `q` and `dq` as the
    /// encoders have them at `time_s`.
    fn arm_state(&self, time_s: &Bound<'_, PyAny>, q: &Bound<'_, PyAny>, dq: &Bound<'_, PyAny>) -> PyResult<ArmState> {
        let (q, dq) = (joints("q", q, self.dof)?, joints("dq", dq, self.dof)?);
        let time_s = quantity("time_s", time_s, &quantity::CLOCK_S)?;
        Ok(ArmState { sensed: locked(&self.executor).arm_state(time_s, q, dq), dof: self.dof })
    }
}

/// Moves that the fingers have not begun, soonest first.
#[pyclass(frozen, module = "catchingbot")]
#[derive(Default)]
pub struct GripperQueue {
    queue: Mutex<CellQueue>,
}

#[pymethods]
impl GripperQueue {
    #[new]
    fn new() -> Self {
        Self::default()
    }

    /// Replaces all moves that have not started at `now_s`. One that should have started starts at once.
    fn receive(&self, moves: &Bound<'_, PyAny>, now_s: &Bound<'_, PyAny>) -> PyResult<()> {
        let moves = GripperMove::list(moves, "moves")?;
        let now_s = quantity("now_s", now_s, &quantity::CLOCK_S)?;
        locked(&self.queue).receive(&moves, now_s);
        Ok(())
    }

    /// Takes out the soonest move if the fingers begin it by `time_s`: `latency_s` after its start.
    #[pyo3(signature = (time_s, latency_s=None), text_signature = "($self, time_s, latency_s=0.0)")]
    fn take_due(
        &self,
        time_s: &Bound<'_, PyAny>,
        latency_s: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<Option<GripperMove>> {
        let time_s = quantity("time_s", time_s, &quantity::CLOCK_S)?;
        let latency_s = latency_s.map_or(Ok(0.0), |it| quantity("latency_s", it, &quantity::LATENCY_S))?;
        let mut queue = locked(&self.queue);
        Ok(queue.take_due(time_s, |start_s| start_s + latency_s).map(GripperMove::from))
    }
}
