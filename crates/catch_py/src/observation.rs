//! What the cell senses, as Python sees it.

use std::sync::Arc;

use catch_body::JointVector;
use catch_cell::{CameraModel, Observation as Sensed};
use numpy::{PyArray1, PyArray2, PyArrayMethods, ToPyArray};
use pyo3::prelude::*;

/// One number per joint of the arm.
pub fn joint_array<'py>(py: Python<'py>, joints: &JointVector, dof: usize) -> Bound<'py, PyArray1<f64>> {
    PyArray1::from_slice(py, &joints.as_slice()[..dof])
}

/// What the cell senses at one instant.
#[pyclass(frozen, module = "catchingbot")]
pub struct Observation {
    sensed: Arc<Sensed>,
    dof: usize,
}

impl Observation {
    /// Of an arm with `dof` joints.
    pub fn new(sensed: Arc<Sensed>, dof: usize) -> Self {
        Self { sensed, dof }
    }

    /// Joints of the arm.
    pub fn dof(&self) -> usize {
        self.dof
    }

    /// As brains take it.
    pub fn sensed(&self) -> &Arc<Sensed> {
        &self.sensed
    }
}

/// A serialized name, such as that of a state.
pub fn name_of(value: impl serde::Serialize) -> String {
    serde_json::to_value(value).ok().and_then(|it| it.as_str().map(str::to_owned)).unwrap_or_default()
}

#[pymethods]
impl Observation {
    /// The cell's clock in seconds.
    #[getter]
    fn time_s(&self) -> f64 {
        self.sensed.time_s
    }

    /// Joint positions in radians as the encoders give them.
    #[getter]
    fn q<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        joint_array(py, &self.sensed.arm.q, self.dof)
    }

    /// Joint velocities in rad/s as the encoders give them.
    #[getter]
    fn dq<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        joint_array(py, &self.sensed.arm.dq, self.dof)
    }

    /// Positions, velocities and accelerations that the robot controller asks of the joints, one a row.
    #[getter]
    fn commanded<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let catch_cell::Setpoint { q, dq, ddq } = &self.sensed.arm.commanded;
        let rows = [q, dq, ddq].map(|row| row.as_slice()[..self.dof].to_vec());
        Ok(PyArray2::from_vec2(py, &rows)?)
    }

    /// Identifier of the trajectory that is being executed, if there is one.
    #[getter]
    fn executing(&self) -> Option<u64> {
        self.sensed.arm.executing.map(|it| it.0)
    }

    /// The trajectories that were rejected since the last observation: identifiers with reasons.
    #[getter]
    fn rejected(&self) -> Vec<(u64, String)> {
        self.sensed.arm.rejected.iter().map(|it| (it.id.0, it.reason.to_string())).collect()
    }

    /// Distance between the fingers' inner faces in metres.
    #[getter]
    fn gripper_width_m(&self) -> f64 {
        self.sensed.gripper.width_m
    }

    /// Force of each finger in N.
    #[getter]
    fn gripper_force_n(&self) -> f64 {
        self.sensed.gripper.force_n
    }

    /// What the gripper's drive makes of its grasp: idle, positioning, grasping, holding, no_part or part_lost.
    #[getter]
    fn gripper_state(&self) -> String {
        name_of(self.sensed.gripper.grasp)
    }

    /// Depth images that have arrived since the last observation.
    #[getter]
    fn frames(&self) -> Vec<DepthFrame> {
        (0..self.sensed.frames.len()).map(|index| DepthFrame { sensed: self.sensed.clone(), index }).collect()
    }

    fn __repr__(&self) -> String {
        format!("<Observation at {:.3} s, {} frames>", self.sensed.time_s, self.sensed.frames.len())
    }
}

/// One depth image, or the window of it that was read out.
#[pyclass(frozen, module = "catchingbot")]
pub struct DepthFrame {
    sensed: Arc<Sensed>,
    index: usize,
}

impl DepthFrame {
    fn frame(&self) -> &catch_cell::DepthFrame {
        &self.sensed.frames[self.index]
    }

    /// Rows and columns.
    fn shape(&self) -> [usize; 2] {
        [self.frame().window.height as usize, self.frame().window.width as usize]
    }
}

#[pymethods]
impl DepthFrame {
    /// Index of the camera in `Setup.cameras`.
    #[getter]
    fn camera(&self) -> usize {
        self.frame().camera
    }

    /// When the shutter closed, on the cell's clock.
    #[getter]
    fn capture_s(&self) -> f64 {
        self.frame().capture_s
    }

    /// First column of the window in the camera's image.
    #[getter]
    fn left(&self) -> u32 {
        self.frame().window.left
    }

    /// First row of the window in the camera's image.
    #[getter]
    fn top(&self) -> u32 {
        self.frame().window.top
    }

    /// Depth along the optical axis in metres, rows by columns; NaN where nothing was measured.
    #[getter]
    fn depth_m<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f32>>> {
        PyArray1::from_slice(py, &self.frame().depth_m).reshape(self.shape())
    }

    /// Which of these pixels show the object, where the cell's sensors can tell.
    #[getter]
    fn mask<'py>(&self, py: Python<'py>) -> PyResult<Option<Bound<'py, PyArray2<bool>>>> {
        self.frame().mask.as_ref().map(|mask| PyArray1::from_slice(py, mask).reshape(self.shape())).transpose()
    }
}

/// A pinhole depth camera at a known place: z along its optical axis, x to the right, y down in the image.
#[pyclass(frozen, module = "catchingbot")]
pub struct Camera {
    model: CameraModel,
}

impl From<&CameraModel> for Camera {
    fn from(model: &CameraModel) -> Self {
        Self { model: model.clone() }
    }
}

#[pymethods]
impl Camera {
    /// Pose of the camera in the world, 4×4.
    #[getter]
    #[allow(non_snake_case)]
    fn X_WC<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray2<f64>> {
        self.model.X_WC.to_homogeneous().to_pyarray(py)
    }

    /// Width and height of its images in pixels.
    #[getter]
    fn size_px(&self) -> (u32, u32) {
        (self.model.width_px, self.model.height_px)
    }

    /// Focal length in pixels.
    #[getter]
    fn focal_px(&self) -> f64 {
        self.model.focal_px
    }

    /// Principal point in image coordinates.
    #[getter]
    fn principal_px(&self) -> (f64, f64) {
        self.model.principal_px.into()
    }
}
