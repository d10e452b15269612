//! Reads URDF files leniently: what is missing stays unknown, what is there must be right.

use nalgebra::{Unit, Vector3};

use super::{Description, EXTENT_M, Geometry, JointKind, Link, MESH_SCALE, Shape, StatedLimits, TreeJoint};
use catch_body::{
    InputError,
    document::Node,
    quantity::{self, Quantity},
    urdf::{self, Urdf},
};

/// Masses and moments of whatever a file describes; what an arm can have is asked of the links that it
/// consists of.
const NOT_NEGATIVE: Quantity = Quantity { least: 0.0, most: f64::MAX, unit: "" };
/// Offsets, likewise.
const OFFSET_M: Quantity = Quantity { least: -1e4, most: 1e4, unit: "m" };

/// Turns of a motor for one of its joint; backwards is negative.
const GEAR_RATIO: Quantity = Quantity { least: -1e5, most: 1e5, unit: "" };

impl Description {
    /// Reads a URDF file.
    ///
    /// # Errors
    /// If it is no URDF, or has elements of xacro; an element without its name, a number out of its range.
    pub fn from_urdf(file: &str, text: &str) -> Result<Self, InputError> {
        let document = urdf::parse(file, text)?;
        let urdf = Urdf::read(&document)?;
        let mut description =
            Self { file: file.to_owned(), name: urdf.name.clone(), root: urdf.root.to_owned(), ..Self::default() };
        for (&name, &element) in &urdf.links {
            description.links.insert(name.to_owned(), link(element)?);
            let joints = urdf.joints_of(name).iter().map(|it| joint(*it)).collect::<Result<Vec<_>, _>>()?;
            if !joints.is_empty() {
                description.joints.insert(name.to_owned(), joints);
            }
        }
        for (joint, rotor_inertia) in rotor_inertias(&urdf)? {
            let of_joint = description.joints.values_mut().flatten().filter(|it| it.name == joint);
            of_joint.for_each(|it| it.rotor_inertia = Some(rotor_inertia));
        }
        document.finish(&[urdf::HARMLESS])?;
        Ok(description)
    }
}

/// Rotor inertias that transmissions state as Drake reads them, reflected to their joints.
fn rotor_inertias<'a>(urdf: &Urdf<'a>) -> Result<Vec<(&'a str, f64)>, InputError> {
    let mut all = Vec::new();
    for transmission in &urdf.transmissions {
        // A differential has two of both, of which only those of its maker know what moves what.
        for actuator in transmission.children("actuator") {
            let Some(rotor) = actuator.only("drake:rotor_inertia")? else { continue };
            let gear = actuator.only("drake:gear_ratio")?;
            let ratio = gear.map_or(Ok(1.0), |it| it.number_of("value", GEAR_RATIO))?;
            let joint = transmission.required("joint")?.text_of("name")?;
            all.push((joint, rotor.number_of("value", NOT_NEGATIVE)? * ratio * ratio));
        }
    }
    Ok(all)
}

fn link(element: Node) -> Result<Link, InputError> {
    let inertia = match element.only("inertial")? {
        Some(inertial) if weighs_something(inertial)? => {
            Some(urdf::inertia(inertial, [NOT_NEGATIVE, quantity::FINITE, OFFSET_M])?)
        }
        Some(nothing) => {
            nothing.leave_out();
            None
        }
        None => None,
    };
    let shapes = |name| element.children(name).map(geometry).collect::<Result<Vec<_>, _>>();
    let contact = element.only("contact")?;
    let of_contact = |name, range| -> Result<Option<f64>, InputError> {
        let stated = contact.map(|it| it.only(name)).transpose()?.flatten();
        stated.map(|it| it.number_of("value", range)).transpose()
    };
    let friction = of_contact("lateral_friction", quantity::FRICTION)?;
    let restitution = of_contact("restitution", quantity::FRACTION)?;
    let (collisions, visuals) = (shapes("collision")?, shapes("visual")?);
    Ok(Link { inertia, friction, restitution, unused: Vec::new(), collisions, visuals })
}

fn weighs_something(inertial: Node) -> Result<bool, InputError> {
    // Frames without a body get the least mass that some simulator takes.
    Ok(inertial.required("mass")?.number_of("value", NOT_NEGATIVE)? >= quantity::PART_MASS_KG.least)
}

