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

use catch_body::{Gripper, InputError, JointVector, Pose, Robot, dynamics::gravity, robot::LimitScale};
use catch_paper::posed::Target;
use nalgebra::{Matrix3, Point3, Rotation3, Translation3, UnitQuaternion};
use serde::{Deserialize, de::IgnoredAny};
use serde_json::Value;

use crate::{
    assets::{Asset, Kind},
    scenario::{
        Scenario,
        setup::{DEFAULT_SCENARIO, arm_with_hand},
    },
};
use catch_recording::{bounded_file::FileKind, whole_file::COMMAND_LINE};

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
    let table = serde_json::from_str(text).map_err(|fault| {
        let (line, column) = (fault.line(), fault.column());
        let rest = text.lines().nth(line.saturating_sub(1)).unwrap_or_default().chars().skip(column.saturating_sub(1));
        let found = format!("`{}`", rest.take(20).collect::<String>());
        let found = if fault.is_eof() { "the end of the file".to_owned() } else { found };
        let expected = "one whole JSON document, which has no NaN and no null";
        InputError::new(file, format!("line {line}, column {column}"), found, expected)
    })?;
    let document: Document = InputError::without_faults(InputError::from_table(file, table)?)?;
    if let Some(found) = document.gravity.filter(|it| (it - gravity().norm()).abs() > 1e-9) {
        let expected = format!("{}, that of the arm's model", gravity().norm());
        return Err(InputError::new(file, "gravity", found, expected));
    }
    if document.cases.is_empty() {
        return Err(InputError::new(file, "cases", "[]", "one case or more"));
    }
    document.cases.iter().enumerate().map(|(i, case)| case.read(&document, file, format!("cases[{i}]"))).collect()
}

/// A file of cases.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Document {
    #[serde(rename = "about")]
    _about: Option<IgnoredAny>,
    gravity: Option<f64>,
    q_start: Option<Vec<f64>>,
    dq_start: Option<Vec<f64>>,
    grasp_centre_y_m: f64,
    robot: Option<String>,
    cases: Vec<Case>,
}

/// A case as it stands in a file.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Case {
    #[serde(default)]
    id: Value,
    time_remaining_s: f64,
    object_p: [f64; 3],
    object_v: [f64; 3],
    R_WG: [[f64; 3]; 3],
    p_WG: [f64; 3],
    #[serde(rename = "s_max")]
    _s_max: Option<IgnoredAny>,
    q_start: Option<Vec<f64>>,
    dq_start: Option<Vec<f64>>,
    robot: Option<String>,
}

impl Case {
    /// The case, whose own fields go before those of the file; errors call it `path`.
    fn read(&self, whole: &Document, file: &str, path: String) -> Result<PlannerCase, InputError> {
        let fault = |name: &str, found: String, expected: &str| {
            Err(InputError::new(file, format!("{path}.{name}"), found, expected))
        };
        let Some(q_start) = self.q_start.as_ref().or(whole.q_start.as_ref()).cloned() else {
            return fault("q_start", "nothing".to_owned(), "joint positions in radians");
        };
        let catch_s = self.time_remaining_s;
        if !(catch_s > 0.0 && catch_s <= 10.0) {
            return fault("time_remaining_s", catch_s.to_string(), "above 0 and at most 10 s");
        }
        let Some(R_WG) = rotation(&self.R_WG) else {
            let expected = "three rows of a rotation matrix, its columns the gripper's axes in the world";
            return fault("R_WG", format!("{:?}", self.R_WG), expected);
        };
        let X_WG = Pose::from_parts(Translation3::from(self.p_WG), R_WG);
        let p_WO = Point3::from(self.object_p);
        let centre = X_WG * Point3::new(0.0, whole.grasp_centre_y_m, 0.0);
        if (centre - p_WO).norm() > TOLERANCE_M {
            let expected = format!("the grasp centre p_WG + grasp_centre_y_m·y_G = {:?}", centre.coords.as_slice());
            return fault("object_p", format!("{:?}", self.object_p), &expected);
        }
        Ok(PlannerCase {
            id: self.id.clone(),
            robot: self.robot.as_ref().or(whole.robot.as_ref()).cloned(),
            q_start,
            dq_start: self.dq_start.as_ref().or(whole.dq_start.as_ref()).cloned(),
            target: Target { catch_s, X_WG, v_WO: self.object_v.into() },
            p_WO,
            grasp_centre_y_m: whole.grasp_centre_y_m,
            path,
        })
    }
}

/// The rotation of these rows of a matrix, if they are those of one.
fn rotation(rows: &[[f64; 3]; 3]) -> Option<UnitQuaternion<f64>> {
    let matrix = Matrix3::from(*rows).transpose();
    let off = (matrix * matrix.transpose() - Matrix3::identity()).amax();
    // The digits of a file leave it a little off; the nearest rotation is meant.
    let turn = || Rotation3::from_matrix_eps(&matrix, 1e-15, 50, Rotation3::from_matrix_unchecked(matrix));
    (off <= TOLERANCE_R && matrix.determinant() > 0.0).then(|| UnitQuaternion::from_rotation_matrix(&turn()))
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
    let scenario = Asset::asked(Kind::Scenario, DEFAULT_SCENARIO, (COMMAND_LINE, "--scenario"))?;
    let parts = Scenario::of_asset(&scenario)?;
    let robot = Asset::asked(Kind::Robot, name.unwrap_or(&parts.robot), asked_by)?;
    let gripper = Asset::find(Kind::Gripper, &parts.gripper, &scenario.origin, (&scenario.file, "gripper"))?;
    let (_, arm, hand) = arm_with_hand(&robot, &gripper, None, LimitScale::default())?;
    Ok((arm, hand))
}
