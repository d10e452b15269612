//! Recorded throws: their scene, and what the brain commanded.

use std::{path::PathBuf, sync::Arc};

use catch_lab::{
    assets::Origin,
    recording::{GroundTruth, LabReader, Simulation},
    scenario::setup::{Choice, Setup as LabSetup},
};
use catch_recording::{Part, name_of};
use numpy::{PyArray1, PyArrayMethods};
use pyo3::{prelude::*, types::PyDict};

use crate::{
    arguments::{Named, fault, input_fault},
    command::Command,
    equipment::rows_of,
    setup::Setup,
};

/// A recorded throw of the arena: its scene, and the brain's commands.
#[pyclass(frozen, module = "catchingbot")]
pub struct Recording {
    file: PathBuf,
    simulation: Simulation,
    truth: GroundTruth,
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
                    let truth = ending.ground_truth.ok_or_else(none)?;
                    return Ok(Self { file, simulation, truth, commands, dof });
                }
            }
        }
    }

    /// The setup of the throw.
    #[getter]
    fn setup(&self, py: Python<'_>) -> PyResult<Setup> {
        let file = self.file.display().to_string();
        let scenario = self.simulation.scenario.clone();
        let nowhere = Origin::BuiltIn(PathBuf::new());
        let lab = py.detach(|| LabSetup::of_scenario(scenario, &file, &nowhere, &Choice::default()));
        Ok(Setup { lab: Arc::new(lab.map_err(input_fault)?), made_by: None })
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

    /// Reason of the miss, if the object was not caught.
    #[getter]
    fn reason(&self) -> Option<String> {
        self.truth.verdict.reason.map(name_of)
    }

    /// The true motion as `judge` takes it.
    #[getter]
    fn samples<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let samples = &self.truth.truth.samples;
        let dict = PyDict::new(py);
        let rows = |of: Vec<f64>| PyArray1::from_vec(py, of);
        dict.set_item("time_s", rows(samples.iter().map(|it| it.time_s).collect()))?;
        dict.set_item("width_m", rows(samples.iter().map(|it| it.width_m).collect()))?;
        dict.set_item("commanded_width_m", rows(samples.iter().map(|it| it.commanded_width_m).collect()))?;
        let poses = [samples.len(), 4, 4];
        dict.set_item(
            "X_WG",
            rows(samples.iter().flat_map(|it| rows_of(&it.X_WG).into_iter().flatten()).collect()).reshape(poses)?,
        )?;
        dict.set_item(
            "X_WO",
            rows(samples.iter().flat_map(|it| rows_of(&it.X_WO).into_iter().flatten()).collect()).reshape(poses)?,
        )?;
        let speeds = samples.iter().flat_map(|it| it.dq.iter().copied().take(self.dof)).collect();
        dict.set_item("dq", rows(speeds).reshape([samples.len(), self.dof])?)?;
        let contacts = samples
            .iter()
            .map(|it| it.contact)
            .flat_map(|it| [it.left_finger, it.right_finger, it.palm, it.arm, it.floor, it.obstacle].map(f64::from));
        dict.set_item("contacts", rows(contacts.collect()).reshape([samples.len(), 6])?)?;
        Ok(dict)
    }

    /// Start of the disturbance test, if there was one.
    #[getter]
    fn disturbed_since_s(&self) -> Option<f64> {
        self.truth.truth.disturbed_since_s
    }

    /// Commands, each with the time of the observation that it answers.
    #[getter]
    fn commands(&self) -> Vec<(f64, Command)> {
        self.commands
            .iter()
            .map(|(time_s, sent)| (*time_s, Command { sent: sent.clone(), snapshot: None, dof: self.dof }))
            .collect()
    }
}
