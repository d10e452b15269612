//! Catches described in a file: when, in which pose of the gripper, from which state of the arm.
//!
//! ```json
//! {"q_start": […], "dq_start": […], "grasp_centre_y_m": 0.0833, "gravity": 9.81, "robot": "…", "cases": [
//!   {"id": 0, "time_remaining_s": 0.46, "object_p": […], "object_v": […], "R_WG": [[…], […], […]], "p_WG": […]}]}
//! ```
//! The rows of `R_WG` are those of the matrix whose columns are the gripper's axes in W; the grasp centre
//! p_WG + `grasp_centre_y_m`·y_G is to be at `object_p` with velocity s·`object_v`. `q_start`, `dq_start` and
//! `robot` may stand in a case, too, and count for it alone.

use std::path::Path;

use catch_body::{Gripper, InputError, JointVector, Pose, Robot, dynamics::gravity};
use catch_paper::posed::Target;
use nalgebra::{Matrix3, Point3, Rotation3, Translation3, UnitQuaternion, Vector3};
use serde_json::{Map, Value};

use crate::{
    assets::{Asset, Kind, Origin},
    scenario::{Scenario, setup::DEFAULT_SCENARIO},
};
use catch_recording::{
    bounded_file::FileKind,
    sources::{SourceNames, Sources},
    whole_file::COMMAND_LINE,
};

/// Largest distance between grasp centre and object in a file, in metres.
const TOLERANCE_M: f64 = 1e-6;
/// Largest deviation of a rotation matrix in a file from an orthonormal one.
const TOLERANCE_R: f64 = 1e-6;

/// One catch to be planned.
#[derive(Debug, Clone)]
pub struct PlannerCase {
    /// Name given by the author of the case.
    pub id: Value,
    /// Name or file of the arm; the caller's choice if none is named.
    pub robot: Option<String>,
    /// Joint positions at time zero.
    pub q_start: Vec<f64>,
    /// Joint velocities then; at rest if there are none.
    pub dq_start: Option<Vec<f64>>,
    /// Target pose and time.
    pub target: Target,
    /// Position of the object at that time.
    pub p_WO: Point3<f64>,
    /// Distance of the grasp centre from the gripper's origin.
    pub grasp_centre_y_m: f64,
    /// Name of the case in error messages.
    path: String,
}

/// Reads a file of cases.
///
/// # Errors
/// The first fault: file, field, what stands there and what would be right.
pub fn read(path: &Path) -> Result<Vec<PlannerCase>, InputError> {
    let file = path.display().to_string();
    parse(&file, &FileKind::text("a readable JSON file of planner cases").read_text(path)?)
}

/// Reads cases from the text of a file that errors call `file`.
///
/// # Errors
/// As [`read`].
pub fn parse(file: &str, text: &str) -> Result<Vec<PlannerCase>, InputError> {
    let document: Value = serde_json::from_str(text).map_err(|fault| {
        let (line, column) = (fault.line(), fault.column());
        let rest = text.lines().nth(line.saturating_sub(1)).unwrap_or_default().chars().skip(column.saturating_sub(1));
        let found = format!("`{}`", rest.take(20).collect::<String>());
        let found = if fault.is_eof() { "the end of the file".to_owned() } else { found };
        InputError::new(
            file,
            format!("line {line}, column {column}"),
            found,
            "one whole JSON document, which has no NaN",
        )
    })?;
    let whole = Fields::new(file, "", &document)?;
    whole.only(&["about", "gravity", "q_start", "dq_start", "grasp_centre_y_m", "robot", "cases"])?;
    if let Some(value) = whole.get("gravity") {
        let found = whole.number("gravity", value)?;
        if (found - gravity().norm()).abs() > 1e-9 {
            return Err(whole.fault("gravity", value, &format!("{}, that of the arm's model", gravity().norm())));
        }
    }
    let cases = whole.required("cases", "a list of cases")?;
    let list = cases.as_array().ok_or_else(|| whole.fault("cases", cases, "a list of cases"))?;
    if list.is_empty() {
        return Err(whole.fault("cases", cases, "one case or more"));
    }
    list.iter().enumerate().map(|(i, value)| case(&whole, &Fields::new(file, &format!("cases[{i}]"), value)?)).collect()
}

