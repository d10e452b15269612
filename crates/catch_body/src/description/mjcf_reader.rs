//! Reads MuJoCo's model files (MJCF): bodies with hinges, default classes, meshes, inertias and what actuators can exert.

use std::collections::{BTreeMap, HashMap};

use nalgebra::{Matrix3, Point3, Quaternion, Rotation3, Translation3, Unit, UnitQuaternion, Vector3};
use roxmltree::{Document, Node, ParsingOptions};

use super::{Description, Geometry, JointKind, Link, Shape, TreeJoint, mjcf_classes::Classes};
use crate::{InputError, Pose, robot::Inertia};

/// Elements and attributes of a file at most.
const MOST_NODES: u32 = 1_000_000;
/// Bodies or classes within one another at most.
pub(super) const DEEPEST: usize = 200;
/// What a file should be.
const EXPECTED: &str = "a model in MuJoCo's format (MJCF)";
/// Whatever is larger is nonsense, or in other units.
const MOST: f64 = 1e6;

impl Description {
    /// Reads a MuJoCo model; the world is its root.
    ///
    /// # Errors
    /// If it is no MJCF, includes other files, or has an element whose numbers make no sense.
    pub fn from_mjcf(file: &str, text: &str) -> Result<Self, InputError> {
        let options = ParsingOptions { nodes_limit: MOST_NODES, ..ParsingOptions::default() };
        let document = Document::parse_with_options(text, options)
            .map_err(|fault| InputError::new(file, "mujoco", fault, EXPECTED))?;
        let root = document.root_element();
        if !root.has_tag_name("mujoco") {
            return Err(InputError::new(file, "mujoco", format!("<{}>", root.tag_name().name()), EXPECTED));
        }
        if let Some(include) = root.descendants().find(|it| it.has_tag_name("include")) {
            let found = format!("<include file=\"{}\">", include.attribute("file").unwrap_or_default());
            let expected = "one file, such as MuJoCo's viewer saves (`Save xml`)";
            return Err(InputError::new(file, "mujoco", found, expected));
        }
        Reader::new(file, root)?.read(root)
    }
}

struct Reader<'a> {
    file: &'a str,
    in_degrees: bool,
    limits_by_range: bool,
    mesh_folder: String,
    classes: Classes,
    meshes: HashMap<String, Node<'a, 'a>>,
    /// Highest torques by the names of joints.
    efforts: HashMap<String, f64>,
    mimicking: Vec<String>,
    links: BTreeMap<String, Link>,
    joints: BTreeMap<String, Vec<TreeJoint>>,
}

impl<'a> Reader<'a> {
    fn new(file: &'a str, root: Node<'a, 'a>) -> Result<Self, InputError> {
        let compiler = |name: &str| {
            let all = elements(root, "compiler").filter_map(|it| it.attribute(name).map(str::to_owned));
            all.last()
        };
        let mut reader = Self {
            file,
            in_degrees: compiler("angle").as_deref() != Some("radian"),
            limits_by_range: compiler("autolimits").as_deref() != Some("false"),
            mesh_folder: compiler("meshdir").or_else(|| compiler("assetdir")).unwrap_or_default(),
            classes: Classes::read(file, root)?,
            meshes: HashMap::new(),
            efforts: HashMap::new(),
            mimicking: Vec::new(),
            links: BTreeMap::new(),
            joints: BTreeMap::new(),
        };
        if compiler("eulerseq").is_some_and(|it| it != "xyz") || compiler("coordinate").is_some_and(|it| it != "local")
        {
            return Err(reader.fault(
                "compiler",
                "other eulerseq or coordinate",
                "eulerseq=\"xyz\" and local coordinates",
            ));
        }
        for mesh in elements(root, "asset").flat_map(|it| elements(it, "mesh")) {
            let stem = |file: &str| {
                file.rsplit('/').next().and_then(|it| it.rsplit_once('.')).map(|(stem, _)| stem.to_owned())
            };
            let name = mesh.attribute("name").map(str::to_owned).or_else(|| mesh.attribute("file").and_then(stem));
            reader.meshes.extend(name.map(|name| (name, mesh)));
        }
        for actuator in elements(root, "actuator").flat_map(|it| it.children()).filter(Node::is_element) {
            let Some(joint) = actuator.attribute("joint") else { continue };
            let kind = actuator.tag_name().name();
            let range = |name| reader.numbers::<2>(actuator, kind, None, name);
            let gear = reader
                .attribute(actuator, kind, None, "gear")
                .and_then(|it| it.split_whitespace().next()?.parse::<f64>().ok());
            let force = range("forcerange")?.or(if kind == "motor" { range("ctrlrange")? } else { None });
            if let Some([low, high]) = force {
                let effort = low.abs().min(high.abs()) * gear.unwrap_or(1.0).abs();
                reader.efforts.insert(joint.to_owned(), effort);
            }
        }
        let equalities = elements(root, "equality").flat_map(|it| elements(it, "joint"));
        reader.mimicking = equalities
            .filter(|it| it.has_attribute("joint2"))
            .filter_map(|it| it.attribute("joint1").map(str::to_owned))
            .collect();
        Ok(reader)
    }

