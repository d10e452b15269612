//! Arms, grippers and objects from their files: texts for whoever reads them, numbers for whoever simulates
//! them.

use catch_body::{
    Gripper as BodyGripper, InputError, Pose, Robot as BodyRobot, robot::LimitScale, robot_file::RobotFiles,
    workcell::Workcell,
};
use catch_lab::{
    assets::{Asset, Kind},
    scenario::setup::Setup,
};
use catch_recording::{
    sources::{Meshes, Sources},
    whole_file::COMMAND_LINE,
};
use nalgebra::{Matrix3, Point3};
use numpy::{PyArray1, PyArray2, ToPyArray};
use pyo3::{prelude::*, types::PyDict};
use serde_json::json;

use crate::{
    arguments::{Named, Numbers, input_fault, joints, json_dict},
    cell_state::joint_array,
};

/// Finds the asset that an argument names: a built-in one, or a file.
pub fn asset(kind: Kind, name: &str, argument: &str) -> PyResult<Asset> {
    Asset::asked(kind, name, (COMMAND_LINE, &format!("--{argument}"))).map_err(input_fault)
}

/// An arm by its name or the file `robot.toml`, and what stands around it.
#[pyclass(frozen, module = "catchingbot")]
pub struct Robot {
    /// The arm, with its workcell; it waits at its `ready_q`.
    pub model: BodyRobot,
    /// The texts it is made from; those of a gripper are not its own.
    pub sources: Sources,
}

impl Robot {
    /// Returns the texts of arm and gripper, as recordings keep them.
    pub fn sources(&self, gripper: &Gripper) -> Sources {
        let (gripper_toml, gripper_meshes) = (gripper.toml.clone(), gripper.meshes.clone());
        Sources { gripper_toml, gripper_meshes, ..self.sources.clone() }
    }
}

#[pymethods]
impl Robot {
    #[new]
    #[pyo3(signature = (robot, *, workcell=None, ready_q=None))]
    fn new(
        py: Python<'_>,
        robot: Named,
        workcell: Option<Named>,
        ready_q: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<Self> {
        let arm = asset(Kind::Robot, &robot.text(py, "robot")?, "robot")?;
        let (urdf_file, urdf) = arm.read_text_beside("robot.urdf").map_err(input_fault)?;
        let files = RobotFiles { urdf_file: &urdf_file, urdf: &urdf, toml_file: &arm.file, toml: &arm.text };
        let model = BodyRobot::from_files(&files).and_then(|it| it.with_meshes(&|name| arm.read_beside(name)));
        let mut model = model.map_err(input_fault)?;
        let around = workcell.map(|it| asset(Kind::Workcell, &it.text(py, "workcell")?, "workcell")).transpose()?;
        if let Some(around) = &around {
            model.obstacles = Workcell::from_toml(&around.file, &around.text).map_err(input_fault)?.obstacles;
        }
        if let Some(ready_q) = ready_q {
            let values = Numbers::read("ready_q", ready_q, &[model.dof()])?.values;
            model.ready_q = model.checked_pose(COMMAND_LINE, "--ready_q", &values).map_err(input_fault)?;
        }
        let sources = Sources {
            robot_urdf: urdf,
            robot_meshes: arm.meshes().map_err(input_fault)?,
            robot_toml: arm.text,
            gripper_toml: String::new(),
            gripper_meshes: Meshes::new(),
            workcell_toml: around.map(|it| it.text),
            limit_scale: LimitScale::default(),
        };
        Ok(Self { model, sources })
    }

    /// Text of `robot.urdf`.
    #[getter]
    fn urdf(&self) -> &str {
        &self.sources.robot_urdf
    }

    /// Text of `robot.toml`, which says what a URDF cannot.
    #[getter]
    fn toml(&self) -> &str {
        &self.sources.robot_toml
    }

    /// Text of the workcell's file, if there is one.
    #[getter]
    fn workcell(&self) -> Option<&str> {
        self.sources.workcell_toml.as_deref()
    }

    /// Number of its joints.
    #[getter]
    fn dof(&self) -> usize {
        self.model.dof()
    }

    /// Joint positions in radians where it waits.
    #[getter]
    fn ready_q<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        joint_array(py, &self.model.ready_q, self.dof())
    }

