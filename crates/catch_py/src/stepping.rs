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

/// One throw in the arena: `act(command)` follows each `sense()` until it is `done`.
#[pyclass(frozen, module = "catchingbot")]
pub struct Arena {
    setup: Arc<Setup>,
    scene: (u64, u64),
    state: Mutex<State>,
}

enum State {
    /// The object flies. What was sensed last, and when, waits for an answer.
    Flying { episode: Box<Episode>, sensed: Option<(f64, Instant)> },
    /// The referee has judged.
    Done(Box<Row>),
    /// Closed by the user.
    Closed,
}

impl Arena {
    /// Throw number `index` of `seed`.
    pub fn new(setup: &Arc<Setup>, seed: u64, index: u64) -> Self {
        let episode = Box::new(Episode::new(setup, seed, index));
        let state = Mutex::new(State::Flying { episode, sensed: None });
        Self { setup: setup.clone(), scene: (seed, index), state }
    }

    fn with<T: Send>(&self, py: Python<'_>, work: impl FnOnce(&mut State) -> PyResult<T> + Send) -> PyResult<T> {
        py.detach(|| work(&mut locked(&self.state)))
    }

    fn act_on(&self, state: &mut State, command: &catch_cell::Command, told: Option<&StateSnapshot>) -> PyResult<()> {
        let State::Flying { episode, sensed } = state else { return Err(state.fault()) };
        let (time_s, since) =
            sensed.take().ok_or_else(|| PyRuntimeError::new_err("arena: sense() comes before act()"))?;
        let snapshot = told.cloned().unwrap_or(StateSnapshot { time_s, report: None, stage_ms: Vec::new() });
        episode.act(command, StateSnapshot { time_s, ..snapshot }, since.elapsed().as_secs_f64());
        if episode.is_done()
            && let State::Flying { episode, .. } = std::mem::replace(state, State::Closed)
        {
            let verdict = referee::judge(&self.setup, &episode.into_trial(Stopwatch::default()));
            *state = State::Done(Box::new(evaluation::row(&self.setup, self.scene.0, self.scene.1, verdict)));
        }
        Ok(())
    }

    fn row_of<T: Send>(&self, py: Python<'_>, of: impl FnOnce(&Row) -> PyResult<T> + Send) -> PyResult<T> {
        self.with(py, |state| match state {
            State::Done(row) => of(row),
            State::Flying { .. } => Err(PyRuntimeError::new_err("arena: the throw is not done")),
            State::Closed => Err(state.fault()),
        })
    }
}

impl State {
    /// Error of a call that is no longer possible.
    fn fault(&self) -> PyErr {
        PyRuntimeError::new_err(match self {
            Self::Closed => "arena: it is closed",
            Self::Done(_) | Self::Flying { .. } => "arena: the throw is done",
        })
    }
}

#[pymethods]
impl Arena {
    /// Time passes until the next image; what is sensed then.
    fn sense(&self, py: Python<'_>) -> PyResult<Observation> {
        let sensed = self.with(py, |state| match state {
            State::Flying { sensed: Some(_), .. } => {
                Err(PyRuntimeError::new_err("arena: act() comes before the next sense()"))
            }
            State::Flying { episode, sensed } => {
                let observation = episode.sense();
                *sensed = Some((observation.time_s, Instant::now()));
                Ok(observation)
            }
            State::Done(_) | State::Closed => Err(state.fault()),
        })?;
        Ok(Observation::new(Arc::new(sensed), self.setup.robot.dof()))
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
        self.with(py, |state| self.act_on(state, sent, snapshot))
    }

    /// True if the throw is over.
    #[getter]
    fn done(&self, py: Python<'_>) -> PyResult<bool> {
        self.with(py, |state| match state {
            State::Closed => Err(state.fault()),
            state => Ok(matches!(state, State::Done(_))),
        })
    }

    /// The row of this throw in an evaluation, once it is done.
    #[getter]
    fn row<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let row = self.row_of(py, |row| Ok(row.clone()))?;
        json_dict(py, &row)
    }

    /// Result of the throw as the line of JSON that `catchingbot eval` writes.
    #[getter]
    fn jsonl<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyBytes>> {
        let line = self.row_of(py, line)?;
        Ok(PyBytes::new(py, line.as_bytes()))
    }

    /// Frees what the arena holds. An arena may be closed more than once.
    fn close(&self, py: Python<'_>) -> PyResult<()> {
        self.with(py, |state| {
            *state = State::Closed;
            Ok(())
        })
    }
}
