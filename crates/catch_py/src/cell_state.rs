//! States of arm and gripper, and what became of trajectories.

use catch_body::{
    JointVector,
    quantity::{self, Quantity},
};
use catch_cell::{
    ArmState as SensedArm, GraspState, GripperState as SensedGripper, RejectedTrajectory, Setpoint, TrajectoryId,
};
use catch_recording::name_of;
use numpy::{PyArray1, PyArray2};
use pyo3::{exceptions::PyTypeError, prelude::*, types::PyDict};
use serde_json::{Value, json};

use crate::arguments::{Numbers, Whole, fault, joint_vector, json_dict, list, number};

/// One number per joint of the arm.
pub fn joint_array<'py>(py: Python<'py>, joints: &JointVector, dof: usize) -> Bound<'py, PyArray1<f64>> {
    PyArray1::from_slice(py, &joints.as_slice()[..dof])
}

/// Positions, velocities and accelerations, one a row.
pub fn setpoint_array<'py>(py: Python<'py>, setpoint: &Setpoint, dof: usize) -> PyResult<Bound<'py, PyArray2<f64>>> {
    let rows = [setpoint.q, setpoint.dq, setpoint.ddq].map(|row| row.as_slice()[..dof].to_vec());
    Ok(PyArray2::from_vec2(py, &rows)?)
}

/// A number within a range.
pub fn quantity(argument: &str, value: &Bound<'_, PyAny>, range: &Quantity) -> PyResult<f64> {
    let value = number(argument, value)?;
    if range.contains(value) { Ok(value) } else { Err(fault(argument, value, range)) }
}

/// Numbers of joints within a range.
fn joints_within(argument: &str, values: &[f64], range: &Quantity) -> PyResult<JointVector> {
    if let Some(value) = values.iter().find(|it| !range.contains(**it)) {
        return Err(fault(argument, value, range));
    }
    Ok(joint_vector(values))
}

/// The arm as its robot controller reports it.
#[pyclass(frozen, module = "catchingbot")]
pub struct ArmState {
    /// State of the arm, as brains take it.
    pub sensed: SensedArm,
    /// Joints of the arm.
    pub dof: usize,
}

#[pymethods]
impl ArmState {
    /// The arm at `time_s` on the cell's clock: positions `q` and velocities `dq` of the joints as the
    /// encoders give them, and the positions, velocities and accelerations that the controller asks for
    /// (3×n), those of `q` at rest if nothing is said.
    #[new]
    #[pyo3(signature = (time_s, q, dq, commanded=None, executing=None, rejected=None))]
    fn new(
        py: Python<'_>,
        time_s: &Bound<'_, PyAny>,
        q: &Bound<'_, PyAny>,
        dq: &Bound<'_, PyAny>,
        commanded: Option<&Bound<'_, PyAny>>,
        executing: Option<Whole>,
        rejected: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<Self> {
        let positions = Numbers::read("q", q, &[0])?.values;
        let dof = positions.len();
        if dof == 0 || dof > catch_body::MAX_JOINTS {
            return Err(fault("q", format!("{dof} numbers"), format!("1 to {}", catch_body::MAX_JOINTS)));
        }
        let (position, velocity) = (&quantity::JOINT_RAD, &quantity::JOINT_RADPS);
        let q = joints_within("q", &positions, position)?;
        let dq = joints_within("dq", &Numbers::read("dq", dq, &[dof])?.values, velocity)?;
        let commanded = match commanded {
            None => Setpoint::at_rest(q),
            Some(rows) => {
                let values = Numbers::read("commanded", rows, &[3, dof])?.values;
                let row = |i: usize, range| joints_within("commanded", &values[i * dof..(i + 1) * dof], range);
                Setpoint { q: row(0, position)?, dq: row(1, velocity)?, ddq: row(2, &quantity::JOINT_RADPS2)? }
            }
        };
        let executing = executing.map(|it| it.checked(py, "executing", 0, u64::MAX)).transpose()?.map(TrajectoryId);
        let rejected = rejected.map(|all| list("rejected", all, "a list of Rejection", |it: &Rejection| it.rejected));
        let time_s = quantity("time_s", time_s, &quantity::CLOCK_S)?;
        let rejected = rejected.transpose()?.unwrap_or_default();
        Ok(Self { sensed: SensedArm { time_s, q, dq, commanded, executing, rejected }, dof })
    }

    /// Time of the sample, on the cell's clock.
    #[getter]
    fn time_s(&self) -> f64 {
        self.sensed.time_s
    }

    /// Joint positions in radians as the encoders give them.
    #[getter]
    fn q<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        joint_array(py, &self.sensed.q, self.dof)
    }

    /// Joint velocities in rad/s as the encoders give them.
    #[getter]
    fn dq<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        joint_array(py, &self.sensed.dq, self.dof)
    }

    /// Positions, velocities and accelerations that the robot controller asks of the joints, one a row.
    #[getter]
    fn commanded<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        setpoint_array(py, &self.sensed.commanded, self.dof)
    }

    /// Identifier of the trajectory that is being executed, if there is one.
    #[getter]
    fn executing(&self) -> Option<u64> {
        self.sensed.executing.map(|it| it.0)
    }

    /// The trajectories that were rejected since the last observation.
    #[getter]
    fn rejected(&self) -> Vec<Rejection> {
        self.sensed.rejected.iter().map(|&rejected| Rejection { rejected }).collect()
    }
}

