//! Geoms of MuJoCo's model files: shapes of bodies, and their masses.

use nalgebra::{Matrix3, Point3, Translation3, Vector3};

use super::{
    Geometry, Link, Shape,
    mjcf_reader::{FromGeoms, Placed, Reader, z_to},
};
use crate::{InputError, Pose, document::Node, quantity, robot::Inertia};

/// What a geom is filled with that says no mass.
const WATER_KGPM3: f64 = 1000.0;
/// Lengths of a geom at most, in metres.
const MOST_SIZE_M: f64 = 1e4;

impl<'a> Reader<'a> {
    /// Shapes, mass properties and friction of a body; `X_LB` is its frame in that of its last joint.
    pub(super) fn link(
        &self,
        body: Node<'a>,
        class: Option<&'a str>,
        X_LB: &Translation3<f64>,
    ) -> Result<Link, InputError> {
        let mut link = Link::default();
        let mut of_geoms = Some(Vec::new());
        for placed in self.within(body, "geom", class)? {
            let (geom, _, class) = placed;
            // Both are asked for, whatever the first one says.
            let groups = ["contype", "conaffinity"].map(|it| self.attribute(geom, class, it));
            let touches = groups.iter().any(|it| *it != Some("0"));
            let said = self.attribute(geom, class, "friction");
            let mass = self.numbers::<1>(geom, class, "mass")?.map(|[it]| it);
            let density = self.numbers::<1>(geom, class, "density")?.map_or(WATER_KGPM3, |[it]| it);
            let Some(mut geometry) = self.geometry(placed)? else { continue };
            let X_BS = geometry.X_LS;
            geometry.X_LS = X_LB * X_BS;
            match (mass_of(&geometry, mass, density), &mut of_geoms) {
                (Some(part), Some(parts)) => parts.extend((part.mass > 0.0).then_some(part)),
                _ => of_geoms = None,
            }
            if touches {
                link.collisions.push(geometry);
            } else {
                link.visuals.push(geometry);
            }
            let sliding = said.and_then(|it| it.split_whitespace().next()?.parse::<f64>().ok());
            link.friction = link.friction.or(sliding.filter(|it| quantity::FRICTION.contains(*it)));
        }
        let inertial = body.child("inertial");
        let of_geoms = of_geoms.and_then(|parts| parts.into_iter().reduce(|one, other| one.joined(&other)));
        link.inertia = match (self.masses, inertial) {
            (FromGeoms::Always, _) | (FromGeoms::WithoutInertial, None) => {
                inertial.into_iter().for_each(Node::leave_out);
                of_geoms
            }
            (_, Some(inertial)) => Some(self.inertia(inertial, X_LB)?),
            (FromGeoms::Never, None) => None,
        };
        link.inertia = link.inertia.filter(|it| it.mass >= quantity::PART_MASS_KG.least);
        Ok(link)
    }

    fn inertia(&self, inertial: Node<'a>, X_LB: &Translation3<f64>) -> Result<Inertia, InputError> {
        let mass = self.numbers::<1>(inertial, None, "mass")?.map_or(0.0, |[it]| it);
        let diagonal = self.numbers::<3>(inertial, None, "diaginertia")?;
        let full = self.numbers::<6>(inertial, None, "fullinertia")?;
        let about_com = match (full, diagonal) {
            (Some([xx, yy, zz, xy, xz, yz]), _) => Matrix3::new(xx, xy, xz, xy, yy, yz, xz, yz, zz),
            (None, Some(diagonal)) => Matrix3::from_diagonal(&Vector3::from(diagonal)),
            (None, None) => Matrix3::zeros(),
        };
        let X_LI = X_LB * self.pose(inertial, None)?;
        Ok(Inertia { mass, com: Point3::origin(), about_com }.transformed(&X_LI))
    }

