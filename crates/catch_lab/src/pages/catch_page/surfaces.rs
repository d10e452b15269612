//! Surfaces as the page carries them.

use serde::Serialize;

use crate::{
    pages::packed::Packed,
    recording::surfaces::{Part, Surface},
};

/// A surface, packed.
#[derive(Debug, Clone, Serialize)]
pub struct PackedSurface {
    of: Part,
    /// The number of the arm's link whose frame it is in; the gripper's parts are in G, a finger around its own centre.
    link: usize,
    positions: Packed,
    triangles: Packed,
}

impl From<Surface> for PackedSurface {
    fn from(Surface { of, link, mesh }: Surface) -> Self {
        let positions: Vec<f64> = mesh.vertices.iter().flat_map(|vertex| [vertex.x, vertex.y, vertex.z]).collect();
        // Thinned meshes have fewer corners than 65,536.
        let triangles = mesh.triangles.iter().flatten().map(|&vertex| vertex as u16);
        Self { of, link, positions: Packed::numbers(&positions, 3), triangles: Packed::indices(triangles, 3) }
    }
}
