//! Reads an arm from its URDF and the `robot.toml` beside it. A limit that is missing is an error, never a
//! guess.

mod capsules;
mod inertia;

use std::collections::BTreeMap;

use serde::Deserialize;

pub use crate::urdf::ignored_elements;
use capsules::{CapsuleFields, collision_shapes};
use inertia::{LinkFields, link_inertia, stated_inertia};

use crate::{
    InputError,
    document::Node,
    pose::PoseFields,
    quantity,
    robot::{ContactStop, Joint, JointLimits, MAX_JOINTS, Robot},
    stated::Stated,
    urdf::{self, Urdf},
    velocity_table::VelocityFields,
    visual::Visual,
};

/// Contents of the `robot.toml` beside a `robot.urdf`.
#[quantity::checked(deny_unknown_fields)]
#[derive(Deserialize)]
struct RobotFile {
    /// Pose of the base in the world.
    base: PoseFields,
    /// The flange, at which the back of a gripper's housing is mounted.
    flange: FlangeFields,
    /// Flanges as grippers meet them that are mounted in another way, by the gripper's name.
    #[serde(default)]
    flanges: BTreeMap<String, FlangeFields>,
    /// Speed at which the maker's controller stops, of the flange and of the tool.
    max_hand_speed_mps: quantity::hand_speed_mps<Option<f64>>,
    /// Contact at the hand at which it stops; at a joint it is the torque of the motor.
    contact_stop: Option<ContactStop>,
    /// Joint positions in which the arm waits, and in which it is comfortable.
    poses: PosesFields,
    /// Properties of each joint that the URDF cannot state, by the joint's name.
    joints: BTreeMap<String, JointFields>,
    /// Mass properties that take the place of the URDF's, by the link's name.
    #[serde(default)]
    links: BTreeMap<String, LinkFields>,
    /// The arm's collision geometry.
    collision: CollisionFields,
    /// Surfaces of links as cameras see them, by the link's name.
    #[serde(default)]
    visuals: BTreeMap<String, Visual>,
}

/// A flange on the last link. Its axes are those of a gripper there: the fingers close along x, y is the
/// approach.
#[quantity::checked(deny_unknown_fields)]
#[derive(Deserialize)]
struct FlangeFields {
    /// Middle of the flange's face in the frame of the last link.
    position_m: quantity::offset_m<[f64; 3]>,
    /// Rotation: roll, pitch and yaw about the fixed axes x, y and z, as in URDF.
    rpy_rad: quantity::angle_rad<[f64; 3]>,
    /// True if nobody published the pose.
    #[serde(default)]
    assumed: bool,
    /// Reason for the assumption.
    reason: Option<String>,
}

/// Named joint positions.
#[quantity::checked(deny_unknown_fields)]
#[derive(Deserialize)]
struct PosesFields {
    /// The comfortable pose of the paper's heuristics, one angle per joint.
    comfortable_rad: quantity::angle_rad<Vec<f64>>,
    /// Joint positions in which the arm waits, unless a scenario says otherwise.
    ready_rad: quantity::angle_rad<Vec<f64>>,
}

/// Properties of a joint that the URDF cannot state. Each value may be
/// `{ value = …, assumed = true, reason = "…" }`.
#[quantity::checked(deny_unknown_fields)]
#[derive(Deserialize)]
struct JointFields {
    /// Limit of the acceleration.
    max_acceleration_radps2: quantity::joint_acceleration_radps2<Stated<f64>>,
    /// Limit of the jerk; without it the jerk is not limited.
    max_jerk_radps3: quantity::joint_jerk_radps3<Option<Stated<f64>>>,
    /// Inertia of the rotor and the gear, reflected to the joint.
    rotor_inertia_kgm2: quantity::rotor_inertia_kgm2<Stated<f64>>,
    /// Limits of the position, in place of the URDF's.
    range_rad: quantity::joint_position_rad<Option<Stated<[f64; 2]>>>,
    /// Limit of the velocity, in place of the URDF's.
    max_velocity_radps: quantity::joint_velocity_radps<Option<Stated<f64>>>,
    /// Limits of the velocity that depend on the position.
    velocity_by_position: Option<VelocityFields>,
    /// Limit of the torque, in place of the URDF's.
    max_torque_nm: quantity::torque_nm<Option<Stated<f64>>>,
}

