//! One throw: its row, its recording and its page.

use std::fs;

use catch_lab::{
    evaluation::{self, Row},
    recording::recorded_throw::record,
    scenario::setup::Setup,
};
use catch_recording::{name_of, whole_file};
use catch_view::{pages::catch_page, playback::Playback};
use pyo3::{
    exceptions::{PyOSError, PyRuntimeError},
    prelude::*,
    types::{PyBytes, PyDict},
};

use crate::arguments::{input_fault, json_dict};

/// A throw, and what became of it.
#[pyclass(frozen, module = "catchingbot")]
pub struct Trial {
    row: Row,
    recording: Vec<u8>,
}

impl Trial {
    /// Throws once.
    pub fn run(setup: &Setup, seed: u64, index: u64) -> PyResult<Self> {
        let unwritten = |fault| PyOSError::new_err(format!("the recording in the folder for temporary files: {fault}"));
        let folder = tempfile::tempdir().map_err(unwritten)?;
        let recorded = record(setup, seed, index, folder.path(), &mut |_| Ok(())).map_err(unwritten)?;
        let recording = fs::read(&recorded.recording).map_err(unwritten)?;
        Ok(Self { row: evaluation::row(setup, seed, index, recorded.verdict), recording })
    }
}

/// The line of a row in the log of an evaluation.
pub fn line(row: &Row) -> PyResult<String> {
    let line = serde_json::to_string(row).map_err(|it| PyRuntimeError::new_err(format!("the row: {it}")))?;
    Ok(line + "\n")
}

#[pymethods]
impl Trial {
    /// True if the object was caught and held.
    #[getter]
    fn caught(&self) -> bool {
        self.row.verdict.caught
    }

    /// Reason of the miss, if the object was not caught.
    #[getter]
    fn reason(&self) -> Option<String> {
        self.row.verdict.reason.map(name_of)
    }

    /// The row of this throw in an evaluation.
    #[getter]
    fn row<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        json_dict(py, &self.row)
    }

    /// Result of the trial as the line of JSON that `catchingbot eval` writes.
    #[getter]
    fn jsonl<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyBytes>> {
        Ok(PyBytes::new(py, line(&self.row)?.as_bytes()))
    }

    /// The recording, for `catchingbot view` and `catchingbot replay`.
    #[getter]
    fn recording<'py>(&self, py: Python<'py>) -> Bound<'py, PyBytes> {
        PyBytes::new(py, &self.recording)
    }

    /// The throw as one page: three dimensions, a time slider, plots.
    fn html(&self, py: Python<'_>) -> PyResult<String> {
        py.detach(|| {
            let unwritten = |fault| PyOSError::new_err(format!("a temporary file: {fault}"));
            let folder = tempfile::tempdir().map_err(unwritten)?;
            let path = folder.path().join("throw.catch");
            whole_file::write(&path, &self.recording).map_err(input_fault)?;
            Ok(catch_page::page(&Playback::read(&path).map_err(input_fault)?))
        })
    }

    /// The page, as notebooks show it.
    fn _repr_html_(&self, py: Python<'_>) -> PyResult<String> {
        let page = self.html(py)?.replace('&', "&amp;").replace('"', "&quot;");
        Ok(format!("<iframe srcdoc=\"{page}\" style=\"width: 100%; height: 640px; border: 0\"></iframe>"))
    }

    fn __repr__(&self) -> String {
        let scene = &self.row.scene;
        let outcome = self.reason().unwrap_or_else(|| "caught".to_owned());
        let (seed, index) = (scene.seed, scene.index);
        format!("<Trial {} {}, seed {seed}, index {index}: {outcome}>", scene.object, scene.throw)
    }
}
