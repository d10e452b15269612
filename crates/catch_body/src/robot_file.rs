//! Reads an arm from its URDF and the `robot.toml` beside it. A limit that is missing is an error, never a guess.

use std::collections::BTreeMap;

use nalgebra::{Matrix3, Point3, Unit, Vector3};
use serde::Deserialize;

pub use crate::urdf::ignored_elements;
use crate::{
    InputError,
    pose::PoseFields,
    quantity::{self, Quantity},
    robot::{Inertia, Joint, JointLimits, MAX_JOINTS, Robot},
    shape::Capsule,
    urdf::{self, Element, Urdf},
};

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct RobotFile {
    base: PoseFields,
    gripper_mount: MountFields,
    poses: PosesFields,
    joints: BTreeMap<String, JointFields>,
    collision: CollisionFields,
}

/// A pose on the last link.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct MountFields {
    #[serde(deserialize_with = "quantity::offset_m")]
    position_m: [f64; 3],
    #[serde(deserialize_with = "quantity::angle_rad")]
    rpy_rad: [f64; 3],
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct PosesFields {
    #[serde(deserialize_with = "quantity::angle_rad")]
    comfortable_rad: Vec<f64>,
    #[serde(deserialize_with = "quantity::angle_rad")]
    ready_rad: Vec<f64>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct JointFields {
    #[serde(deserialize_with = "quantity::joint_acceleration_radps2")]
    max_acceleration_radps2: f64,
    #[serde(default, deserialize_with = "quantity::joint_jerk_radps3")]
    max_jerk_radps3: Option<f64>,
    #[serde(deserialize_with = "quantity::rotor_inertia_kgm2")]
    rotor_inertia_kgm2: f64,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct CollisionFields {
    ignored_neighbours: usize,
    capsules: Vec<CapsuleFields>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct CapsuleFields {
    link: String,
    #[serde(deserialize_with = "quantity::offset_m")]
    from_m: [f64; 3],
    #[serde(deserialize_with = "quantity::offset_m")]
    to_m: [f64; 3],
    #[serde(deserialize_with = "quantity::radius_m")]
    radius_m: f64,
}

/// The text of a robot's two files, with the names by which errors call them.
#[derive(Debug, Clone, Copy)]
pub struct RobotFiles<'a> {
    /// Name of the URDF file.
    pub urdf_file: &'a str,
    /// Its content.
    pub urdf: &'a str,
    /// Name of the TOML file.
    pub toml_file: &'a str,
    /// Its content.
    pub toml: &'a str,
}

impl Robot {
    /// Builds the arm that the two files describe.
    ///
    /// # Errors
    /// The first fault found: not a URDF, not one serial chain of 1 to [`MAX_JOINTS`] revolute joints, a joint without limits
    /// or inertia, a field of the TOML that is missing, misspelt or out of range.
    pub fn from_files(files: &RobotFiles) -> Result<Self, InputError> {
        let document = urdf::parse(files.urdf_file, files.urdf)?;
        let urdf = Urdf::read(files.urdf_file, &document)?;
        let extra: RobotFile = InputError::parse_toml(files.toml_file, files.toml)?;
        let (base_link, joints) = serial_chain(files, &urdf, &extra.joints)?;

        let link_names: Vec<&str> =
            std::iter::once(base_link.as_str()).chain(joints.iter().map(|it| it.link_name.as_str())).collect();
        let (mut capsules, mut faults) = (Vec::new(), Vec::new());
        for (i, capsule) in extra.collision.capsules.iter().enumerate() {
            let field = |name: &str| format!("collision.capsules[{i}].{name}");
            let link = link_names.iter().position(|name| *name == capsule.link).unwrap_or_else(|| {
                let expected = format!("one of {}", link_names.join(", "));
                faults.push(InputError::new(files.toml_file, field("link"), &capsule.link, expected));
                0
            });
            let CapsuleFields { from_m, to_m, radius_m, .. } = *capsule;
            capsules.push((link, Capsule { from: from_m.into(), to: to_m.into(), radius: radius_m }));
        }

        let mut robot = Self {
            name: urdf.name.clone(),
            X_WB: extra.base.pose(),
            X_LG: PoseFields { position_m: extra.gripper_mount.position_m, rpy_rad: extra.gripper_mount.rpy_rad }
                .pose(),
            joints,
            comfortable_q: nalgebra::zero(),
            ready_q: nalgebra::zero(),
            capsules,
            ignored_neighbours: extra.collision.ignored_neighbours,
        };
        let poses = &extra.poses;
        let comfortable = robot.checked_pose(files.toml_file, "poses.comfortable_rad", &poses.comfortable_rad);
        let ready = robot.checked_pose(files.toml_file, "poses.ready_rad", &poses.ready_rad);
        InputError::first_of(faults.into_iter().map(Err).chain([comfortable.clone(), ready.clone()]))?;
        (robot.comfortable_q, robot.ready_q) = (comfortable?, ready?);
        Ok(robot)
    }

    /// `values` as a joint vector if it has one finite number per joint within that joint's range.
    ///
    /// # Errors
    /// Names the joint that is out of range, or the number of values that would be right.
    pub fn checked_pose(&self, file: &str, field: &str, values: &[f64]) -> Result<crate::JointVector, InputError> {
        let q = self.joint_vector(values).ok_or_else(|| {
            InputError::new(file, field, format!("{values:?}"), format!("{} finite numbers", self.dof()))
        })?;
        for (i, joint) in self.joints.iter().enumerate() {
            let JointLimits { lower, upper, .. } = joint.limits;
            if !(lower..=upper).contains(&q[i]) {
                let expected = format!("{lower} to {upper} rad for {}", joint.name);
                return Err(InputError::new(file, format!("{field}[{i}]"), q[i], expected));
            }
        }
        Ok(q)
    }
}

/// Orders the URDF's revolute joints from base to tip and returns them with the base link's name.
fn serial_chain(
    files: &RobotFiles,
    urdf: &Urdf,
    extra: &BTreeMap<String, JointFields>,
) -> Result<(String, Vec<Joint>), InputError> {
    let fault = |field: String, found: String, expected: &str| InputError::new(files.urdf_file, field, found, expected);
    let roots = urdf.roots();
    let [base] = roots[..] else {
        return Err(fault("link".into(), format!("{} links without a parent", roots.len()), "one base link"));
    };
    let (mut joints, mut faults, mut count) = (Vec::new(), Vec::new(), 0);
    let mut parent = base;
    loop {
        let joint = match urdf.joints_of(parent) {
            [] => break,
            [joint] => joint,
            several => {
                let found = format!("{} joints", several.len());
                return Err(fault(format!("link {parent}"), found, "one joint: a serial arm"));
            }
        };
        let kind = joint.text("type")?;
        if kind != "revolute" {
            return Err(joint.fault("type", kind, "revolute"));
        }
        match revolute_joint(files, urdf, joint, extra) {
            Ok(joint) => joints.push(joint),
            Err(fault) => faults.push(fault),
        }
        parent = joint.required("child")?.text("link")?;
        count += 1;
        if count > MAX_JOINTS {
            return Err(fault("joint".into(), format!("more than {MAX_JOINTS} joints"), "an arm of at most 8 joints"));
        }
    }
    InputError::first_of(faults.into_iter().map(Err::<(), _>))?;
    if joints.is_empty() {
        return Err(fault("joint".into(), "none".into(), "a serial arm of revolute joints"));
    }
    for name in extra.keys() {
        if !joints.iter().any(|joint| &joint.name == name) {
            let names: Vec<&str> = joints.iter().map(|joint| joint.name.as_str()).collect();
            return Err(InputError::new(
                files.toml_file,
                "joints",
                name,
                format!("joints of the URDF: {}", names.join(", ")),
            ));
        }
    }
    Ok((base.to_owned(), joints))
}

fn revolute_joint(
    files: &RobotFiles,
    urdf: &Urdf,
    joint: &Element,
    extra: &BTreeMap<String, JointFields>,
) -> Result<Joint, InputError> {
    let name = joint.text("name")?;
    if let Some(mimic) = joint.child("mimic")? {
        return Err(mimic.fault("joint", mimic.text("joint")?, "no <mimic>: joints that are driven on their own"));
    }
    let limit = joint.child("limit")?.ok_or_else(|| {
        joint.fault("limit", "no limits", "<limit lower upper velocity effort> with the joint's real limits")
    })?;
    let [lower, upper] = [limit.number("lower", JOINT_POSITION_RAD)?, limit.number("upper", JOINT_POSITION_RAD)?];
    if lower >= upper {
        let found = format!("lower {lower} and upper {upper}");
        return Err(joint.fault("limit", found, "finite limits, lower below upper"));
    }
    let fields = extra.get(name).ok_or_else(|| {
        let expected = "max_acceleration_radps2 and rotor_inertia_kgm2, which the URDF cannot say";
        InputError::new(files.toml_file, format!("joints.{name}"), "nothing", expected)
    })?;
    let limits = JointLimits {
        lower,
        upper,
        velocity: limit.number("velocity", quantity::JOINT_VELOCITY_RADPS)?,
        acceleration: fields.max_acceleration_radps2,
        torque: limit.number("effort", quantity::TORQUE_NM)?,
        jerk: fields.max_jerk_radps3,
    };
    let axis = match joint.child("axis")? {
        None => Vector3::x_axis(),
        Some(axis) => {
            let xyz = axis.vector("xyz", quantity::COORDINATE)?;
            Unit::try_new(Vector3::from(xyz), 1e-9)
                .ok_or_else(|| axis.fault("xyz", format!("{xyz:?}"), "a direction"))?
        }
    };
    let damping = joint.child("dynamics")?.filter(|it| it.has("damping"));
    let child = joint.required("child")?.text("link")?;
    Ok(Joint {
        name: name.to_owned(),
        X_PL: joint.origin()?,
        axis,
        limits,
        rotor_inertia: fields.rotor_inertia_kgm2,
        damping: damping.map_or(Ok(0.0), |it| it.number("damping", quantity::DAMPING_NMSPRAD))?,
        inertia: link_inertia(urdf.link(child).ok_or_else(|| {
            let expected = "the link that a joint moves";
            InputError::new(files.urdf_file, format!("link {child}"), "nothing", expected)
        })?)?,
        link_name: child.to_owned(),
    })
}

/// Positions of joints.
const JOINT_POSITION_RAD: Quantity = Quantity { least: -100.0, most: 100.0, unit: "rad" };

fn link_inertia(link: &Element) -> Result<Inertia, InputError> {
    let inertial = link.required("inertial")?;
    let mass = inertial.required("mass")?.number("value", quantity::PART_MASS_KG)?;
    let X_LC = inertial.origin()?;
    let inertia = inertial.required("inertia")?;
    let moment = |name: &str| inertia.number(name, quantity::INERTIA_KGM2);
    let (xx, yy, zz) = (moment("ixx")?, moment("iyy")?, moment("izz")?);
    let (xy, xz, yz) = (moment("ixy")?, moment("ixz")?, moment("iyz")?);
    let about_com = Matrix3::new(xx, xy, xz, xy, yy, yz, xz, yz, zz);
    let moments = about_com.symmetric_eigenvalues();
    if !(moments.min() > 0.0 && 2.0 * moments.max() <= moments.sum() * (1.0 + 1e-9)) {
        let found = format!("principal moments {:?}", moments.as_slice());
        let expected = "moments above zero, none larger than the sum of the other two";
        return Err(inertial.fault("inertia", found, expected));
    }
    Ok(Inertia { mass, com: Point3::origin(), about_com }.transformed(&X_LC))
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;

    const URDF: &str = include_str!("../../../assets/robots/iiwa14/robot.urdf");
    const TOML: &str = include_str!("../../../assets/robots/iiwa14/robot.toml");

    pub fn iiwa() -> Robot {
        read(URDF, TOML).unwrap()
    }

    pub fn ur10e() -> Robot {
        let assets = [
            include_str!("../../../assets/robots/ur10e/robot.urdf"),
            include_str!("../../../assets/robots/ur10e/robot.toml"),
        ];
        read(assets[0], assets[1]).unwrap()
    }

    fn read(urdf: &str, toml: &str) -> Result<Robot, InputError> {
        Robot::from_files(&RobotFiles { urdf_file: "robot.urdf", urdf, toml_file: "robot.toml", toml })
    }

    #[test]
    fn every_fault_names_its_file_and_field() {
        let without_limit =
            URDF.replacen("<limit lower=\"-2.96706\" upper=\"2.96706\" velocity=\"1.48353\" effort=\"320\"/>", "", 1);
        let fault = read(&without_limit, TOML).unwrap_err().to_string();
        assert!(fault.contains("robot.urdf: joint iiwa_joint_1: limit"), "{fault}");

        let fault = read("a poem", TOML).unwrap_err().to_string();
        assert!(fault.contains("expected a URDF"), "{fault}");

        let fault = read(URDF, &TOML.replace("rotor_inertia_kgm2 = 1.321", "")).unwrap_err().to_string();
        assert!(fault.contains("robot.toml") && fault.contains("rotor_inertia_kgm2"), "{fault}");

        let fault = read(URDF, &TOML.replace("[joints.iiwa_joint_7]", "[joints.wrist]")).unwrap_err().to_string();
        assert!(fault.contains("joints.iiwa_joint_7"), "{fault}");

        let fault = read(URDF, &TOML.replace("ready_rad = [", "ready_rad = [9.0, ")).unwrap_err().to_string();
        assert!(fault.contains("poses.ready_rad"), "{fault}");

        for (from, to, expected) in [
            (
                "velocity=\"1.48353\"",
                "velocity=\"fast\"",
                "joint iiwa_joint_1: limit velocity: found `fast`, expected 0.001 to",
            ),
            ("<axis xyz=\"0 0 1\"/>", "<axis xyz=\"0 nan 1\"/>", "joint iiwa_joint_1: axis xyz: found `0 nan 1`"),
            ("<axis xyz=\"0 0 1\"/>", "<axis xyz=\"0 0 0\"/>", "joint iiwa_joint_1: axis xyz"),
            ("<axis xyz=\"0 0 1\"/>", "<mimic joint=\"elbow\"/>", "joint iiwa_joint_1: mimic joint: found elbow"),
            ("<axis xyz=\"0 0 1\"/>", "<xacro:axis/>", "robot: found `<xacro:`"),
            ("<link name=\"iiwa_link_2\">", "<link name=\"iiwa_link_1\">", "link iiwa_link_1: found the name twice"),
            (
                "<joint name=\"iiwa_joint_2\"",
                "<joint name=\"iiwa_joint_1\"",
                "joint iiwa_joint_1: found the name twice",
            ),
        ] {
            assert!(URDF.contains(from), "{from}");
            let fault = read(&URDF.replacen(from, to, 1), TOML).unwrap_err().to_string();
            assert!(fault.starts_with(&format!("robot.urdf: {expected}")), "{fault}");
        }
        for (from, to, expected) in [
            ("[base]\nposition_m = [", "[base]\nposition_m = [-500.0, ", "base.position_m"),
            (
                "[gripper_mount]\nposition_m = [0.0, ",
                "[gripper_mount]\nposition_m = [nan, ",
                "gripper_mount.position_m[0]",
            ),
            ("radius_m = 0.0", "radius_m = 9.0", "collision.capsules[1].radius_m"),
        ] {
            assert!(TOML.contains(from), "{from}");
            let fault = read(URDF, &TOML.replacen(from, to, 1)).unwrap_err().to_string();
            assert!(fault.starts_with(&format!("robot.toml: {expected}")), "{fault}");
        }
    }

    /// The time to read nested elements grows with their number, not with its square.
    #[test]
    fn nested_elements_are_read_or_refused_at_once() {
        for depth in [100, 1_000, 100_000] {
            let text = format!("<robot name=\"deep\">{}{}</robot>", "<a>".repeat(depth), "</a>".repeat(depth));
            let start = std::time::Instant::now();
            let fault = read(&text, TOML).unwrap_err().to_string();
            assert!(fault.starts_with("robot.urdf: ") && start.elapsed().as_secs_f64() < 1.0, "{depth}: {fault}");
        }
    }

    #[test]
    fn limits_are_those_of_the_files() {
        let robot = iiwa();
        assert_eq!(robot.dof(), 7);
        assert_eq!(
            robot.per_joint(|joint| joint.limits.torque).as_slice(),
            [320.0, 320.0, 176.0, 176.0, 110.0, 40.0, 40.0, 0.0]
        );
        assert_eq!(robot.joints[3].limits.acceleration, 11.36);
        assert_eq!(robot.joints[6].rotor_inertia, 1.162);
        assert!(robot.joints.iter().all(|joint| joint.limits.jerk.is_none()));
    }

    #[test]
    fn a_jerk_limit_may_be_stated() {
        let with_jerk = |jerk: &str| {
            TOML.replacen("[joints.iiwa_joint_2]", &format!("[joints.iiwa_joint_2]\nmax_jerk_radps3 = {jerk}"), 1)
        };
        let robot = read(URDF, &with_jerk("5000.0")).unwrap();
        assert_eq!((robot.joints[0].limits.jerk, robot.joints[1].limits.jerk), (None, Some(5000.0)));
        let fault = read(URDF, &with_jerk("0.0")).unwrap_err().to_string();
        assert!(fault.contains("robot.toml: joints.iiwa_joint_2.max_jerk_radps3"), "{fault}");
    }
}
