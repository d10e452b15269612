//! Bodies of objects in the paper's simulator.

use catch_body::{InputError, quantity};
use nalgebra::{Matrix3, Point3, Vector3};
use serde::Deserialize;

use super::ThrownObject;
use crate::object_shape::{ColliderPart, Load, ShapeFields, Solid};

/// Mass properties as the paper's simulator has them, whatever a body of that shape can have. Without a shape
/// of its own, points are in O: along the axes of the shape, from the centre of mass of uniform density.
#[quantity::checked(deny_unknown_fields)]
#[derive(Deserialize)]
pub(super) struct PublishedFields {
    /// Shape of the body, if it differs from the object's. Points are then in the frame of this one.
    shape: Option<ShapeFields>,
    /// Centre of mass.
    #[serde(default)]
    com_m: quantity::shape_m<[f64; 3]>,
    /// Principal moments about the centre of mass along the axes of the shape.
    inertia_kgm2: quantity::moment_kgm2<[f64; 3]>,
    /// True if the body collides as the convex hull of its surface.
    #[serde(default)]
    convex_hull: bool,
}

impl PublishedFields {
    /// The object as it is in the paper's simulator.
    pub fn of(&self, object: &ThrownObject, file: &str, load: Load) -> Result<ThrownObject, InputError> {
        let solid = self.shape.as_ref().map(|shape| shape.solid(file, object.mass_kg, load)).transpose()?;
        let to_O = solid.as_ref().map_or(Vector3::zeros(), |solid| -solid.inertia.com.coords);
        let mut published = ThrownObject {
            com_O: Point3::from(self.com_m) + to_O,
            inertia_kgm2: Matrix3::from_diagonal(&Vector3::from(self.inertia_kgm2)),
            origin_O: Point3::origin() + to_O,
            ..object.clone()
        };
        if let Some(Solid { mesh, parts, .. }) = solid {
            published.mesh = mesh.translated(&to_O);
            published.parts = parts.into_iter().map(|part| part.translated(&to_O)).collect();
        }
        if self.convex_hull {
            published.parts = vec![ColliderPart::Hull(published.mesh.vertices.clone())];
        }
        published.bounding_radius_m = published.mesh.bounding_radius();
        Ok(published)
    }
}
