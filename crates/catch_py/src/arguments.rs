//! Arguments from Python: every one is checked, and errors name it.

use std::{
    fmt::Display,
    sync::{
        Mutex, MutexGuard, PoisonError,
        mpsc::{self, RecvTimeoutError},
    },
    thread,
    time::Duration,
};

use catch_body::{InputError, JointVector};
use catch_recording::whole_file::COMMAND_LINE;
use nalgebra::Point3;
use numpy::{PyReadonlyArrayDyn, PyUntypedArray, PyUntypedArrayMethods};
use pyo3::{
    PyClass,
    exceptions::{PyOSError, PyRuntimeError, PyTypeError, PyValueError},
    prelude::*,
    pyclass::boolean_struct::True,
    types::{PyBool, PyDict, PyString},
};

/// A serialized map as a dict.
pub fn json_dict<'py>(py: Python<'py>, value: &impl serde::Serialize) -> PyResult<Bound<'py, PyDict>> {
    let text = serde_json::to_string(value).map_err(|it| PyRuntimeError::new_err(it.to_string()))?;
    Ok(py.import("json")?.call_method1("loads", (text,))?.cast_into()?)
}

/// A name, or a file as a `str` or a `pathlib.Path`, that is checked once the name of its argument is known.
#[derive(FromPyObject)]
pub struct Named(Py<PyAny>);

impl Named {
    /// Returns the argument as text.
    pub fn text(self, py: Python<'_>, argument: &str) -> PyResult<String> {
        let value = self.0.bind(py);
        let text = py.import("os")?.call_method1("fspath", (value,)).ok().and_then(|it| it.extract().ok());
        text.ok_or_else(|| type_fault(argument, value, "a name, or a file as a str or a pathlib.Path"))
    }
}

/// Does `work` in another thread. An interrupt of the user comes out within a moment; the work then ends by
/// itself, and nobody sees what comes of it.
pub fn interruptible<T: Send + 'static>(py: Python<'_>, work: impl FnOnce() -> T + Send + 'static) -> PyResult<T> {
    const LOOKS_EVERY: Duration = Duration::from_millis(50);
    let (sender, receiver) = mpsc::channel();
    thread::spawn(move || sender.send(work()));
    let receiver = Mutex::new(receiver);
    loop {
        let wait = || locked(&receiver).recv_timeout(LOOKS_EVERY);
        match py.detach(wait) {
            Ok(done) => return Ok(done),
            Err(RecvTimeoutError::Timeout) => py.check_signals()?,
            Err(RecvTimeoutError::Disconnected) => return Err(PyRuntimeError::new_err("the work panicked")),
        }
    }
}

/// The largest number that a throw or a seed can have: what TOML can hold.
pub const MOST: u64 = i64::MAX as u64;

/// The exception for a value that an argument cannot have.
pub fn fault(argument: &str, found: impl Display, expected: impl Display) -> PyErr {
    PyValueError::new_err(format!("{argument}: found {found}, expected {expected}"))
}

/// The exception for a value of a wrong type.
pub fn type_fault(argument: &str, value: &Bound<'_, PyAny>, expected: &str) -> PyErr {
    let found = value.get_type().name().map_or_else(|_| "another type".to_owned(), |it| it.to_string());
    PyTypeError::new_err(format!("{argument}: found {found}, expected {expected}"))
}

/// The object of the class `T` that an argument is to be.
pub fn instance<'a, T: PyClass<Frozen = True> + Sync>(
    argument: &str,
    value: &'a Bound<'_, PyAny>,
    expected: &str,
) -> PyResult<&'a T> {
    let value = value.cast::<T>().map_err(|_| PyTypeError::new_err(format!("{argument}: expected {expected}")))?;
    Ok(value.get())
}

/// What `read` makes of each object of the class `T` in a list.
pub fn list<T: PyClass<Frozen = True> + Sync, U>(
    argument: &str,
    value: &Bound<'_, PyAny>,
    expected: &str,
    read: impl Fn(&T) -> U,
) -> PyResult<Vec<U>> {
    let items = value.try_iter().map_err(|_| PyTypeError::new_err(format!("{argument}: expected {expected}")))?;
    items.map(|it| Ok(read(instance(argument, &it?, expected)?))).collect()
}

/// The content of a lock, whatever became of who held it before.
pub fn locked<T>(lock: &Mutex<T>) -> MutexGuard<'_, T> {
    lock.lock().unwrap_or_else(PoisonError::into_inner)
}

