//! Reads MuJoCo's model files (MJCF): bodies with hinges, default classes, meshes, inertias and what actuators can exert.
//!
//! What it does not read it refuses, as MuJoCo's compiler makes of one attribute what no other can guess.

use std::{
    cell::Cell,
    collections::{BTreeMap, HashMap, HashSet},
};

use nalgebra::{Quaternion, Rotation3, Translation3, Unit, UnitQuaternion, Vector3};

use super::{
    Description, JointKind, Link, TreeJoint,
    mjcf_classes::{Classes, MAIN},
    mjcf_harmless::HARMLESS,
};
use crate::{
    InputError, Pose,
    document::{Document, Node},
};

/// Bodies, frames or classes within one another at most.
pub(super) const DEEPEST: usize = 200;
/// What a file should be.
const EXPECTED: &str = "a model in MuJoCo's format (MJCF)";
/// Whatever is larger is nonsense, or in other units.
const MOST: f64 = 1e6;

impl Description {
    /// Reads a MuJoCo model; the world is its root.
    ///
    /// # Errors
    /// If it is no MJCF, includes other files, has an element whose numbers make no sense, or one that is not
    /// read.
    pub fn from_mjcf(file: &str, text: &str) -> Result<Self, InputError> {
        let document = Document::from_xml(file, text, EXPECTED)?;
        let root = document.root();
        if root.name() != "mujoco" {
            return Err(InputError::new(file, "mujoco", format!("<{}>", root.name()), EXPECTED));
        }
        if let Some(include) = root.descendants().find(|it| it.name() == "include") {
            let found = format!("<include file=\"{}\">", include.attribute("file").unwrap_or_default());
            return Err(include.fault(found, "one file, such as MuJoCo's viewer saves (`Save xml`)"));
        }
        let description = Reader::new(file, root)?.read(root)?;
        document.finish(&[HARMLESS])?;
        Ok(description)
    }
}

/// Whether masses are those of geoms.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum FromGeoms {
    Never,
    WithoutInertial,
    Always,
}

pub(super) struct Reader<'a> {
    file: &'a str,
    in_degrees: bool,
    limits_by_range: bool,
    euler_sequence: String,
    pub(super) masses: FromGeoms,
    pub(super) mesh_folder: String,
    classes: Classes<'a>,
    /// By name, and whether a geom shows them.
    pub(super) meshes: HashMap<String, (Node<'a>, Cell<bool>)>,
    /// Highest torques by the names of joints.
    efforts: HashMap<&'a str, f64>,
    /// By the joint that is driven, the one that drives it.
    mimicking: HashMap<&'a str, &'a str>,
    /// Bodies that are part of a loop.
    in_loop: HashSet<&'a str>,
    links: BTreeMap<String, Link>,
    joints: BTreeMap<String, Vec<TreeJoint>>,
}

/// An element within a body, with the pose of the frames around it in the body, and the class of what names
/// none.
pub(super) type Placed<'a> = (Node<'a>, Pose, Option<&'a str>);

