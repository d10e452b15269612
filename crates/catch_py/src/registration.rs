//! The pose of a point cloud.

use std::path::PathBuf;

use catch_body::quantity;
use catch_import::{
    cloud_file::CloudFile,
    cloud_registration::{self, Registration},
};
use catch_recording::{name_of, whole_file::COMMAND_LINE};
use numpy::{PyArray2, ToPyArray};
use pyo3::{prelude::*, types::PyString};

use crate::arguments::{Numbers, fault, input_fault, number};

/// Name of the argument, which is an asset's name, too.
const REFERENCE: &str = stringify!(reference);

/// Pose of the reference in a cloud.
#[pyclass(frozen, module = "catchingbot")]
pub struct RegisteredPose {
    found: Registration,
}

#[pymethods]
impl RegisteredPose {
    /// `registered`, `degenerate` where other poses explain the cloud as well, `implausible` where its stated
    /// noise does not explain how far the points are off, or what was missing.
    #[getter]
    fn status(&self) -> String {
        name_of(self.found.status)
    }

    /// Takes points of the reference into the cloud's frame, 4×4; `None` unless the status is `registered`.
    #[getter]
    #[allow(non_snake_case)]
    fn X_CR<'py>(&self, py: Python<'py>) -> Option<Bound<'py, PyArray2<f64>>> {
        self.found.X_CR.map(|it| it.to_homogeneous().to_pyarray(py))
    }

    /// Inverse covariance of (rotation vector, position) in the cloud's axes, 6×6.
    #[getter]
    fn information<'py>(&self, py: Python<'py>) -> Option<Bound<'py, PyArray2<f64>>> {
        self.found.information.map(|it| it.to_pyarray(py))
    }

    /// Distance of the points from the reference's surface in metres.
    #[getter]
    fn residual_m(&self) -> Option<f64> {
        self.found.residual_m
    }

    /// Symmetry of the reference: `none`, `half_turn`, `finite`, `axis` or `sphere`.
    #[getter]
    fn symmetry(&self) -> &'static str {
        self.found.symmetry
    }

    fn __repr__(&self) -> String {
        format!("<RegisteredPose: {}>", name_of(self.found.status))
    }
}

/// Looks in `points` (n×3, metres) for `reference`: the name or file of an object, a file of a cloud or mesh,
/// or points all around it (m×3). `noise_m` is the standard deviation of the points.
#[pyfunction]
#[pyo3(signature = (points, reference, noise_m=None), text_signature = "(points, reference, noise_m=0.0)")]
pub fn register(
    py: Python<'_>,
    points: &Bound<'_, PyAny>,
    reference: &Bound<'_, PyAny>,
    noise_m: Option<&Bound<'_, PyAny>>,
) -> PyResult<RegisteredPose> {
    let points = Numbers::read("points", points, &[0, 3])?.points();
    if points.is_empty() {
        return Err(fault("points", "none", "one or more"));
    }
    let noise_m = noise_m.map_or(Ok(0.0), |it| number("noise_m", it))?;
    let noise_m = quantity::ERROR_M.check(COMMAND_LINE, "--noise_m", noise_m).map_err(input_fault)?;
    let is_path = reference.is_instance_of::<PyString>() || reference.hasattr("__fspath__")?;
    let (scan, file) = if is_path {
        let path: PathBuf = reference.extract()?;
        let file = path.display().to_string();
        (py.detach(|| cloud_registration::scan_of(&path, (COMMAND_LINE, "--reference"))).map_err(input_fault)?, file)
    } else {
        let points = Numbers::read(REFERENCE, reference, &[0, 3])?.points();
        (CloudFile { points, normals: None }, REFERENCE.to_owned())
    };
    let found = py.detach(|| {
        let reference = cloud_registration::reference_model(scan, &file)?;
        Ok(cloud_registration::register(&points, noise_m, &reference))
    });
    found.map(|found| RegisteredPose { found }).map_err(input_fault)
}
