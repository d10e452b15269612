//! The arena, tick by tick.

use std::{
    sync::{Arc, Mutex},
    time::Instant,
};

use catch_lab::{
    evaluation::{self, Row},
    referee,
    scenario::setup::Setup,
    trial::{Episode, StateSnapshot, stopwatch::Stopwatch},
};
use pyo3::{
    exceptions::PyRuntimeError,
    prelude::*,
    types::{PyBytes, PyDict},
};

use crate::{
    arguments::{fault, instance, json_dict, locked},
    command::Command,
    observation::Observation,
    trial::line,
};

/// One throw: its episode until it is judged, then its row.
pub struct Throw {
    setup: Arc<Setup>,
    scene: (u64, u64),
    /// Episode of the throw, until it is judged.
    pub episode: Option<Box<Episode>>,
    row: Option<Row>,
}

impl Throw {
    /// Throw number `index` of `seed`.
    pub fn new(setup: &Arc<Setup>, seed: u64, index: u64) -> Self {
        let episode = Some(Box::new(Episode::new(setup, seed, index)));
        Self { setup: setup.clone(), scene: (seed, index), episode, row: None }
    }

    /// The episode, as long as it goes on.
    pub fn flying(&mut self) -> PyResult<&mut Episode> {
        self.episode.as_deref_mut().ok_or_else(|| PyRuntimeError::new_err("arena: the throw is done"))
    }

    /// Lets the referee judge once the throw is over; whether it is.
    pub fn judge_at_end(&mut self) -> bool {
        if let Some(episode) = self.episode.take_if(|it| it.is_done()) {
            let verdict = referee::judge(&self.setup, &episode.into_trial(Stopwatch::default()));
            self.row = Some(evaluation::row(&self.setup, self.scene.0, self.scene.1, verdict));
        }
        self.row.is_some()
    }

    /// The row in an evaluation, once the throw is done.
    pub fn row(&self) -> PyResult<&Row> {
        self.row.as_ref().ok_or_else(|| PyRuntimeError::new_err("arena: the throw is not done"))
    }
}

/// Works on what an arena holds until it is closed.
pub fn with<S: Send, T: Send>(
    py: Python<'_>,
    state: &Mutex<Option<S>>,
    work: impl FnOnce(&mut S) -> PyResult<T> + Send,
) -> PyResult<T> {
    py.detach(|| work(locked(state).as_mut().ok_or_else(|| PyRuntimeError::new_err("arena: it is closed"))?))
}

/// One throw in the arena: `act(command)` follows each `sense()` until it is `done`.
#[pyclass(frozen, module = "catchingbot")]
pub struct Arena {
    setup: Arc<Setup>,
    state: Mutex<Option<State>>,
}

struct State {
    throw: Throw,
    /// Time on the cell's clock of what was sensed and waits for an answer, and when that was.
    sensed: Option<(f64, Instant)>,
}

impl Arena {
    /// Throw number `index` of `seed`.
    pub fn new(setup: &Arc<Setup>, seed: u64, index: u64) -> Self {
        let throw = Throw::new(setup, seed, index);
        Self { setup: setup.clone(), state: Mutex::new(Some(State { throw, sensed: None })) }
    }
}

impl State {
    fn act(&mut self, command: &catch_cell::Command, told: Option<&StateSnapshot>) -> PyResult<()> {
        let episode = self.throw.flying()?;
        let (time_s, since) =
            self.sensed.take().ok_or_else(|| PyRuntimeError::new_err("arena: sense() comes before act()"))?;
        let snapshot = told.cloned().unwrap_or(StateSnapshot { time_s, report: None, stage_ms: Vec::new() });
        episode.act(command, StateSnapshot { time_s, ..snapshot }, since.elapsed().as_secs_f64());
        self.throw.judge_at_end();
        Ok(())
    }
}

#[pymethods]
impl Arena {
    /// Time passes until the next image; what is sensed then.
    fn sense(&self, py: Python<'_>) -> PyResult<Observation> {
        let sensed = with(py, &self.state, |state| {
            let episode = state.throw.flying()?;
            if state.sensed.is_some() {
                return Err(PyRuntimeError::new_err("arena: act() comes before the next sense()"));
            }
            let observation = episode.sense();
            state.sensed = Some((observation.time_s, Instant::now()));
            Ok(observation)
        })?;
        Ok(Observation { sensed: Arc::new(sensed), dof: self.setup.robot.dof() })
    }

    /// Passes a command on, or none.
    #[pyo3(signature = (command=None))]
    fn act(&self, py: Python<'_>, command: Option<&Bound<'_, PyAny>>) -> PyResult<()> {
        let command = command.map(|it| instance::<Command>("command", it, "a Command or None")).transpose()?;
        let windows = command.and_then(|it| it.sent.windows.as_ref());
        if windows.is_some_and(|windows| windows.len() != self.setup.cameras.len()) {
            return Err(fault("command", "one for other cameras", "one of a brain of this setup"));
        }
        let nothing = catch_cell::Command::default();
        let sent = command.map_or(&nothing, |it| &it.sent);
        let snapshot = command.and_then(|it| it.snapshot.as_deref());
        with(py, &self.state, |state| state.act(sent, snapshot))
    }

    /// True if the throw is over.
    #[getter]
    fn done(&self, py: Python<'_>) -> PyResult<bool> {
        with(py, &self.state, |state| Ok(state.throw.row.is_some()))
    }

    /// The row of this throw in an evaluation, once it is done.
    #[getter]
    fn row<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        json_dict(py, &with(py, &self.state, |state| state.throw.row().cloned())?)
    }

    /// Result of the throw as the line of JSON that `catchingbot eval` writes.
    #[getter]
    fn jsonl<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyBytes>> {
        let line = with(py, &self.state, |state| line(state.throw.row()?))?;
        Ok(PyBytes::new(py, line.as_bytes()))
    }

    /// Frees what the arena holds. An arena may be closed more than once.
    fn close(&self, py: Python<'_>) {
        py.detach(|| *locked(&self.state) = None);
    }
}
