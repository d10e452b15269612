//! Brains that are written in Python.

use std::sync::{
    Arc, Mutex, PoisonError,
    atomic::{AtomicBool, Ordering},
};

use catch_bot::Report;
use catch_cell::{Brain, Command, Observation, Probe};
use catch_lab::{evaluation::BrainFactory, scenario::brain::ObservedBrain};
use pyo3::{exceptions::PyTypeError, prelude::*};

use crate::{command, observation};

/// Brains of one evaluation: what makes them, and the first exception of any.
#[derive(Clone)]
pub struct PythonBrains {
    make: Arc<Py<PyAny>>,
    /// What `make` is told, and the number of the arm's joints.
    setup: Arc<Py<PyAny>>,
    dof: usize,
    fault: Arc<Mutex<Option<PyErr>>>,
    /// Whether nothing that they say counts any more.
    has_ended: Arc<AtomicBool>,
}

impl PythonBrains {
    /// Made by `make(setup, seed, index)`, for an arm with `dof` joints.
    pub fn new(make: Py<PyAny>, setup: Py<PyAny>, dof: usize) -> Self {
        Self { make: Arc::new(make), setup: Arc::new(setup), dof, fault: Arc::default(), has_ended: Arc::default() }
    }

    /// The exception that ended a brain, if one did.
    pub fn check(&self) -> PyResult<()> {
        self.fault.lock().unwrap_or_else(PoisonError::into_inner).take().map_or(Ok(()), Err)
    }

    /// From now on no brain is asked any more.
    pub fn end(&self) {
        self.has_ended.store(true, Ordering::Relaxed);
    }

    fn fail(&self, fault: PyErr) {
        self.end();
        self.fault.lock().unwrap_or_else(PoisonError::into_inner).get_or_insert(fault);
    }

    fn make(&self, seed: u64, index: u64) -> PyResult<Py<PyAny>> {
        Python::attach(|py| {
            let brain = self.make.call1(py, (self.setup.clone_ref(py), seed, index))?;
            if !brain.bind(py).hasattr("tick")? {
                let found = brain.bind(py).get_type().name()?;
                return Err(PyTypeError::new_err(format!(
                    "brain: found {found}, expected an object with a method tick"
                )));
            }
            Ok(brain)
        })
    }
}

/// As the lab's evaluations take them.
pub fn factory(brains: &PythonBrains) -> BrainFactory {
    let brains = brains.clone();
    BrainFactory::new(move |_, seed, index| {
        let brain = brains.make(seed, index).map_err(|fault| brains.fail(fault)).ok();
        Box::new(PythonBrain { brain, brains: brains.clone(), report: None })
    })
}

/// One brain. After an exception it asks for nothing any more: the evaluation ends with the exception.
struct PythonBrain {
    brain: Option<Py<PyAny>>,
    brains: PythonBrains,
    /// Of the brain whose command it passed on, if it was one of ours.
    report: Option<Report>,
}

impl PythonBrain {
    fn command(&mut self, observation: &Observation) -> PyResult<Command> {
        let Some(brain) = self.brain.as_ref().filter(|_| !self.brains.has_ended.load(Ordering::Relaxed)) else {
            return Ok(Command::default());
        };
        let dof = self.brains.dof;
        Python::attach(|py| {
            let observation = observation::Observation::new(Arc::new(observation.clone()), dof);
            let answer = brain.call_method1(py, "tick", (observation,))?;
            let answer = answer.bind(py);
            if answer.is_none() {
                return Ok(Command::default());
            }
            let command = answer.cast::<command::Command>().map_err(|_| {
                PyTypeError::new_err(format!("brain: tick returned {answer}, expected a Command or None"))
            })?;
            self.report = command.get().snapshot.as_ref().and_then(|it| it.report.clone());
            Ok(command.get().sent.clone())
        })
    }
}

impl Brain for PythonBrain {
    fn tick(&mut self, observation: &Observation, _: &mut dyn Probe) -> Command {
        self.command(observation).unwrap_or_else(|fault| {
            self.brains.fail(fault);
            Command::default()
        })
    }

    fn reset(&mut self) {}
}

impl ObservedBrain for PythonBrain {
    fn report(&self) -> Option<&Report> {
        self.report.as_ref()
    }
}
