//! The surface of an object as a recording keeps it.

use catch_body::{TriangleMesh, quantity};
use nalgebra::Point3;
use serde::{Deserialize, Serialize};

/// A surface of triangles in single precision.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(try_from = "SurfaceFields")]
pub struct RecordedSurface {
    /// Corner points in metres.
    pub vertices_m: Vec<[f32; 3]>,
    /// Three indices into them per triangle, counter-clockwise from outside.
    pub triangles: Vec<[u32; 3]>,
}

/// Fields of a surface before they are checked.
#[derive(Deserialize)]
struct SurfaceFields {
    vertices_m: Vec<[f32; 3]>,
    triangles: Vec<[u32; 3]>,
}

impl TryFrom<SurfaceFields> for RecordedSurface {
    type Error = String;

    fn try_from(SurfaceFields { vertices_m, triangles }: SurfaceFields) -> Result<Self, String> {
        let range = quantity::PLACE_M;
        if let Some(value) = vertices_m.iter().flatten().find(|value| !range.contains(f64::from(**value))) {
            return Err(format!("found a vertex at {value} m, expected {range}"));
        }
        match triangles.iter().flatten().find(|index| **index as usize >= vertices_m.len()) {
            Some(index) => Err(format!("found vertex number {index}, expected one of {} vertices", vertices_m.len())),
            None => Ok(Self { vertices_m, triangles }),
        }
    }
}

impl From<&TriangleMesh> for RecordedSurface {
    fn from(mesh: &TriangleMesh) -> Self {
        let single = |vertex: &Point3<f64>| vertex.coords.cast::<f32>().into();
        Self { vertices_m: mesh.vertices.iter().map(single).collect(), triangles: mesh.triangles.clone() }
    }
}

impl RecordedSurface {
    /// The surface as a mesh.
    pub fn mesh(&self) -> TriangleMesh {
        let vertices = self.vertices_m.iter().map(|&vertex| Point3::from(vertex).cast()).collect();
        TriangleMesh { vertices, triangles: self.triangles.clone() }
    }
}