fn geometry(element: Node) -> Result<Geometry, InputError> {
    let geometry = element.required("geometry")?;
    let shape = if let Some(it) = geometry.only("box")? {
        Shape::Cuboid(it.vector("size", EXTENT_M)?.into())
    } else if let Some(it) = geometry.only("cylinder")? {
        Shape::Cylinder { radius_m: it.number_of("radius", EXTENT_M)?, length_m: it.number_of("length", EXTENT_M)? }
    } else if let Some(it) = geometry.only("capsule")? {
        Shape::Capsule { radius_m: it.number_of("radius", EXTENT_M)?, length_m: it.number_of("length", EXTENT_M)? }
    } else if let Some(it) = geometry.only("sphere")? {
        Shape::Sphere(it.number_of("radius", EXTENT_M)?)
    } else {
        let mesh = geometry.only("mesh")?.ok_or_else(|| {
            geometry.fault_of("shape", "none that is known", "<box>, <cylinder>, <capsule>, <sphere> or <mesh>")
        })?;
        let scale = if mesh.has("scale") { mesh.vector("scale", MESH_SCALE)?.into() } else { Vector3::repeat(1.0) };
        Shape::Mesh { file: mesh.text_of("filename")?.to_owned(), scale }
    };
    Ok(Geometry { X_LS: urdf::origin(element, OFFSET_M)?, shape })
}

fn joint(element: Node) -> Result<TreeJoint, InputError> {
    let child = element.required("child")?.text_of("link")?;
    let kind = element.text_of("type")?;
    let limit = element.only("limit")?;
    let number = |name| optional(limit, name, NOT_NEGATIVE);
    let either = |one, other| Ok::<_, InputError>(number(one)?.or(number(other)?).filter(|it| *it > 0.0));
    // What may be commanded, and the speed of a gear before a spring, narrow what is stated beside them.
    let least = |one, other| {
        let stated = [number(one)?, number(other)?].into_iter().flatten().filter(|it| *it > 0.0);
        Ok::<_, InputError>(stated.reduce(f64::min))
    };
    let mimic = element.only("mimic")?;
    let [lower, upper] = range(element, kind, limit)?.map_or([None; 2], |it| it.map(Some));
    Ok(TreeJoint {
        name: element.text_of("name")?.to_owned(),
        kind: match kind {
            "fixed" => JointKind::Fixed,
            "revolute" | "continuous" => JointKind::Revolute,
            "prismatic" => JointKind::Prismatic,
            "floating" | "planar" => JointKind::Other,
            kind => {
                let expected = "fixed, revolute, continuous, prismatic, floating or planar";
                return Err(element.fault_of("type", kind, expected));
            }
        },
        child: child.to_owned(),
        X_PL: urdf::origin(element, OFFSET_M)?,
        axis: if kind == "fixed" { unused_axis(element)? } else { urdf::axis(element)? },
        limits: StatedLimits {
            lower,
            upper,
            velocity: least("velocity", "gear_velocity")?,
            acceleration: either("acceleration", "drake:acceleration")?,
            jerk: either("jerk", "drake:jerk")?,
            effort: least("effort", "command_effort")?,
        },
        damping: optional(element.only("dynamics")?, "damping", NOT_NEGATIVE)?.unwrap_or(0.0),
        rotor_inertia: None,
        mimics: mimic.map(|it| it.text_of("joint").map(str::to_owned)).transpose()?,
    })
}

fn optional(of: Option<Node>, name: &'static str, range: Quantity) -> Result<Option<f64>, InputError> {
    of.filter(|it| it.has(name)).map(|it| it.number_of(name, range)).transpose()
}

fn unused_axis(element: Node) -> Result<Unit<Vector3<f64>>, InputError> {
    if let Some(axis) = element.only("axis")? {
        axis.leave_out();
    }
    Ok(Vector3::x_axis())
}