/// A trajectory that a robot controller did not take, and why: `malformed`, `unknown_joint`, `repeated_id`,
/// `late`, `discontinuous`, `not_at_rest`, `limit` or `declined`.
#[pyclass(frozen, module = "catchingbot")]
pub struct Rejection {
    /// The rejection as cells tell it.
    pub rejected: RejectedTrajectory,
}

impl Rejection {
    /// Returns the reason's name, and its details.
    fn parts(&self) -> (String, Value) {
        match serde_json::to_value(self.rejected.reason).unwrap_or_default() {
            Value::Object(tagged) => tagged.into_iter().next().unwrap_or_default(),
            value => (value.as_str().unwrap_or_default().to_owned(), json!({})),
        }
    }
}

#[pymethods]
impl Rejection {
    /// Rejection of a trajectory by its identifier; `details` as the getter gives them.
    #[new]
    #[pyo3(signature = (id, reason="declined", details=None))]
    fn new(py: Python<'_>, id: Whole, reason: &str, details: Option<&Bound<'_, PyAny>>) -> PyResult<Self> {
        let id = TrajectoryId(id.checked(py, "id", 0, u64::MAX)?);
        let told = match details {
            Some(details) if details.len().map_err(|_| PyTypeError::new_err("details: expected a dict"))? > 0 => {
                let text: String = py.import("json")?.call_method1("dumps", (details,))?.extract()?;
                json!({ reason: serde_json::from_str::<Value>(&text).unwrap_or_default() })
            }
            _ => json!(reason),
        };
        let wrong = |it: serde_json::Error| fault("reason", format!("'{reason}'"), it);
        Ok(Self { rejected: RejectedTrajectory { id, reason: serde_json::from_value(told).map_err(wrong)? } })
    }

    /// Identifier of the trajectory.
    #[getter]
    fn id(&self) -> u64 {
        self.rejected.id.0
    }

    /// Name of the reason.
    #[getter]
    fn reason(&self) -> String {
        self.parts().0
    }

    /// Joint, time and amount, as far as the reason has them: `joint`, `time_s`, `by_s`, `size`, `kind`,
    /// `ratio`, `dof`.
    #[getter]
    fn details<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        json_dict(py, &self.parts().1)
    }

    fn __repr__(&self) -> String {
        format!("<Rejection of trajectory {}: {}>", self.rejected.id, self.rejected.reason)
    }
}

/// A gripper as it reports itself.
#[pyclass(frozen, module = "catchingbot")]
pub struct GripperState {
    /// State of the gripper, as brains take it.
    pub sensed: SensedGripper,
}

#[pymethods]
impl GripperState {
    /// The distance between the fingers' inner faces, its rate of change, each finger's force, and what the
    /// drive makes of its grasp: `idle`, `positioning`, `grasping`, `holding`, `no_part` or `part_lost`.
    #[new]
    #[pyo3(
        signature = (width_m, speed_mps=None, force_n=None, grasp="idle"),
        text_signature = "(width_m, speed_mps=0.0, force_n=0.0, grasp='idle')"
    )]
    fn new(
        width_m: &Bound<'_, PyAny>,
        speed_mps: Option<&Bound<'_, PyAny>>,
        force_n: Option<&Bound<'_, PyAny>>,
        grasp: &str,
    ) -> PyResult<Self> {
        let state: Option<GraspState> = serde_json::from_value(json!(grasp)).ok();
        let expected = "'idle', 'positioning', 'grasping', 'holding', 'no_part' or 'part_lost'";
        let or_zero = |name: &str, value: Option<&Bound<'_, PyAny>>, range: &Quantity| {
            value.map_or(Ok(0.0), |it| quantity(name, it, range))
        };
        let sensed = SensedGripper {
            width_m: quantity("width_m", width_m, &quantity::DRIVE_M)?,
            speed_mps: or_zero("speed_mps", speed_mps, &quantity::DRIVE_MPS)?,
            force_n: or_zero("force_n", force_n, &quantity::DRIVE_N)?,
            grasp: state.ok_or_else(|| fault("grasp", format!("'{grasp}'"), expected))?,
        };
        Ok(Self { sensed })
    }

    /// Distance between the fingers' inner faces in metres.
    #[getter]
    fn width_m(&self) -> f64 {
        self.sensed.width_m
    }

    /// Rate of change of the width in m/s, negative while closing.
    #[getter]
    fn speed_mps(&self) -> f64 {
        self.sensed.speed_mps
    }

    /// Force of each finger in N.
    #[getter]
    fn force_n(&self) -> f64 {
        self.sensed.force_n
    }

    /// Grasp status that the gripper's drive reports.
    #[getter]
    fn grasp(&self) -> String {
        name_of(self.sensed.grasp)
    }
}
