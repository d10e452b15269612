//! Makes a robot of this project from a description that somebody else published: `robot.urdf` and
//! `robot.toml`.
//!
//! The serial arm is found and its fixed joints are folded, capsules are fitted to its shapes, and what the
//! description lacks is filled in and marked as assumed, with the reason.

mod draft;
mod geometry;
mod joint_limits;
mod poses;
mod visual_mesh;

use std::{
    collections::BTreeMap,
    path::{Path, PathBuf},
};

use crate::description::{Chain, Description, Selection, StatedLimits};
use catch_body::{
    Gripper, InputError, JointVector, Robot,
    document::root_element,
    mesh_file::obj_text,
    quantity::{self, Quantity},
    robot::Inertia,
    robot_file::{RobotFiles, ignored_elements},
    stated::{Assumption, Stated, assumptions},
};
use nalgebra::{Point3, Translation3};

use super::{mesh_files::MeshFiles, model_of_mujoco};
use catch_recording::{bounded_file::FileKind, whole_file::COMMAND_LINE};
use draft::{DENSITY_KGPM3, assumed_inertia, is_joint, limits_of, rounded};
pub use draft::{Draft, JointValues};
pub use geometry::BodyShape;

/// Around links whose shape is unknown, in metres.
const UNKNOWN_RADIUS_M: f64 = 0.06;
/// Links nearer to each other have no shape of their own where it is unknown.
const LEAST_LENGTH_M: f64 = 0.02;
/// The file beside a description with what URDF cannot say.
const LIMITS_FILE: &str = "joint_limits.yaml";

/// Elements that only an import reads.
const READ_BESIDES: [&str; 3] = ["mimic", "safety_controller", "transmission"];

/// Joints that an error offers.
const MOST_NAMES: usize = 24;

/// Options of a robot's import.
#[derive(Debug, Clone, Default)]
pub struct ImportOptions {
    /// The link that stands still, if it is not the first.
    pub base: Option<String>,
    /// The link at whose frame the gripper is mounted.
    pub tip: Option<String>,
    /// A `joint_limits.yaml` that does not lie beside the description.
    pub joint_limits: Option<PathBuf>,
    /// Highest accelerations in rad/s²: none, one for all joints or one for each.
    pub max_acceleration: Vec<f64>,
    /// Rotor inertias in kg·m², likewise.
    pub rotor_inertia: Vec<f64>,
    /// Highest jerks in rad/s³, likewise.
    pub max_jerk: Vec<f64>,
}

/// A robot that was imported, not yet written.
#[derive(Debug, Clone)]
pub struct ImportedRobot {
    /// The arm as its files describe it.
    pub robot: Robot,
    /// Contents of its files.
    pub draft: Draft,
    /// Poses from which a search for the best waiting pose can begin, the best first.
    pub starts: Vec<JointVector>,
    /// Elements of the description that say nothing to an arm.
    pub ignored: Vec<String>,
}

impl ImportedRobot {
    /// Reads the description in `file`; the gripper is what the arm is to carry.
    ///
    /// # Errors
    /// Faults of the description or of the options: no serial arm, more than one, numbers out of their
    /// ranges.
    pub fn read(file: &Path, options: &ImportOptions, gripper: &Gripper) -> Result<Self, InputError> {
        let name = file.display().to_string();
        let text = FileKind::text("a description of a robot, URDF").read_text(file)?;
        let description = match root_element(&text) {
            Some("mujoco") => return Err(model_of_mujoco(&name)),
            _ => Description::from_urdf(&name, &text)?,
        };
        let selection = Selection { base: options.base.as_deref(), tip: options.tip.as_deref() };
        let chain = Chain::of(&description, &selection)?;
        let limits = read_limits(file, options, &description)?;

        let bodies = std::iter::once(&chain.base).chain(chain.joints.iter().map(|it| &it.body));
        let mut meshes = MeshFiles::new(file);
        let shapes: Result<Vec<BodyShape>, _> = bodies.map(|body| BodyShape::of(body, &mut meshes)).collect();
        let mut shapes = shapes?;
        assume_shapes(&chain, &mut shapes);
        let joints = joint_values(&name, &chain, &limits, options)?;
        let dof = joints.len();
        let middle: Vec<f64> = joints.iter().map(|it| f64::midpoint(it.range.value[0], it.range.value[1])).collect();
        let file_name = file.file_name().unwrap_or_default().to_string_lossy().into_owned();
        let mut draft = Draft {
            name: if description.name.trim().is_empty() { "robot".into() } else { description.name.clone() },
            source: file_name,
            inertias: inertias(&name, &chain, &shapes)?,
            base_height_m: 0.0,
            X_LF: flange(&chain, &shapes),
            chain,
            shapes,
            joints,
            ignored_neighbours: 2,
            comfortable_rad: middle.clone(),
            ready_rad: middle,
        };

        let mounted = |draft: &Draft| parsed(draft).map(|it| it.with_mount_of(gripper));
        let mut robot = mounted(&draft)?;
        if lighten(&mut draft, &robot, gripper) {
            robot = mounted(&draft)?;
        }
        let torques = poses::sufficient_torques(&robot, gripper);
        for (i, values) in draft.joints.iter_mut().enumerate() {
            if values.torque.assumed.is_some() {
                let reason =
                    "no file has one: what the arm and a gripper need at the highest accelerations, and a fifth more";
                values.torque = Stated { value: rounded(torques[i].max(1.0)), assumed: Some(reason.into()) };
            }
        }
        draft.ignored_neighbours = poses::ignored_neighbours(&robot, gripper);
        draft.base_height_m = poses::base_height_m(&robot);
        let starts = poses::good_poses(&mounted(&draft)?, gripper, MOST_STARTS);
        let ignored = ignored_elements(&text, &READ_BESIDES);
        let mut imported = Self { robot: mounted(&draft)?, draft, starts, ignored };
        if let Some(&best) = imported.starts.first() {
            imported.draft.comfortable_rad = in_short(&best, dof);
            imported.set_ready(&best)?;
        }
        Ok(imported)
    }

