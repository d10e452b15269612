//! Studies: variants of a scenario, taken apart for evaluations elsewhere.

use std::sync::Arc;

use catch_lab::{scenario::setup::Choice, study::Study};
use pyo3::{exceptions::PyIndexError, prelude::*};

use crate::{
    arguments::{Whole, input_fault},
    setup::Setup,
};

/// Names of a study's steps, with the number of conditions of each, and the number of throws among which the
/// trials of an object are divided.
#[pyfunction]
pub fn study_steps(py: Python<'_>, study: &str) -> PyResult<Vec<(String, usize, usize)>> {
    let study = py.detach(|| Study::load(study, ("study", "study"))).map_err(input_fault)?;
    let objects = study.objects();
    let choice = Choice::default();
    let counted = py.detach(|| {
        let of_step = |step| Ok((study.cells(step, &choice, &objects)?.len(), step.throws.len()));
        study.steps.iter().map(of_step).collect::<Result<Vec<_>, _>>()
    });
    let counted = counted.map_err(input_fault)?;
    Ok(study.steps.iter().zip(counted).map(|(step, (cells, throws))| (step.head.name.clone(), cells, throws)).collect())
}

/// The setup of a condition of a study's step, both by their numbers.
#[pyfunction]
pub fn study_setup(py: Python<'_>, study: &str, step: Whole, condition: Whole) -> PyResult<Setup> {
    let [step, condition] = [(step, "step"), (condition, "condition")]
        .map(|(it, name)| it.checked(py, name, 0, u64::from(u32::MAX)).map(|it| it as usize));
    let (step, condition) = (step?, condition?);
    let lab = py.detach(|| {
        let study = Study::load(study, ("study", "study")).map_err(input_fault)?;
        let none = || {
            PyIndexError::new_err(format!(
                "step or condition: found {step} and {condition}, expected ones of the study"
            ))
        };
        let cells = study.cells(study.steps.get(step).ok_or_else(none)?, &Choice::default(), &study.objects());
        cells.map_err(input_fault)?.into_iter().nth(condition).map(|cell| cell.setup).ok_or_else(none)
    })?;
    Setup::of_study(py, Arc::new(lab), (study, step, condition))
}
