//! A robot's two files while they are written: every value with its reason where nobody published it.

use std::{collections::BTreeMap, fmt::Write};

use crate::description::{Body, Chain, ChainJoint, StatedLimits, TreeJoint};
use catch_body::{InputError, Pose, TriangleMesh, input_error::steers_text, quantity, robot::Inertia, stated::Stated};
use nalgebra::Matrix3;

use super::geometry::BodyShape;

/// Contents of a robot's files.
#[derive(Debug, Clone)]
pub struct Draft {
    /// Name of the robot.
    pub name: String,
    /// Source of the robot.
    pub source: String,
    /// The arm.
    pub chain: Chain,
    /// Shapes of the base and of each moved body.
    pub shapes: Vec<BodyShape>,
    /// Values of the arm's joints.
    pub joints: Vec<JointValues>,
    /// Mass properties of each moved body.
    pub inertias: Vec<Stated<Inertia>>,
    /// Height of the base above the floor, in metres.
    pub base_height_m: f64,
    /// Pose of the flange on the last body.
    pub X_LF: Stated<Pose>,
    /// Links so near in the chain are not compared.
    pub ignored_neighbours: usize,
    /// Joint positions far from the ends of the ranges.
    pub comfortable_rad: Vec<f64>,
    /// Joint positions in which the arm waits.
    pub ready_rad: Vec<f64>,
}

/// A text as XML holds it.
fn text_in_xml(text: &str) -> String {
    let escaped = [("&", "&amp;"), ("<", "&lt;"), (">", "&gt;"), ("\"", "&quot;"), ("'", "&#39;")];
    escaped.iter().fold(text.to_owned(), |text, (letter, name)| text.replace(letter, name))
}

/// Values of a joint: its limits and its rotor inertia.
#[derive(Debug, Clone)]
pub struct JointValues {
    /// Lowest and highest position in radians.
    pub range: Stated<[f64; 2]>,
    /// Highest speed in rad/s.
    pub velocity: Stated<f64>,
    /// Highest torque in N·m.
    pub torque: Stated<f64>,
    /// Highest acceleration in rad/s².
    pub acceleration: Stated<f64>,
    /// Highest jerk in rad/s³.
    pub jerk: Option<Stated<f64>>,
    /// Rotor inertia in kg·m².
    pub rotor_inertia: Stated<f64>,
}

/// Range of a joint that rotates without end.
const ENDLESS_RAD: f64 = std::f64::consts::TAU;
/// A speed for a joint of which none is known.
const SPEED_RADPS: f64 = 2.0;
/// Arms reach full speed within about this time: 0.13 to 0.29 s by Franka's published limits.
const TO_FULL_SPEED_S: f64 = 0.2;
/// The reflected rotor inertia of most models in MuJoCo Menagerie.
const ROTOR_INERTIA_KGM2: f64 = 0.1;
/// Placeholder of a torque that is worked out when all else is known.
const UNKNOWN_TORQUE_NM: f64 = 1e4;

impl JointValues {
    /// Combines the sources of a joint's values: those given by hand come first, which are the highest
    /// acceleration, the rotor inertia and the highest jerk; of those that `joint_limits.yaml` and the
    /// description state, the narrower; the rest is assumed.
    ///
    /// # Errors
    /// A range that is none, or in other units; `file` is the description.
    pub fn of(
        file: &str,
        joint: &ChainJoint,
        limits: &StatedLimits,
        given: [Option<f64>; 3],
    ) -> Result<Self, InputError> {
        let joint = &joint.joint;
        let limits = limits.narrowed(&joint.limits);
        let by_hand = |value: Option<f64>, option: &str| {
            let reason = format!("given by {option} when the robot was imported");
            value.map(|value| Stated { value, assumed: Some(reason) })
        };
        let published = |value: Option<f64>| value.map(|value| Stated { value, assumed: None });
        let assumed = |value: f64, reason: &str| Stated { value, assumed: Some(reason.to_owned()) };

        let range = range_of(file, joint, &limits)?;
        let velocity = published(limits.velocity)
            .unwrap_or_else(|| assumed(SPEED_RADPS, "the description has none: as arms of this kind have"));
        let [acceleration, rotor_inertia, jerk] = given;
        let acceleration =
            by_hand(acceleration, "--max-acceleration").or(published(limits.acceleration)).unwrap_or_else(|| {
                let reason = format!(
                    "no file has one: full speed within {TO_FULL_SPEED_S} s, as published limits of other arms allow"
                );
                assumed(rounded(velocity.value / TO_FULL_SPEED_S), &reason)
            });
        let rotor_inertia =
            by_hand(rotor_inertia, "--rotor-inertia").or(published(joint.rotor_inertia)).unwrap_or_else(|| {
                assumed(ROTOR_INERTIA_KGM2, "no file has one: what models of such arms in MuJoCo Menagerie have")
            });
        let torque = published(limits.effort).unwrap_or_else(|| assumed(UNKNOWN_TORQUE_NM, "unknown"));
        let jerk = by_hand(jerk, "--max-jerk").or(published(limits.jerk));
        Ok(Self { range, velocity, torque, acceleration, jerk, rotor_inertia })
    }
}