/// The exception for a fault in a file or an argument, which the command line calls `--argument`.
pub fn input_fault(fault: InputError) -> PyErr {
    let is_of_output = fault.of_output;
    let line = |it: InputError| match it.field.strip_prefix("--") {
        _ if it.file != COMMAND_LINE => it.to_string(),
        Some(argument) if !argument.starts_with("set") => {
            format!("{argument}: found {}, expected {}", it.found, it.expected)
        }
        // Faults of the command line's `--set` and of a scenario's fields that it sets.
        _ => format!("settings: {}: found {}, expected {}", it.field, it.found, it.expected),
    };
    let text = fault.all().into_iter().map(line).collect::<Vec<_>>().join("\n");
    if is_of_output { PyOSError::new_err(text) } else { PyValueError::new_err(text) }
}

/// A whole number that is checked once the name of its argument is known.
#[derive(FromPyObject)]
pub enum Whole {
    /// A value as the caller gave it.
    Given(Py<PyAny>),
    /// The default.
    Default(u64),
}

impl Whole {
    /// Returns the value, from `least` to `most`.
    pub fn checked(self, py: Python<'_>, argument: &str, least: u64, most: u64) -> PyResult<u64> {
        let value = match self {
            Self::Default(value) => return Ok(value),
            Self::Given(value) => value.into_bound(py),
        };
        let expected = format!("a whole number from {least} to {most}");
        if value.is_instance_of::<PyBool>() || !value.hasattr("__index__")? {
            return Err(type_fault(argument, &value, &expected));
        }
        let number = value.extract::<u64>().ok().filter(|number| (least..=most).contains(number));
        number.ok_or_else(|| fault(argument, &value, expected))
    }
}

/// A finite number.
pub fn number(argument: &str, value: &Bound<'_, PyAny>) -> PyResult<f64> {
    let number: f64 = value.extract().map_err(|_| type_fault(argument, value, "a number"))?;
    if number.is_finite() { Ok(number) } else { Err(fault(argument, number, "a finite number")) }
}

/// Numbers in an array.
pub struct Numbers {
    /// Row by row.
    pub values: Vec<f64>,
    /// Length along each axis.
    pub shape: Vec<usize>,
}

impl Numbers {
    /// Reads real, finite numbers from whatever NumPy makes an array of. `axes` says which length each axis
    /// has, 0 for any.
    pub fn read(argument: &str, value: &Bound<'_, PyAny>, axes: &[usize]) -> PyResult<Self> {
        let this = Self::of_any_shape(argument, value)?;
        let fits =
            this.shape.len() == axes.len() && this.shape.iter().zip(axes).all(|(n, axis)| [0, *n].contains(axis));
        let length = |n: &usize| if *n == 0 { "n".to_owned() } else { n.to_string() };
        let shape = |axes: &[usize]| format!("({})", axes.iter().map(length).collect::<Vec<_>>().join(", "));
        if fits {
            return Ok(this);
        }
        let found = this.shape.iter().map(usize::to_string).collect::<Vec<_>>().join(", ");
        Err(fault(argument, format!("shape ({found})"), format!("shape {}", shape(axes))))
    }

    /// Reads an array of any shape.
    pub fn of_any_shape(argument: &str, value: &Bound<'_, PyAny>) -> PyResult<Self> {
        let py = value.py();
        let expected = "an array of real numbers";
        let numpy = py.import("numpy")?;
        let array = numpy.call_method1("asarray", (value,)).map_err(|_| type_fault(argument, value, expected))?;
        let kind: String = array.getattr("dtype")?.getattr("kind")?.extract()?;
        let is_empty = array.cast::<PyUntypedArray>()?.len() == 0;
        if !["f", "i", "u"].contains(&kind.as_str()) {
            let dtype = array.getattr("dtype")?;
            return Err(PyTypeError::new_err(format!("{argument}: found dtype {dtype}, expected {expected}")));
        }
        let array = numpy.call_method1("asarray", (&array, "float64", "C"))?;
        let array: PyReadonlyArrayDyn<'_, f64> = array.extract()?;
        let shape = array.shape().to_vec();
        let values = if is_empty { Vec::new() } else { array.as_slice()?.to_vec() };
        match values.iter().position(|it| !it.is_finite()) {
            None => Ok(Self { values, shape }),
            Some(at) => Err(fault(argument, format!("{} at index {at}", values[at]), "finite numbers")),
        }
    }

    /// Points, one a row.
    pub fn points(&self) -> Vec<Point3<f64>> {
        self.values.chunks_exact(3).map(Point3::from_slice).collect()
    }
}