/// The arm as capsules, for contact and clearance, and for cameras where a link has no visual shape.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct CollisionFields {
    /// Links that lie at most this far apart in the chain are not compared.
    ignored_neighbours: usize,
    /// The capsules.
    capsules: Vec<CapsuleFields>,
}

/// The text of a robot's two files, with the names by which errors call them.
#[derive(Debug, Clone, Copy)]
pub struct RobotFiles<'a> {
    /// Name of the URDF file.
    pub urdf_file: &'a str,
    /// Content of the URDF file.
    pub urdf: &'a str,
    /// Name of the TOML file.
    pub toml_file: &'a str,
    /// Content of the TOML file.
    pub toml: &'a str,
}

impl Robot {
    /// Builds the arm that the two files describe, but for the meshes that they name
    /// ([`with_meshes`](Self::with_meshes)).
    ///
    /// # Errors
    /// The first fault found: not a URDF, not one serial chain of 1 to [`MAX_JOINTS`] revolute joints, a
    /// joint without limits or inertia, a field of the TOML that is missing, misspelt or out of range.
    pub fn from_files(files: &RobotFiles) -> Result<Self, InputError> {
        let document = urdf::parse(files.urdf_file, files.urdf)?;
        let urdf = Urdf::read(&document)?;
        let extra: RobotFile = InputError::parse_toml(files.toml_file, files.toml)?;
        let (base_link, joints) = serial_chain(files, &urdf, &extra)?;
        document.finish(&[urdf::HARMLESS, urdf::IN_TOML])?;

        let link_names: Vec<&str> =
            std::iter::once(base_link.as_str()).chain(joints.iter().map(|it| it.link_name.as_str())).collect();
        let mut faults = Vec::new();
        let (capsules, mut visuals) = collision_shapes(files, &extra.collision.capsules, &link_names, &mut faults)?;
        visuals.extend(visuals_of_links(files, extra.visuals, &link_names, &mut faults));
        let mut mounted = |field: &str, mount: &FlangeFields| {
            faults.extend(unreasoned(files, field, mount.assumed, mount.reason.as_ref()));
            PoseFields { position_m: mount.position_m, rpy_rad: mount.rpy_rad }.pose()
        };
        let X_LF = mounted("flange.", &extra.flange);
        let named = extra.flanges.iter();
        let X_LF_by_gripper =
            named.map(|(name, it)| (name.clone(), mounted(&format!("flanges.{name}."), it))).collect();

        let mut robot = Self {
            name: urdf.name.clone(),
            base_link,
            X_WB: extra.base.pose(),
            X_LF,
            X_LF_by_gripper,
            X_LG: X_LF,
            tool_G: nalgebra::Point3::origin(),
            max_hand_speed_mps: extra.max_hand_speed_mps,
            contact_stop: extra.contact_stop,
            joints,
            comfortable_q: nalgebra::zero(),
            ready_q: nalgebra::zero(),
            capsules,
            visuals,
            ignored_neighbours: extra.collision.ignored_neighbours,
            obstacles: Vec::new(),
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

/// Visual shapes by the numbers of their links.
fn visuals_of_links(
    files: &RobotFiles,
    by_name: BTreeMap<String, Visual>,
    link_names: &[&str],
    faults: &mut Vec<InputError>,
) -> BTreeMap<usize, Visual> {
    let numbered = by_name.into_iter().filter_map(|(name, visual)| {
        let field = format!("visuals.{name}");
        faults.extend(visual.check(files.toml_file, &field).err());
        let link = link_names.iter().position(|it| *it == name);
        if link.is_none() {
            let expected = format!("one of {}", link_names.join(", "));
            faults.push(InputError::new(files.toml_file, field, "a link that is not there", expected));
        }
        Some((link?, visual))
    });
    numbered.collect()
}

/// The fault of a mark that says nothing.
fn unreasoned(files: &RobotFiles, of: &str, assumed: bool, reason: Option<&String>) -> Option<InputError> {
    let has_reason = reason.is_some_and(|it| !it.trim().is_empty());
    let expected = "why the value is what it is, as nobody published it";
    (assumed && !has_reason).then(|| InputError::new(files.toml_file, format!("{of}reason"), "nothing", expected))
}

/// Orders the URDF's revolute joints from base to tip and returns them with the base link's name.
fn serial_chain(files: &RobotFiles, urdf: &Urdf, extra: &RobotFile) -> Result<(String, Vec<Joint>), InputError> {
    let fault = |field: String, found: String, expected: &str| InputError::new(files.urdf_file, field, found, expected);
    let base = urdf.root;
    let (mut joints, mut faults, mut count) = (Vec::new(), Vec::new(), 0);
    // The base does not move, so it needs no mass. What is said of it has to be right all the same.
    let of_base = urdf.links[base];
    if of_base.only("inertial")?.is_some() {
        faults.extend(link_inertia(of_base).err());
    }
    let mut parent = base;
    loop {
        let joint = match urdf.joints_of(parent) {
            [] => break,
            [joint] => *joint,
            several => {
                let found = format!("{} joints", several.len());
                return Err(fault(format!("link {parent}"), found, "one joint: a serial arm"));
            }
        };
        let kind = joint.text_of("type")?;
        if !matches!(kind, "revolute" | "continuous") {
            let expected =
                "revolute or continuous: `catchingbot robot import` makes a serial arm of other descriptions";
            return Err(joint.fault_of("type", kind, expected));
        }
        match revolute_joint(files, urdf, joint, extra) {
            Ok(joint) => joints.push(joint),
            Err(fault) => faults.push(fault),
        }
        parent = joint.required("child")?.text_of("link")?;
        count += 1;
        if count > MAX_JOINTS {
            return Err(fault("joint".into(), format!("more than {MAX_JOINTS} joints"), "an arm of at most 8 joints"));
        }
    }
    InputError::first_of(faults.into_iter().map(Err::<(), _>))?;
    if joints.is_empty() {
        return Err(fault("joint".into(), "none".into(), "a serial arm of revolute joints"));
    }
    let unknown = |field: &str, given: Vec<&String>, name_of: &dyn Fn(&Joint) -> String| {
        let names: Vec<String> = joints.iter().map(name_of).collect();
        let unknown = given.into_iter().find(|name| !names.contains(name))?;
        let expected = format!("{field} of the URDF: {}", names.join(", "));
        Some(InputError::new(files.toml_file, field, unknown, expected))
    };
    let unknown_joint = unknown("joints", extra.joints.keys().collect(), &|joint| joint.name.clone());
    let unknown_link = unknown("links", extra.links.keys().collect(), &|joint| joint.link_name.clone());
    if let Some(fault) = unknown_joint.or(unknown_link) { Err(fault) } else { Ok((base.to_owned(), joints)) }
}

/// The positions between which a joint moves: those of the TOML file, else those `of_urdf`.
fn position_range(
    files: &RobotFiles,
    joint: Node,
    fields: &JointFields,
    of_urdf: impl FnOnce() -> [Result<f64, InputError>; 2],
) -> Result<[f64; 2], InputError> {
    let field = format!("joints.{}.range_rad", joint.text_of("name")?);
    let [lower, upper] = match &fields.range_rad {
        Some(range) => range.value,
        None if joint.text_of("type")? == "continuous" => {
            let expected = format!("revolute with limits, or {field} in {}", files.toml_file);
            return Err(joint.fault_of("type", "continuous", expected));
        }
        None => {
            let [lower, upper] = of_urdf();
            [lower?, upper?]
        }
    };
    if lower < upper {
        return Ok([lower, upper]);
    }
    let (found, expected) = (format!("lower {lower} and upper {upper}"), "finite limits, lower below upper");
    Err(match &fields.range_rad {
        Some(_) => InputError::new(files.toml_file, field, found, expected),
        None => joint.fault_of("limit", found, expected),
    })
}

fn revolute_joint(files: &RobotFiles, urdf: &Urdf, joint: Node, extra: &RobotFile) -> Result<Joint, InputError> {
    let name = joint.text_of("name")?;
    if let Some(mimic) = joint.only("mimic")? {
        return Err(mimic.fault_of(
            "joint",
            mimic.text_of("joint")?,
            "no <mimic>: joints that are driven on their own",
        ));
    }
    let limits_of_urdf = joint.only("limit")?;
    let limit = |field: &'static str, range| {
        let limit = limits_of_urdf.ok_or_else(|| {
            joint.fault_of("limit", "no limits", "<limit lower upper velocity effort> with the joint's real limits")
        })?;
        limit.number_of(field, range)
    };
    // A URDF without limits is the first thing to be mended.
    if limits_of_urdf.is_none() && extra.joints.get(name).is_none_or(|it| it.range_rad.is_none()) {
        limit("lower", quantity::JOINT_POSITION_RAD)?;
    }
    let fields = extra.joints.get(name).ok_or_else(|| {
        let expected = "max_acceleration_radps2 and rotor_inertia_kgm2, which the URDF cannot say";
        InputError::new(files.toml_file, format!("joints.{name}"), "nothing", expected)
    })?;
    let stated = |value: &Option<Stated<f64>>, field: &'static str, range| match value {
        Some(stated) => Ok(stated.value),
        None => limit(field, range),
    };
    let [lower, upper] =
        position_range(files, joint, fields, || ["lower", "upper"].map(|it| limit(it, quantity::JOINT_POSITION_RAD)))?;
    let limits = JointLimits {
        lower,
        upper,
        velocity: stated(&fields.max_velocity_radps, "velocity", quantity::JOINT_VELOCITY_RADPS)?,
        acceleration: fields.max_acceleration_radps2.value,
        torque: stated(&fields.max_torque_nm, "effort", quantity::TORQUE_NM)?,
        jerk: fields.max_jerk_radps3.as_ref().map(|it| it.value),
    };
    let damping = joint.only("dynamics")?.filter(|it| it.has("damping"));
    let child = joint.required("child")?.text_of("link")?;
    let link = urdf.links[child];
    Ok(Joint {
        name: name.to_owned(),
        X_PL: urdf::origin(joint, quantity::OFFSET_M)?,
        axis: urdf::axis(joint)?,
        limits,
        velocity_table: match &fields.velocity_by_position {
            Some(table) => Some(table.checked(files.toml_file, &format!("joints.{name}.velocity_by_position"))?),
            None => None,
        },
        rotor_inertia: fields.rotor_inertia_kgm2.value,
        damping: damping.map_or(Ok(0.0), |it| it.number_of("damping", quantity::DAMPING_NMSPRAD))?,
        inertia: match extra.links.get(child) {
            Some(fields) => stated_inertia(files, child, fields)?,
            None => link_inertia(link)?,
        },
        link_name: child.to_owned(),
    })
}

/// Greatest number of capsules: each pair costs time in every clearance.
const MOST_CAPSULES: usize = 128;

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use crate::robot::LimitScale;