/// Range of a joint within the `limits` that are left of all that anybody states; where there is none, a
/// whole turn is assumed.
fn range_of(file: &str, joint: &TreeJoint, limits: &StatedLimits) -> Result<Stated<[f64; 2]>, InputError> {
    let field = || format!("joint {}: limit", joint.name);
    let mut described = [joint.limits.lower, joint.limits.upper].into_iter().flatten();
    if let Some(other) = described.find(|it| !quantity::JOINT_POSITION_RAD.contains(*it)) {
        let expected = format!("{}, or type=\"continuous\" without bounds", quantity::JOINT_POSITION_RAD);
        return Err(InputError::new(file, field(), other, expected));
    }
    let assumed = match (limits.lower, limits.upper) {
        (Some(_), Some(_)) => None,
        (None, None) => Some("the joint turns without end, or states none: a whole turn either way"),
        _ => Some("one end is stated: a whole turn at the other"),
    };
    let value = [limits.lower.unwrap_or(-ENDLESS_RAD), limits.upper.unwrap_or(ENDLESS_RAD)];
    if value[0] < value[1] {
        return Ok(Stated { value, assumed: assumed.map(str::to_owned) });
    }
    let found = format!("from {} to {}", value[0], value[1]);
    Err(InputError::new(file, field(), found, "lower below upper in all that states bounds; one that is left out is 0"))
}

/// Rounds to three significant digits.
pub fn rounded(value: f64) -> f64 {
    format!("{value:.2e}").parse().unwrap_or(value)
}

impl Draft {
    /// The content of `robot.urdf`: one serial chain, with what the description says.
    pub fn urdf(&self) -> String {
        let mut text = String::from("<?xml version=\"1.0\"?>\n");
        let source = text_in_xml(&self.source).replace("--", "- -");
        let _ = writeln!(
            text,
            "<!-- Made by `catchingbot robot import` from {source}: fixed joints folded, fingers taken off. -->"
        );
        let _ = writeln!(text, "<robot name=\"{}\">", text_in_xml(&self.name));
        let base = &self.chain.base;
        // The base does not move, so a mass that no part of an arm has is no fault.
        let is_part = |it: &Inertia| it.is_of_a_body() && quantity::PART_MASS_KG.contains(it.mass);
        let of_base = base.inertia.filter(is_part).map(|it| inertial(&it)).unwrap_or_default();
        let _ = writeln!(text, "  <link name=\"{}\">\n{of_base}  </link>", text_in_xml(&base.links[0]));
        for (joint, inertia) in self.chain.joints.iter().zip(&self.inertias) {
            // Assumed values stand in robot.toml.
            let known = if inertia.assumed.is_none() { inertial(&inertia.value) } else { String::new() };
            let _ = writeln!(text, "  <link name=\"{}\">\n{known}  </link>", text_in_xml(&joint.body.links[0]));
        }
        let mut parent = &base.links[0];
        for (joint, values) in self.chain.joints.iter().zip(&self.joints) {
            let child = &joint.body.links[0];
            // Other readers need all attributes; which of the values are assumed stands in robot.toml, which
            // goes before them.
            let [lower, upper] = values.range.value;
            let is_endless = values.range.assumed.is_some() && [lower, upper] == [-ENDLESS_RAD, ENDLESS_RAD];
            let kind = if is_endless { "continuous" } else { "revolute" };
            let range =
                if kind == "revolute" { format!(" lower=\"{lower}\" upper=\"{upper}\"") } else { String::new() };
            let (velocity, effort) = (values.velocity.value, values.torque.value);
            let axis = joint.joint.axis;
            let _ = writeln!(
                text,
                "  <joint name=\"{}\" type=\"{kind}\">\n    <parent link=\"{}\"/>\n    <child link=\"{}\"/>\n    {}\n    \
                 <axis xyz=\"{} {} {}\"/>\n    <limit{range} velocity=\"{velocity}\" effort=\"{effort}\"/>\n    <dynamics damping=\"{}\"/>\n  </joint>",
                text_in_xml(&joint.joint.name),
                text_in_xml(parent),
                text_in_xml(child),
                origin(&joint.joint.X_PL),
                axis.x,
                axis.y,
                axis.z,
                joint.joint.damping,
            );
            parent = child;
        }
        text + "</robot>\n"
    }

