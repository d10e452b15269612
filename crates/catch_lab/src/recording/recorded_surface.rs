//! The surface of an object as a recording keeps it.

use catch_body::TriangleMesh;
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
    /// The surface as a mesh.
    pub fn mesh(&self) -> TriangleMesh {
        let vertices = self.vertices_m.iter().map(|&vertex| Point3::from(vertex).cast()).collect();
        TriangleMesh { vertices, triangles: self.triangles.clone() }
    }
}
