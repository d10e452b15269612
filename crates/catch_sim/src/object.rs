//! Thrown objects as they truly are. The brain's knowledge of them stands in other files, which nothing here
//! reads.

mod published;

use catch_body::{InputError, TriangleMesh, quantity, shape::Cuboid};
use nalgebra::{Matrix3, Point3};
use serde::{Deserialize, de::IgnoredAny};

use crate::{
    config::Drawn,
    object_shape::{ShapeFields, Solid},
};
pub use crate::{
    convex_parts::hull_area_m2,
    object_shape::{ColliderPart, check_length},
};
use published::PublishedFields;

/// Physical properties of an object. Its frame O has its origin at the centre of mass and the axes of its
/// file.
#[derive(Debug, Clone, PartialEq)]
pub struct ThrownObject {
    /// Name.
    pub name: String,
    /// Mass in kg.
    pub mass_kg: f64,
    /// Rotational inertia about the centre of mass, along the axes of O, in kg·m².
    pub inertia_kgm2: Matrix3<f64>,
    /// Centre of mass in O: the origin, unless it has the mass properties of the paper's simulator.
    pub com_O: Point3<f64>,
    /// The point in O that sensors and the paper's measure take for the object's place: the origin, unless it
    /// has the frame of the paper's simulator.
    pub origin_O: Point3<f64>,
    /// The object as it is in the paper's simulator, if its file says so.
    pub as_published: Option<Box<Self>>,
    /// Coefficient of restitution: speed after an impact over speed before.
    pub restitution: f64,
    /// Drag constant k of a = −k·|v|·v, in 1/m.
    pub drag_per_m: f64,
    /// Coulomb friction coefficient of its contacts, if it has one of its own; the arena's otherwise.
    pub friction: Option<Drawn>,
    /// Stiffness of its surface under a finger in N/m, if it is soft enough to matter.
    pub stiffness_npm: Option<f64>,
    /// Surface of the object in O.
    pub mesh: TriangleMesh,
    /// Convex parts in O as which it collides.
    pub parts: Vec<ColliderPart>,
    /// Radius of the ball around the centre of mass that holds the object.
    pub bounding_radius_m: f64,
}

/// Stiffness of a surface whose file names none: as in the arena's contacts, 80 N press it 0.1 mm deep.
const HARD_NPM: f64 = 8e5;
/// Radius of gyration of the thinnest needle.
const LEAST_GYRATION_M: f64 = 1e-4;

/// File of an object to throw.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct ObjectFile {
    /// Name. Results call an object by its file's name.
    name: String,
    /// True properties of the object; only the arena reads them.
    truth: TruthFields,
    /// Body of the object in the paper's simulator.
    published: Option<PublishedFields>,
    /// The brain's knowledge, where it stands in the same file.
    #[serde(rename = "known", alias = "prior")]
    _known: Option<IgnoredAny>,
}

/// Mass properties, contact and air.
#[quantity::checked(deny_unknown_fields)]
#[derive(Deserialize)]
struct TruthFields {
    /// Mass.
    mass_kg: quantity::thrown_mass_kg,
    /// Coefficient of restitution against something hard.
    restitution: quantity::fraction,
    /// Drag constant k of a = −k·|v|·v; it counts where a scenario has air.
    drag_per_m: quantity::drag_per_m,
    /// Centre of mass in the axes of the shape; that of uniform density otherwise.
    com_m: quantity::shape_m<Option<[f64; 3]>>,
    /// Inertia about the centre of mass along the axes of the shape: ixx, ixy, ixz, iyy, iyz, izz, in the
    /// order of URDF; that of uniform density otherwise.
    inertia_kgm2: quantity::inertia_kgm2<Option<[f64; 6]>>,
    /// Coulomb friction coefficient, a number or `{ min, max }` from which every throw draws; the scenario's
    /// otherwise.
    friction: quantity::friction<Option<Drawn>>,
    /// Stiffness of a soft surface under a finger, whose patch resists the rotation about the normal.
    stiffness_npm: quantity::stiffness_npm<Option<f64>>,
    /// Shape.
    shape: ShapeFields,
}