    /// Lowest and highest positions, highest velocities, accelerations and torques of the joints, one a row.
    #[getter]
    pub fn limits<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let joints = self.model.joints.iter().map(|it| it.limits);
        let columns: Vec<[f64; 5]> =
            joints.map(|it| [it.lower, it.upper, it.velocity, it.acceleration, it.torque]).collect();
        let rows: Vec<Vec<f64>> = (0..5).map(|row| columns.iter().map(|column| column[row]).collect()).collect();
        Ok(PyArray2::from_vec2(py, &rows)?)
    }

    /// All that a simulator needs. `X_WB` is the pose of the base. Each of `joints` has `name`, `link`,
    /// `X_PL` (pose of its link in the one before while the joint is at zero), `axis` (in the link), `lower`,
    /// `upper`, `torque`, `damping`, `rotor_inertia`, and the link's `mass`, `com` and `inertia` (about it).
    /// `X_LF` is the pose of the flange in the last link, `X_LF_by_gripper` that for grippers, by their
    /// names, that are mounted in another way, and `X_LG` that of the setup's gripper: the flange's for an
    /// arm that belongs to no setup. `capsules` are its shape: `link` (0 is the base), `from`, `to`,
    /// `radius`. `boxes` (`X_WS`, `size`) and `obstacle_capsules` stand around it.
    #[getter]
    fn numbers<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let it = &self.model;
        let joints = it.joints.iter().map(|joint| {
            json!({
                "name": joint.name, "link": joint.link_name, "X_PL": rows_of(&joint.X_PL), "axis": joint.axis.as_slice(),
                "lower": joint.limits.lower, "upper": joint.limits.upper, "torque": joint.limits.torque,
                "damping": joint.damping, "rotor_inertia": joint.rotor_inertia, "mass": joint.inertia.mass,
                "com": joint.inertia.com.coords.as_slice(), "inertia": matrix_rows(&joint.inertia.about_com),
            })
        });
        let capsule = |link: usize, of: &catch_body::shape::Capsule| {
            let [from, to] = [of.from, of.to].map(|end| <[f64; 3]>::from(end.coords));
            json!({ "link": link, "from": from, "to": to, "radius": of.radius })
        };
        let boxes = it.obstacles.iter().filter_map(|it| it.as_cuboid());
        let numbers = json!({
            "name": it.name, "X_WB": rows_of(&it.X_WB), "joints": joints.collect::<Vec<_>>(), "X_LG": rows_of(&it.X_LG),
            "X_LF": rows_of(&it.X_LF),
            "X_LF_by_gripper": it.X_LF_by_gripper.iter().map(|(name, X)| (name.clone(), json!(rows_of(X)))).collect::<serde_json::Map<_, _>>(),
            "capsules": it.capsules.iter().map(|(link, of)| capsule(*link, of)).collect::<Vec<_>>(),
            "boxes": boxes.map(|(X_WS, of)| json!({ "X_WS": rows_of(X_WS), "size": of.size.as_slice() })).collect::<Vec<_>>(),
            "obstacle_capsules": it.obstacles.iter().filter_map(|it| it.as_capsule()).map(|of| capsule(0, of)).collect::<Vec<_>>(),
        });
        json_dict(py, &numbers)
    }

    /// Pose of a gripper in the world (4×4) with the joints at `q`. Without `gripper` it is that of the
    /// setup, or the flange of an arm that belongs to none.
    #[pyo3(signature = (q, gripper=None))]
    fn gripper_pose<'py>(
        &self,
        py: Python<'py>,
        q: &Bound<'py, PyAny>,
        gripper: Option<&Gripper>,
    ) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let q = joints("q", q, self.dof())?;
        let mut model = self.model.clone();
        if let Some(gripper) = gripper {
            model = model.with_mount_of(&gripper.model);
        }
        Ok(model.gripper_pose(&q).to_homogeneous().to_pyarray(py))
    }

    fn __repr__(&self) -> String {
        format!("<Robot {}: {} joints>", self.model.name, self.dof())
    }
}

/// A gripper by its name or file.
#[pyclass(frozen, module = "catchingbot")]
pub struct Gripper {
    /// The gripper.
    pub model: BodyGripper,
    /// The text that it is made from.
    pub toml: String,
    /// The meshes that the text names.
    pub meshes: Meshes,
}

#[pymethods]
impl Gripper {
    #[new]
    fn new(py: Python<'_>, gripper: Named) -> PyResult<Self> {
        let file = asset(Kind::Gripper, &gripper.text(py, "gripper")?, "gripper")?;
        let model = BodyGripper::from_toml(&file.file, &file.text);
        let model = model.and_then(|it| it.with_meshes(&|name| file.read_beside(name))).map_err(input_fault)?;
        let meshes = file.meshes().map_err(input_fault)?;
        Ok(Self { model, toml: file.text, meshes })
    }

    /// Text of its file.
    #[getter]
    fn toml(&self) -> &str {
        &self.toml
    }

    /// The fields of its file, with `latency_s` and `state_rate_hz` of its drive.
    #[getter]
    fn numbers<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let fields: toml::Table = InputError::parse_toml("gripper", &self.toml).map_err(input_fault)?;
        let dict = json_dict(py, &fields)?;
        dict.set_item("latency_s", self.model.drive.latency_s)?;
        dict.set_item("state_rate_hz", self.model.drive.state_rate_hz)?;
        Ok(dict)
    }

    fn __repr__(&self) -> String {
        format!("<Gripper {}>", self.model.name)
    }
}

/// The object of a setup as it truly is, for whoever simulates it.
pub fn object_dict<'py>(py: Python<'py>, setup: &Setup) -> PyResult<Bound<'py, PyDict>> {
    let object = &setup.object;
    let numbers = json!({
        "name": object.name, "mass": object.mass_kg, "com": coordinates(&object.com_O),
        "inertia": matrix_rows(&object.inertia_kgm2), "restitution": object.restitution,
        "stiffness_npm": object.stiffness_npm, "parts": object.parts,
    });
    let dict = json_dict(py, &numbers)?;
    let vertices: Vec<Vec<f64>> = object.mesh.vertices.iter().map(|it| coordinates(it).to_vec()).collect();
    let faces: Vec<Vec<u32>> = object.mesh.triangles.iter().map(|it| it.to_vec()).collect();
    dict.set_item("vertices", PyArray2::from_vec2(py, &vertices)?)?;
    dict.set_item("faces", PyArray2::from_vec2(py, &faces)?)?;
    Ok(dict)
}

fn coordinates(point: &Point3<f64>) -> [f64; 3] {
    point.coords.into()
}

fn matrix_rows(matrix: &Matrix3<f64>) -> [[f64; 3]; 3] {
    matrix.transpose().into()
}

#[allow(non_snake_case)]
pub fn rows_of(X: &Pose) -> [[f64; 4]; 4] {
    X.to_homogeneous().transpose().into()
}
