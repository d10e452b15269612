//! Surfaces as pages carry them.

use catch_body::TriangleMesh;
use serde::Serialize;
use serde_json::{Value, json};

use crate::{pages::packed::Packed, surfaces::paint::Colour};

/// A surface, packed: a mesh of at most 65,536 corners, which thinned ones have. `of` says what it belongs
/// to, `colour` is for those that have one of their own.
///
/// The number `link` is that of the arm's link whose frame it is in; the gripper's parts are in G, a finger
/// around its own centre.
pub fn packed_surface(of: impl Serialize, link: usize, mesh: &TriangleMesh, colour: Option<Colour>) -> Value {
    let positions: Vec<f64> = mesh.vertices.iter().flat_map(|vertex| [vertex.x, vertex.y, vertex.z]).collect();
    let triangles = mesh.triangles.iter().flatten().map(|&vertex| vertex as u16);
    let (positions, triangles) = (Packed::numbers(&positions, 3), Packed::indices(triangles, 3));
    json!({ "of": of, "link": link, "colour": colour, "positions": positions, "triangles": triangles })
}