impl ThrownObject {
    /// Reads the table `[truth]` of an object's TOML file; `file` names it in errors. `load` reads a mesh
    /// file that it names.
    ///
    /// # Errors
    /// A field that is missing, misspelt or out of range.
    pub fn from_toml(
        file: &str,
        text: &str,
        load: &dyn Fn(&str) -> Result<Vec<u8>, InputError>,
    ) -> Result<Self, InputError> {
        let ObjectFile { name, truth, published, _known } = InputError::parse_toml(file, text)?;
        let mass_kg = truth.mass_kg;
        let Solid { mesh, parts, mut inertia } = truth.shape.solid(file, mass_kg, load)?;
        if let Some(com_m) = truth.com_m {
            inertia.com = checked_com(file, com_m, &mesh.aabb())?;
        }
        if let Some(moments) = truth.inertia_kgm2 {
            inertia.about_com = checked_inertia(file, moments, mass_kg, mesh.aabb().size.norm())?;
        }
        let to_com = -inertia.com.coords;
        let mesh = mesh.translated(&to_com);
        let parts = parts.into_iter().map(|part| part.translated(&to_com)).collect();
        let mut object = Self {
            name,
            mass_kg,
            inertia_kgm2: inertia.about_com,
            com_O: Point3::origin(),
            origin_O: Point3::origin(),
            as_published: None,
            restitution: truth.restitution,
            drag_per_m: truth.drag_per_m,
            friction: truth.friction,
            stiffness_npm: truth.stiffness_npm,
            bounding_radius_m: mesh.bounding_radius(),
            mesh,
            parts,
        };
        object.as_published = published.map(|it| it.of(&object, file, load).map(Box::new)).transpose()?;
        Ok(object)
    }

    /// The largest torque in N·m with which a finger that presses with `force_n` resists the object's
    /// rotation about the normal, where the object is `width_m` wide between the fingers: ⅔·μ·N·a, if the
    /// pressure on the patch is even (Howe & Cutkosky, Practical force-motion models for sliding
    /// manipulation, 1996). Where flat surfaces touch at several points, these resist, too.
    pub fn spin_friction_nm(&self, friction: f64, force_n: f64, width_m: f64) -> f64 {
        2.0 / 3.0 * friction * force_n * self.patch_radius_m(force_n, width_m)
    }

    /// Radius of the patch that is flattened by `force_n`: a surface of radius r over a = √(r·N/k) (Hertz).
    /// Half the width stands for r.
    pub fn patch_radius_m(&self, force_n: f64, width_m: f64) -> f64 {
        (width_m / 2.0 * force_n.max(0.0) / self.stiffness_npm.unwrap_or(HARD_NPM)).sqrt()
    }

    /// Volume of the convex parts over that of the mesh. Parts may overlap where they meet.
    pub fn parts_volume_ratio(&self) -> f64 {
        self.parts.iter().map(ColliderPart::volume_m3).sum::<f64>() / self.mesh.volume()
    }

    /// Volume of the mesh's convex hull over that of the mesh: how concave the object is.
    pub fn hull_volume_ratio(&self) -> f64 {
        ColliderPart::Hull(self.mesh.vertices.clone()).volume_m3() / self.mesh.volume()
    }
}

/// A centre of mass within the box around the shape.
fn checked_com(file: &str, com_m: [f64; 3], bounds: &Cuboid) -> Result<Point3<f64>, InputError> {
    let com = Point3::from(com_m);
    if (com - bounds.centre).abs().iter().zip(bounds.size.iter()).all(|(offset, size)| 2.0 * offset <= *size) {
        return Ok(com);
    }
    let [low, high] = [-0.5, 0.5].map(|side| bounds.centre + bounds.size * side);
    let expected = format!(
        "a point of the shape, between [{:.4}, {:.4}, {:.4}] and [{:.4}, {:.4}, {:.4}] m",
        low.x, low.y, low.z, high.x, high.y, high.z
    );
    Err(InputError::new(file, "truth.com_m", format!("{com_m:?}"), expected))
}

