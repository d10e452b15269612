//! Recorded throws: their scene, and what the brain commanded.

use std::{path::PathBuf, sync::Arc};

use catch_lab::{
    assets::Origin,
    recording::{LabReader, Simulation},
    scenario::setup::{Choice, Setup as LabSetup},
};
use catch_recording::Part;
use pyo3::prelude::*;

use crate::{
    arguments::{Named, fault, input_fault},
    cell_state::Made,
    command::Command,
    setup::Setup,
};

/// A recorded throw of the arena: its scene, and the brain's commands.
#[pyclass(frozen, module = "catchingbot")]
pub struct Recording {
    file: PathBuf,
    simulation: Simulation,
    caught: bool,
    /// Commands with the times of the observations that they answer.
    commands: Vec<(f64, catch_cell::Command)>,
    dof: usize,
}

#[pymethods]
impl Recording {
    #[new]
    fn new(py: Python<'_>, file: Named) -> PyResult<Self> {
        let file = PathBuf::from(file.text(py, "file")?);
        let mut reader = LabReader::open(&file).map_err(input_fault)?;
        let none = || fault("file", format!("`{}`, of a real cell", file.display()), "a recording of the arena");
        let simulation = reader.header.simulation.clone().ok_or_else(none)?;
        let dof = reader.header.cell.ready_rad.len();
        let mut commands = Vec::new();
        loop {
            match reader.next_part().map_err(input_fault)? {
                Part::Tick(tick) => commands.push((tick.observation.time_s, tick.command)),
                Part::Ending(ending) => {
                    let caught = ending.ground_truth.ok_or_else(none)?.verdict.caught;
                    return Ok(Self { file, simulation, caught, commands, dof });
                }
            }
        }
    }

    fn __reduce__<'py>(slf: &Bound<'py, Self>, py: Python<'py>) -> PyResult<Made<'py>> {
        Ok((slf.get_type().into_any(), (slf.get().file.display().to_string(),).into_pyobject(py)?))
    }

    /// The setup of the throw.
    #[getter]
    fn setup(&self, py: Python<'_>) -> PyResult<Setup> {
        let file = self.file.display().to_string();
        let scenario = self.simulation.scenario.clone();
        let nowhere = Origin::BuiltIn(PathBuf::new());
        let lab = py.detach(|| LabSetup::of_scenario(scenario, &file, &nowhere, &Choice::default()));
        Setup::of_recording(py, Arc::new(lab.map_err(input_fault)?), &file)
    }

    /// Seed of the throw.
    #[getter]
    fn seed(&self) -> u64 {
        self.simulation.scene.seed
    }

    /// Number of the throw.
    #[getter]
    fn index(&self) -> u64 {
        self.simulation.scene.index
    }

    /// True if the object was caught and held.
    #[getter]
    fn caught(&self) -> bool {
        self.caught
    }

    /// Commands, each with the time of the observation that it answers.
    #[getter]
    fn commands(&self) -> Vec<(f64, Command)> {
        self.commands.iter().map(|(time_s, sent)| (*time_s, Command::recorded(sent.clone(), self.dof))).collect()
    }
}

/// The setup of a recorded throw, for other processes.
#[pyfunction]
pub fn recorded_setup(py: Python<'_>, file: Named) -> PyResult<Setup> {
    Recording::new(py, file)?.setup(py)
}
