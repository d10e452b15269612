//! Brains that are written in Python.

use std::sync::{
    Arc, Mutex,
    atomic::{AtomicBool, Ordering},
};

use catch_bot::Report;
use catch_cell::{Brain, Command, Observation, Probe};
use catch_lab::evaluation::BrainFactory;
use catch_recording::brain::ObservedBrain;
use pyo3::{call::PyCallArgs, exceptions::PyTypeError, prelude::*};

use crate::{arguments::locked, command, observation};

/// Reason of the end of an evaluation: the first exception of anything that is written in Python.
#[derive(Clone, Default)]
pub struct Ending {
    fault: Arc<Mutex<Option<PyErr>>>,
    /// Set when the results of Python no longer count.
    has_come: Arc<AtomicBool>,
}

impl Ending {
    /// The exception, if there was one.
    pub fn check(&self) -> PyResult<()> {
        locked(&self.fault).take().map_or(Ok(()), Err)
    }

    /// Ends the evaluation: nothing is asked any more.
    pub fn come(&self) {
        self.has_come.store(true, Ordering::Relaxed);
    }

    /// Returns whether the evaluation has ended.
    pub fn has_come(&self) -> bool {
        self.has_come.load(Ordering::Relaxed)
    }

    /// Ends the evaluation with an exception.
    pub fn fail(&self, fault: PyErr) {
        self.come();
        locked(&self.fault).get_or_insert(fault);
    }
}

/// Factory of a brain or a stage of it for each throw: `make(setup, seed, index)`.
#[derive(Clone)]
pub struct Maker {
    /// The argument that it was, and the method that what it makes must have.
    pub names: [&'static str; 2],
    make: Arc<Py<PyAny>>,
    setup: Arc<Py<PyAny>>,
    ending: Ending,
}

impl Maker {
    /// Creates the factory of an argument, for a setup as Python has it.
    pub fn new(names: [&'static str; 2], make: Py<PyAny>, setup: Py<PyAny>, ending: Ending) -> Self {
        Self { names, make: Arc::new(make), setup: Arc::new(setup), ending }
    }

    /// Makes the brain or stage for a throw. After an exception it makes nothing: the evaluation ends.
    pub fn make(&self, seed: u64, index: u64) -> Made {
        let [argument, method] = self.names;
        let made = Python::attach(|py| {
            let made = self.make.call1(py, (self.setup.clone_ref(py), seed, index))?;
            if made.bind(py).hasattr(method)? {
                return Ok(made);
            }
            let found = made.bind(py).get_type().name()?;
            Err(PyTypeError::new_err(format!("{argument}: found {found}, expected an object with a method {method}")))
        });
        Made {
            object: made.map_err(|fault| self.ending.fail(fault)).ok(),
            names: self.names,
            ending: self.ending.clone(),
        }
    }
}

/// A brain or a stage that is written in Python.
pub struct Made {
    object: Option<Py<PyAny>>,
    names: [&'static str; 2],
    ending: Ending,
}

impl Made {
    /// Calls its method with what `arguments` gives and reads the answer; nothing from the first exception of
    /// the evaluation on.
    pub fn ask<A, T>(
        &self,
        arguments: impl FnOnce(Python<'_>) -> PyResult<A>,
        read: impl FnOnce(&Bound<'_, PyAny>) -> Option<T>,
        expected: &str,
    ) -> Option<T>
    where
        A: for<'py> PyCallArgs<'py>,
    {
        let object = self.object.as_ref().filter(|_| !self.ending.has_come())?;
        let [argument, method] = self.names;
        let answer = Python::attach(|py| {
            let answer = object.call_method1(py, method, arguments(py)?)?;
            let answer = answer.bind(py);
            if answer.is_none() {
                return Ok(None);
            }
            let wrong =
                || PyTypeError::new_err(format!("{argument}: {method} returned {answer}, expected {expected} or None"));
            read(answer).ok_or_else(wrong).map(Some)
        });
        answer.map_err(|fault| self.ending.fail(fault)).ok().flatten()
    }
}

/// Returns a factory for the lab's evaluations, for an arm with `dof` joints.
pub fn factory(maker: Maker, dof: usize) -> BrainFactory {
    Arc::new(move |_, seed, index| Box::new(PythonBrain { made: maker.make(seed, index), dof, report: None }))
}

/// One brain.
struct PythonBrain {
    made: Made,
    /// Joints of the arm.
    dof: usize,
    /// Report of the built-in brain whose command this brain passed on, if any.
    report: Option<Report>,
}

impl Brain for PythonBrain {
    fn tick(&mut self, observation: &Observation, _: &mut dyn Probe) -> Command {
        let arguments = |_: Python<'_>| {
            let sensed = Arc::new(observation.clone());
            Ok((observation::Observation { sensed, dof: self.dof },))
        };
        let read = |answer: &Bound<'_, PyAny>| {
            let command = answer.cast::<command::Command>().ok()?.get();
            Some((command.sent.clone(), command.snapshot.as_ref().and_then(|it| it.report.clone())))
        };
        let Some((command, report)) = self.made.ask(arguments, read, "a Command") else { return Command::default() };
        self.report = report;
        command
    }

    fn reset(&mut self) {}
}

impl ObservedBrain for PythonBrain {
    fn report(&self) -> Option<&Report> {
        self.report.as_ref()
    }
}