impl<'a> Reader<'a> {
    fn new(file: &'a str, root: Node<'a>) -> Result<Self, InputError> {
        let compilers: Vec<Node> = root.children("compiler").collect();
        let compiler = |name| compilers.iter().filter_map(|it| it.attribute(name)).reduce(|_, last| last);
        let mut reader = Self {
            file,
            in_degrees: compiler("angle") != Some("radian"),
            limits_by_range: compiler("autolimits") != Some("false"),
            euler_sequence: compiler("eulerseq").unwrap_or("xyz").to_owned(),
            masses: match compiler("inertiafromgeom") {
                Some("true") => FromGeoms::Always,
                Some("false") => FromGeoms::Never,
                _ => FromGeoms::WithoutInertial,
            },
            mesh_folder: compiler("meshdir").or_else(|| compiler("assetdir")).unwrap_or_default().to_owned(),
            classes: Classes::read(root)?,
            meshes: HashMap::new(),
            efforts: HashMap::new(),
            mimicking: HashMap::new(),
            in_loop: HashSet::new(),
            links: BTreeMap::new(),
            joints: BTreeMap::new(),
        };
        if let Some(other) = compiler("coordinate").filter(|it| *it != "local") {
            return Err(reader.fault("compiler", format!("coordinate=\"{other}\""), "local coordinates"));
        }
        for mesh in root.children("asset").flat_map(|it| it.children("mesh")) {
            let stem = |file: &str| {
                file.rsplit('/').next().and_then(|it| it.rsplit_once('.')).map(|(stem, _)| stem.to_owned())
            };
            let name = mesh.attribute("name").map(str::to_owned).or_else(|| mesh.attribute("file").and_then(stem));
            let name = name.ok_or_else(|| mesh.fault("no file", "a mesh in a file of its own"))?;
            reader.meshes.insert(name, (mesh, Cell::new(false)));
        }
        reader.read_actuators(root)?;
        for equality in root.children("equality") {
            let driven = equality.children("joint");
            reader.mimicking.extend(
                driven.filter_map(|it| Some((it.attribute("joint1")?, it.attribute("joint2").unwrap_or_default()))),
            );
            for tie in equality.children("connect").chain(equality.children("weld")) {
                reader.in_loop.extend([tie.attribute("body1"), tie.attribute("body2")].into_iter().flatten());
            }
        }
        Ok(reader)
    }

    fn read_actuators(&mut self, root: Node<'a>) -> Result<(), InputError> {
        for actuator in root.children("actuator").flat_map(Node::elements) {
            let Some(joint) = actuator.read().attribute("joint") else {
                // What pulls at tendons, sites and bodies moves no joint of an arm by itself.
                actuator.leave_out();
                continue;
            };
            let range = |name| self.numbers::<2>(actuator, None, name);
            let gear = self.attribute(actuator, None, "gear");
            let gear = gear.and_then(|it| it.split_whitespace().next()?.parse::<f64>().ok()).unwrap_or(1.0);
            let is_limited = self.attribute(actuator, None, "forcelimited") != Some("false");
            let is_controlled = self.attribute(actuator, None, "ctrllimited") != Some("false");
            let of_motor = range("ctrlrange")?.filter(|_| actuator.name() == "motor" && is_controlled);
            let bounds = [range("forcerange")?.filter(|_| is_limited), of_motor].into_iter().flatten();
            let force = bounds.map(|[low, high]| low.abs().min(high.abs())).reduce(f64::min);
            if let Some(effort) = force.map(|it| it * gear.abs()) {
                let least = self.efforts.get(joint).map_or(effort, |it| it.min(effort));
                self.efforts.insert(joint, least);
            }
        }
        Ok(())
    }

    pub(super) fn fault(&self, field: &str, found: impl std::fmt::Display, expected: &str) -> InputError {
        InputError::new(self.file, field, found, expected)
    }