    /// The content of `robot.toml`.
    pub fn toml(&self) -> String {
        let mut text = format!(
            "# What the URDF of {} cannot say. Made by `catchingbot robot import` from\n# {}.\n#\n# A value that nobody \
             published is marked `assumed = true`, with its reason; `catchingbot check` lists them.\n\n# Where the robot stands: \
             the pose of its base in the world.\n[base]\nposition_m = [0.0, 0.0, {:?}]\nrpy_rad = [0.0, 0.0, 0.0]\n\n",
            one_line(&self.name),
            one_line(&self.source),
            self.base_height_m,
        );
        let X_LF = &self.X_LF.value;
        let (roll, pitch, yaw) = X_LF.rotation.euler_angles();
        let _ = write!(
            text,
            "# The flange on the last link, at the frame {}: y is the approach of a gripper there, its fingers close along x.\n\
             [flange]\nposition_m = {}\nrpy_rad = {}\n{}\n",
            one_line(&self.chain.flange),
            list(X_LF.translation.vector.as_slice()),
            list(&[roll, pitch, yaw]),
            mark(self.X_LF.assumed.as_ref()),
        );
        let _ = write!(
            text,
            "[poses]\n# Close to it the arm is comfortable: far from all ends of its joints' ranges, and easy to move.\n\
             comfortable_rad = {}\n# Where the arm waits when the scenario names no other pose.\nready_rad = {}\n\n",
            list(&self.comfortable_rad),
            list(&self.ready_rad),
        );
        self.write_joints(&mut text);
        self.write_inertias(&mut text);
        self.write_collision(&mut text);
        self.write_visuals(&mut text);
        text
    }

    /// Surfaces for cameras: names of the links and of the files, and the meshes with their sources.
    pub fn visuals(&self) -> impl Iterator<Item = (&str, String, &(TriangleMesh, String))> {
        let visuals = self.bodies().zip(&self.shapes).enumerate();
        visuals.filter_map(|(i, (body, shape))| {
            Some((body.links[0].as_str(), format!("visual/link{i}.obj"), shape.visual.as_ref()?))
        })
    }

    /// The base and each moved body.
    fn bodies(&self) -> impl Iterator<Item = &Body> {
        std::iter::once(&self.chain.base).chain(self.chain.joints.iter().map(|it| &it.body))
    }

    fn write_visuals(&self, text: &mut String) {
        for (i, (link, file, (_, source))) in self.visuals().enumerate() {
            let comment = "\n# Surfaces of the links as cameras see them, in the links' frames.";
            let _ = write!(
                text,
                "{}\n[visuals.{}]\nmesh = {}\nsource = {}\n",
                if i == 0 { comment } else { "" },
                key(link),
                quoted(&file),
                quoted(&format!("{}: {source}", self.source)),
            );
        }
    }

    fn write_joints(&self, text: &mut String) {
        for (joint, values) in self.chain.joints.iter().zip(&self.joints) {
            let _ = writeln!(text, "[joints.{}]", key(&joint.joint.name));
            let mut line = |name: &str, value: String, assumed: Option<&String>| {
                let _ = match assumed {
                    None => writeln!(text, "{name} = {value}"),
                    Some(reason) => {
                        writeln!(text, "{name} = {{ value = {value}, assumed = true, reason = {} }}", quoted(reason))
                    }
                };
            };
            let mut number = |name: &str, it: &Stated<f64>| line(name, format!("{:?}", it.value), it.assumed.as_ref());
            number("max_acceleration_radps2", &values.acceleration);
            number("rotor_inertia_kgm2", &values.rotor_inertia);
            if let Some(jerk) = &values.jerk {
                number("max_jerk_radps3", jerk);
            }
            for (name, it) in [("max_velocity_radps", &values.velocity), ("max_torque_nm", &values.torque)] {
                if it.assumed.is_some() {
                    number(name, it);
                }
            }
            if values.range.assumed.is_some() {
                line("range_rad", list(&values.range.value), values.range.assumed.as_ref());
            }
            text.push('\n');
        }
    }

