//! Reads URDF files leniently: what is missing stays unknown, what is there must be right.

use nalgebra::Vector3;

use super::{Description, Geometry, JointKind, Link, Shape, TreeJoint};
use crate::{
    InputError,
    quantity::{self, Quantity},
    urdf::{self, Element, Urdf},
};

/// Numbers that some files give as zero, or without bound, where nobody knows them.
const ANY_NUMBER: Quantity = Quantity { least: -f64::MAX, most: f64::MAX, unit: "" };
/// Extents of a shape.
const EXTENT_M: Quantity = Quantity { least: 0.0, most: 10.0, unit: "m" };
/// Factors on the axes of a mesh; a mirrored one has a negative factor.
const MESH_SCALE: Quantity = Quantity { least: -1000.0, most: 1000.0, unit: "m per unit" };

impl Description {
    /// Reads a URDF file.
    ///
    /// # Errors
    /// If it is no URDF, or has elements of xacro; an element without its name, a number out of its range.
    pub fn from_urdf(file: &str, text: &str) -> Result<Self, InputError> {
        read(file, text)
    }
}

fn read(file: &str, text: &str) -> Result<Description, InputError> {
    let document = urdf::parse(file, text)?;
    let urdf = Urdf::read(file, &document)?;
    let roots = urdf.roots();
    let [root] = roots[..] else {
        let found = format!("{} links without a parent", roots.len());
        return Err(InputError::new(file, "link", found, "one base link"));
    };
    let mut description = Description {
        file: file.to_owned(),
        name: urdf.name.clone(),
        root: root.to_owned(),
        links: Default::default(),
        joints: Default::default(),
    };
    for (name, element) in urdf.links() {
        description.links.insert(name.to_owned(), link(element)?);
        let joints = urdf.joints_of(name).iter().map(|it| joint(&urdf, it)).collect::<Result<Vec<_>, _>>()?;
        if !joints.is_empty() {
            description.joints.insert(name.to_owned(), joints);
        }
    }
    Ok(description)
}

fn link(element: &Element) -> Result<Link, InputError> {
    let inertia = match element.child("inertial")? {
        Some(inertial) if weighs_something(&inertial)? => Some(inertial.inertia()?),
        _ => None,
    };
    let shapes = |name| element.children(name).map(|it| geometry(&it)).collect::<Result<Vec<_>, _>>();
    let contact = element.child("contact")?.map(|it| it.child("lateral_friction")).transpose()?.flatten();
    let friction = contact.map(|it| it.number("value", quantity::FRICTION)).transpose()?;
    Ok(Link { inertia, friction, collisions: shapes("collision")?, visuals: shapes("visual")? })
}

fn weighs_something(inertial: &Element) -> Result<bool, InputError> {
    // Frames without a body get the least mass that some simulator takes.
    Ok(inertial.required("mass")?.number("value", ANY_NUMBER)? >= quantity::PART_MASS_KG.least)
}

fn geometry(element: &Element) -> Result<Geometry, InputError> {
    let geometry = element.required("geometry")?;
    let shape = if let Some(it) = geometry.child("box")? {
        Shape::Cuboid(it.vector("size", EXTENT_M)?.into())
    } else if let Some(it) = geometry.child("cylinder")? {
        Shape::Cylinder { radius_m: it.number("radius", EXTENT_M)?, length_m: it.number("length", EXTENT_M)? }
    } else if let Some(it) = geometry.child("capsule")? {
        Shape::Capsule { radius_m: it.number("radius", EXTENT_M)?, length_m: it.number("length", EXTENT_M)? }
    } else if let Some(it) = geometry.child("sphere")? {
        Shape::Sphere(it.number("radius", EXTENT_M)?)
    } else {
        let mesh = geometry.child("mesh")?.ok_or_else(|| {
            geometry.fault("shape", "none that is known", "<box>, <cylinder>, <capsule>, <sphere> or <mesh>")
        })?;
        let scale = if mesh.has("scale") { mesh.vector("scale", MESH_SCALE)?.into() } else { Vector3::repeat(1.0) };
        Shape::Mesh { file: mesh.text("filename")?.to_owned(), scale }
    };
    Ok(Geometry { X_LS: element.origin()?, shape })
}

fn joint(urdf: &Urdf, element: &Element) -> Result<TreeJoint, InputError> {
    let child = element.required("child")?.text("link")?;
    if urdf.link(child).is_none() {
        return Err(element.fault("child link", child, "the name of a link"));
    }
    let kind = element.text("type")?;
    let limit = element.child("limit")?;
    let number = |name: &str| match &limit {
        Some(limit) if limit.has(name) => limit.number(name, ANY_NUMBER).map(Some),
        _ => Ok(None),
    };
    let range = number("lower")?.zip(number("upper")?).filter(|(lower, upper)| lower < upper);
    let dynamics = element.child("dynamics")?.filter(|it| it.has("damping"));
    Ok(TreeJoint {
        name: element.text("name")?.to_owned(),
        kind: match kind {
            "fixed" => JointKind::Fixed,
            "revolute" | "continuous" => JointKind::Revolute,
            "prismatic" => JointKind::Prismatic,
            "floating" | "planar" => JointKind::Other,
            kind => {
                return Err(element.fault("type", kind, "fixed, revolute, continuous, prismatic, floating or planar"));
            }
        },
        child: child.to_owned(),
        X_PL: element.origin()?,
        axis: if kind == "fixed" { Vector3::x_axis() } else { element.axis()? },
        range: range.filter(|_| kind != "continuous").map(|(lower, upper)| [lower, upper]),
        velocity: number("velocity")?.filter(|it| *it > 0.0),
        effort: number("effort")?.filter(|it| *it > 0.0),
        damping: dynamics.map_or(Ok(0.0), |it| it.number("damping", quantity::DAMPING_NMSPRAD))?,
        rotor_inertia: None,
        mimics: element.child("mimic")?.is_some(),
    })
}