/// Numbers for the joints of an arm, zero for those that it has not.
pub fn joint_vector(values: &[f64]) -> JointVector {
    JointVector::from_fn(|i, _| values.get(i).copied().unwrap_or_default())
}

/// One number per joint of an arm with `dof` of them.
pub fn joints(argument: &str, value: &Bound<'_, PyAny>, dof: usize) -> PyResult<JointVector> {
    Numbers::read(argument, value, &[dof]).map(|it| joint_vector(&it.values))
}

/// The entries of a dict whose keys are names.
fn entries<'py>(argument: &str, dict: &Bound<'py, PyDict>) -> PyResult<Vec<(String, Bound<'py, PyAny>)>> {
    let fault = |key: &Bound<'_, PyAny>| type_fault(argument, key, "names of fields");
    dict.iter().map(|(key, value)| Ok((key.cast::<PyString>().map_err(|_| fault(&key))?.to_string(), value))).collect()
}

/// Settings as the command line takes them: `FIELD=VALUE`.
pub fn settings(settings: Option<&Bound<'_, PyAny>>) -> PyResult<Vec<String>> {
    let Some(settings) = settings else { return Ok(Vec::new()) };
    let expected = "a dict of fields of the scenario, such as {'arena.drag': False}";
    let settings = settings.cast::<PyDict>().map_err(|_| type_fault("settings", settings, expected))?;
    let setting = |(field, value): (String, Bound<'_, PyAny>)| {
        if field.contains('=') {
            return Err(fault("settings", format!("the field `{field}`"), "a field's name"));
        }
        let value = toml_value(&format!("settings: {field}"), &value, 0)?;
        let is_word = |text: &str| {
            let is_letter = |it: char| it.is_ascii_alphanumeric() || it == '_';
            text.starts_with(|it: char| it.is_ascii_alphabetic()) && text.chars().all(is_letter)
        };
        // A value that is no TOML is meant as text; names of results stay those of the command line.
        let text = match value {
            toml::Value::String(text) if is_word(&text) && !["true", "false", "inf", "nan"].contains(&&*text) => text,
            value => value.to_string(),
        };
        Ok(format!("{field}={text}"))
    };
    entries("settings", settings)?.into_iter().map(setting).collect()
}

/// Fields by their names, with dots where they lie in tables, as TOML.
pub fn toml_text(argument: &str, fields: Option<&Bound<'_, PyAny>>) -> PyResult<String> {
    let Some(fields) = fields else { return Ok(String::new()) };
    let fields = fields.cast::<PyDict>().map_err(|_| type_fault(argument, fields, "a dict of fields"))?;
    let line = |(field, value): (String, Bound<'_, PyAny>)| {
        if !field.chars().all(|it| it.is_ascii_alphanumeric() || ['_', '.'].contains(&it)) {
            return Err(fault(argument, format!("the field `{field}`"), "a field's name"));
        }
        Ok(format!("{field} = {}\n", toml_value(&format!("{argument}: {field}"), &value, 0)?))
    };
    entries(argument, fields)?.into_iter().map(line).collect()
}

/// Tables in tables, at most.
const DEEPEST: usize = 16;

/// A value of Python as one of TOML.
fn toml_value(argument: &str, value: &Bound<'_, PyAny>, depth: usize) -> PyResult<toml::Value> {
    let expected = "a bool, a number, a str, or a list or dict of these";
    if depth > DEEPEST {
        return Err(fault(argument, "lists within lists", expected));
    }
    if let Ok(value) = value.extract::<bool>() {
        return Ok(value.into());
    }
    if value.hasattr("__index__")? {
        let number = value.extract::<i64>().map_err(|_| fault(argument, value, "a number below 2**63"))?;
        return Ok(number.into());
    }
    if let Ok(text) = value.cast::<PyString>() {
        return Ok(text.to_string().into());
    }
    if let Ok(number) = value.extract::<f64>() {
        return Ok(number.into());
    }
    if let Ok(table) = value.cast::<PyDict>() {
        let entry = |(key, value)| Ok((key, toml_value(argument, &value, depth + 1)?));
        return entries(argument, table)?
            .into_iter()
            .map(entry)
            .collect::<PyResult<toml::Table>>()
            .map(toml::Value::Table);
    }
    let items = value.try_iter().map_err(|_| type_fault(argument, value, expected))?;
    items.map(|item| toml_value(argument, &item?, depth + 1)).collect::<PyResult<Vec<_>>>().map(toml::Value::Array)
}