    fn write_inertias(&self, text: &mut String) {
        for (joint, inertia) in self.chain.joints.iter().zip(&self.inertias) {
            let Inertia { mass, com, about_com: it } = &inertia.value;
            if inertia.assumed.is_some() {
                let moments = [it.m11, it.m22, it.m33, it.m12, it.m13, it.m23];
                let _ = writeln!(
                    text,
                    "[links.{}]\nmass_kg = {mass:?}\ncom_m = {}\ninertia_kgm2 = {}\n{}",
                    key(&joint.body.links[0]),
                    list(com.coords.as_slice()),
                    list(&moments),
                    mark(inertia.assumed.as_ref()),
                );
            }
        }
    }

    fn write_collision(&self, text: &mut String) {
        let _ = write!(
            text,
            "# The arm's outline: capsules in the frames of their links, which hold the shapes of the description. They serve\n\
             # contact with thrown objects and collision avoidance.\n[collision]\n# Links that lie at most this far \
             apart in the chain are not compared.\nignored_neighbours = {}\n",
            self.ignored_neighbours,
        );
        for (body, shape) in self.bodies().zip(&self.shapes) {
            for capsule in &shape.capsules {
                let _ = write!(
                    text,
                    "\n[[collision.capsules]]\nlink = {}\nfrom_m = {}\nto_m = {}\nradius_m = {:?}\n{}",
                    quoted(&body.links[0]),
                    list(capsule.from.coords.as_slice()),
                    list(capsule.to.coords.as_slice()),
                    capsule.radius,
                    mark(shape.assumed.as_ref()),
                );
            }
        }
    }
}

fn mark(reason: Option<&String>) -> String {
    reason.map(|reason| format!("assumed = true\nreason = {}\n", quoted(reason))).unwrap_or_default()
}

fn list(values: &[f64]) -> String {
    // Adding zero makes −0 a zero.
    let numbers: Vec<String> = values.iter().map(|value| format!("{:?}", value + 0.0)).collect();
    format!("[{}]", numbers.join(", "))
}

fn one_line(text: &str) -> String {
    text.chars().filter(|it| !steers_text(*it)).take(200).collect()
}

fn quoted(text: &str) -> String {
    toml::Value::String(one_line(text)).to_string()
}

fn key(name: &str) -> String {
    let is_bare = !name.is_empty() && name.chars().all(|it| it.is_ascii_alphanumeric() || it == '_' || it == '-');
    if is_bare { name.to_owned() } else { toml::Value::String(name.to_owned()).to_string() }
}

fn origin(X_AB: &Pose) -> String {
    let (p, (roll, pitch, yaw)) = (X_AB.translation.vector, X_AB.rotation.euler_angles());
    format!("<origin xyz=\"{} {} {}\" rpy=\"{roll} {pitch} {yaw}\"/>", p.x, p.y, p.z)
}

fn inertial(inertia: &Inertia) -> String {
    let Inertia { mass, com, about_com: it } = inertia;
    format!(
        "    <inertial>\n      <origin xyz=\"{} {} {}\" rpy=\"0 0 0\"/>\n      <mass value=\"{mass}\"/>\n      \
         <inertia ixx=\"{}\" ixy=\"{}\" ixz=\"{}\" iyy=\"{}\" iyz=\"{}\" izz=\"{}\"/>\n    </inertial>\n",
        com.x, com.y, com.z, it.m11, it.m12, it.m13, it.m22, it.m23, it.m33
    )
}

/// Mass per volume of a link's capsules, housings and hollows averaged: the median of 12 imported arms that
/// state their masses, which have 280 to 990; a Sawyer, whose base has wide capsules, does not count.
pub const DENSITY_KGPM3: f64 = 600.0;

