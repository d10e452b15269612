//! Reads surfaces from OBJ, STL, COLLADA, PLY and glTF files.

mod collada;
mod gltf;
mod gltf_accessor;
mod ply;

use std::path::Path;

use catch_body::{
    InputError, TriangleMesh,
    document::Node,
    mesh_file::{MOST_TRIANGLES, checked, extension, groups_of},
    quantity::Quantity,
};
use nalgebra::Matrix4;

use crate::mesh_paths::resolve;
use catch_recording::bounded_file::FileKind;

pub use ply::PlyFile;
pub(crate) use ply::{Element, Property};

/// Files with surfaces.
pub(crate) const MESH: FileKind = FileKind::geometry("a mesh: .obj, .stl, .ply, .dae, .gltf or .glb");

/// Nodes of a scene may be nested this deep.
const DEEPEST: usize = 64;
/// Nodes of a scene, instances counted each time.
const MOST_VISITS: usize = 10_000;
/// Numbers of transformations and places.
const NUMBER: Quantity = Quantity { least: -1e12, most: 1e12, unit: "" };

/// The triangles of each group of an OBJ file as they stand there, in its unit or in metres where the format
/// states one: nothing is welded, nothing repaired. Other files are one group. True beside them if they are
/// in metres by the format.
///
/// # Errors
/// If the file cannot be read, is no mesh of the format that its extension says, or has no triangle, numbers
/// that are not finite or indices without a vertex.
pub(crate) fn read(path: &Path) -> Result<(Vec<TriangleMesh>, bool), InputError> {
    let (file, bytes) = (path.display().to_string(), MESH.read(path)?);
    let load = |name: &str| MESH.read(&resolve(path, name).unwrap_or_else(|| path.with_file_name(name)));
    let (groups, in_metres) = match extension(&file).as_str() {
        "gltf" | "glb" => (vec![gltf::read(&file, &bytes, &load)?], true),
        "dae" => (vec![collada::read(&file, &bytes)?], true),
        "obj" | "stl" => (groups_of(&file, &bytes)?, false),
        "ply" => (vec![PlyFile::from_bytes(&file, &bytes)?.mesh], false),
        other => return Err(InputError::new(&file, "extension", format!("`{other}`"), MESH.expected)),
    };
    let groups = checked(&file, groups)?;
    let none = groups.iter().all(|it| it.triangles.is_empty());
    if none { Err(InputError::new(&file, "faces", "no triangles", "a surface")) } else { Ok((groups, in_metres)) }
}

/// The surface that the nodes of a scene show.
#[derive(Default)]
struct Scene {
    shown: TriangleMesh,
    visits: usize,
}

impl Scene {
    /// Counts a node that is nested `depth` deep.
    ///
    /// # Errors
    /// If it is one of too many.
    fn visit(&mut self, node: Node, depth: usize) -> Result<(), InputError> {
        self.visits += 1;
        if depth <= DEEPEST && self.visits <= MOST_VISITS {
            return Ok(());
        }
        let expected = format!("at most {MOST_VISITS}, nested at most {DEEPEST} deep");
        Err(node.fault("nodes without end", expected))
    }

    /// Adds a surface, which `of` describes, where a node places it.
    ///
    /// # Errors
    /// If there are too many triangles then.
    fn add(&mut self, surface: &TriangleMesh, X_WS: &Matrix4<f64>, of: Node) -> Result<(), InputError> {
        if self.shown.triangles.len() + surface.triangles.len() > MOST_TRIANGLES {
            return Err(of.fault("more triangles in all that is shown", format!("at most {MOST_TRIANGLES}")));
        }
        let first = self.shown.vertices.len();
        self.shown.merge(surface);
        self.shown.vertices[first..].iter_mut().for_each(|it| *it = X_WS.transform_point(it));
        Ok(())
    }
}
