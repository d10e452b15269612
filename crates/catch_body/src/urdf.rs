//! Reads the elements and attributes of a URDF file; every fault is told with its element and attribute.

use std::{
    collections::{BTreeMap, HashSet},
    fmt::Display,
};

use nalgebra::{Matrix3, Point3, Translation3, Unit, UnitQuaternion, Vector3};

use crate::{
    InputError,
    document::{Document, Harmless, Node},
    pose::Pose,
    quantity,
    quantity::Quantity,
    robot::Inertia,
};

/// Kind of file that is expected.
const EXPECTED: &str = "a URDF description of a robot";

/// Names that only draw, simulate or drive the robot, repeat something, or that all readers of URDF pass
/// over.
pub const HARMLESS: Harmless = &[
    (
        "robot",
        "material gazebo transmission ros2_control sensor mujoco frame create parameter \
         collision_filter_group RefLink @version @xsi:schemaLocation",
    ),
    ("transmission", "* @*"),
    ("actuator", "* @*"),
    (
        "link",
        "sensor gazebo self_collision_checking collision_checking self_filter kinematic surface gravity \
         origin audio_source @type @concave",
    ),
    ("visual", "material texture meta gazebo @name @group"),
    ("collision", "material verbose contact_coefficients gazebo @name @group @concave"),
    ("contact", "* @*"),
    ("lateral_friction", "@*"),
    ("inertial", "@name"),
    ("mesh", "@name"),
    (
        "joint",
        "calibration hardwareInterface gazebo sensor traits controller_gains anchor joint_properties \
         @dont_collapse",
    ),
    ("axis", "@rpy"),
    ("geometry", "@name"),
    ("inertia", "@iyx @izx @izy"),
    ("dynamics", "@D @K @mu_coulomb @mu_viscous @friction @spring_reference @spring_stiffness"),
    ("safety_controller", "@k_position @k_velocity"),
    ("mimic", "@multiplier @offset"),
    ("limit", "@current @k_position @k_velocity"),
    (
        "*",
        "drake:proximity_properties drake:perception_properties drake:accepting_renderer drake:diffuse_map \
         drake:collision_filter_group drake:declare_convex",
    ),
];

/// Names of what `robot.toml` states in place of the URDF, and of what needs no shape beside its capsules.
pub const IN_TOML: Harmless =
    &[("link", "visual collision contact inertial"), ("joint", "limit"), ("limit", "@lower @upper @velocity @effort")];

/// Parses a URDF file; `file` names it in errors.
///
/// # Errors
/// If it is no XML, no URDF, or still has elements or expressions of xacro.
pub fn parse(file: &str, text: &str) -> Result<Document, InputError> {
    let document = Document::from_xml(file, text, EXPECTED)?;
    let root = document.root();
    if root.name() != "robot" {
        return Err(InputError::new(file, "robot", format!("<{}>", root.name()), EXPECTED));
    }
    if let Some((node, found)) = document.first_used(HARMLESS, |node| {
        let is_element = node.name().starts_with("xacro:").then(|| format!("<{}>", node.name()));
        is_element.or_else(|| node.text().contains("${").then(|| format!("`{}`", node.text())))
    }) {
        let named = if file.contains("xacro") { file } else { "FILE.urdf.xacro" };
        return Err(node.fault(found, format!("a URDF without xacro: `xacro {named} > robot.urdf` expands it")));
    }
    Ok(document)
}

/// The links and joints of a URDF file.
pub struct Urdf<'a> {
    /// Name of the robot.
    pub name: String,
    /// Links by their names.
    links: BTreeMap<&'a str, Element<'a>>,
    /// Joints by the names of their parents.
    joints: BTreeMap<&'a str, Vec<Element<'a>>>,
    /// Links that some joint moves.
    children: HashSet<&'a str>,
    transmissions: Vec<Element<'a>>,
}

impl<'a> Urdf<'a> {
    /// Reads the links and joints of a robot.
    ///
    /// # Errors
    /// An element without a name, two of one name, a joint whose parent or child is missing.
    pub fn read(document: &'a Document) -> Result<Self, InputError> {
        let (file, root) = (document.file(), document.root());
        let name = root.attribute("name").unwrap_or_default().to_owned();
        let transmissions = root.children("transmission").enumerate();
        let transmissions =
            transmissions.map(|(i, node)| Element { file, node, path: format!("transmission {}", i + 1) }).collect();
        let mut urdf =
            Self { name, links: BTreeMap::new(), joints: BTreeMap::new(), children: HashSet::new(), transmissions };
        let mut names = HashSet::new();
        for node in root.children("link").chain(root.children("joint")) {
            let kind = node.name();
            let unnamed = Element { file, node, path: kind.to_owned() };
            let name = unnamed.text("name")?;
            let element = Element { path: format!("{kind} {name}"), ..unnamed };
            if !names.insert((kind, name)) {
                return Err(InputError::new(file, element.path, "the name twice", format!("one {kind} of each name")));
            }
            if kind == "link" {
                urdf.links.insert(name, element);
            } else {
                let [parent, child] =
                    [element.required("parent")?.text("link")?, element.required("child")?.text("link")?];
                if !urdf.children.insert(child) {
                    let found = format!("the link {child}, which another joint moves, too");
                    return Err(element.fault("child", found, "a link of its own for each joint"));
                }
                urdf.joints.entry(parent).or_default().push(element);
            }
        }
        for (parent, joints) in &urdf.joints {
            for joint in joints {
                let child = joint.required("child")?.text("link")?;
                if let Some((of, missing)) =
                    [("parent", *parent), ("child", child)].into_iter().find(|it| !urdf.links.contains_key(it.1))
                {
                    return Err(joint.fault(
                        of,
                        format!("the link `{missing}`, which is not there"),
                        "the name of a link",
                    ));
                }
            }
        }
        Ok(urdf)
    }

