//! Reads the links of SDF files, as simulators describe objects.

use nalgebra::{Matrix3, Point3, Translation3, UnitQuaternion, Vector3};
use roxmltree::{Document, Node, ParsingOptions};

use super::{Description, Geometry, Link, Shape};
use crate::{
    InputError, Pose,
    quantity::{self, Quantity},
    robot::Inertia,
};

/// Elements and attributes of a file at most.
const MOST_NODES: u32 = 1_000_000;
/// What a file should be.
const EXPECTED: &str = "a model in the Simulation Description Format (SDF)";
/// Extents of a shape.
const EXTENT_M: Quantity = Quantity { least: 0.0, most: 10.0, unit: "m" };
/// Offsets in metres, and angles in radians or degrees.
const POSE: Quantity = Quantity { least: -1000.0, most: 1000.0, unit: "m or rad" };
/// Factors on the axes of a mesh; a mirrored one has a negative factor.
const MESH_SCALE: Quantity = Quantity { least: -1000.0, most: 1000.0, unit: "m per unit" };

impl Description {
    /// Reads the links of the first model in an SDF file, each in its own frame. Joints, and where links stand, are not read.
    ///
    /// # Errors
    /// If it is no SDF, has no model with a link, or a number out of its range.
    pub fn from_sdf(file: &str, text: &str) -> Result<Self, InputError> {
        let options = ParsingOptions { nodes_limit: MOST_NODES, ..ParsingOptions::default() };
        let fault = |found: String| InputError::new(file, "sdf", found, EXPECTED);
        let document = Document::parse_with_options(text, options).map_err(|it| fault(it.to_string()))?;
        let root = document.root_element();
        if !root.has_tag_name("sdf") {
            return Err(fault(format!("<{}>", root.tag_name().name())));
        }
        let model = root.descendants().find(|it| it.has_tag_name("model"));
        let model = model.ok_or_else(|| fault("no <model>".into()))?;
        let reader = Reader { file };
        let mut description = Self {
            file: file.to_owned(),
            name: model.attribute("name").unwrap_or_default().to_owned(),
            root: String::new(),
            links: Default::default(),
            joints: Default::default(),
        };
        for node in children(model, "link") {
            let name = node.attribute("name").unwrap_or_default().to_owned();
            let link = reader.link(node, &name)?;
            if description.root.is_empty() {
                description.root.clone_from(&name);
            }
            if description.links.insert(name.clone(), link).is_some() {
                return Err(InputError::new(file, format!("link {name}"), "the name twice", "one link of each name"));
            }
        }
        if description.links.is_empty() { Err(fault("no <link>".into())) } else { Ok(description) }
    }
}

struct Reader<'a> {
    file: &'a str,
}

impl Reader<'_> {
    fn link(&self, node: Node, name: &str) -> Result<Link, InputError> {
        let path = format!("link {name}");
        let inertial = child(node, "inertial");
        let inertia = inertial.map(|it| self.inertia(it, &format!("{path}: inertial"))).transpose()?.flatten();
        let shapes = |kind: &str| {
            let all = children(node, kind).enumerate();
            let of = all.map(|(i, it)| self.geometry(it, &format!("{path}: {kind} {}", i + 1)));
            of.filter_map(Result::transpose).collect::<Result<Vec<_>, _>>()
        };
        let frictions = node.descendants().filter(|it| {
            it.has_tag_name("mu_dynamic") || it.tag_name().name() == "mu_dynamic" || it.has_tag_name("mu")
        });
        let mut frictions = frictions.filter_map(|it| it.text()?.trim().parse::<f64>().ok());
        let friction = frictions.find(|it| quantity::FRICTION.contains(*it));
        Ok(Link { inertia, friction, collisions: shapes("collision")?, visuals: shapes("visual")? })
    }

    fn inertia(&self, node: Node, path: &str) -> Result<Option<Inertia>, InputError> {
        let Some(mass) = child(node, "mass") else { return Ok(None) };
        let [mass] = self.numbers(mass, path, quantity::PART_MASS_KG)?;
        let X_LC = self.pose(node, path)?;
        let moments = child(node, "inertia");
        let moment = |name: &str| {
            let of = moments.and_then(|it| child(it, name));
            of.map_or(Ok(0.0), |it| self.numbers(it, path, quantity::INERTIA_KGM2).map(|[it]| it))
        };
        let (xx, yy, zz) = (moment("ixx")?, moment("iyy")?, moment("izz")?);
        let (xy, xz, yz) = (moment("ixy")?, moment("ixz")?, moment("iyz")?);
        let about_com = Matrix3::new(xx, xy, xz, xy, yy, yz, xz, yz, zz);
        Ok(Some(Inertia { mass, com: Point3::origin(), about_com }.transformed(&X_LC)))
    }

    /// The shape of a visual or a collision; `None` for planes and the like.
    fn geometry(&self, node: Node, path: &str) -> Result<Option<Geometry>, InputError> {
        let Some(geometry) = child(node, "geometry") else { return Ok(None) };
        let X_LS = self.pose(node, path)?;
        let Some(kind) = geometry.children().find(Node::is_element) else { return Ok(None) };
        let number = |name: &str| {
            let missing = || InputError::new(self.file, path, format!("no <{name}>"), "a number of metres");
            let of = child(kind, name).ok_or_else(missing)?;
            self.numbers(of, path, EXTENT_M).map(|[it]| it)
        };
        let shape = match kind.tag_name().name() {
            "box" => {
                let missing = || InputError::new(self.file, path, "no <size>", "three lengths in metres");
                let size = child(kind, "size").ok_or_else(missing)?;
                Shape::Cuboid(self.numbers::<3>(size, path, EXTENT_M)?.into())
            }
            "cylinder" => Shape::Cylinder { radius_m: number("radius")?, length_m: number("length")? },
            "capsule" => Shape::Capsule { radius_m: number("radius")?, length_m: number("length")? },
            "sphere" => Shape::Sphere(number("radius")?),
            "mesh" => {
                let uri = child(kind, "uri").and_then(|it| it.text()).unwrap_or_default().trim();
                if uri.is_empty() {
                    return Err(InputError::new(self.file, path, "a mesh without <uri>", "the file of the mesh"));
                }
                let scale = child(kind, "scale");
                let scale = scale.map_or(Ok([1.0; 3]), |it| self.numbers::<3>(it, path, MESH_SCALE))?;
                Shape::Mesh { file: uri.to_owned(), scale: scale.into() }
            }
            _ => return Ok(None),
        };
        Ok(Some(Geometry { X_LS, shape }))
    }

    /// The pose in the child `<pose>`; the identity where there is none.
    fn pose(&self, node: Node, path: &str) -> Result<Pose, InputError> {
        let Some(pose) = child(node, "pose") else { return Ok(Pose::identity()) };
        if let Some(other) = pose.attribute("relative_to").filter(|it| !it.is_empty()) {
            let expected = "poses in the link's frame: without `relative_to`";
            return Err(InputError::new(
                self.file,
                format!("{path}: pose"),
                format!("relative_to=\"{other}\""),
                expected,
            ));
        }
        let [x, y, z, roll, pitch, yaw] = self.numbers::<6>(pose, path, POSE)?;
        let per = if pose.attribute("degrees") == Some("true") { 1f64.to_radians() } else { 1.0 };
        let rotation = UnitQuaternion::from_euler_angles(roll * per, pitch * per, yaw * per);
        Ok(Pose::from_parts(Translation3::from(Vector3::new(x, y, z)), rotation))
    }

    fn numbers<const N: usize>(&self, node: Node, path: &str, range: Quantity) -> Result<[f64; N], InputError> {
        let text = node.text().unwrap_or_default();
        let numbers: Option<Vec<f64>> =
            text.split_whitespace().map(|it| it.parse().ok().filter(|it| range.contains(*it))).collect();
        let fault = || {
            let field = format!("{path}: {}", node.tag_name().name());
            InputError::new(self.file, field, format!("`{}`", text.trim()), format!("{N} numbers, each {range}"))
        };
        numbers.and_then(|it| it.try_into().ok()).ok_or_else(fault)
    }
}