    const URDF: &str = include_str!("../../../assets/robots/iiwa14/robot.urdf");
    const TOML: &str = include_str!("../../../assets/robots/iiwa14/robot.toml");

    pub fn iiwa() -> Robot {
        read(URDF, TOML).unwrap()
    }

    pub fn ur10e() -> Robot {
        named("ur10e")
    }

    /// A built-in arm.
    pub fn named(name: &str) -> Robot {
        let folder = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../../assets/robots").join(name);
        let [urdf, toml] = ["robot.urdf", "robot.toml"].map(|file| std::fs::read_to_string(folder.join(file)).unwrap());
        read(&urdf, &toml).unwrap()
    }

    fn read(urdf: &str, toml: &str) -> Result<Robot, InputError> {
        Robot::from_files(&RobotFiles { urdf_file: "robot.urdf", urdf, toml_file: "robot.toml", toml })
    }

    /// Franka's documentation: a joint may turn towards an end of its range at √(k·d) − c and at most at v,
    /// where d is the way to that end. Between the rows of a table, up to 0.9 rad/s apart, straight lines lie
    /// up to 0.11 rad/s below the curve.
    #[test]
    fn the_velocity_tables_of_the_fr3_lie_just_within_its_published_limits() {
        const PUBLISHED: [([f64; 2], [f64; 3]); 7] = [
            ([-2.7501, 2.7501], [2.62, 12.0, 0.30]),
            ([-1.7918, 1.7918], [2.62, 5.17, 0.20]),
            ([-2.9065, 2.9065], [2.62, 7.0, 0.20]),
            ([-3.0481, -0.1458], [2.62, 8.0, 0.30]),
            ([-2.8101, 2.8101], [5.26, 34.0, 0.35]),
            ([0.54092, 4.5205], [4.18, 11.0, 0.35]),
            ([-3.0196, 3.0196], [5.26, 34.0, 0.35]),
        ];
        let halved = LimitScale { velocity: 0.5, ..LimitScale::default() };
        let [robot, slower] = [named("fr3"), named("fr3").with_limits_scaled(&halved)];
        for ((joint, slower), (ends, [v, k, c])) in robot.joints.iter().zip(&slower.joints).zip(PUBLISHED) {
            for step in 0..=1000 {
                let q = joint.limits.lower + (joint.limits.upper - joint.limits.lower) * f64::from(step) / 1000.0;
                let published = |end: f64| ((k * (end - q).abs()).sqrt() - c).min(v);
                for (direction, end) in [-1.0, 1.0].into_iter().zip(ends) {
                    let (ours, theirs) = (joint.max_speed(q, direction), published(end));
                    assert!(ours <= theirs && ours > theirs - 0.12, "{}: {ours} {theirs} at {q}", joint.name);
                    assert!((2.0 * slower.max_speed(q, direction) - ours).abs() < 1e-12);
                }
            }
        }
    }

