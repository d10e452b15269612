//! Evaluations: many throws on all cores, as columns.

use std::fs;

use catch_body::InputError;
use catch_lab::{
    evaluation::{
        Cell, Evaluation, Row,
        trial_table::{self, Column, Kind},
    },
    parallel,
    scenario::setup::Setup,
};
use numpy::IntoPyArray;
use pyo3::{
    exceptions::PyOSError,
    prelude::*,
    types::{PyBytes, PyDict},
};
use serde_json::Value;

use crate::{
    arguments::{fault, input_fault},
    python_brain::{self, Ending, Maker},
    python_stages,
    trial::line,
};

/// Evaluation that is asked for, with all arguments checked.
pub struct Asked {
    /// The setup as Python has it.
    pub setup: Py<PyAny>,
    /// Throws.
    pub trials: u64,
    /// Seed of everything random.
    pub seed: u64,
    /// Number of the first throw.
    pub first: u64,
    /// Throws at the same time; `None` is one per core.
    pub threads: Option<u64>,
    /// Makes a brain for each throw; `None` is the scenario's.
    pub brain: Option<Py<PyAny>>,
    /// Make its predictor and its planner; `None` are the scenario's.
    pub predictor: Option<Py<PyAny>>,
    /// See `predictor`.
    pub planner: Option<Py<PyAny>>,
    /// Callback that is given the number of finished throws, and of all.
    pub progress: Option<Py<PyAny>>,
}

/// Runs the throws. An exception of the brain or of `progress` ends it, and so does the user's interrupt.
pub fn evaluate<'py>(py: Python<'py>, setup: &Setup, asked: Asked) -> PyResult<Bound<'py, PyAny>> {
    let Asked { setup: shown, trials, seed, first, threads, brain, predictor, planner, progress } = asked;
    let python = Ending::default();
    let maker =
        |names, make: Option<Py<PyAny>>| make.map(|make| Maker::new(names, make, shown.clone_ref(py), python.clone()));
    let brain = maker(["brain", "tick"], brain);
    let (predictor, planner) = (maker(["predictor", "predict"], predictor), maker(["planner", "plan"], planner));
    let mut rows: Vec<Row> = Vec::new();
    let mut ending = None;
    let done = py.detach(|| {
        // Clones keep what has been prepared.
        setup.prepare();
        let mut cell = Cell::new(setup.clone());
        if let Some(maker) = brain {
            cell.brain = python_brain::factory(maker, setup.robot.dof());
        } else if predictor.is_some() || planner.is_some() {
            cell.brain = python_stages::factory(predictor, planner);
        }
        let evaluation = Evaluation { cells: vec![cell], seed, first, trials };
        let threads = threads.map_or_else(parallel::threads, |it| it as usize);
        evaluation.run(0, threads, &mut |row, _| {
            rows.push(row);
            let told = python.check().and_then(|()| {
                Python::attach(|py| {
                    py.check_signals()?;
                    progress.as_ref().map_or(Ok(()), |it| it.call1(py, (rows.len(), trials)).map(drop))
                })
            });
            told.map_err(|it| {
                python.come();
                ending = Some(it);
                InputError::new("the evaluation", "a throw", "an exception", "none")
            })
        })
    });
    if let Some(ending) = ending {
        return Err(ending);
    }
    done.map_err(input_fault)?;
    let lines = rows.iter().map(line).collect::<PyResult<String>>()?;
    py.import("catchingbot.table")?.call_method1("Table", (arrays(py, &rows)?, PyBytes::new(py, lines.as_bytes())))
}

/// The columns of rows, by their names.
fn arrays<'py>(py: Python<'py>, rows: &[Row]) -> PyResult<Bound<'py, PyDict>> {
    let table = PyDict::new(py);
    for Column { name, kind, values } in trial_table::columns(rows) {
        table.set_item(name, column(py, kind, &values)?)?;
    }
    Ok(table)
}

/// Rows from lines of JSON.
fn read(jsonl: &[u8]) -> PyResult<Vec<Row>> {
    let lines = jsonl.split(|byte| *byte == b'\n').filter(|line| !line.is_empty());
    let row = |(number, line)| {
        serde_json::from_slice(line)
            .map_err(|it| fault("jsonl", format!("line {}: {it}", number + 1), "the row of a trial"))
    };
    lines.enumerate().map(row).collect()
}

/// The columns of rows that are lines of JSON.
#[pyfunction]
#[pyo3(name = "columns")]
pub fn columns_of<'py>(py: Python<'py>, jsonl: &[u8]) -> PyResult<Bound<'py, PyDict>> {
    arrays(py, &read(jsonl)?)
}

/// A Parquet file of rows that are lines of JSON.
#[pyfunction]
pub fn parquet<'py>(py: Python<'py>, jsonl: &[u8]) -> PyResult<Bound<'py, PyBytes>> {
    let rows = read(jsonl)?;
    let bytes = py.detach(|| {
        let unwritten = |fault| PyOSError::new_err(format!("a temporary file: {fault}"));
        let folder = tempfile::tempdir().map_err(unwritten)?;
        trial_table::write(folder.path(), &rows, "").map_err(input_fault)?;
        fs::read(folder.path().join(trial_table::PARQUET_FILE)).map_err(unwritten)
    })?;
    Ok(PyBytes::new(py, &bytes))
}

/// A column as an array: NaN for numbers that are missing, an empty text for texts.
fn column<'py>(py: Python<'py>, kind: Kind, values: &[Value]) -> PyResult<Bound<'py, PyAny>> {
    let number = |it: &Value| it.as_f64().or(it.as_bool().map(f64::from)).unwrap_or(f64::NAN);
    Ok(match kind {
        Kind::Text => {
            let texts: Vec<&str> = values.iter().map(|it| it.as_str().unwrap_or_default()).collect();
            py.import("numpy")?.call_method1("array", (texts, "U"))?
        }
        Kind::Count => {
            let counts: Vec<i64> = values.iter().map(|it| it.as_i64().unwrap_or_default()).collect();
            counts.into_pyarray(py).into_any()
        }
        Kind::Flag if values.iter().all(Value::is_boolean) => {
            let flags: Vec<bool> = values.iter().filter_map(Value::as_bool).collect();
            flags.into_pyarray(py).into_any()
        }
        Kind::Flag | Kind::Number => {
            let numbers: Vec<f64> = values.iter().map(number).collect();
            numbers.into_pyarray(py).into_any()
        }
    })
}
