//! Bodies of objects in the paper's simulator.

use catch_body::{InputError, TriangleMesh, quantity};
use nalgebra::{Matrix3, Point3, Vector3};
use serde::Deserialize;

use super::ThrownObject;
use crate::object_shape::{ColliderPart, Load, ShapeFields, Solid};

/// Mass properties as the paper's simulator has them, whatever a body of that shape can have. Without a shape
/// of its own, points are in O: along the axes of the shape, from the centre of mass of uniform density.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct PublishedFields {
    /// Shape of the body, if it differs from the object's. Points are then in the frame of this one.
    shape: Option<ShapeFields>,
    /// Centre of mass.
    #[serde(default, deserialize_with = "quantity::shape_m")]
    com_m: [f64; 3],
    /// Principal moments about the centre of mass along the axes of the shape.
    #[serde(deserialize_with = "quantity::moment_kgm2")]
    inertia_kgm2: [f64; 3],
    /// The origin of its frame.
    #[serde(default, deserialize_with = "quantity::shape_m")]
    origin_m: [f64; 3],
    /// True if the body collides as the convex hull of its surface.
    #[serde(default)]
    convex_hull: bool,
}

/// Body of an object in the paper's simulator.
#[derive(Debug, Clone, PartialEq)]
pub struct PublishedBody {
    com_O: Point3<f64>,
    inertia_kgm2: Matrix3<f64>,
    origin_O: Point3<f64>,
    convex_hull: bool,
    surface: Option<(TriangleMesh, Vec<ColliderPart>)>,
}

impl PublishedFields {
    pub fn body(&self, file: &str, mass_kg: f64, load: Load) -> Result<PublishedBody, InputError> {
        let moments = self.inertia_kgm2;
        let solid = self.shape.as_ref().map(|shape| shape.solid(file, mass_kg, load)).transpose()?;
        let to_O = solid.as_ref().map_or(Vector3::zeros(), |solid| -solid.inertia.com.coords);
        Ok(PublishedBody {
            com_O: Point3::from(self.com_m) + to_O,
            inertia_kgm2: Matrix3::from_diagonal(&Vector3::from(moments)),
            origin_O: Point3::from(self.origin_m) + to_O,
            convex_hull: self.convex_hull,
            surface: solid.map(|Solid { mesh, parts, .. }| {
                (mesh.translated(&to_O), parts.into_iter().map(|part| part.translated(&to_O)).collect())
            }),
        })
    }
}

impl ThrownObject {
    /// The object as it is in the paper's simulator, `None` if its file does not say.
    pub fn as_published(&self) -> Option<Self> {
        let PublishedBody { com_O, inertia_kgm2, origin_O, convex_hull, surface } = self.published.clone()?;
        let (mesh, parts) = surface.unwrap_or_else(|| (self.mesh.clone(), self.parts.clone()));
        let parts = if convex_hull { vec![ColliderPart::Hull(mesh.vertices.clone())] } else { parts };
        let bounding_radius_m = mesh.bounding_radius();
        Some(Self { com_O, inertia_kgm2, origin_O, mesh, parts, bounding_radius_m, ..self.clone() })
    }
}
