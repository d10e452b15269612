//! Surfaces as pages carry them.

use catch_body::TriangleMesh;
use serde::Serialize;

use crate::{
    pages::packed::Packed,
    surfaces::{Part, Surface, paint::Colour},
};

/// A surface, packed; `K` says what it belongs to.
#[derive(Debug, Clone, Serialize)]
pub struct PackedSurface<K = Part> {
    of: K,
    /// The number of the arm's link whose frame it is in; the gripper's parts are in G, a finger around its
    /// own centre.
    link: usize,
    /// Where it has one of its own.
    #[serde(skip_serializing_if = "Option::is_none")]
    colour: Option<Colour>,
    positions: Packed,
    triangles: Packed,
}

impl<K> PackedSurface<K> {
    /// Packs a mesh of at most 65,536 corners, which thinned ones have.
    pub fn new(of: K, link: usize, mesh: &TriangleMesh) -> Self {
        let positions: Vec<f64> = mesh.vertices.iter().flat_map(|vertex| [vertex.x, vertex.y, vertex.z]).collect();
        let triangles = mesh.triangles.iter().flatten().map(|&vertex| vertex as u16);
        Self {
            of,
            link,
            colour: None,
            positions: Packed::numbers(&positions, 3),
            triangles: Packed::indices(triangles, 3),
        }
    }
}

impl From<Surface> for PackedSurface {
    fn from(Surface { of, link, mesh, colour }: Surface) -> Self {
        Self { colour: Some(colour), ..Self::new(of, link, &mesh) }
    }
}