fn case(whole: &Fields, own: &Fields) -> Result<PlannerCase, InputError> {
    own.only(&[
        "id",
        "time_remaining_s",
        "object_p",
        "object_v",
        "R_WG",
        "p_WG",
        "s_max",
        "q_start",
        "dq_start",
        "robot",
    ])?;
    // Fields of the case go before those of the file.
    let either =
        |name: &'static str| own.get(name).map(|it| (own, it)).or_else(|| whole.get(name).map(|it| (whole, it)));
    let numbers = |name: &'static str| either(name).map(|(at, value)| at.numbers(name, value)).transpose();
    let q_start = numbers("q_start")?.ok_or_else(|| own.missing("q_start", "joint positions in radians"))?;
    let robot = match either("robot") {
        None => None,
        Some((at, value)) => {
            Some(value.as_str().ok_or_else(|| at.fault("robot", value, "a name or a file"))?.to_owned())
        }
    };
    let time = own.required("time_remaining_s", "seconds until the catch")?;
    let catch_s = own.number("time_remaining_s", time)?;
    if !(catch_s > 0.0 && catch_s <= 10.0) {
        return Err(own.fault("time_remaining_s", time, "above 0 and at most 10 s"));
    }
    let vector = |name: &'static str| -> Result<Vector3<f64>, InputError> {
        let expected = "three finite numbers";
        let value = own.required(name, expected)?;
        let numbers = own.numbers(name, value)?;
        let numbers: [f64; 3] = numbers.try_into().map_err(|_| own.fault(name, value, expected))?;
        Ok(numbers.into())
    };
    let centre = either("grasp_centre_y_m");
    let (at, value) = centre.ok_or_else(|| whole.missing("grasp_centre_y_m", "metres along the gripper's y axis"))?;
    let grasp_centre_y_m = at.number("grasp_centre_y_m", value)?;

    let R_WG = rotation(own)?;
    let (p_WG, p_WO, v_WO) = (vector("p_WG")?, vector("object_p")?, vector("object_v")?);
    let X_WG = Pose::from_parts(Translation3::from(p_WG), R_WG);
    let centre = X_WG * Point3::new(0.0, grasp_centre_y_m, 0.0);
    if (centre.coords - p_WO).norm() > TOLERANCE_M {
        let expected = format!("the grasp centre p_WG + grasp_centre_y_m·y_G = {:?}", centre.coords.as_slice());
        return Err(own.fault("object_p", own.required("object_p", "")?, &expected));
    }
    Ok(PlannerCase {
        id: own.get("id").cloned().unwrap_or_default(),
        robot,
        q_start,
        dq_start: numbers("dq_start")?,
        target: Target { catch_s, X_WG, v_WO },
        p_WO: p_WO.into(),
        grasp_centre_y_m,
        path: own.path.clone(),
    })
}

fn rotation(own: &Fields) -> Result<UnitQuaternion<f64>, InputError> {
    let expected = "three rows of a rotation matrix, its columns the gripper's axes in the world";
    let value = own.required("R_WG", expected)?;
    let fault = || own.fault("R_WG", value, expected);
    let rows = value.as_array().filter(|rows| rows.len() == 3).ok_or_else(fault)?;
    let mut matrix = Matrix3::zeros();
    for (i, row) in rows.iter().enumerate() {
        let row = own.numbers("R_WG", row)?;
        if row.len() != 3 {
            return Err(fault());
        }
        matrix.set_row(i, &Vector3::from_column_slice(&row).transpose());
    }
    let off = (matrix * matrix.transpose() - Matrix3::identity()).amax();
    if off > TOLERANCE_R || matrix.determinant() < 0.0 {
        return Err(fault());
    }
    // The digits of a file leave it a little off; the nearest rotation is meant.
    let turn = Rotation3::from_matrix_eps(&matrix, 1e-15, 50, Rotation3::from_matrix_unchecked(matrix));
    Ok(UnitQuaternion::from_rotation_matrix(&turn))
}

