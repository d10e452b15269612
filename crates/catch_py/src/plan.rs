//! A planned catch.

use catch_bot::control::Decision;
use catch_recording::name_of;
use numpy::{PyArray1, PyArray2, ToPyArray};
use pyo3::prelude::*;

use crate::{cell_state::joint_array, command::control_points};

/// A catch and the motion to it, or why there is none.
#[pyclass(frozen, module = "catchingbot")]
pub struct Plan {
    /// The decision as planners make it.
    pub decision: Decision,
    /// Joints of the arm.
    pub dof: usize,
}

#[pymethods]
impl Plan {
    /// `planned`, `plan_kept` for one that is executed already, or why not: `out_of_reach`, `no_grasp`,
    /// `blocked`, `no_plan` or `out_of_budget`.
    #[getter]
    fn status(&self) -> String {
        name_of(self.decision.status)
    }

    /// Knots of the motion, a clamped cubic B-spline, in seconds.
    #[getter]
    fn knots_s<'py>(&self, py: Python<'py>) -> Option<Bound<'py, PyArray1<f64>>> {
        self.decision.plan.as_ref().map(|plan| PyArray1::from_slice(py, &plan.trajectory.knots_s))
    }

    /// Control points of the trajectory in radians, one a row.
    #[getter]
    fn control_points<'py>(&self, py: Python<'py>) -> PyResult<Option<Bound<'py, PyArray2<f64>>>> {
        let plan = self.decision.plan.as_ref();
        plan.map(|plan| control_points(py, &plan.trajectory, self.dof)).transpose()
    }

    /// Time at which the object is at the grasp centre.
    #[getter]
    fn catch_s(&self) -> Option<f64> {
        self.decision.plan.as_ref().map(|plan| plan.catch_s)
    }

    /// Joint positions then, in radians.
    #[getter]
    fn q<'py>(&self, py: Python<'py>) -> Option<Bound<'py, PyArray1<f64>>> {
        self.decision.plan.as_ref().map(|plan| joint_array(py, &plan.q, self.dof))
    }

    /// Pose of the gripper then, 4×4.
    #[getter]
    #[allow(non_snake_case)]
    fn X_WG<'py>(&self, py: Python<'py>) -> Option<Bound<'py, PyArray2<f64>>> {
        self.decision.plan.as_ref().map(|plan| plan.X_WG.to_homogeneous().to_pyarray(py))
    }

    /// Gripper aperture before the catch, in metres.
    #[getter]
    fn aperture_m(&self) -> Option<f64> {
        self.decision.plan.as_ref().map(|plan| plan.aperture_m)
    }

    fn __repr__(&self) -> String {
        format!("<Plan: {}>", name_of(self.decision.status))
    }
}
