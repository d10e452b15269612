//! Thrown objects: what they truly are, and what the brain is told of them.

use std::ops::RangeInclusive;

use catch_body::{InputError, TriangleMesh};
use nalgebra::{Matrix3, Vector3};
use serde::Deserialize;

use crate::object_shape::{ColliderPart, ShapeFields, Solid};

/// What an object is like. Its frame O has its origin at the centre of mass and the axes of its file.
#[derive(Debug, Clone, PartialEq)]
pub struct ThrownObject {
    /// Name.
    pub name: String,
    /// Mass in kg.
    pub mass_kg: f64,
    /// Rotational inertia about the centre of mass, along the axes of O, in kg·m².
    pub inertia_kgm2: Matrix3<f64>,
    /// Coefficient of restitution: speed after an impact over speed before.
    pub restitution: f64,
    /// Drag constant k of a = −k·|v|·v, in 1/m.
    pub drag_per_m: f64,
    /// Stiffness of its surface under a finger in N/m, if it is soft enough to matter.
    pub stiffness_npm: Option<f64>,
    /// Its surface in O.
    pub mesh: TriangleMesh,
    /// Convex parts in O that make up the solid.
    pub parts: Vec<ColliderPart>,
    /// Radius of the ball around the centre of mass that holds the object.
    pub bounding_radius_m: f64,
    /// What the brain is told beforehand, besides a scan.
    pub prior: ObjectPrior,
}

/// What is known of an object's flight before it is thrown.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ObjectPrior {
    /// Expected drag constant k of a = −k·|v|·v, in 1/m.
    pub drag_per_m: f64,
    /// Its standard deviation.
    pub drag_sd_per_m: f64,
    /// Expected coefficient of restitution against the gripper, 0 to 1, if anything is known of it.
    pub restitution: Option<f64>,
}

/// How long something may be that is thrown: what is outside comes from a file in other units.
const LENGTHS_M: RangeInclusive<f64> = 0.005..=0.5;
/// How heavy it may be, likewise.
const MASSES_KG: RangeInclusive<f64> = 0.001..=5.0;