impl PlannerCase {
    /// The arm's state at time zero as joint vectors.
    ///
    /// # Errors
    /// If it does not fit the arm.
    pub fn start(&self, file: &str, robot: &Robot) -> Result<(JointVector, JointVector), InputError> {
        let field = |name: &str| format!("{}.{name}", self.path);
        let q = robot.checked_pose(file, &field("q_start"), &self.q_start)?;
        let Some(values) = &self.dq_start else { return Ok((q, JointVector::zeros())) };
        let dq = robot.joint_vector(values).ok_or_else(|| {
            let expected = format!("{} finite numbers", robot.dof());
            InputError::new(file, field("dq_start"), format!("{values:?}"), expected)
        })?;
        for (i, joint) in robot.joints.iter().enumerate() {
            let [low, high] = joint.velocity_range(q[i]);
            if dq[i] < low || dq[i] > high {
                let expected = format!("{low} to {high} rad/s for {}", joint.name);
                return Err(InputError::new(file, format!("{}[{i}]", field("dq_start")), dq[i], expected));
            }
        }
        Ok((q, dq))
    }
}

/// The arm called `name`, or that of the default scenario, and the default scenario's gripper, its grasp
/// centre at `grasp_centre_y_m`.
///
/// # Errors
/// Faults in the name or the files behind it.
pub fn arm(name: Option<&str>, asked_by: (&str, &str)) -> Result<(Robot, Gripper), InputError> {
    let nowhere = Origin::BuiltIn(Default::default());
    let scenario = Asset::find(Kind::Scenario, DEFAULT_SCENARIO, &nowhere, (COMMAND_LINE, "--scenario"))?;
    let parts = Scenario::of_asset(&scenario)?;
    let robot = Asset::find(Kind::Robot, name.unwrap_or(&parts.robot), &nowhere, asked_by)?;
    let gripper = Asset::find(Kind::Gripper, &parts.gripper, &scenario.origin, (&scenario.file, "gripper"))?;
    let (urdf_file, robot_urdf) = robot.read_text_beside("robot.urdf")?;
    let names =
        SourceNames { robot_urdf: &urdf_file, robot_toml: &robot.file, gripper_toml: &gripper.file, workcell_toml: "" };
    let sources = Sources {
        robot_urdf,
        robot_meshes: robot.meshes()?,
        robot_toml: robot.text.clone(),
        gripper_meshes: gripper.meshes()?,
        gripper_toml: gripper.text.clone(),
        workcell_toml: None,
        limit_scale: Default::default(),
    };
    sources.parse(&names)
}

/// A JSON object, and what errors call it.
struct Fields<'a> {
    file: &'a str,
    path: String,
    map: &'a Map<String, Value>,
}

impl<'a> Fields<'a> {
    fn new(file: &'a str, path: &str, value: &'a Value) -> Result<Self, InputError> {
        let map = value.as_object().ok_or_else(|| {
            InputError::new(file, if path.is_empty() { "the document" } else { path }, brief(value), "an object {…}")
        })?;
        Ok(Self { file, path: path.to_owned(), map })
    }

    fn field(&self, name: &str) -> String {
        if self.path.is_empty() { name.to_owned() } else { format!("{}.{name}", self.path) }
    }

    fn get(&self, name: &str) -> Option<&'a Value> {
        self.map.get(name)
    }

    fn fault(&self, name: &str, found: &Value, expected: &str) -> InputError {
        InputError::new(self.file, self.field(name), brief(found), expected)
    }

    fn missing(&self, name: &str, expected: &str) -> InputError {
        InputError::new(self.file, self.field(name), "nothing", expected)
    }

    fn required(&self, name: &str, expected: &str) -> Result<&'a Value, InputError> {
        self.get(name).ok_or_else(|| self.missing(name, expected))
    }

    fn number(&self, name: &str, value: &Value) -> Result<f64, InputError> {
        value.as_f64().filter(|it| it.is_finite()).ok_or_else(|| self.fault(name, value, "a finite number"))
    }

    fn numbers(&self, name: &str, value: &Value) -> Result<Vec<f64>, InputError> {
        let list = value.as_array().ok_or_else(|| self.fault(name, value, "a list of numbers"))?;
        list.iter().enumerate().map(|(i, it)| self.number(&format!("{name}[{i}]"), it)).collect()
    }

    fn only(&self, known: &[&str]) -> Result<(), InputError> {
        match self.map.keys().find(|key| !known.contains(&key.as_str())) {
            None => Ok(()),
            Some(key) => {
                Err(InputError::new(self.file, self.field(key), "a field that means nothing here", known.join(", ")))
            }
        }
    }
}

/// A value on one short line.
fn brief(value: &Value) -> String {
    let text = value.to_string();
    if text.chars().count() <= 60 { text } else { text.chars().take(57).chain("...".chars()).collect() }
}
