//! Reads surfaces from OBJ, STL, COLLADA and PLY files.

mod collada;
mod ply;

use catch_body::{
    InputError, TriangleMesh,
    mesh_file::{Soup, check_size, checked, extension, groups_of, welded},
};
use nalgebra::Point3;

pub use ply::PlyFile;
pub(crate) use ply::strip;

/// Reads a surface in the unit of its file, or in metres where that states its unit; nothing is asked of it
/// but finite vertices.
///
/// The extension of `file` says which format the bytes have: `.obj`, `.stl` or `.dae` (COLLADA).
///
/// # Errors
/// If the bytes are not a mesh of that format, or have no triangle, numbers that are not finite or indices
/// without a vertex.
pub fn surface_from_bytes(file: &str, bytes: &[u8]) -> Result<TriangleMesh, InputError> {
    check_size(file, bytes)?;
    let mut surface = TriangleMesh::default();
    for (points, faces) in checked(file, groups(file, bytes)?)? {
        surface.merge(&welded(&points, &faces, 1.0));
    }
    if surface.triangles.is_empty() {
        return Err(InputError::new(file, "faces", "no triangles", "a surface"));
    }
    Ok(surface)
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
    let groups = if extension(file) == "ply" {
        let PlyFile { vertices, triangles, .. } = PlyFile::from_bytes(file, bytes)?;
        vec![(vertices, triangles)]
    } else {
        groups(file, bytes)?
    };
    let mesh = |(vertices, triangles): Soup| TriangleMesh {
        vertices: vertices.into_iter().map(Point3::from).collect(),
        triangles,
    };
    let groups: Vec<TriangleMesh> = checked(file, groups)?.into_iter().map(mesh).collect();
    let none = groups.iter().all(|it| it.triangles.is_empty());
    if none { Err(InputError::new(file, "faces", "no triangles", "a surface")) } else { Ok(groups) }
}

/// The groups of a file of any format but PLY.
fn groups(file: &str, bytes: &[u8]) -> Result<Vec<Soup>, InputError> {
    match extension(file).as_str() {
        "dae" => Ok(vec![collada::read(file, bytes)?]),
        "obj" | "stl" => groups_of(file, bytes),
        other => Err(InputError::new(file, "extension", other, "a mesh: .obj, .stl or .dae")),
    }
}