    /// Names of the links that no joint moves.
    pub fn roots(&self) -> Vec<&'a str> {
        self.links.keys().copied().filter(|link| !self.children.contains(link)).collect()
    }

    /// All links by their names.
    pub fn links(&self) -> impl Iterator<Item = (&'a str, &Element<'a>)> {
        self.links.iter().map(|(name, element)| (*name, element))
    }

    /// The joints whose parent is `link`.
    pub fn joints_of(&self, link: &str) -> &[Element<'a>] {
        self.joints.get(link).map_or(&[], Vec::as_slice)
    }

    /// Transmissions, which drive the joints.
    pub fn transmissions(&self) -> &[Element<'a>] {
        &self.transmissions
    }

    /// The link of this name.
    pub fn link(&self, name: &str) -> Option<&Element<'a>> {
        self.links.get(name)
    }
}

/// Elements of a URDF file that say nothing to an arm of this program, by their names; `used` names those
/// that an import reads besides.
///
/// What only draws the robot is not among them, and a file that cannot be parsed has none.
pub fn ignored_elements(text: &str, used: &[&str]) -> Vec<String> {
    let Ok(document) = Document::from_xml("robot.urdf", text, EXPECTED) else { return Vec::new() };
    let read: [(&str, &[&str]); 4] = [
        ("robot", &["link", "joint", "material"]),
        ("link", &["inertial", "visual", "collision"]),
        ("joint", &["origin", "parent", "child", "axis", "limit", "dynamics"]),
        ("inertial", &["origin", "mass", "inertia"]),
    ];
    let mut ignored = Vec::new();
    let mut add = |said: String| {
        if !ignored.contains(&said) {
            ignored.push(said);
        }
    };
    let root = document.root();
    let parts = || root.children("link").chain(root.children("joint"));
    for parent in std::iter::once(root).chain(parts()).chain(parts().flat_map(|it| it.children("inertial"))) {
        let known = read.iter().find(|(name, _)| *name == parent.name()).map(|(_, known)| known);
        let unknown = known
            .into_iter()
            .flat_map(|known| parent.elements().filter(|it| !known.contains(&it.name()) && !used.contains(&it.name())));
        unknown.for_each(|node| add(format!("<{}> in <{}>", node.name(), parent.name())));
    }
    for node in document.root().descendants() {
        if node.name() == "dynamics" && node.attribute("friction").is_some_and(|it| it.parse() != Ok(0.0)) {
            add("friction of <dynamics>".to_owned());
        }
        if node.name() == "param" && node.attribute("name").is_some_and(|it| matches!(it, "min" | "max")) {
            add("min and max of <ros2_control>".to_owned());
        }
    }
    ignored
}

/// An element, and what errors call it.
#[derive(Clone)]
pub struct Element<'a> {
    file: &'a str,
    node: Node<'a>,
    path: String,
}

impl<'a> Element<'a> {
    /// A fault in an attribute or a child.
    pub fn fault(&self, part: &str, found: impl Display, expected: impl Display) -> InputError {
        let separator = if self.path.contains(": ") { " " } else { ": " };
        InputError::new(self.file, format!("{}{separator}{part}", self.path), found, expected)
    }

    fn within(&self, node: Node<'a>, name: &str) -> Self {
        let separator = if self.path.contains(": ") { " " } else { ": " };
        Self { file: self.file, node, path: format!("{}{separator}{name}", self.path) }
    }

    /// The child of this name, if there is one.
    ///
    /// # Errors
    /// If there are several.
    pub fn child(&self, name: &'static str) -> Result<Option<Self>, InputError> {
        let mut all = self.node.children(name);
        let (first, second) = (all.next(), all.next());
        if second.is_some() {
            return Err(self.fault(name, "the element twice", "it once"));
        }
        Ok(first.map(|node| self.within(node, name)))
    }

