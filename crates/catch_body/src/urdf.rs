//! Reads the elements and attributes of a URDF file; every fault is told with its element and attribute.

use std::{
    collections::{BTreeMap, HashSet},
    fmt::Display,
};

use nalgebra::{Matrix3, Point3, Translation3, Unit, UnitQuaternion, Vector3};
use roxmltree::{Document, Node, ParsingOptions};

use crate::{InputError, pose::Pose, quantity, quantity::Quantity, robot::Inertia};

/// Elements and attributes of a URDF file at most.
const MOST_NODES: u32 = 1_000_000;

/// What a file should be.
const EXPECTED: &str = "a URDF description of a robot";

/// Parses a URDF file; `file` names it in errors.
///
/// # Errors
/// If it is no XML, or has elements of xacro.
pub(crate) fn parse<'a>(file: &str, text: &'a str) -> Result<Document<'a>, InputError> {
    if text.contains("<xacro:") || text.contains("${") {
        let found = if text.contains("<xacro:") { "`<xacro:`" } else { "`${`" };
        let named = if file.contains("xacro") { file } else { "FILE.urdf.xacro" };
        let expected = format!("a URDF without xacro: `xacro {named} > robot.urdf` expands it");
        return Err(InputError::new(file, "robot", found, expected));
    }
    let options = ParsingOptions { nodes_limit: MOST_NODES, ..ParsingOptions::default() };
    Document::parse_with_options(text, options).map_err(|fault| InputError::new(file, "robot", fault, EXPECTED))
}

/// The links and joints of a URDF file.
pub(crate) struct Urdf<'a> {
    /// Name of the robot.
    pub name: String,
    /// By name.
    links: BTreeMap<&'a str, Element<'a>>,
    /// By the names of their parents.
    joints: BTreeMap<&'a str, Vec<Element<'a>>>,
    /// Links that some joint moves.
    children: HashSet<&'a str>,
}

impl<'a> Urdf<'a> {
    /// Reads the links and joints of a robot.
    ///
    /// # Errors
    /// An element without a name, two of one name, a joint without a parent or a child.
    pub fn read(file: &'a str, document: &'a Document<'a>) -> Result<Self, InputError> {
        let root = document.root_element();
        if !root.has_tag_name("robot") {
            let found = format!("<{}>", root.tag_name().name());
            return Err(InputError::new(file, "robot", found, EXPECTED));
        }
        let name = root.attribute("name").unwrap_or_default().to_owned();
        let mut urdf = Self { name, links: BTreeMap::new(), joints: BTreeMap::new(), children: HashSet::new() };
        let mut names = HashSet::new();
        for node in root.children().filter(|it| it.has_tag_name("link") || it.has_tag_name("joint")) {
            let kind = node.tag_name().name();
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

    /// The link of this name.
    pub fn link(&self, name: &str) -> Option<&Element<'a>> {
        self.links.get(name)
    }
}

/// Elements of a URDF file that say nothing to this program, by their names.
///
/// What only draws the robot is not among them, and a file that cannot be parsed has none.
pub fn ignored_elements(text: &str) -> Vec<String> {
    let options = ParsingOptions { nodes_limit: MOST_NODES, ..ParsingOptions::default() };
    let Ok(document) = Document::parse_with_options(text, options) else { return Vec::new() };
    let read: [(&str, &[&str]); 4] = [
        ("robot", &["link", "joint", "material"]),
        ("link", &["inertial", "visual", "collision"]),
        ("joint", &["origin", "parent", "child", "axis", "limit", "dynamics"]),
        ("inertial", &["origin", "mass", "inertia"]),
    ];
    let mut ignored = Vec::new();
    for (parent, known) in read {
        let parents = document.descendants().filter(|it| it.has_tag_name(parent));
        for node in parents.flat_map(|it| it.children()).filter(Node::is_element) {
            let name = node.tag_name().name();
            let said = format!("<{name}> in <{parent}>");
            if !known.contains(&name) && !ignored.contains(&said) {
                ignored.push(said);
            }
        }
    }
    if document.descendants().any(|it| it.has_tag_name("dynamics") && it.attribute("friction").is_some()) {
        ignored.push("friction of <dynamics>".to_owned());
    }
    ignored
}

/// An element, and what errors call it.
#[derive(Clone)]
pub(crate) struct Element<'a> {
    file: &'a str,
    node: Node<'a, 'a>,
    path: String,
}