    /// An attribute: the element's own, that of its class, or that of the class that its body says.
    pub(super) fn attribute(&self, node: Node<'a>, of_body: Option<&str>, name: &'static str) -> Option<&'a str> {
        let class = node.attribute("class").or(of_body).unwrap_or(MAIN);
        node.attribute(name).or_else(|| self.classes.attribute(class, node.name(), name))
    }

    pub(super) fn numbers<const N: usize>(
        &self,
        node: Node<'a>,
        of_body: Option<&str>,
        name: &'static str,
    ) -> Result<Option<[f64; N]>, InputError> {
        let Some(text) = self.attribute(node, of_body, name) else { return Ok(None) };
        let numbers: Option<Vec<f64>> =
            text.split_whitespace().map(|it| it.parse().ok().filter(|it: &f64| it.abs() <= MOST)).collect();
        let numbers = numbers.and_then(|it| <[f64; N]>::try_from(it).ok());
        let fault = || {
            let field = format!("{}.{name}", node.place());
            self.fault(&field, format!("`{text}`"), &format!("{N} numbers of at most {MOST}"))
        };
        numbers.map(Some).ok_or_else(fault)
    }

    fn angle(&self, value: f64) -> f64 {
        if self.in_degrees { value.to_radians() } else { value }
    }

    /// A rotation by Euler angles: about axes that move in small letters, about fixed ones in capitals.
    fn euler(&self, angles: [f64; 3]) -> Option<UnitQuaternion<f64>> {
        let letters: [char; 3] = self.euler_sequence.chars().collect::<Vec<_>>().try_into().ok()?;
        letters.into_iter().zip(angles).try_fold(UnitQuaternion::identity(), |all, (letter, angle)| {
            let axis = match letter.to_ascii_lowercase() {
                'x' => Vector3::x_axis(),
                'y' => Vector3::y_axis(),
                'z' => Vector3::z_axis(),
                _ => return None,
            };
            let turn = UnitQuaternion::from_axis_angle(&axis, self.angle(angle));
            Some(if letter.is_ascii_lowercase() { all * turn } else { turn * all })
        })
    }

    pub(super) fn pose(&self, node: Node<'a>, of_body: Option<&str>) -> Result<Pose, InputError> {
        let p = self.numbers::<3>(node, of_body, "pos")?.unwrap_or_default();
        let rotation = if let Some([w, x, y, z]) = self.numbers::<4>(node, of_body, "quat")? {
            UnitQuaternion::try_new(Quaternion::new(w, x, y, z), 1e-9)
        } else if let Some(angles) = self.numbers::<3>(node, of_body, "euler")? {
            self.euler(angles)
        } else if let Some([x, y, z, angle]) = self.numbers::<4>(node, of_body, "axisangle")? {
            Unit::try_new(Vector3::new(x, y, z), 1e-9)
                .map(|axis| UnitQuaternion::from_axis_angle(&axis, self.angle(angle)))
        } else if let Some([a, b, c, d, e, f]) = self.numbers::<6>(node, of_body, "xyaxes")? {
            let (x, y) = (Vector3::new(a, b, c), Vector3::new(d, e, f));
            let x = x.try_normalize(1e-9);
            let y = x.and_then(|x| (y - x * y.dot(&x)).try_normalize(1e-9));
            x.zip(y).map(|(x, y)| {
                UnitQuaternion::from_rotation_matrix(&Rotation3::from_basis_unchecked(&[x, y, x.cross(&y)]))
            })
        } else if let Some(z) = self.numbers::<3>(node, of_body, "zaxis")? {
            z_to(&z.into())
        } else {
            Some(UnitQuaternion::identity())
        };
        let expected = "a unit quaternion, axes that are not zero, or an eulerseq of x, y and z";
        let rotation = rotation.ok_or_else(|| node.fault("a rotation that is none", expected))?;
        Ok(Pose::from_parts(Translation3::from(p), rotation))
    }

    fn read(mut self, root: Node<'a>) -> Result<Description, InputError> {
        self.links.insert("world".to_owned(), Link::default());
        for world in root.children("worldbody") {
            for (body, X_WF, class) in self.within(world, "body", None)? {
                self.body(body, "world", (X_WF, class), 0)?;
            }
        }
        // What no geom shows is not looked at.
        self.meshes.values().filter(|(_, is_used)| !is_used.get()).for_each(|(mesh, _)| mesh.leave_out());
        Ok(Description {
            file: self.file.to_owned(),
            name: root.attribute("model").unwrap_or_default().to_owned(),
            root: "world".to_owned(),
            links: self.links,
            joints: self.joints,
        })
    }

    /// The elements of a name in a body and in the frames within it.
    pub(super) fn within(
        &self,
        body: Node<'a>,
        name: &'static str,
        class: Option<&'a str>,
    ) -> Result<Vec<Placed<'a>>, InputError> {
        let mut found = Vec::new();
        let mut waiting = vec![(body, Pose::identity(), class, 0)];
        while let Some((node, X_BF, class, depth)) = waiting.pop() {
            if depth > DEEPEST {
                return Err(node.fault(format!("{depth} frames within one another"), "fewer"));
            }
            found.extend(node.children(name).map(|it| (it, X_BF, class)));
            let first = waiting.len();
            for frame in node.children("frame") {
                let class = frame.attribute("childclass").or(class);
                waiting.push((frame, X_BF * self.pose(frame, None)?, class, depth + 1));
            }
            waiting[first..].reverse();
        }
        Ok(found)
    }

    /// `placed` is the frame in which the body stands, and the class of what is within.
    fn body(
        &mut self,
        body: Node<'a>,
        parent: &str,
        placed: (Pose, Option<&'a str>),
        depth: usize,
    ) -> Result<(), InputError> {
        if depth > DEEPEST {
            return Err(body.fault(format!("{depth} bodies within one another"), "fewer"));
        }
        let (X_PF, of_parent) = placed;
        let class = body.attribute("childclass").or(of_parent);
        if let Some(unknown) = class.filter(|it| !self.classes.has(it)) {
            return Err(body.fault(format!("the class {unknown}"), "a class of a <default>"));
        }
        let name = body.attribute("name").map_or_else(|| format!("body_{}", self.links.len()), str::to_owned);
        let hinges: Vec<Node> =
            body.elements().filter(|it| matches!(it.name(), "joint" | "freejoint")).map(Node::read).collect();
        let X_PB = X_PF * self.pose(body, class)?;
        let (mut parent, mut X_PL, mut p_BL) = (parent.to_owned(), X_PB, Vector3::zeros());
        for (i, hinge) in hinges.iter().enumerate() {
            let is_last = i + 1 == hinges.len();
            let link = if is_last { name.clone() } else { format!("{name}_{i}") };
            // The link's frame is at the joint, turned as the body.
            let at: Vector3<f64> = self.numbers::<3>(*hinge, class, "pos")?.unwrap_or_default().into();
            X_PL *= Translation3::from(at - p_BL);
            p_BL = at;
            let mut joint = self.joint(*hinge, class, &link, X_PL)?;
            if self.in_loop.contains(name.as_str()) {
                joint.mimics.get_or_insert_with(|| name.clone());
            }
            self.insert(&parent, &link, joint)?;
            (parent, X_PL) = (link, Pose::identity());
        }
        if hinges.is_empty() {
            let joint = TreeJoint { X_PL, ..TreeJoint::fixed(format!("{name}_fixed"), &name) };
            self.insert(&parent, &name, joint)?;
        }
        let X_LB = Translation3::from(-p_BL);
        let link = self.link(body, class, &X_LB)?;
        self.links.insert(name.clone(), link);
        for (site, X_BF, class) in self.within(body, "site", class)? {
            if let Some(frame) = site.attribute("name").filter(|it| !self.links.contains_key(*it)) {
                let X_LS = X_LB * X_BF * self.pose(site, class)?;
                let joint = TreeJoint { X_PL: X_LS, ..TreeJoint::fixed(format!("{frame}_fixed"), frame) };
                self.insert(&name, frame, joint)?;
            } else {
                site.leave_out();
            }
        }
        for (child, X_BF, class) in self.within(body, "body", class)? {
            // What hangs on the body's frame, seen from the joint's.
            self.body(child, &name, (X_LB * X_BF, class), depth + 1)?;
        }
        Ok(())
    }

    fn insert(&mut self, parent: &str, child: &str, joint: TreeJoint) -> Result<(), InputError> {
        if self.links.insert(child.to_owned(), Link::default()).is_some() {
            return Err(self.fault(&format!("body {child}"), "the name twice", "one body or site of each name"));
        }
        self.joints.entry(parent.to_owned()).or_default().push(joint);
        Ok(())
    }

    fn joint(&self, node: Node<'a>, class: Option<&str>, child: &str, X_PL: Pose) -> Result<TreeJoint, InputError> {
        let name = node.attribute("name").map_or_else(|| format!("{child}_joint"), str::to_owned);
        if node.name() == "freejoint" {
            return Ok(TreeJoint { kind: JointKind::Other, X_PL, ..TreeJoint::fixed(name, child) });
        }
        let kind = match self.attribute(node, class, "type") {
            None | Some("hinge") => JointKind::Revolute,
            Some("slide") => JointKind::Prismatic,
            Some(_) => JointKind::Other,
        };
        let axis = self.numbers::<3>(node, class, "axis")?.map_or_else(Vector3::z, Vector3::from);
        let axis = Unit::try_new(axis, 1e-9)
            .ok_or_else(|| self.fault(&format!("joint {name}: axis"), "zero", "a direction"))?;
        let in_units = |it: f64| if kind == JointKind::Prismatic { it } else { self.angle(it) };
        let range = self.numbers::<2>(node, class, "range")?.map(|it| it.map(in_units));
        let range = match self.attribute(node, class, "limited") {
            Some("true") => range.or(Some([0.0; 2])),
            Some("false") => None,
            _ => range.filter(|[low, high]| self.limits_by_range && low < high),
        };
        let number = |attribute| Ok(self.numbers::<1>(node, class, attribute)?.map(|[it]| it).filter(|it| *it > 0.0));
        let is_limited = self.attribute(node, class, "actuatorfrclimited") != Some("false");
        let of_joint = self.numbers::<2>(node, class, "actuatorfrcrange")?.filter(|_| is_limited);
        let of_joint = of_joint.map(|[low, high]| low.abs().min(high.abs()));
        let of_actuator = self.efforts.get(name.as_str()).copied();
        // The file shows the joint where it is at `ref`.
        let shown_at = self.numbers::<1>(node, class, "ref")?.map_or(0.0, |[it]| in_units(it));
        let back = match kind {
            JointKind::Prismatic => Translation3::from(axis.into_inner() * -shown_at).into(),
            _ => Pose::from_parts(Translation3::identity(), UnitQuaternion::from_axis_angle(&axis, -shown_at)),
        };
        Ok(TreeJoint {
            kind,
            X_PL: X_PL * back,
            axis,
            range,
            effort: [of_joint, of_actuator].into_iter().flatten().filter(|it| *it > 0.0).reduce(f64::min),
            damping: number("damping")?.unwrap_or(0.0),
            rotor_inertia: number("armature")?,
            mimics: self.mimicking.get(name.as_str()).map(|it| (*it).to_owned()),
            ..TreeJoint::fixed(name, child)
        })
    }
}