fn children<'a>(node: Node<'a, 'a>, name: &str) -> impl Iterator<Item = Node<'a, 'a>> {
    node.children().filter(move |it| it.has_tag_name(name))
}

fn child<'a>(node: Node<'a, 'a>, name: &str) -> Option<Node<'a, 'a>> {
    node.children().find(|it| it.has_tag_name(name))
}

#[cfg(test)]
mod tests {
    use super::*;

    const CAN: &str = r#"<sdf version="1.7"><model name="can"><link name="can">
        <inertial><pose>0 0 0.01 0 0 0</pose><mass>0.3</mass><inertia><ixx>1e-3</ixx><iyy>1e-3</iyy><izz>2e-3</izz></inertia></inertial>
        <visual name="v"><pose>0 0 0.1 1.5707963 0 0</pose><geometry><mesh><uri>package://a/can.gltf</uri></mesh></geometry></visual>
        <collision name="c"><geometry><cylinder><radius>0.03</radius><length>0.1</length></cylinder></geometry>
        <surface><friction><ode><mu>0.4</mu></ode></friction></surface></collision></link></model></sdf>"#;

    #[test]
    fn a_link_is_read_with_its_mass_shapes_and_friction() {
        let description = Description::from_sdf("can.sdf", CAN).unwrap();
        let can = &description.links["can"];
        let inertia = can.inertia.unwrap();
        assert_eq!((inertia.mass, inertia.com, inertia.about_com[(2, 2)]), (0.3, Point3::new(0.0, 0.0, 0.01), 2e-3));
        assert_eq!(can.friction, Some(0.4));
        assert_eq!(can.collisions[0].shape, Shape::Cylinder { radius_m: 0.03, length_m: 0.1 });
        let mesh = Shape::Mesh { file: "package://a/can.gltf".into(), scale: Vector3::repeat(1.0) };
        assert_eq!(can.visuals[0].shape, mesh);
        assert!((can.visuals[0].X_LS * Vector3::y() - Vector3::z()).norm() < 1e-6);
    }

    #[test]
    fn faults_are_told() {
        for (from, to, expected) in [
            ("sdf", "urdf", "found <urdf>"),
            ("<mass>0.3", "<mass>heavy", "link can: inertial: mass: found `heavy`"),
            ("<radius>0.03</radius>", "", "no <radius>"),
            ("<pose>0 0 0.1 1.5707963 0 0", "<pose>0 0 0.1", "link can: visual 1: pose: found `0 0 0.1`"),
            ("package://a/can.gltf", "", "a mesh without <uri>"),
        ] {
            let fault = Description::from_sdf("can.sdf", &CAN.replace(from, to)).unwrap_err().to_string();
            assert!(fault.contains(expected), "{fault}");
        }
    }
}
