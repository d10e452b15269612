//! Reads the elements and attributes of a URDF file; every fault is told with its element and attribute.

use std::collections::{BTreeMap, HashSet};

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
    /// The link that no joint moves.
    pub root: &'a str,
    /// Links by their names.
    pub links: BTreeMap<&'a str, Node<'a>>,
    /// Joints by the names of their parents.
    joints: BTreeMap<&'a str, Vec<Node<'a>>>,
    /// Transmissions, which drive the joints.
    pub transmissions: Vec<Node<'a>>,
}

impl<'a> Urdf<'a> {
    /// Reads the links and joints of a robot.
    ///
    /// # Errors
    /// An element without a name, two of one name, a joint whose parent or child is missing, several links
    /// that no joint moves.
    pub fn read(document: &'a Document) -> Result<Self, InputError> {
        let robot = document.root();
        let (mut links, mut joints) = (BTreeMap::new(), BTreeMap::<&str, Vec<Node>>::new());
        let (mut names, mut children) = (HashSet::new(), HashSet::new());
        for node in robot.children("link").chain(robot.children("joint")) {
            let (kind, name) = (node.name(), node.text_of("name")?);
            if !names.insert((kind, name)) {
                return Err(node.fault("the name twice", format!("one {kind} of each name")));
            }
            if kind == "link" {
                links.insert(name, node);
                continue;
            }
            let [parent, child] = [node.required("parent")?.text_of("link")?, node.required("child")?.text_of("link")?];
            for (of, link) in [("parent", parent), ("child", child)] {
                if !links.contains_key(link) {
                    let found = format!("the link `{link}`, which is not there");
                    return Err(node.fault_of(of, found, "the name of a link"));
                }
            }
            if !children.insert(child) {
                let found = format!("the link {child}, which another joint moves, too");
                return Err(node.fault_of("child", found, "a link of its own for each joint"));
            }
            joints.entry(parent).or_default().push(node);
        }
        let roots: Vec<&str> = links.keys().copied().filter(|link| !children.contains(link)).collect();
        let [root] = roots[..] else {
            let found = format!("{} links without a parent", roots.len());
            return Err(InputError::new(document.file(), "link", found, "one base link"));
        };
        let name = robot.attribute("name").unwrap_or_default().to_owned();
        Ok(Self { name, root, links, joints, transmissions: robot.children("transmission").collect() })
    }

    /// The joints whose parent is `link`.
    pub fn joints_of(&self, link: &str) -> &[Node<'a>] {
        self.joints.get(link).map_or(&[], Vec::as_slice)
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

/// The pose in the child `<origin>`, whose offset has a range; the identity where there is none.
///
/// # Errors
/// Numbers that are none or out of their ranges.
pub fn origin(element: Node, offset_m: Quantity) -> Result<Pose, InputError> {
    let Some(origin) = element.only("origin")? else { return Ok(Pose::identity()) };
    let or_zero = |name: &'static str, range| if origin.has(name) { origin.vector(name, range) } else { Ok([0.0; 3]) };
    let (xyz, [roll, pitch, yaw]) = (or_zero("xyz", offset_m)?, or_zero("rpy", quantity::ANGLE_RAD)?);
    Ok(Pose::from_parts(Translation3::from(xyz), UnitQuaternion::from_euler_angles(roll, pitch, yaw)))
}

/// The direction in the child `<axis>`; x where there is none.
///
/// # Errors
/// As [`origin`], or if it has no direction.
pub fn axis(element: Node) -> Result<Unit<Vector3<f64>>, InputError> {
    let Some(axis) = element.only("axis")? else { return Ok(Vector3::x_axis()) };
    let xyz = axis.vector("xyz", quantity::COORDINATE)?;
    Unit::try_new(Vector3::from(xyz), 1e-9).ok_or_else(|| axis.fault_of("xyz", format!("{xyz:?}"), "a direction"))
}

/// The mass properties that an `<inertial>` states, in its link's frame.
///
/// # Errors
/// A value that is missing, no number or out of the ranges of a mass, a moment and an offset.
pub fn inertia(inertial: Node, [mass_kg, moment_kgm2, offset_m]: [Quantity; 3]) -> Result<Inertia, InputError> {
    let mass = inertial.required("mass")?.number_of("value", mass_kg)?;
    let X_LC = origin(inertial, offset_m)?;
    let inertia = inertial.required("inertia")?;
    let about_com = moments(|name| inertia.number_of(name, moment_kgm2))?;
    Ok(Inertia { mass, com: Point3::origin(), about_com }.transformed(&X_LC))
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