/// Whether a shape is as long as something that is thrown; `advice` says what to do if it is in millimetres.
///
/// # Errors
/// If it is not.
pub fn check_length(file: &str, field: &str, length_m: f64, advice: &str) -> Result<(), InputError> {
    if LENGTHS_M.contains(&length_m) {
        return Ok(());
    }
    let advice = if length_m > *LENGTHS_M.end() { format!("; {advice}") } else { String::new() };
    let expected = format!("{} m to {} m{advice}", LENGTHS_M.start(), LENGTHS_M.end());
    let digits = if length_m < 1e-3 { 6 } else { 3 };
    Err(InputError::new(file, field, format!("something {length_m:.digits$} m long"), expected))
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct ObjectFile {
    name: String,
    truth: TruthFields,
    prior: ObjectPrior,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct TruthFields {
    mass_kg: f64,
    restitution: f64,
    drag_per_m: f64,
    stiffness_npm: Option<f64>,
    shape: ShapeFields,
}

impl ThrownObject {
    /// Reads an object's TOML file; `file` names it in errors. `load` reads a mesh file that it names.
    ///
    /// # Errors
    /// A field that is missing, misspelt or out of range.
    pub fn from_toml(
        file: &str,
        text: &str,
        load: &dyn Fn(&str) -> Result<Vec<u8>, InputError>,
    ) -> Result<Self, InputError> {
        let ObjectFile { name, truth, prior } = InputError::parse_toml(file, text)?;
        let mass_kg = truth.mass_kg;
        let within = |field: &str, value: f64, range: &RangeInclusive<f64>, expected: &str| {
            let fault = || InputError::new(file, field, value, expected);
            if range.contains(&value) { Ok(()) } else { Err(fault()) }
        };
        let (share, not_negative) = (0.0..=1.0, 0.0..=f64::MAX);
        let masses = format!("{} to {}, in kilogrammes", MASSES_KG.start(), MASSES_KG.end());
        InputError::first_of([
            within("truth.mass_kg", mass_kg, &MASSES_KG, &masses),
            within("truth.restitution", truth.restitution, &share, "0 to 1"),
            within("prior.restitution", prior.restitution.unwrap_or_default(), &share, "0 to 1"),
            within("truth.drag_per_m", truth.drag_per_m, &not_negative, "zero or more"),
            within("prior.drag_per_m", prior.drag_per_m, &not_negative, "zero or more"),
            within("prior.drag_sd_per_m", prior.drag_sd_per_m, &not_negative, "zero or more"),
            InputError::positive(file, "truth.stiffness_npm", truth.stiffness_npm.unwrap_or(1.0)).map(drop),
        ])?;
        let Solid { mesh, parts, inertia } = truth.shape.solid(file, mass_kg, load)?;
        let advice = "a mesh in millimetres needs `scale = 0.001`";
        check_length(file, "truth.shape", mesh.aabb().size.max(), advice)?;
        let to_com = -inertia.com.coords;
        let mesh = mesh.translated(&to_com);
        let parts = parts.into_iter().map(|part| part.translated(&to_com)).collect();
        Ok(Self {
            name,
            mass_kg,
            inertia_kgm2: inertia.about_com,
            restitution: truth.restitution,
            drag_per_m: truth.drag_per_m,
            stiffness_npm: truth.stiffness_npm,
            bounding_radius_m: mesh.bounding_radius(),
            mesh,
            parts,
            prior,
        })
    }

    /// The largest torque in N·m with which a finger that presses with `force_n` resists the object's turning about the normal.
    ///
    /// The engine finds several points of contact on flat surfaces, but one on a ball, which resists nothing. A soft ball is
    /// flattened by N/k over a patch of radius a = √(r·N/k) (Hertz), which resists up to ⅔·μ·N·a if the pressure is even (Howe &
    /// Cutkosky, Practical force-motion models for sliding manipulation, 1996).
    pub fn spin_friction_nm(&self, friction: f64, force_n: f64) -> f64 {
        let (Some(stiffness_npm), [ColliderPart::Ball { radius_m, .. }]) = (self.stiffness_npm, &self.parts[..]) else {
            return 0.0;
        };
        2.0 / 3.0 * friction * force_n * (radius_m * force_n.max(0.0) / stiffness_npm).sqrt()
    }
}

impl ColliderPart {
    fn translated(self, offset: &Vector3<f64>) -> Self {
        match self {
            Self::Ball { centre, radius_m } => Self::Ball { centre: centre + offset, radius_m },
            Self::Hull(points) => Self::Hull(points.into_iter().map(|point| point + offset).collect()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use approx::assert_relative_eq;

    const FILES: [(&str, &str); 3] = [
        ("tennis_ball", include_str!("../../../assets/objects/tennis_ball.toml")),
        ("banana", include_str!("../../../assets/objects/banana.toml")),
        ("pill_bottle", include_str!("../../../assets/objects/pill_bottle.toml")),
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
        let text = FILES[1].1.replace("mass_kg = 0.118", "mass_kg = -1.0");
        let fault = read("banana.toml", &text).unwrap_err().to_string();
        assert!(fault.contains("banana.toml: truth.mass_kg"), "{fault}");
        let text = FILES[0].1.replace("restitution = 0.75", "restitution = 1.75");
        assert!(read("ball.toml", &text).unwrap_err().to_string().contains("truth.restitution"));
        // A ball of 67.2 m is one of 67.2 mm.
        let text = FILES[0].1.replace("diameter_m = 0.0672", "diameter_m = 67.2");
        let fault = read("ball.toml", &text).unwrap_err().to_string();
        assert!(fault.contains("67.200 m long") && fault.contains("scale = 0.001"), "{fault}");
    }

    #[test]
    fn a_pressed_ball_resists_turning_and_what_has_edges_is_left_to_the_engine() {
        let object = |name: &str| {
            let (name, text) = FILES.iter().find(|file| file.0 == name).unwrap();
            ThrownObject::from_toml(name, text, &|_| unreachable!()).unwrap()
        };
        let ball = object("tennis_ball");
        // √(0.0336·80/24000) = 10.6 mm; ⅔·0.667·80·0.0106 = 0.376.
        assert_relative_eq!(ball.spin_friction_nm(0.667, 80.0), 0.3765, epsilon = 1e-3);
        assert_eq!(ball.spin_friction_nm(0.667, 0.0), 0.0);
        assert_eq!(object("pill_bottle").spin_friction_nm(0.667, 80.0), 0.0);
    }
}
