//! Reads an arm from its URDF and the `robot.toml` beside it. A limit that is missing is an error, never a guess.

use std::collections::BTreeMap;

use nalgebra::{Matrix3, Point3, Translation3, Unit, UnitQuaternion, Vector3};
use serde::Deserialize;

use crate::{
    InputError,
    pose::{Pose, PoseFields},
    robot::{Inertia, Joint, JointLimits, MAX_JOINTS, Robot},
    shape::Capsule,
};

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct RobotFile {
    base: PoseFields,
    gripper_mount: PoseFields,
    poses: PosesFields,
    joints: BTreeMap<String, JointFields>,
    collision: CollisionFields,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct PosesFields {
    comfortable_rad: Vec<f64>,
    ready_rad: Vec<f64>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct JointFields {
    max_acceleration_radps2: f64,
    max_jerk_radps3: Option<f64>,
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
    from_m: [f64; 3],
    to_m: [f64; 3],
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
        let urdf = urdf_rs::read_from_string(files.urdf).map_err(|fault| {
            let summary = fault.to_string().lines().next().unwrap_or("unreadable").to_owned();
            InputError::new(files.urdf_file, "robot", summary, "a URDF description of a robot")
        })?;
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
            faults.extend(InputError::finite(files.toml_file, field("from_m"), from_m).err());
            faults.extend(InputError::finite(files.toml_file, field("to_m"), to_m).err());
            faults.extend(InputError::positive(files.toml_file, field("radius_m"), radius_m).err());
            capsules.push((link, Capsule { from: from_m.into(), to: to_m.into(), radius: radius_m }));
        }

        let mut robot = Self {
            name: urdf.name.clone(),
            X_WB: extra.base.pose(),
            X_LG: extra.gripper_mount.pose(),
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
    urdf: &urdf_rs::Robot,
    extra: &BTreeMap<String, JointFields>,
) -> Result<(String, Vec<Joint>), InputError> {
    let fault = |field: String, found: String, expected: &str| InputError::new(files.urdf_file, field, found, expected);
    let is_child = |link: &str| urdf.joints.iter().any(|joint| joint.child.link == link);
    let roots: Vec<&str> = urdf.links.iter().map(|link| link.name.as_str()).filter(|link| !is_child(link)).collect();
    let [base] = roots[..] else {
        return Err(fault("link".into(), format!("{} links without a parent", roots.len()), "one base link"));
    };

    let (mut joints, mut faults, mut count) = (Vec::new(), Vec::new(), 0);
    let mut parent = base.to_owned();
    loop {
        let next: Vec<&urdf_rs::Joint> = urdf.joints.iter().filter(|joint| joint.parent.link == parent).collect();
        let joint = match next[..] {
            [] => break,
            [joint] => joint,
            _ => {
                return Err(fault(
                    format!("link {parent}"),
                    format!("{} joints", next.len()),
                    "one joint: a serial arm",
                ));
            }
        };
        if joint.joint_type != urdf_rs::JointType::Revolute {
            let found = format!("{:?}", joint.joint_type).to_lowercase();
            return Err(fault(format!("joint {}: type", joint.name), found, "revolute"));
        }
        match revolute_joint(files, urdf, joint, extra) {
            Ok(joint) => joints.push(joint),
            Err(fault) => faults.push(fault),
        }
        parent.clone_from(&joint.child.link);
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
    urdf: &urdf_rs::Robot,
    joint: &urdf_rs::Joint,
    extra: &BTreeMap<String, JointFields>,
) -> Result<Joint, InputError> {
    let field = |name: &str| format!("joint {}: {name}", joint.name);
    let limit = &joint.limit;
    if limit.velocity == 0.0 && limit.lower == 0.0 && limit.upper == 0.0 {
        let expected = "<limit lower upper velocity effort> with the joint's real limits";
        return Err(InputError::new(files.urdf_file, field("limit"), "no limits", expected));
    }
    if !(limit.lower.is_finite() && limit.upper.is_finite() && limit.lower < limit.upper) {
        let found = format!("lower {} and upper {}", limit.lower, limit.upper);
        return Err(InputError::new(files.urdf_file, field("limit"), found, "finite limits, lower below upper"));
    }
    let fields = extra.get(&joint.name).ok_or_else(|| {
        let expected = "max_acceleration_radps2 and rotor_inertia_kgm2, which the URDF cannot say";
        InputError::new(files.toml_file, format!("joints.{}", joint.name), "nothing", expected)
    })?;
    let toml_field = |name: &str| format!("joints.{}.{name}", joint.name);
    let limits = JointLimits {
        lower: limit.lower,
        upper: limit.upper,
        velocity: InputError::positive(files.urdf_file, field("limit velocity"), limit.velocity)?,
        acceleration: InputError::positive(
            files.toml_file,
            toml_field("max_acceleration_radps2"),
            fields.max_acceleration_radps2,
        )?,
        torque: InputError::positive(files.urdf_file, field("limit effort"), limit.effort)?,
        jerk: fields
            .max_jerk_radps3
            .map(|jerk| InputError::positive(files.toml_file, toml_field("max_jerk_radps3"), jerk))
            .transpose()?,
    };
    let rotor_inertia = fields.rotor_inertia_kgm2;
    if !(rotor_inertia.is_finite() && rotor_inertia >= 0.0) {
        return Err(InputError::new(files.toml_file, toml_field("rotor_inertia_kgm2"), rotor_inertia, "zero or more"));
    }
    let axis = Unit::try_new(Vector3::from(joint.axis.xyz.0), 1e-9).ok_or_else(|| {
        InputError::new(files.urdf_file, field("axis"), format!("{:?}", joint.axis.xyz.0), "a direction")
    })?;
    Ok(Joint {
        name: joint.name.clone(),
        X_PL: urdf_pose(files, &field("origin"), &joint.origin)?,
        axis,
        limits,
        rotor_inertia,
        damping: joint.dynamics.as_ref().map_or(0.0, |dynamics| dynamics.damping),
        inertia: link_inertia(files, urdf, &joint.child.link)?,
        link_name: joint.child.link.clone(),
    })
}

fn link_inertia(files: &RobotFiles, urdf: &urdf_rs::Robot, name: &str) -> Result<Inertia, InputError> {
    let field = |part: &str| format!("link {name}: {part}");
    let link = urdf
        .links
        .iter()
        .find(|link| link.name == name)
        .ok_or_else(|| InputError::new(files.urdf_file, field("link"), "nothing", "the link that a joint moves"))?;
    let mass = InputError::positive(files.urdf_file, field("mass"), link.inertial.mass.value)?;
    let X_LC = urdf_pose(files, &field("inertial origin"), &link.inertial.origin)?;
    let it = &link.inertial.inertia;
    let about_com = Matrix3::new(it.ixx, it.ixy, it.ixz, it.ixy, it.iyy, it.iyz, it.ixz, it.iyz, it.izz);
    let moments = about_com.symmetric_eigenvalues();
    if !(moments.min() > 0.0 && 2.0 * moments.max() <= moments.sum() * (1.0 + 1e-9)) {
        let found = format!("principal moments {:?}", moments.as_slice());
        let expected = "moments above zero, none larger than the sum of the other two";
        return Err(InputError::new(files.urdf_file, field("inertia"), found, expected));
    }
    Ok(Inertia { mass, com: Point3::origin(), about_com }.transformed(&X_LC))
}

fn urdf_pose(files: &RobotFiles, field: &str, pose: &urdf_rs::Pose) -> Result<Pose, InputError> {
    let xyz = InputError::finite(files.urdf_file, field, pose.xyz.0)?;
    let [roll, pitch, yaw] = InputError::finite(files.urdf_file, field, pose.rpy.0)?;
    Ok(Pose::from_parts(Translation3::from(xyz), UnitQuaternion::from_euler_angles(roll, pitch, yaw)))
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;

    const URDF: &str = include_str!("../../../assets/robots/iiwa14/robot.urdf");
    const TOML: &str = include_str!("../../../assets/robots/iiwa14/robot.toml");

    pub fn iiwa() -> Robot {
        read(URDF, TOML).unwrap()
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