/// The smallest rotation that turns z into a direction.
pub(super) fn z_to(direction: &Vector3<f64>) -> Option<UnitQuaternion<f64>> {
    let direction = direction.try_normalize(1e-9)?;
    let turned_over = || UnitQuaternion::from_axis_angle(&Vector3::x_axis(), std::f64::consts::PI);
    Some(UnitQuaternion::rotation_between(&Vector3::z(), &direction).unwrap_or_else(turned_over))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::description::{Chain, Selection, Shape};
    use nalgebra::Point3;

    const ARM: &str = r#"<mujoco model="arm"><compiler angle="degree" meshdir="assets"/>
      <default><default class="a"><joint axis="0 1 0" range="-90 90" armature="0.1" damping="2"/>
        <geom type="capsule" size="0.05 0.1"/><position forcerange="-40 50"/></default></default>
      <asset><mesh file="tube.stl" scale="0.001 0.001 0.001"/><mesh name="unused" file="other.stl"/></asset>
      <worldbody><body name="base" childclass="a"><geom type="mesh" mesh="tube" contype="0" conaffinity="0"/><geom contype="1" conaffinity="1" size="0.01 0.01"/>
        <body name="one" pos="0 0 0.3" euler="0 0 90"><inertial mass="2" pos="0 0 0.1" diaginertia="0.02 0.02 0.01"/>
          <joint name="j1" pos="0.1 0 0"/><geom/>
          <body name="two" pos="0 0 0.4"><joint name="j2" range="-3 3"/>
            <body name="three" pos="0 0 0.2"><joint name="j3" axis="0 0 1"/><site name="tool" pos="0 0 0.1"/></body></body>
      </body></body></worldbody>
      <equality><joint name="e" joint1="f1" joint2="f2" solref="0.01 1"/><weld name="w" body1="f" body2="g" active="false"/></equality>
      <actuator><position class="a" joint="j1"/><motor joint="j2" ctrlrange="-1 1" gear="25"/></actuator></mujoco>"#;

    #[test]
    fn an_arm_is_read_with_its_classes() {
        let description = Description::from_mjcf("arm.xml", ARM).unwrap();
        let chain = Chain::of(&description, &Selection::default()).unwrap();
        let names: Vec<&str> = chain.joints.iter().map(|it| it.joint.name.as_str()).collect();
        assert_eq!((names, chain.flange.as_str()), (vec!["j1", "j2", "j3"], "tool"));
        let first = &chain.joints[0];
        assert_eq!((first.joint.effort, first.joint.rotor_inertia, first.joint.damping), (Some(40.0), Some(0.1), 2.0));
        assert!((first.joint.range.unwrap()[1] - std::f64::consts::FRAC_PI_2).abs() < 1e-12);
        assert_eq!(chain.joints[1].joint.effort, Some(25.0));
        // The first body turns about x = 0.1 of its frame, which is y of the world.
        let at = first.joint.X_PL.translation.vector;
        assert!((at - Vector3::new(0.0, 0.1, 0.3)).norm() < 1e-12, "{at}");
        assert!((first.body.inertia.unwrap().com - Point3::new(-0.1, 0.0, 0.1)).norm() < 1e-12);
        assert!((chain.joints[1].joint.X_PL.translation.vector - Vector3::new(-0.1, 0.0, 0.4)).norm() < 1e-12);
        assert_eq!(first.body.collisions[0].shape, Shape::Capsule { radius_m: 0.05, length_m: 0.2 });
        let mesh = Shape::Mesh { file: "assets/tube.stl".into(), scale: Vector3::repeat(0.001) };
        assert_eq!(chain.base.visuals[0].shape, mesh);
    }

    #[test]
    fn faults_are_told() {
        for (from, to, expected) in [
            ("<asset>", "<include file=\"b.xml\"/><asset>", "<include file=\"b.xml\">"),
            ("pos=\"0 0 0.3\"", "pos=\"0 0\"", "found `0 0`, expected 3 numbers"),
            ("<geom/>", "<geom shellinertia=\"true\"/>", "the attribute shellinertia"),
            ("<joint axis=\"0 1 0\"", "<joint axis=\"0 1 0\" wobble=\"1\"", "the attribute wobble"),
            ("<geom/>", "<geom/><composite type=\"cable\"/>", "found <composite>"),
            ("meshdir=\"assets\"", "meshdir=\"assets\" settotalmass=\"3\"", "settotalmass"),
            ("name=\"two\"", "name=\"one\"", "the name twice"),
            ("mujoco", "model", "found <model>"),
            ("axis=\"0 0 1\"", "axis=\"0 0 0\"", "joint j3: axis"),
        ] {
            let fault = Description::from_mjcf("arm.xml", &ARM.replace(from, to)).unwrap_err().to_string();
            assert!(fault.contains(expected), "{fault}");
        }
    }
}
