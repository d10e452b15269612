//! Frozen benchmarks.

use catch_lab::suite::Suite;
use pyo3::{prelude::*, types::PyDict};

use crate::arguments::input_fault;

/// Content of the file of a suite, once its hash is right: `conditions` are scenario, object, throw and
/// number of throws.
#[pyfunction]
pub fn suite_file<'py>(py: Python<'py>, name: &str) -> PyResult<Bound<'py, PyDict>> {
    let suite = py.detach(|| Suite::load(name)).map_err(input_fault)?;
    let said = PyDict::new(py);
    said.set_item("description", &suite.file.description)?;
    said.set_item("seed", suite.file.seed)?;
    said.set_item("content_sha256", &suite.file.content_sha256)?;
    said.set_item("conditions", suite.conditions())?;
    Ok(said)
}
