//! The surface of an object as a recording keeps it.

use catch_body::{InputError, TriangleMesh, quantity};
use nalgebra::Point3;
use serde::{Deserialize, Serialize};

/// A surface of triangles in single precision.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct RecordedSurface {
    /// Corner points in metres.
    pub vertices_m: Vec<[f32; 3]>,
    /// Three indices into them per triangle, counter-clockwise from outside.
    pub triangles: Vec<[u32; 3]>,
}

impl From<&TriangleMesh> for RecordedSurface {
    fn from(mesh: &TriangleMesh) -> Self {
        let single = |vertex: &Point3<f64>| vertex.coords.cast::<f32>().into();
        Self { vertices_m: mesh.vertices.iter().map(single).collect(), triangles: mesh.triangles.clone() }
    }
}

impl RecordedSurface {
    /// Checks the corner points, and that there are all that triangles name.
    ///
    /// # Errors
    /// The first fault, with the field of this surface in `file`.
    pub fn check(&self, file: &str, field: &str) -> Result<(), InputError> {
        for value in self.vertices_m.iter().flatten() {
            quantity::PLACE_M.check(file, format_args!("{field}.vertices_m"), f64::from(*value))?;
        }
        let count = self.vertices_m.len();
        let Some(index) = self.triangles.iter().flatten().find(|index| **index as usize >= count) else {
            return Ok(());
        };
        let (found, expected) = (format!("vertex number {index}"), format!("one of {count} vertices"));
        Err(InputError::new(file, format!("{field}.triangles"), found, expected))
    }

    /// The surface as a mesh.
    pub fn mesh(&self) -> TriangleMesh {
        let vertices = self.vertices_m.iter().map(|&vertex| Point3::from(vertex).cast()).collect();
        TriangleMesh { vertices, triangles: self.triangles.clone() }
    }
}
