//! Commands of a brain as Python objects.

use std::sync::Arc;

use catch_body::MAX_JOINTS;
use catch_cell::{ArmTrajectory, BSpline, Command as Sent, PixelWindow, TrajectoryId};
use catch_lab::trial::StateSnapshot;
use numpy::{PyArray1, PyArray2};
use pyo3::{prelude::*, types::PyTuple};

use crate::{
    arguments::{MOST, Numbers, Whole, fault, instance, joint_vector, list, number},
    observation::{Window, window_of},
};

/// A motion of the arm: a clamped cubic B-spline of joint positions over the cell's clock.
#[pyclass(frozen, module = "catchingbot")]
pub struct Trajectory {
    /// The trajectory as it is sent.
    pub sent: ArmTrajectory,
    dof: usize,
}

/// The control points of a spline, one a row.
pub fn control_points<'py>(py: Python<'py>, spline: &BSpline, dof: usize) -> PyResult<Bound<'py, PyArray2<f64>>> {
    let rows: Vec<Vec<f64>> = spline.control_points.iter().map(|point| point.as_slice()[..dof].to_vec()).collect();
    Ok(PyArray2::from_vec2(py, &rows)?)
}

#[pymethods]
impl Trajectory {
    #[new]
    #[pyo3(signature = (id, knots_s, control_points), text_signature = "(id, knots_s, control_points)")]
    fn new(py: Python<'_>, id: Whole, knots_s: &Bound<'_, PyAny>, control_points: &Bound<'_, PyAny>) -> PyResult<Self> {
        let id = id.checked(py, "id", 0, MOST)?;
        let knots = Numbers::read("knots_s", knots_s, &[0])?.values;
        let points = Numbers::read("control_points", control_points, &[0, 0])?;
        let dof = points.shape[1];
        if dof == 0 || dof > MAX_JOINTS {
            return Err(fault("control_points", format!("{dof} columns"), "one for each joint of the arm"));
        }
        let control_points = points.values.chunks_exact(dof).map(joint_vector);
        let spline = BSpline { knots_s: knots, control_points: control_points.collect() };
        if !spline.is_valid() || spline.start_s() >= spline.end_s() {
            let found = format!("{} for {} control points", spline.knots_s.len(), spline.control_points.len());
            return Err(fault("knots_s", found, "rising times, four more than the four or more control points"));
        }
        Ok(Self { sent: ArmTrajectory { id: TrajectoryId(id), spline }, dof })
    }

    fn __getnewargs__<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyTuple>> {
        (self.id(), self.knots_s(py), self.control_points(py)?).into_pyobject(py)
    }

    /// Identifier, higher than those of all trajectories that were sent before.
    #[getter]
    fn id(&self) -> u64 {
        self.sent.id.0
    }

    /// Knots in seconds.
    #[getter]
    fn knots_s<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_slice(py, &self.sent.spline.knots_s)
    }

    /// Control points in radians, one a row.
    #[getter]
    fn control_points<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        control_points(py, &self.sent.spline, self.dof)
    }
}

/// One move of the fingers.
#[pyclass(frozen, get_all, module = "catchingbot")]
#[derive(Clone, Copy)]
pub struct GripperMove {
    /// Start of the move, on the cell's clock.
    start_s: f64,
    /// Width at the end of the move: the distance between the fingers' inner faces in metres.
    width_m: f64,
    /// Highest speed of the fingers relative to each other, in m/s.
    speed_mps: f64,
    /// Highest force of each finger, in N.
    force_n: f64,
}

impl From<catch_cell::GripperMove> for GripperMove {
    fn from(sent: catch_cell::GripperMove) -> Self {
        let catch_cell::GripperMove { start_s, width_m, speed_mps, force_n } = sent;
        Self { start_s, width_m, speed_mps, force_n }
    }
}

impl GripperMove {
    /// Moves in a list.
    pub fn list(moves: &Bound<'_, PyAny>, argument: &str) -> PyResult<Vec<catch_cell::GripperMove>> {
        list(argument, moves, "a list of GripperMove", |it: &Self| {
            let Self { start_s, width_m, speed_mps, force_n } = *it;
            catch_cell::GripperMove { start_s, width_m, speed_mps, force_n }
        })
    }
}

#[pymethods]
impl GripperMove {
    #[new]
    fn new(
        start_s: &Bound<'_, PyAny>,
        width_m: &Bound<'_, PyAny>,
        speed_mps: &Bound<'_, PyAny>,
        force_n: &Bound<'_, PyAny>,
    ) -> PyResult<Self> {
        let above_zero = |argument: &str, value| {
            let value = number(argument, value)?;
            if value > 0.0 { Ok(value) } else { Err(fault(argument, value, "a number above zero")) }
        };
        Ok(Self {
            start_s: number("start_s", start_s)?,
            width_m: number("width_m", width_m)?,
            speed_mps: above_zero("speed_mps", speed_mps)?,
            force_n: above_zero("force_n", force_n)?,
        })
    }
}

/// Command of a brain: a new trajectory, other moves of the gripper, both or nothing.
#[pyclass(frozen, module = "catchingbot")]
pub struct Command {
    /// Command as the cell takes it.
    pub sent: Sent,
    /// Snapshot of the brain, if it is a built-in one.
    pub snapshot: Option<Arc<StateSnapshot>>,
    /// Joints of the arm.
    pub dof: usize,
}

#[pymethods]
impl Command {
    #[new]
    #[pyo3(signature = (trajectory=None, gripper=None, windows=None))]
    fn new(
        trajectory: Option<&Bound<'_, PyAny>>,
        gripper: Option<&Bound<'_, PyAny>>,
        windows: Option<Vec<Window>>,
    ) -> PyResult<Self> {
        let trajectory = trajectory.map(|it| instance::<Trajectory>("trajectory", it, "a Trajectory or None"));
        let trajectory = trajectory.transpose()?;
        let moves = gripper.map(|moves| GripperMove::list(moves, "gripper"));
        let window = |(left, top, width, height): Window| PixelWindow { left, top, width, height };
        let windows = windows.map(|windows| windows.into_iter().map(window).collect());
        let sent = Sent { arm: trajectory.map(|it| it.sent.clone()), gripper: moves.transpose()?, windows };
        Ok(Self { sent, snapshot: None, dof: trajectory.map_or(0, |it| it.dof) })
    }

    /// Replaces the executing trajectory from its start on; `None` changes nothing.
    #[getter]
    fn trajectory(&self) -> Option<Trajectory> {
        Some(Trajectory { sent: self.sent.arm.clone()?, dof: self.dof })
    }

    /// Replaces all gripper moves that have not started; `None` changes nothing.
    #[getter]
    fn gripper(&self) -> Option<Vec<GripperMove>> {
        self.sent.gripper.as_ref().map(|moves| moves.iter().copied().map(GripperMove::from).collect())
    }
    /// The part of each camera's next images that the brain wants, as (left, top, width, height) in pixels;
    /// `None` means all that the cameras give by themselves.
    #[getter]
    fn windows(&self) -> Option<Vec<Window>> {
        self.sent.windows.as_ref().map(|windows| windows.iter().map(window_of).collect())
    }
}