/// The range that all bounds of a joint leave, whether or not there is anything between them; `None` if it
/// states no bound.
fn range(element: Node, kind: &str, limit: Option<Node>) -> Result<Option<[f64; 2]>, InputError> {
    let number = |of, name| optional(of, name, quantity::FINITE);
    let hard = [number(limit, "lower")?, number(limit, "upper")?];
    let safety = element.only("safety_controller")?;
    let soft = [number(safety, "soft_lower_limit")?, number(safety, "soft_upper_limit")?];
    // A bound that is left out is zero, as the format says; zero twice is what some files write for none.
    let pair = |bounds: [Option<f64>; 2]| bounds.map(|it| it.unwrap_or(0.0));
    let has_hard = limit.is_some() && (kind != "continuous" || pair(hard) != [0.0; 2]);
    let hard = Some(pair(hard)).filter(|_| has_hard && matches!(kind, "revolute" | "continuous" | "prismatic"));
    let soft = Some(pair(soft)).filter(|it| *it != [0.0; 2]);
    let all = [hard, soft].into_iter().flatten();
    Ok(all.reduce(|[a, b], [c, d]| [a.max(c), b.min(d)]))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn arm(joint: &str) -> String {
        format!(
            "<robot name=\"a\"><link name=\"l\"><!-- <xacro:if value=\"${{x}}\"> --></link><link name=\"m\"/>\
             <joint name=\"j\" {joint}<parent link=\"l\"/><child link=\"m\"/></joint></robot>"
        )
    }

    fn read_range(joint: &str) -> Option<[f64; 2]> {
        let limits = Description::from_urdf("a.urdf", &arm(joint)).unwrap().joints["l"][0].limits;
        limits.lower.zip(limits.upper).map(Into::into)
    }

    #[test]
    fn a_bound_that_is_left_out_is_zero() {
        let range = |limit: &str| read_range(&format!("type=\"revolute\"><limit {limit}/>"));
        assert_eq!(range("upper=\"1.4\""), Some([0.0, 1.4]));
        assert_eq!(range("lower=\"-1.4\""), Some([-1.4, 0.0]));
        assert_eq!(range("lower=\"2\" upper=\"-2\""), Some([2.0, -2.0]));
        assert_eq!(range("effort=\"3\""), Some([0.0, 0.0]));
        let soft = "type=\"revolute\"><limit lower=\"-2\" upper=\"2\"/><safety_controller soft_lower_limit=\"-1\" soft_upper_limit=\"3\"/>";
        assert_eq!(read_range(soft), Some([-1.0, 2.0]));
        assert_eq!(read_range("type=\"continuous\"><limit lower=\"0\" upper=\"0\" effort=\"1\"/>"), None);
        assert_eq!(read_range("type=\"continuous\"><limit lower=\"-1\" upper=\"2\"/>"), Some([-1.0, 2.0]));
    }

    /// As in the description of ANYmal B.
    #[test]
    fn limits_of_drives_narrow_those_of_their_joints() {
        let text = arm(
            "type=\"revolute\"><limit command_effort=\"40\" current=\"10\" effort=\"80\" gear_velocity=\"10\" lower=\"-9\" upper=\"9\" velocity=\"15\"/>",
        );
        let joint = &Description::from_urdf("a.urdf", &text).unwrap().joints["l"][0];
        assert_eq!((joint.limits.effort, joint.limits.velocity), (Some(40.0), Some(10.0)));
    }

    /// Rotor inertias are read as Drake reads them, among what other programs say of a transmission.
    #[test]
    fn rotor_inertias_are_reflected_to_their_joints() {
        let text = arm("type=\"revolute\"><axis xyz=\"0 0 1\"/>");
        let rotor = |rotor: &str| {
            let transmission = format!(
                "<transmission name=\"t\"><type>a</type><joint name=\"j\"/><actuator name=\"m\"><drake:rotor_inertia \
                 {rotor}/><drake:gear_ratio value=\"-50\"/></actuator></transmission></robot>"
            );
            Description::from_urdf("a.urdf", &text.replace("</robot>", &transmission))
        };
        let of = |description: Description| description.joints["l"][0].rotor_inertia;
        assert_eq!(of(rotor("value=\"4e-4\"").unwrap()), Some(4e-4 * 2500.0));
        assert_eq!(of(Description::from_urdf("a.urdf", &text).unwrap()), None);
        let fault = rotor("").unwrap_err().to_string();
        assert!(fault.contains("transmission t.actuator m.drake:rotor_inertia.value: found nothing"), "{fault}");
    }

    #[test]
    fn what_is_not_read_is_refused_with_its_place() {
        let dollar = "type=\"revolute\"><axis xyz=\"0 0 ${z}\"/>";
        let shapes = "<visual><geometry><box size=\"1 1 1\"/><sphere radius=\"1\"/></geometry></visual>";
        let two = arm("type=\"fixed\">").replace("<link name=\"m\"/>", &format!("<link name=\"m\">{shapes}</link>"));
        for (text, expected) in [
            (arm("type=\"revolute\"><limits upper=\"1\"/>"), "joint j.limits: found <limits>, which is not read"),
            (arm("type=\"revolute\"><limit uper=\"1\"/>"), "what is read in limit: acceleration"),
            (arm(dollar), "found `0 0 ${z}`, expected a URDF without xacro"),
            (arm("type=\"fixed\"><xacro:if value=\"1\"/>"), "found <xacro:if>"),
            (two, "geometry.sphere: found <sphere>"),
        ] {
            let fault = Description::from_urdf("a.urdf", &text).unwrap_err().to_string();
            assert!(fault.contains(expected), "{fault}");
        }
    }
}