impl<'a> Element<'a> {
    /// A fault in an attribute or a child.
    pub fn fault(&self, part: &str, found: impl Display, expected: impl Display) -> InputError {
        let separator = if self.path.contains(": ") { " " } else { ": " };
        InputError::new(self.file, format!("{}{separator}{part}", self.path), found, expected)
    }

    /// The child of this name, if there is one.
    ///
    /// # Errors
    /// If there are several.
    pub fn child(&self, name: &str) -> Result<Option<Self>, InputError> {
        let mut all = self.node.children().filter(|it| it.has_tag_name(name));
        let (first, second) = (all.next(), all.next());
        if second.is_some() {
            return Err(self.fault(name, "the element twice", "it once"));
        }
        let separator = if self.path.contains(": ") { " " } else { ": " };
        Ok(first.map(|node| Self { file: self.file, node, path: format!("{}{separator}{name}", self.path) }))
    }

    /// The child of this name.
    ///
    /// # Errors
    /// If there is none, or several.
    pub fn required(&self, name: &str) -> Result<Self, InputError> {
        self.child(name)?.ok_or_else(|| self.fault(name, "nothing", format!("an element <{name}>")))
    }

    /// The children of this name.
    pub fn children(&self, name: &str) -> impl Iterator<Item = Self> {
        let separator = if self.path.contains(": ") { " " } else { ": " };
        let path = format!("{}{separator}{name}", self.path);
        let all = self.node.children().filter(move |it| it.has_tag_name(name));
        all.enumerate().map(move |(i, node)| Self { file: self.file, node, path: format!("{path} {}", i + 1) })
    }

    /// Whether there is an attribute of this name.
    pub fn has(&self, name: &str) -> bool {
        self.node.attribute(name).is_some()
    }

    /// An attribute.
    ///
    /// # Errors
    /// If it is missing.
    pub fn text(&self, name: &str) -> Result<&'a str, InputError> {
        self.node.attribute(name).ok_or_else(|| self.fault(name, "nothing", format!("an attribute {name}=\"…\"")))
    }

    /// An attribute that is a number.
    ///
    /// # Errors
    /// If it is missing, no number, or out of its range.
    pub fn number(&self, name: &str, range: Quantity) -> Result<f64, InputError> {
        let text = self.text(name)?;
        let number = text.trim().parse().ok().filter(|number| range.contains(*number));
        number.ok_or_else(|| self.fault(name, format!("`{text}`"), range))
    }

    /// An attribute that is three numbers.
    ///
    /// # Errors
    /// As [`number`](Self::number).
    pub fn vector(&self, name: &str, range: Quantity) -> Result<[f64; 3], InputError> {
        let text = self.text(name)?;
        let numbers: Option<Vec<f64>> = text.split_whitespace().map(|it| it.parse().ok()).collect();
        let vector = numbers.and_then(|it| <[f64; 3]>::try_from(it).ok());
        let vector = vector.filter(|it| it.iter().all(|number| range.contains(*number)));
        vector.ok_or_else(|| self.fault(name, format!("`{text}`"), format!("three numbers, each {range}")))
    }

    /// The pose in the child `<origin>`; the identity where there is none.
    ///
    /// # Errors
    /// As [`vector`](Self::vector).
    pub fn origin(&self) -> Result<Pose, InputError> {
        let Some(origin) = self.child("origin")? else { return Ok(Pose::identity()) };
        let or_zero = |name: &str, range| if origin.has(name) { origin.vector(name, range) } else { Ok([0.0; 3]) };
        let (xyz, [roll, pitch, yaw]) = (or_zero("xyz", quantity::OFFSET_M)?, or_zero("rpy", quantity::ANGLE_RAD)?);
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
    /// What is missing, no number or out of its range.
    pub fn inertia(&self) -> Result<Inertia, InputError> {
        let mass = self.required("mass")?.number("value", quantity::PART_MASS_KG)?;
        let X_LC = self.origin()?;
        let inertia = self.required("inertia")?;
        let moment = |name: &str| inertia.number(name, quantity::INERTIA_KGM2);
        let (xx, yy, zz) = (moment("ixx")?, moment("iyy")?, moment("izz")?);
        let (xy, xz, yz) = (moment("ixy")?, moment("ixz")?, moment("iyz")?);
        let about_com = Matrix3::new(xx, xy, xz, xy, yy, yz, xz, yz, zz);
        Ok(Inertia { mass, com: Point3::origin(), about_com }.transformed(&X_LC))
    }
}