    fn fault(&self, field: &str, found: impl std::fmt::Display, expected: &str) -> InputError {
        InputError::new(self.file, field, found, expected)
    }

    /// An attribute: the element's own, that of its class, or that of the class that its body says.
    fn attribute<'b>(
        &'b self,
        node: Node<'b, 'b>,
        kind: &str,
        of_body: Option<&str>,
        name: &'b str,
    ) -> Option<&'b str> {
        let class = node.attribute("class").or(of_body).unwrap_or("main");
        node.attribute(name).or_else(|| self.classes.attribute(class, kind, name))
    }

    fn numbers<const N: usize>(
        &self,
        node: Node,
        kind: &str,
        of_body: Option<&str>,
        name: &str,
    ) -> Result<Option<[f64; N]>, InputError> {
        let Some(text) = self.attribute(node, kind, of_body, name) else { return Ok(None) };
        let numbers: Option<Vec<f64>> =
            text.split_whitespace().map(|it| it.parse().ok().filter(|it: &f64| it.abs() <= MOST)).collect();
        let numbers = numbers.and_then(|it| <[f64; N]>::try_from(it).ok());
        let field = || format!("{kind} {}: {name}", node.attribute("name").unwrap_or_default());
        numbers
            .map(Some)
            .ok_or_else(|| self.fault(&field(), format!("`{text}`"), &format!("{N} numbers of at most {MOST}")))
    }

    fn angle(&self, value: f64) -> f64 {
        if self.in_degrees { value.to_radians() } else { value }
    }

    fn pose(&self, node: Node, kind: &str, of_body: Option<&str>) -> Result<Pose, InputError> {
        let numbers = |name| self.numbers::<3>(node, kind, of_body, name);
        let p = numbers("pos")?.unwrap_or_default();
        let rotation = if let Some([w, x, y, z]) = self.numbers::<4>(node, kind, of_body, "quat")? {
            UnitQuaternion::try_new(Quaternion::new(w, x, y, z), 1e-9)
        } else if let Some([x, y, z]) = numbers("euler")? {
            let turn = |axis, angle| UnitQuaternion::from_axis_angle(&axis, self.angle(angle));
            Some(turn(Vector3::x_axis(), x) * turn(Vector3::y_axis(), y) * turn(Vector3::z_axis(), z))
        } else if let Some([x, y, z, angle]) = self.numbers::<4>(node, kind, of_body, "axisangle")? {
            Unit::try_new(Vector3::new(x, y, z), 1e-9)
                .map(|axis| UnitQuaternion::from_axis_angle(&axis, self.angle(angle)))
        } else if let Some([a, b, c, d, e, f]) = self.numbers::<6>(node, kind, of_body, "xyaxes")? {
            let (x, y) = (Vector3::new(a, b, c), Vector3::new(d, e, f));
            let x = x.try_normalize(1e-9);
            let y = x.and_then(|x| (y - x * y.dot(&x)).try_normalize(1e-9));
            x.zip(y).map(|(x, y)| {
                UnitQuaternion::from_rotation_matrix(&Rotation3::from_basis_unchecked(&[x, y, x.cross(&y)]))
            })
        } else if let Some(z) = numbers("zaxis")? {
            UnitQuaternion::rotation_between(&Vector3::z(), &Vector3::from(z))
        } else {
            Some(UnitQuaternion::identity())
        };
        let rotation = rotation.ok_or_else(|| {
            self.fault(kind, "a rotation that is none", "a unit quaternion, or axes that are not zero")
        })?;
        Ok(Pose::from_parts(Translation3::from(p), rotation))
    }

    fn read(mut self, root: Node<'a, 'a>) -> Result<Description, InputError> {
        self.links.insert("world".to_owned(), Link::default());
        for world in elements(root, "worldbody") {
            for body in elements(world, "body") {
                self.body(body, "world", None, 0)?;
            }
        }
        Ok(Description {
            file: self.file.to_owned(),
            name: root.attribute("model").unwrap_or_default().to_owned(),
            root: "world".to_owned(),
            links: self.links,
            joints: self.joints,
        })
    }

    fn body(
        &mut self,
        body: Node<'a, 'a>,
        parent: &str,
        of_parent: Option<&'a str>,
        depth: usize,
    ) -> Result<(), InputError> {
        if depth > DEEPEST {
            return Err(self.fault("body", format!("{depth} bodies within one another"), "fewer"));
        }
        let class = body.attribute("childclass").or(of_parent);
        let name = body.attribute("name").map_or_else(|| format!("body_{}", self.links.len()), str::to_owned);
        let hinges: Vec<Node> =
            body.children().filter(|it| it.has_tag_name("joint") || it.has_tag_name("freejoint")).collect();
        let X_PB = self.pose(body, "body", class)?;
        let (mut parent, mut X_PL, mut p_BL) = (parent.to_owned(), X_PB, Vector3::zeros());
        for (i, hinge) in hinges.iter().enumerate() {
            let is_last = i + 1 == hinges.len();
            let link = if is_last { name.clone() } else { format!("{name}_{i}") };
            // The link's frame is at the joint, turned as the body.
            let at: Vector3<f64> = self.numbers::<3>(*hinge, "joint", class, "pos")?.unwrap_or_default().into();
            X_PL *= Translation3::from(at - p_BL);
            p_BL = at;
            let joint = self.joint(*hinge, class, &link, X_PL)?;
            self.insert(&parent, &link, joint)?;
            (parent, X_PL) = (link, Pose::identity());
        }
        if hinges.is_empty() {
            let joint = TreeJoint { X_PL, ..TreeJoint::fixed(format!("{name}_fixed"), &name) };
            self.insert(&parent, &name, joint)?;
        }
        let link = self.link(body, class, &Translation3::from(-p_BL))?;
        self.links.insert(name.clone(), link);
        for site in elements(body, "site") {
            if let Some(frame) = site.attribute("name").filter(|it| !self.links.contains_key(*it)) {
                let X_LS = Translation3::from(-p_BL) * self.pose(site, "site", class)?;
                let joint = TreeJoint { X_PL: X_LS, ..TreeJoint::fixed(format!("{frame}_fixed"), frame) };
                self.insert(&name, frame, joint)?;
            }
        }
        for child in elements(body, "body") {
            let before = self.joints.get(&name).map_or(0, Vec::len);
            self.body(child, &name, class, depth + 1)?;
            // What hangs on the body's frame, seen from the joint's.
            for joint in self.joints.get_mut(&name).into_iter().flatten().skip(before) {
                joint.X_PL = Translation3::from(-p_BL) * joint.X_PL;
            }
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

    fn joint(&self, node: Node, class: Option<&str>, child: &str, X_PL: Pose) -> Result<TreeJoint, InputError> {
        let name = node.attribute("name").map_or_else(|| format!("{child}_joint"), str::to_owned);
        let kind = match self.attribute(node, "joint", class, "type") {
            _ if node.has_tag_name("freejoint") => JointKind::Other,
            None | Some("hinge") => JointKind::Revolute,
            Some("slide") => JointKind::Prismatic,
            Some(_) => JointKind::Other,
        };
        let axis = self.numbers::<3>(node, "joint", class, "axis")?.map_or_else(Vector3::z, Vector3::from);
        let axis = Unit::try_new(axis, 1e-9)
            .ok_or_else(|| self.fault(&format!("joint {name}: axis"), "zero", "a direction"))?;
        let range = self.numbers::<2>(node, "joint", class, "range")?.filter(|[low, high]| low < high);
        let is_limited = match self.attribute(node, "joint", class, "limited") {
            Some("true") => true,
            Some("false") => false,
            _ => self.limits_by_range,
        };
        let number =
            |attribute| Ok(self.numbers::<1>(node, "joint", class, attribute)?.map(|[it]| it).filter(|it| *it > 0.0));
        let of_joint =
            self.numbers::<2>(node, "joint", class, "actuatorfrcrange")?.map(|[low, high]| low.abs().min(high.abs()));
        Ok(TreeJoint {
            kind,
            X_PL,
            axis,
            range: range
                .filter(|_| is_limited)
                .map(|it| if kind == JointKind::Revolute { it.map(|it| self.angle(it)) } else { it }),
            effort: of_joint.or(self.efforts.get(&name).copied()).filter(|it| *it > 0.0),
            damping: number("damping")?.unwrap_or(0.0),
            rotor_inertia: number("armature")?,
            mimics: self.mimicking.contains(&name),
            ..TreeJoint::fixed(name, child)
        })
    }

    fn link(&self, body: Node, class: Option<&str>, X_LB: &Translation3<f64>) -> Result<Link, InputError> {
        let mut link = Link::default();
        if let Some(inertial) = elements(body, "inertial").next() {
            let mass = self.numbers::<1>(inertial, "inertial", None, "mass")?.map_or(0.0, |[it]| it);
            let diagonal = self.numbers::<3>(inertial, "inertial", None, "diaginertia")?;
            let full = self.numbers::<6>(inertial, "inertial", None, "fullinertia")?;
            let about_com = match (full, diagonal) {
                (Some([xx, yy, zz, xy, xz, yz]), _) => Matrix3::new(xx, xy, xz, xy, yy, yz, xz, yz, zz),
                (None, Some(diagonal)) => Matrix3::from_diagonal(&Vector3::from(diagonal)),
                (None, None) => Matrix3::zeros(),
            };
            let X_LI = X_LB * self.pose(inertial, "inertial", None)?;
            let inertia = Inertia { mass, com: Point3::origin(), about_com };
            link.inertia = Some(inertia.transformed(&X_LI)).filter(|it| it.mass >= crate::quantity::PART_MASS_KG.least);
        }
        for geom in elements(body, "geom") {
            let touches =
                ["contype", "conaffinity"].iter().any(|it| self.attribute(geom, "geom", class, it) != Some("0"));
            if let Some(mut geometry) = self.geometry(geom, class)? {
                let X_BS = geometry.X_LS;
                geometry.X_LS = X_LB * X_BS;
                if touches {
                    link.collisions.push(geometry);
                } else {
                    link.visuals.push(geometry);
                }
                let said = self.attribute(geom, "geom", class, "friction");
                let sliding = said.and_then(|it| it.split_whitespace().next()?.parse::<f64>().ok());
                link.friction = link.friction.or(sliding.filter(|it| crate::quantity::FRICTION.contains(*it)));
            }
        }
        Ok(link)
    }

    /// The shape of a geom; `None` for planes and the like.
    fn geometry(&self, geom: Node, class: Option<&str>) -> Result<Option<Geometry>, InputError> {
        let mut X_LS = self.pose(geom, "geom", class)?;
        let size: Vec<f64> = self
            .attribute(geom, "geom", class, "size")
            .unwrap_or_default()
            .split_whitespace()
            .filter_map(|it| it.parse().ok())
            .collect();
        if size.iter().any(|it| !(0.0..=10.0).contains(it)) {
            return Err(self.fault("geom: size", format!("{size:?}"), "0 to 10 m"));
        }
        let mut half_length = size.get(1).copied();
        if let Some([a, b, c, d, e, f]) = self.numbers::<6>(geom, "geom", class, "fromto")? {
            let (from, to) = (Vector3::new(a, b, c), Vector3::new(d, e, f));
            let rotation = UnitQuaternion::rotation_between(&Vector3::z(), &(to - from)).unwrap_or_default();
            X_LS = Pose::from_parts(Translation3::from((from + to) / 2.0), rotation);
            half_length = Some((to - from).norm() / 2.0);
        }
        let mesh = self.attribute(geom, "geom", class, "mesh");
        let kind =
            self.attribute(geom, "geom", class, "type").unwrap_or(if mesh.is_some() { "mesh" } else { "sphere" });
        let shape = match (kind, &size[..]) {
            ("box", &[x, y, z, ..]) => Shape::Cuboid(Vector3::new(x, y, z) * 2.0),
            ("sphere", &[radius, ..]) => Shape::Sphere(radius),
            ("ellipsoid", sizes) if !sizes.is_empty() => Shape::Sphere(sizes.iter().copied().fold(0.0, f64::max)),
            ("cylinder", &[radius_m, ..]) => Shape::Cylinder { radius_m, length_m: 2.0 * half_length.unwrap_or(0.0) },
            ("capsule", &[radius_m, ..]) => Shape::Capsule { radius_m, length_m: 2.0 * half_length.unwrap_or(0.0) },
            ("mesh", _) => {
                let Some(asset) = mesh.and_then(|name| self.meshes.get(name)) else { return Ok(None) };
                let Some(named) = asset.attribute("file") else { return Ok(None) };
                let scale = self.numbers::<3>(*asset, "mesh", None, "scale")?.unwrap_or([1.0; 3]).into();
                let file = if self.mesh_folder.is_empty() {
                    named.to_owned()
                } else {
                    format!("{}/{named}", self.mesh_folder.trim_end_matches('/'))
                };
                Shape::Mesh { file, scale }
            }
            _ => return Ok(None),
        };
        Ok(Some(Geometry { X_LS, shape }))
    }
}

pub(super) fn elements<'a>(node: Node<'a, 'a>, name: &'static str) -> impl Iterator<Item = Node<'a, 'a>> {
    node.children().filter(move |it| it.has_tag_name(name))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::description::{Chain, Selection};

    const ARM: &str = r#"<mujoco model="arm"><compiler angle="degree" meshdir="assets"/>
      <default><default class="a"><joint axis="0 1 0" range="-90 90" armature="0.1" damping="2"/>
        <geom type="capsule" size="0.05 0.1"/><position forcerange="-40 50"/></default></default>
      <asset><mesh file="tube.stl" scale="0.001 0.001 0.001"/></asset>
      <worldbody><body name="base" childclass="a"><geom type="mesh" mesh="tube" contype="0" conaffinity="0"/>
        <body name="one" pos="0 0 0.3" euler="0 0 90"><inertial mass="2" pos="0 0 0.1" diaginertia="0.02 0.02 0.01"/>
          <joint name="j1" pos="0.1 0 0"/><geom/>
          <body name="two" pos="0 0 0.4"><joint name="j2" range="-3 3"/>
            <body name="three" pos="0 0 0.2"><joint name="j3" axis="0 0 1"/><site name="tool" pos="0 0 0.1"/></body></body>
      </body></body></worldbody>
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
            ("name=\"two\"", "name=\"one\"", "the name twice"),
            ("mujoco", "model", "found <model>"),
            ("axis=\"0 0 1\"", "axis=\"0 0 0\"", "joint j3: axis"),
        ] {
            let fault = Description::from_mjcf("arm.xml", &ARM.replace(from, to)).unwrap_err().to_string();
            assert!(fault.contains(expected), "{fault}");
        }
    }
}