    /// The shape of a geom; `None` for a plane.
    fn geometry(&self, (geom, X_BF, class): Placed<'a>) -> Result<Option<Geometry>, InputError> {
        let mesh = self.attribute(geom, class, "mesh");
        let kind = self.attribute(geom, class, "type").unwrap_or(if mesh.is_some() { "mesh" } else { "sphere" });
        if kind == "plane" {
            geom.leave_out();
            return Ok(None);
        }
        let text = self.attribute(geom, class, "size").unwrap_or_default();
        let size: Option<Vec<f64>> = text.split_whitespace().map(|it| it.parse().ok()).collect();
        let size = size.filter(|it| it.iter().all(|it| (0.0..=MOST_SIZE_M).contains(it)));
        let mut size = size.ok_or_else(|| geom.fault(format!("size=\"{text}\""), format!("0 to {MOST_SIZE_M} m")))?;
        let mut X_BS = X_BF * self.pose(geom, class)?;
        let is_long = matches!(kind, "capsule" | "cylinder" | "box" | "ellipsoid");
        if let Some([a, b, c, d, e, f]) = self.numbers::<6>(geom, class, "fromto")?.filter(|_| is_long) {
            let (from, to) = (Vector3::new(a, b, c), Vector3::new(d, e, f));
            let missing = || geom.fault("fromto with one point twice", "two points, and a size");
            let rotation = z_to(&(from - to)).filter(|_| !size.is_empty()).ok_or_else(missing)?;
            X_BS = X_BF * Pose::from_parts(Translation3::from((from + to) / 2.0), rotation);
            let half = (to - from).norm() / 2.0;
            size = if matches!(kind, "box" | "ellipsoid") { vec![size[0], size[0], half] } else { vec![size[0], half] };
        }
        if let Some(mesh) = mesh {
            return self.mesh(geom, (mesh, kind), X_BS).map(Some);
        }
        let shape = match (kind, &size[..]) {
            ("box", &[x, y, z, ..]) => Shape::Cuboid(Vector3::new(x, y, z) * 2.0),
            ("ellipsoid", &[x, y, z, ..]) => Shape::Ellipsoid(Vector3::new(x, y, z)),
            ("sphere", &[radius, ..]) => Shape::Sphere(radius),
            ("cylinder", &[radius_m, half, ..]) => Shape::Cylinder { radius_m, length_m: 2.0 * half },
            ("capsule", &[radius_m, half, ..]) => Shape::Capsule { radius_m, length_m: 2.0 * half },
            _ => {
                let expected =
                    "a box, an ellipsoid, a sphere, a cylinder or a capsule with all of its sizes, or a mesh";
                return Err(geom.fault(format!("type=\"{kind}\" size=\"{text}\""), expected));
            }
        };
        Ok(Some(Geometry { X_LS: X_BS, shape }))
    }

    fn mesh(&self, geom: Node<'a>, (name, kind): (&str, &str), X_BS: Pose) -> Result<Geometry, InputError> {
        if kind != "mesh" {
            return Err(geom.fault(format!("a {kind} around a mesh"), "the mesh, or a shape with sizes"));
        }
        let missing = || geom.fault(format!("the mesh {name}"), "the name of a mesh with a file in <asset>");
        let (asset, is_used) = self.meshes.get(name).ok_or_else(missing)?;
        is_used.set(true);
        let asset = *asset;
        let named = asset.attribute("file").ok_or_else(missing)?;
        let scale: Vector3<f64> = self.numbers::<3>(asset, None, "scale")?.unwrap_or([1.0; 3]).into();
        // A vertex v of the file is at scale · R⁻¹·(v − p).
        let p: Vector3<f64> = self.numbers::<3>(asset, None, "refpos")?.unwrap_or_default().into();
        let quat = self.numbers::<4>(asset, None, "refquat")?.unwrap_or([1.0, 0.0, 0.0, 0.0]);
        let quat = nalgebra::Quaternion::new(quat[0], quat[1], quat[2], quat[3]);
        let rotation = nalgebra::UnitQuaternion::try_new(quat, 1e-9)
            .ok_or_else(|| asset.fault("refquat of length 0", "a unit quaternion"))?
            .inverse();
        let is_uniform = scale.x == scale.y && scale.y == scale.z && scale.x > 0.0;
        if rotation.angle() > 1e-9 && !is_uniform {
            return Err(asset.fault("refquat with a scale that differs from axis to axis", "one of both"));
        }
        let X_SV = Pose::from_parts(Translation3::from(-(rotation * p).component_mul(&scale)), rotation);
        let folder = self.mesh_folder.trim_end_matches('/');
        let file = if folder.is_empty() { named.to_owned() } else { format!("{folder}/{named}") };
        Ok(Geometry { X_LS: X_BS * X_SV, shape: Shape::Mesh { file, scale } })
    }
}

/// The mass properties of a geom; a mesh that states its mass is a point, as its moments are those of a file.
/// `None` if nothing is known.
fn mass_of(geometry: &Geometry, mass: Option<f64>, density: f64) -> Option<Inertia> {
    let unit = geometry.filled(1.0);
    match (unit, mass) {
        (Some(unit), mass) if unit.mass > 0.0 => {
            let factor = mass.map_or(density, |mass| mass / unit.mass);
            Some(Inertia { mass: unit.mass * factor, about_com: unit.about_com * factor, ..unit })
        }
        (_, Some(mass)) => {
            let com = Point3::from(geometry.X_LS.translation.vector);
            Some(Inertia { mass, com, about_com: Matrix3::zeros() })
        }
        (_, None) if density == 0.0 => Some(Inertia { mass: 0.0, com: Point3::origin(), about_com: Matrix3::zeros() }),
        _ => None,
    }
}