/// An inertia that a body of this mass within `length_m` can have.
fn checked_inertia(file: &str, moments: [f64; 6], mass_kg: f64, length_m: f64) -> Result<Matrix3<f64>, InputError> {
    let field = "truth.inertia_kgm2";
    let [xx, xy, xz, yy, yz, zz] = moments;
    let inertia = Matrix3::new(xx, xy, xz, xy, yy, yz, xz, yz, zz);
    let principal = inertia.symmetric_eigenvalues();
    // No moment is larger than the sum of the other two, by rounding for flat bodies.
    let is_possible = principal.min() > 0.0 && 2.0 * principal.max() <= principal.sum() * (1.0 + 1e-6);
    // All mass lies within that length of the centre of mass.
    let [least, most] = [LEAST_GYRATION_M, length_m].map(|radius_m| mass_kg * radius_m * radius_m);
    if is_possible && principal.min() >= least && principal.max() <= most {
        return Ok(inertia);
    }
    let expected = format!(
        "ixx, ixy, ixz, iyy, iyz, izz about the centre of mass: positive definite, no principal moment above the sum of the other \
         two, all from {least:.2e} to {most:.2e} kg·m² for this mass and size"
    );
    Err(InputError::new(file, field, format!("{moments:?}"), expected))
}

#[cfg(test)]
mod tests {
    use super::*;
    use approx::assert_relative_eq;
    use nalgebra::Vector3;

    const FILES: [(&str, &str); 3] = [
        ("tennis_ball", include_str!("../../../assets/objects/tennis_ball/truth.toml")),
        ("banana", include_str!("../../../assets/objects/banana/truth.toml")),
        ("pill_bottle", include_str!("../../../assets/objects/pill_bottle/truth.toml")),
    ];

    fn read(file: &str, text: &str) -> Result<ThrownObject, InputError> {
        ThrownObject::from_toml(file, text, &|name| Err(InputError::new(name, "file", "nothing", "a file")))
    }

    fn object(name: &str) -> ThrownObject {
        let (file, text) = FILES.iter().find(|(file, _)| *file == name).unwrap();
        read(file, text).unwrap()
    }

    #[test]
    fn extents_are_those_of_the_real_things() {
        for (name, extents) in [
            ("tennis_ball", [0.0672, 0.0672, 0.0672]),
            ("banana", [0.030, 0.062, 0.176]),
            ("pill_bottle", [0.0508, 0.0508, 0.0786]),
        ] {
            let size = object(name).mesh.aabb().size;
            assert!((size - Vector3::from(extents)).amax() < 3e-4, "{name}: {size}");
        }
    }

    #[test]
    fn origin_is_the_centre_of_mass_and_meshes_are_closed() {
        for (name, _) in FILES {
            let object = object(name);
            assert_eq!(object.name, name);
            assert!(object.mesh.is_closed());
            let inertia = object.mesh.mass_properties(object.mass_kg);
            assert!(inertia.com.coords.norm() < 1e-9, "{name}: {}", inertia.com);
            if name != "tennis_ball" {
                assert_relative_eq!(inertia.about_com, object.inertia_kgm2, epsilon = 1e-12);
            }
        }
    }

    #[test]
    fn convex_parts_fill_the_mesh() {
        for (name, parts) in [("tennis_ball", 1), ("banana", 9), ("pill_bottle", 2)] {
            let object = object(name);
            assert_eq!(object.parts.len(), parts, "{name}");
            for part in &object.parts {
                if let ColliderPart::Hull(points) = part {
                    assert!(points.iter().all(|point| point.coords.norm() <= object.bounding_radius_m + 1e-9));
                }
            }
        }
    }

    #[test]
    fn inertia_of_the_ball_is_that_of_a_shell() {
        let ball = object("tennis_ball");
        assert_relative_eq!(ball.inertia_kgm2[(0, 0)], 2.0 / 3.0 * 0.058 * 0.0336f64.powi(2), max_relative = 1e-12);
    }