/// Mass properties of a body of which only the shape is known, solid and `mass_kg` heavy; those of a small
/// box without any shape.
pub fn assumed_inertia(shape: &BodyShape, mass_kg: Option<f64>) -> Inertia {
    let volumes: Vec<f64> = shape.capsules.iter().map(crate::capsule_fit::volume).collect();
    let volume: f64 = volumes.iter().sum();
    let mass_kg = mass_kg.unwrap_or(volume * DENSITY_KGPM3).max(0.01);
    let parts =
        shape.capsules.iter().zip(&volumes).map(|(capsule, part)| {
            catch_body::TriangleMesh::capsule(capsule, 24).mass_properties(mass_kg * part / volume)
        });
    let of_point = || Inertia {
        mass: mass_kg,
        com: nalgebra::Point3::origin(),
        about_com: Matrix3::identity() * (mass_kg * 0.05 * 0.05 / 6.0),
    };
    let joined = parts.reduce(|one, other| one.joined(&other)).unwrap_or_else(of_point);
    let brief = |value: f64| format!("{value:.6e}").parse().unwrap_or(value);
    Inertia { mass: brief(joined.mass), com: joined.com.map(brief), about_com: joined.about_com.map(brief) }
}

/// Limits by joint names; none where the file does not name the joint.
pub fn limits_of(limits: &BTreeMap<String, StatedLimits>, name: &str) -> StatedLimits {
    // Names of joints get prefixes where several robots share a cell.
    let by_end = || limits.iter().filter(|(key, _)| is_joint(key, name)).max_by_key(|(key, _)| key.len());
    limits.get(name).copied().or_else(|| by_end().map(|(_, it)| *it)).unwrap_or_default()
}

/// Returns whether an entry of limits is of a joint.
pub fn is_joint(key: &str, joint: &str) -> bool {
    !key.is_empty() && joint.ends_with(key)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn range(described: Option<[f64; 2]>, lower: Option<f64>, upper: Option<f64>) -> Result<[f64; 2], String> {
        let [low, high] = described.map_or([None; 2], |it| it.map(Some));
        let limits = StatedLimits { lower: low, upper: high, ..Default::default() };
        let joint = TreeJoint { limits, ..TreeJoint::fixed("j".into(), "l") };
        let joint = ChainJoint { joint, body: Body::default() };
        let limits = StatedLimits { lower, upper, ..Default::default() };
        let values = JointValues::of("a.urdf", &joint, &limits, [None; 3]);
        values.map(|it| it.range.value).map_err(|it| it.to_string())
    }

    proptest! {
        /// A limit that anybody states only narrows; what is no range is refused.
        #[test]
        fn ranges_lie_within_all_stated_bounds(
            described in proptest::option::of([-200.0..200.0, -200.0..200.0]),
            lower in proptest::option::of(-7.0..7.0),
            upper in proptest::option::of(-7.0..7.0),
        ) {
            match range(described, lower, upper) {
                Ok([low, high]) => {
                    prop_assert!(low < high && low.abs() <= 100.0 && high.abs() <= 100.0);
                    let bounds = described.into_iter().chain([
                        [lower.unwrap_or(f64::NEG_INFINITY), upper.unwrap_or(f64::INFINITY)],
                    ]);
                    for [least, most] in bounds {
                        prop_assert!(least <= low && high <= most);
                    }
                }
                Err(fault) => prop_assert!(fault.starts_with("a.urdf: joint j: limit: found "), "{fault}"),
            }
        }
    }

    #[test]
    fn bounds_of_all_kinds_are_kept() {
        let tau = std::f64::consts::TAU;
        assert_eq!(range(Some([-2.4, 2.3]), None, Some(1.0)), Ok([-2.4, 1.0]));
        assert_eq!(range(None, None, None), Ok([-tau, tau]));
        assert_eq!(range(None, Some(-1.0), None), Ok([-1.0, tau]));
        assert!(range(Some([2.1, -1.9]), None, None).unwrap_err().contains("from 2.1 to -1.9"));
        assert!(range(Some([0.0, 0.0]), None, None).is_err());
        assert!(range(Some([-180.0, 180.0]), None, None).unwrap_err().contains("-100 to 100 rad"));
    }

    #[test]
    fn the_slowest_and_the_weakest_count() {
        let described =
            StatedLimits { velocity: Some(3.0), effort: Some(50.0), acceleration: Some(4.0), ..Default::default() };
        let joint = TreeJoint { limits: described, ..TreeJoint::fixed("j".into(), "l") };
        let joint = ChainJoint { joint, body: Body::default() };
        let limits = StatedLimits { velocity: Some(2.0), effort: Some(80.0), ..Default::default() };
        let values = JointValues::of("a.urdf", &joint, &limits, [None; 3]).unwrap();
        assert_eq!((values.velocity.value, values.torque.value, values.acceleration.value), (2.0, 50.0, 4.0));
    }
}