    /// Makes `q` the pose in which the arm waits.
    ///
    /// # Errors
    /// If a joint is out of its range there.
    pub fn set_ready(&mut self, q: &JointVector) -> Result<(), InputError> {
        self.draft.ready_rad = in_short(q, self.robot.dof());
        self.robot = Robot { X_LG: self.robot.X_LG, ..parsed(&self.draft)? };
        Ok(())
    }

    /// The meshes that `robot.toml` names, with these names.
    pub fn meshes(&self) -> Vec<(String, String)> {
        self.draft.visuals().map(|(_, name, (mesh, _))| (name, obj_text(std::slice::from_ref(mesh)))).collect()
    }

    /// Returns whether the shapes of all links were read and each of their triangles is inside a capsule, and
    /// a sentence that says so.
    pub fn coverage(&self) -> (bool, String) {
        let all = self.draft.shapes.len();
        let read: Vec<&BodyShape> = self.draft.shapes.iter().filter(|it| !it.surface.triangles.is_empty()).collect();
        match read.len() {
            0 => (false, "no shape was read, so all capsules are assumed".to_owned()),
            _ if !read.iter().all(|it| it.is_inside()) => (false, "some shape is outside of its capsules".to_owned()),
            some if some < all => {
                (false, format!("{some} of {all} links have shapes, which are inside their capsules"))
            }
            _ => (true, "every shape is inside its capsules".to_owned()),
        }
    }

    /// All values that nobody published.
    pub fn assumptions(&self) -> Vec<Assumption> {
        assumptions("robot.toml", &self.draft.toml())
    }
}

/// Poses that are kept to begin a search with.
const MOST_STARTS: usize = 40;

/// The arm that a draft describes.
fn parsed(draft: &Draft) -> Result<Robot, InputError> {
    let (urdf, toml) = (draft.urdf(), draft.toml());
    let file = |ending: &str| format!("{} ({ending})", draft.source);
    Robot::from_files(&RobotFiles {
        urdf_file: &file("as robot.urdf"),
        urdf: &urdf,
        toml_file: &file("as robot.toml"),
        toml: &toml,
    })
}

fn in_short(q: &JointVector, dof: usize) -> Vec<f64> {
    // Towards zero: a pose within the ranges stays there.
    q.iter().take(dof).map(|value| (value * 1e3).trunc() / 1e3).collect()
}

/// Limits beside the description, or where somebody says they are; each has to be of one of its joints.
fn read_limits(
    file: &Path,
    options: &ImportOptions,
    description: &Description,
) -> Result<BTreeMap<String, StatedLimits>, InputError> {
    let beside = file.with_file_name(LIMITS_FILE);
    let path = match &options.joint_limits {
        Some(path) => path.clone(),
        None if beside.exists() => beside,
        None => return Ok(BTreeMap::new()),
    };
    let text = FileKind::toml("limits of joints in YAML").read_text(&path)?;
    let path = path.display().to_string();
    let limits = joint_limits::read(&path, &text)?;
    let joints: Vec<&str> = description.joints.values().flatten().map(|it| it.name.as_str()).collect();
    let unknown = limits.keys().find(|key| !joints.iter().any(|joint| is_joint(key, joint)));
    unknown.map_or(Ok(()), |key| {
        let names: Vec<&str> = joints.iter().take(MOST_NAMES).copied().collect();
        let expected = format!("one of the joints {}, or the end of its name", names.join(", "));
        Err(InputError::new(&path, format!("joint_limits.{key}"), "a joint that is not there", expected))
    })?;
    Ok(limits)
}

