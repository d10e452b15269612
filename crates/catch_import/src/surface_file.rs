//! Reads surfaces from OBJ, STL, COLLADA, PLY and glTF files.

mod collada;
mod gltf;
mod gltf_accessor;
mod ply;

use std::path::Path;

use catch_body::{
    InputError, TriangleMesh,
    mesh_file::{Soup, checked, extension, groups_of},
};
use nalgebra::Point3;

use crate::mesh_paths::resolve;
use catch_recording::bounded_file::FileKind;

pub use ply::PlyFile;

/// Files with surfaces.
pub(crate) const MESH: FileKind = FileKind::geometry("a mesh: .obj, .stl, .ply, .dae, .gltf or .glb");

/// The triangles of each group of a file, as [`triangles_from_bytes`] has them; glTF (`.gltf`, `.glb`) is
/// read as well. True beside them if they are in metres by the format.
///
/// # Errors
/// A file that cannot be read, and as [`triangles_from_bytes`].
pub(crate) fn read(path: &Path) -> Result<(Vec<TriangleMesh>, bool), InputError> {
    let (file, bytes) = (path.display().to_string(), MESH.read(path)?);
    match extension(&file).as_str() {
        "gltf" | "glb" => {
            let load = |name: &str| MESH.read(&resolve(path, name).unwrap_or_else(|| path.with_file_name(name)));
            Ok((vec![gltf::read(&file, &bytes, &load)?], true))
        }
        ending => Ok((triangles_from_bytes(&file, &bytes)?, ending == "dae")),
    }
}

/// Reads the triangles of each group of an OBJ file as they stand there, in its unit or in metres where it
/// states one: nothing is welded, nothing repaired. Other files are one group.
///
/// The extension of `file` says which format the bytes have: `.obj`, `.stl`, `.ply` or `.dae` (COLLADA). The
/// caller limits their number.
///
/// # Errors
/// If the bytes are not a mesh of that format, or have no triangle, numbers that are not finite or indices
/// without a vertex.
pub fn triangles_from_bytes(file: &str, bytes: &[u8]) -> Result<Vec<TriangleMesh>, InputError> {
    let groups = match extension(file).as_str() {
        "dae" => vec![collada::read(file, bytes)?],
        "obj" | "stl" => groups_of(file, bytes)?,
        "ply" => {
            let PlyFile { vertices, triangles, .. } = PlyFile::from_bytes(file, bytes)?;
            vec![(vertices, triangles)]
        }
        other => return Err(InputError::new(file, "extension", format!("`{other}`"), MESH.expected)),
    };
    let mesh = |(vertices, triangles): Soup| TriangleMesh {
        vertices: vertices.into_iter().map(Point3::from).collect(),
        triangles,
    };
    let groups: Vec<TriangleMesh> = checked(file, groups)?.into_iter().map(mesh).collect();
    let none = groups.iter().all(|it| it.triangles.is_empty());
    if none { Err(InputError::new(file, "faces", "no triangles", "a surface")) } else { Ok(groups) }
}