    /// The child of this name.
    ///
    /// # Errors
    /// If there is none, or several.
    pub fn required(&self, name: &'static str) -> Result<Self, InputError> {
        self.child(name)?.ok_or_else(|| self.fault(name, "nothing", format!("an element <{name}>")))
    }

    /// The children of this name.
    pub fn children(&self, name: &'static str) -> impl Iterator<Item = Self> {
        self.node.children(name).enumerate().map(move |(i, node)| self.within(node, &format!("{name} {}", i + 1)))
    }

    /// Marks the element and all within it as not used.
    pub fn leave_out(&self) {
        self.node.leave_out();
    }

    /// Returns whether there is an attribute of this name.
    pub fn has(&self, name: &'static str) -> bool {
        self.node.has(name)
    }

    /// An attribute.
    ///
    /// # Errors
    /// If it is missing.
    pub fn text(&self, name: &'static str) -> Result<&'a str, InputError> {
        self.node.attribute(name).ok_or_else(|| self.fault(name, "nothing", format!("an attribute {name}=\"…\"")))
    }

    /// An attribute that is a number, if it is there.
    ///
    /// # Errors
    /// As [`number`](Self::number).
    pub fn optional(&self, name: &'static str, range: Quantity) -> Result<Option<f64>, InputError> {
        if self.has(name) { self.number(name, range).map(Some) } else { Ok(None) }
    }

    /// An attribute that is a number.
    ///
    /// # Errors
    /// If it is missing, no number, or out of its range.
    pub fn number(&self, name: &'static str, range: Quantity) -> Result<f64, InputError> {
        let text = self.text(name)?;
        let number = text.trim().parse().ok().filter(|number| range.contains(*number));
        number.ok_or_else(|| self.fault(name, format!("`{text}`"), range))
    }

    /// An attribute that is three numbers.
    ///
    /// # Errors
    /// As [`number`](Self::number).
    pub fn vector(&self, name: &'static str, range: Quantity) -> Result<[f64; 3], InputError> {
        let text = self.text(name)?;
        let numbers: Option<Vec<f64>> = text.split_whitespace().map(|it| it.parse().ok()).collect();
        let vector = numbers.and_then(|it| <[f64; 3]>::try_from(it).ok());
        let vector = vector.filter(|it| it.iter().all(|number| range.contains(*number)));
        vector.ok_or_else(|| self.fault(name, format!("`{text}`"), format!("three numbers, each {range}")))
    }

    /// The pose in the child `<origin>`, whose offset has a range; the identity where there is none.
    ///
    /// # Errors
    /// As [`vector`](Self::vector).
    pub fn origin(&self, offset_m: Quantity) -> Result<Pose, InputError> {
        let Some(origin) = self.child("origin")? else { return Ok(Pose::identity()) };
        let or_zero =
            |name: &'static str, range| if origin.has(name) { origin.vector(name, range) } else { Ok([0.0; 3]) };
        let (xyz, [roll, pitch, yaw]) = (or_zero("xyz", offset_m)?, or_zero("rpy", quantity::ANGLE_RAD)?);
        Ok(Pose::from_parts(Translation3::from(xyz), UnitQuaternion::from_euler_angles(roll, pitch, yaw)))
    }

    /// The direction in the child `<axis>`; x where there is none.
    ///
    /// # Errors
    /// As [`vector`](Self::vector), or if it has no direction.
    pub fn axis(&self) -> Result<Unit<Vector3<f64>>, InputError> {
        let Some(axis) = self.child("axis")? else { return Ok(Vector3::x_axis()) };
        let xyz = axis.vector("xyz", quantity::COORDINATE)?;
        Unit::try_new(Vector3::from(xyz), 1e-9).ok_or_else(|| axis.fault("xyz", format!("{xyz:?}"), "a direction"))
    }

    /// The mass properties that an `<inertial>` states, in its link's frame.
    ///
    /// # Errors
    /// A value that is missing, no number or out of the ranges of a mass, a moment and an offset.
    pub fn inertia(&self, [mass_kg, moment_kgm2, offset_m]: [Quantity; 3]) -> Result<Inertia, InputError> {
        let mass = self.required("mass")?.number("value", mass_kg)?;
        let X_LC = self.origin(offset_m)?;
        let inertia = self.required("inertia")?;
        let about_com = moments(|name| inertia.number(name, moment_kgm2))?;
        Ok(Inertia { mass, com: Point3::origin(), about_com }.transformed(&X_LC))
    }
}

/// The matrix of moments of inertia, each by its name in a description, as `ixy`.
///
/// # Errors
/// Those of `moment`.
pub fn moments(moment: impl Fn(&'static str) -> Result<f64, InputError>) -> Result<Matrix3<f64>, InputError> {
    let (xx, yy, zz) = (moment("ixx")?, moment("iyy")?, moment("izz")?);
    let (xy, xz, yz) = (moment("ixy")?, moment("ixz")?, moment("iyz")?);
    Ok(Matrix3::new(xx, xy, xz, xy, yy, yz, xz, yz, zz))
}