    #[test]
    fn faults_name_file_and_field() {
        let text = FILES[1].1.replacen("mass_kg = 0.118", "mass_kg = -1.0", 1);
        let fault = read("banana.toml", &text).unwrap_err().to_string();
        assert!(fault.contains("banana.toml: truth.mass_kg"), "{fault}");
        let text = FILES[0].1.replace("restitution = 0.75", "restitution = 1.75");
        let faults = read("ball.toml", &text).unwrap_err().all();
        assert_eq!(faults.iter().map(|it| it.field.as_str()).collect::<Vec<_>>(), ["truth.restitution"]);
        // A ball of 67.2 m is one of 67.2 mm.
        let text = FILES[0].1.replace("diameter_m = 0.0672", "diameter_m = 67.2");
        let fault = read("ball.toml", &text).unwrap_err().to_string();
        assert!(fault.contains("67.200 m long") && fault.contains("scale = 0.001"), "{fault}");
    }

    #[test]
    fn a_pressed_surface_resists_rotation_a_soft_one_more() {
        let ball = object("tennis_ball");
        // √(0.0336·80/24000) = 10.6 mm; ⅔·0.667·80·0.0106 = 0.376.
        assert_relative_eq!(ball.spin_friction_nm(0.667, 80.0, 0.0672), 0.3765, epsilon = 1e-3);
        assert_eq!(ball.spin_friction_nm(0.667, 0.0, 0.0672), 0.0);
        // √(0.025·80/800000) = 1.58 mm.
        assert_relative_eq!(object("pill_bottle").spin_friction_nm(0.667, 80.0, 0.05), 0.0562, epsilon = 1e-3);
        let soft = FILES[2].1.replacen("mass_kg = 0.100", "mass_kg = 0.100\nstiffness_npm = 24000", 1);
        assert!(read("soft.toml", &soft).unwrap().spin_friction_nm(0.667, 80.0, 0.05) > 0.3);
    }

    #[test]
    fn centre_of_mass_inertia_and_friction_may_be_given() {
        let with = |lines: &str| {
            read("b.toml", &FILES[2].1.replacen("mass_kg = 0.100", &format!("mass_kg = 0.1\n{lines}"), 1))
        };
        let bottle =
            with("com_m = [0.0, 0.001, 0.03]\ninertia_kgm2 = [6e-5, 1e-6, 0, 6e-5, 0, 3e-5]\nfriction = 0.3").unwrap();
        // The bottom of the shape, at z = 0, lies 30 mm below the centre of mass.
        let low = bottle.mesh.vertices.iter().map(|vertex| vertex.z).fold(f64::INFINITY, f64::min);
        assert_relative_eq!(low, -0.03, epsilon = 1e-12);
        assert_eq!((bottle.inertia_kgm2[(0, 1)], bottle.inertia_kgm2[(1, 0)]), (1e-6, 1e-6));
        assert_eq!(bottle.friction, Some(Drawn::Always(0.3)));
        for (lines, field) in [
            ("com_m = [0.0, 0.3, 0.0]", "truth.com_m"),
            ("com_m = [nan, 0.0, 0.0]", "truth.com_m"),
            ("inertia_kgm2 = [1e-5, 0, 0, 1e-5, 0, 9e-5]", "truth.inertia_kgm2"),
            ("inertia_kgm2 = [0.16, 0, 0, 0.16, 0, 0.16]", "truth.inertia_kgm2"),
            ("inertia_kgm2 = [1e-5, 0, 0, 1e-5, 0, -1e-5]", "truth.inertia_kgm2"),
            ("inertia_kgm2 = [1e-110, 0, 0, 1e-110, 0, 1e-110]", "truth.inertia_kgm2"),
            ("friction = { min = 0.5, max = 0.4 }", "truth.friction"),
            ("friction = -0.1", "truth.friction"),
        ] {
            let fault = with(lines).unwrap_err().to_string();
            assert!(fault.starts_with(&format!("b.toml: {field}")), "{fault}");
        }
    }

    #[test]
    fn a_body_that_nearly_fills_its_hull_is_told_from_one_that_does_not() {
        for (name, hull, parts) in [("tennis_ball", 1.0, 1.0), ("pill_bottle", 1.035, 1.0), ("banana", 1.67, 1.0)] {
            let object = object(name);
            assert!((object.hull_volume_ratio() - hull).abs() < 0.02, "{name}: {}", object.hull_volume_ratio());
            assert!((object.parts_volume_ratio() - parts).abs() < 0.02, "{name}: {}", object.parts_volume_ratio());
        }
    }
}