    #[test]
    fn a_velocity_table_that_is_none_is_refused() {
        let whole = "position_rad = [0, 1]\nlowest_radps = [-1, -1]\nhighest_radps = [1, 0.5]";
        let with = |table: &str| {
            read(URDF, &format!("{TOML}\n[joints.iiwa_joint_2.velocity_by_position]\n{table}\n"))
                .map_err(|it| it.to_string())
        };
        assert_eq!(with(whole).unwrap().joints[1].velocity_range(0.5), [-1.0, 0.75]);
        for (from, to) in [("[0, 1]", "[1, 0]"), ("[0, 1]", "[0]"), ("-1, -1", "-1, 0"), ("0.5]", "-0.5]")] {
            let fault = with(&whole.replace(from, to)).unwrap_err();
            assert!(fault.contains("robot.toml: joints.iiwa_joint_2.velocity_by_position"), "{fault}");
        }
    }

    #[test]
    fn every_fault_names_its_file_and_field() {
        let without_limit =
            URDF.replacen("<limit lower=\"-2.96706\" upper=\"2.96706\" velocity=\"1.48353\" effort=\"320\"/>", "", 1);
        let fault = read(&without_limit, TOML).unwrap_err().to_string();
        assert!(fault.contains("joint iiwa_joint_1.limit"), "{fault}");

        let fault = read("a poem", TOML).unwrap_err().to_string();
        assert!(fault.contains("expected a URDF"), "{fault}");

        let fault = read(URDF, &TOML.replace("rotor_inertia_kgm2 = 1.321", "")).unwrap_err().to_string();
        assert!(fault.contains("robot.toml") && fault.contains("rotor_inertia_kgm2"), "{fault}");

        let fault = read(URDF, &TOML.replace("[joints.iiwa_joint_7]", "[joints.wrist]")).unwrap_err().to_string();
        assert!(fault.contains("joints.iiwa_joint_7"), "{fault}");

        let capsule =
            "[[collision.capsules]]\nlink = \"iiwa_link_0\"\nfrom_m = [0, 0, 0]\nto_m = [0, 0, 0]\nradius_m = 0.1\n";
        let fault = read(URDF, &(TOML.to_owned() + &capsule.repeat(200))).unwrap_err().to_string();
        assert!(fault.contains("collision.capsules") && fault.contains("at most 128"), "{fault}");
        let fault = read(URDF, &TOML.replace("ready_rad = [", "ready_rad = [9.0, ")).unwrap_err().to_string();
        assert!(fault.contains("poses.ready_rad"), "{fault}");

        for (from, to, expected) in [
            (
                "velocity=\"1.48353\"",
                "velocity=\"fast\"",
                "joint iiwa_joint_1.limit.velocity: found `fast`, expected 0.001 to",
            ),
            ("<axis xyz=\"0 0 1\"/>", "<axis xyz=\"0 nan 1\"/>", "joint iiwa_joint_1.axis.xyz: found `0 nan 1`"),
            ("<axis xyz=\"0 0 1\"/>", "<axis xyz=\"0 0 0\"/>", "joint iiwa_joint_1.axis.xyz"),
            ("<axis xyz=\"0 0 1\"/>", "<mimic joint=\"elbow\"/>", "joint iiwa_joint_1.mimic.joint: found elbow"),
            (
                "<axis xyz=\"0 0 1\"/>",
                "<xacro:axis/>",
                "joint iiwa_joint_1.xacro:axis: found <xacro:axis>, expected a URDF without xacro",
            ),
            ("<link name=\"iiwa_link_2\">", "<link name=\"iiwa_link_1\">", "link iiwa_link_1: found the name twice"),
            ("<mass value=\"5\"/>", "<mass value=\"nan\"/>", "link iiwa_link_0.inertial.mass.value: found `nan`"),
            ("izz=\"0.03\"", "izz=\"0.3\"", "link iiwa_link_0.inertial.inertia: found principal moments"),
            (
                "<joint name=\"iiwa_joint_2\"",
                "<joint name=\"iiwa_joint_1\"",
                "joint iiwa_joint_1: found the name twice",
            ),
        ] {
            assert!(URDF.contains(from), "{from}");
            let fault = read(&URDF.replacen(from, to, 1), TOML).unwrap_err().to_string();
            assert!(fault.starts_with("robot.urdf: line ") && fault.contains(&format!(": {expected}")), "{fault}");
        }
        for (from, to, expected) in [
            ("[base]\nposition_m = [", "[base]\nposition_m = [-500.0, ", "base.position_m"),
            (
                "[[collision.capsules]]",
                "[[collision.capsules]]\nlink = \"iiwa_link_1\"\nfrom_m = [0, 0, 0]\nto_m = [0, 0, 1]\nradius_m = 0.1\n\
                 depths_mm = [[0], [1, 2, 120], [0]]\n\n[[collision.capsules]]",
                "collision.capsules[0].depths_mm[1][2]: found 120, expected 0 to 99.9 mm",
            ),
            (
                "[[collision.capsules]]",
                "[[collision.capsules]]\nlink = \"iiwa_link_1\"\nfrom_m = [0, 0, 0]\nto_m = [0, 0, 1]\nradius_m = 0.1\n\
                 depths_mm = [[0], [1, 2, 3], [0, 0]]\n\n[[collision.capsules]]",
                "collision.capsules[0].depths_mm[2]: found 2 numbers, expected 1: one at a pole",
            ),
            ("[flange]\nposition_m = [0.0, ", "[flange]\nposition_m = [nan, ", "flange.position_m[0]"),
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

    /// Franka's description turns its hand by −45° about the flange's axis; its fingers close along y.
    #[test]
    fn a_gripper_may_be_mounted_in_its_own_way() {
        use nalgebra::{Point3, UnitQuaternion, Vector3};
        let panda = named("panda");
        let [wsg50, franka_hand] = ["wsg50", "franka_hand"].map(|name| {
            let file = format!("{}/../../assets/grippers/{name}.toml", env!("CARGO_MANIFEST_DIR"));
            let gripper = crate::Gripper::from_toml(&file, &std::fs::read_to_string(&file).unwrap()).unwrap();
            panda.clone().with_mount_of(&gripper).X_LG
        });
        assert!((wsg50.translation.vector - Vector3::new(0.0, 0.0, 0.107 + 0.03625)).norm() < 1e-12);
        let turned = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), -std::f64::consts::FRAC_PI_4);
        assert!((franka_hand.rotation * Vector3::x() - turned * Vector3::y()).norm() < 1e-9);
        let flange = franka_hand * Point3::new(0.0, -0.033, 0.0);
        assert!((flange - Point3::new(0.0, 0.0, 0.107)).norm() < 1e-9);
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