/// Values of the joints of an arm, of all that is stated and given; `file` is the description.
fn joint_values(
    file: &str,
    chain: &Chain,
    limits: &BTreeMap<String, StatedLimits>,
    options: &ImportOptions,
) -> Result<Vec<JointValues>, InputError> {
    let dof = chain.joints.len();
    let acceleration =
        per_joint(&options.max_acceleration, dof, "--max-acceleration", quantity::JOINT_ACCELERATION_RADPS2)?;
    let rotor_inertia = per_joint(&options.rotor_inertia, dof, "--rotor-inertia", quantity::ROTOR_INERTIA_KGM2)?;
    let jerk = per_joint(&options.max_jerk, dof, "--max-jerk", quantity::JOINT_JERK_RADPS3)?;
    let joints = chain.joints.iter().enumerate().map(|(i, joint)| {
        let given = [acceleration[i], rotor_inertia[i], jerk[i]];
        JointValues::of(file, joint, &limits_of(limits, &joint.joint.name), given)
    });
    joints.collect()
}

/// Values of an option within a range, one for each joint.
fn per_joint(values: &[f64], dof: usize, option: &str, range: Quantity) -> Result<Vec<Option<f64>>, InputError> {
    InputError::first_of(values.iter().map(|it| range.check(COMMAND_LINE, option, *it)))?;
    match values {
        [] => Ok(vec![None; dof]),
        [value] => Ok(vec![Some(*value); dof]),
        values if values.len() == dof => Ok(values.iter().copied().map(Some).collect()),
        values => {
            let (found, expected) = (values.len(), format!("one for all joints or one for each of the {dof}"));
            Err(InputError::new(COMMAND_LINE, option, format!("{found} values"), expected))
        }
    }
}

/// Capsules from joint to joint for links whose shapes are unknown.
fn assume_shapes(chain: &Chain, shapes: &mut [BodyShape]) {
    for (i, shape) in shapes.iter_mut().enumerate() {
        let next = chain.joints.get(i).map_or(chain.X_LF, |it| it.joint.X_PL);
        let to = Point3::from(next.translation.vector);
        if shape.capsules.is_empty() && to.coords.norm() > LEAST_LENGTH_M {
            shape.assume_capsule(to, UNKNOWN_RADIUS_M);
        }
    }
}

fn inertias(file: &str, chain: &Chain, shapes: &[BodyShape]) -> Result<Vec<Stated<Inertia>>, InputError> {
    let of_body = |(joint, shape): (&crate::description::ChainJoint, &BodyShape)| {
        if let Some(inertia) = joint.body.inertia {
            let field = format!("link {}: mass", joint.body.links[0]);
            quantity::PART_MASS_KG.check(file, field, inertia.mass)?;
        }
        Ok(match joint.body.inertia {
            Some(inertia) if inertia.is_of_a_body() => Stated { value: inertia, assumed: None },
            Some(inertia) => Stated {
                value: Inertia { com: inertia.com, ..assumed_inertia(shape, Some(inertia.mass)) },
                assumed: Some(
                    "no body has the moments that the description states: those of its capsules with its mass".into(),
                ),
            },
            None => Stated {
                value: assumed_inertia(shape, None),
                assumed: Some(format!(
                    "the description states no mass, or leaves it to a mesh: the link's capsules filled with {DENSITY_KGPM3} kg/m³"
                )),
            },
        })
    };
    chain.joints.iter().zip(shapes.iter().skip(1)).map(of_body).collect()
}

/// Takes so much off the masses that are assumed that the motors can hold the arm. Returns whether it had to.
fn lighten(draft: &mut Draft, robot: &Robot, gripper: &Gripper) -> bool {
    let has_mass = |joint: &crate::description::ChainJoint| joint.body.inertia.is_some();
    let is_assumed: Vec<bool> = draft.chain.joints.iter().map(|it| !has_mass(it)).collect();
    let fraction = poses::fraction_that_is_held(robot, &is_assumed, gripper);
    if fraction == 1.0 {
        return false;
    }
    for (inertia, _) in draft.inertias.iter_mut().zip(&is_assumed).filter(|(_, is_assumed)| **is_assumed) {
        let Inertia { mass, com, about_com } = inertia.value;
        let reason = format!(
            "the description states no mass: the link's capsules filled with {:.0} kg/m³, so that half of the torque limits holds the arm",
            DENSITY_KGPM3 * fraction
        );
        let value = Inertia { mass: rounded(mass * fraction), com, about_com: about_com * fraction };
        *inertia = Stated { value, assumed: Some(reason) };
    }
    true
}

/// Pose of the flange: its frame in the description, or in front of the last link's shape where there is
/// none.
fn flange(chain: &Chain, shapes: &[BodyShape]) -> Stated<catch_body::Pose> {
    let X_LG = chain.X_LF * chain.X_FG();
    if chain.has_flange {
        return Stated { value: X_LG, assumed: None };
    }
    let approach_L = X_LG.rotation * nalgebra::Vector3::y();
    let from_m = approach_L.dot(&chain.X_LF.translation.vector);
    let beyond_m = shapes.last().and_then(|it| it.reach(&approach_L)).map_or(0.0, |reach| (reach - from_m).max(0.0));
    let value = Translation3::from(approach_L * beyond_m) * X_LG;
    let reason =
        "the description has no frame for a gripper: where the shape of the last link ends along its joint's axis";
    Stated { value, assumed: Some(reason.into()) }
}
