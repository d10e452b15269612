//! Reads meshes from OBJ and STL files, and writes OBJ.

mod obj;
mod stl;

use std::fmt::Write;

use nalgebra::Point3;

use crate::{InputError, mesh::TriangleMesh, quantity};

/// Triangles of a file at most, instances counted each time, and of all files of one thing: a scan of a
/// thrown object has some 100,000.
pub const MOST_TRIANGLES: usize = 1_500_000;

/// The thinnest solid that is accepted: its volume as a fraction of the cube of its longest side.
const LEAST_FILLING: f64 = 1e-9;

/// Reads a closed solid; the extension of `file` (`.obj` or `.stl`) says which format the bytes have, `scale`
/// turns the file's unit of length into metres.
///
/// Vertices at the same place become one and triangles without area are left out, so that neighbours share
/// their edges. A solid that is turned inside out is turned back.
///
/// # Errors
/// If the bytes are not a mesh of that format, or the mesh has no triangles, numbers that are not finite,
/// indices without a vertex, holes, or no volume.
pub fn mesh_from_bytes(file: &str, bytes: &[u8], scale: f64) -> Result<TriangleMesh, InputError> {
    solid(file, surface_from_bytes(file, bytes, scale)?)
}

/// Reads a surface as [`mesh_from_bytes`] reads a solid; it may be open and face anywhere.
///
/// # Errors
/// If the bytes are not a mesh of that format, or numbers are not finite, or indices without a vertex.
pub fn surface_from_bytes(file: &str, bytes: &[u8], scale: f64) -> Result<TriangleMesh, InputError> {
    Ok(welded(&TriangleMesh::merged(read_groups(file, bytes, scale)?), scale))
}

/// Meshes as the groups of an OBJ file in metres, to a tenth of a micrometre.
pub fn obj_text(groups: &[TriangleMesh]) -> String {
    let mut text = String::new();
    let mut first = 1;
    for (i, mesh) in groups.iter().enumerate() {
        // A String takes whatever is written to it.
        let _ = writeln!(text, "o part_{}", i + 1);
        for p in &mesh.vertices {
            let _ = writeln!(text, "v {:.7} {:.7} {:.7}", p.x, p.y, p.z);
        }
        for triangle in &mesh.triangles {
            let [a, b, c] = triangle.map(|it| it as usize + first);
            let _ = writeln!(text, "f {a} {b} {c}");
        }
        first += mesh.vertices.len();
    }
    text
}

/// Reads the vertices of each group of an OBJ file, in metres; an STL file is one group. Nothing is asked of
/// the faces.
///
/// # Errors
/// If the bytes are not a mesh of that format, or a group has no triangle, or numbers that are not finite, or
/// indices without a vertex.
pub fn groups_from_bytes(file: &str, bytes: &[u8], scale: f64) -> Result<Vec<Vec<Point3<f64>>>, InputError> {
    let groups = read_groups(file, bytes, scale)?;
    if groups.is_empty() {
        return Err(InputError::new(file, "faces", "no triangles", "the surface of a solid"));
    }
    Ok(groups.iter().map(|it| welded(it, scale).vertices).collect())
}

/// The groups of a file, their numbers finite and their indices within range.
fn read_groups(file: &str, bytes: &[u8], scale: f64) -> Result<Vec<TriangleMesh>, InputError> {
    quantity::SCALE.check(file, "scale", scale)?;
    checked(file, groups_of(file, bytes)?)
}

/// The extension of a file's name in lower case.
pub fn extension(file: &str) -> String {
    file.rsplit_once('.').map(|(_, extension)| extension.to_ascii_lowercase()).unwrap_or_default()
}

/// The groups of an OBJ file as they stand there; an STL file is one group.
///
/// # Errors
/// If the bytes are not a mesh of that format.
pub fn groups_of(file: &str, bytes: &[u8]) -> Result<Vec<TriangleMesh>, InputError> {
    match extension(file).as_str() {
        "obj" => obj::read(file, bytes),
        "stl" => Ok(vec![stl::read(file, bytes)?]),
        extension => Err(InputError::new(file, "extension", extension, "a mesh: .obj or .stl")),
    }
}

/// Groups whose numbers are finite and whose indices are within range.
///
/// # Errors
/// The first number or index that is not.
pub fn checked(file: &str, groups: Vec<TriangleMesh>) -> Result<Vec<TriangleMesh>, InputError> {
    for TriangleMesh { vertices, triangles } in &groups {
        if let Some(i) = vertices.iter().position(|it| !it.iter().all(|value| value.is_finite())) {
            let (field, found) = (format!("vertex {}", i + 1), format!("{:?}", vertices[i].coords.as_slice()));
            return Err(InputError::new(file, field, found, "finite numbers"));
        }
        if let Some(missing) = triangles.iter().flatten().find(|&&index| index as usize >= vertices.len()) {
            let expected = format!("indices of the {} vertices", vertices.len());
            return Err(InputError::new(file, "faces", format!("vertex number {}", u64::from(*missing) + 1), expected));
        }
    }
    Ok(groups)
}

/// Joins vertices that lie at the same place, drops triangles that are left without three corners, and
/// scales.
pub fn welded(surface: &TriangleMesh, scale: f64) -> TriangleMesh {
    let mut places = std::collections::HashMap::new();
    let mut mesh = TriangleMesh::default();
    let merged: Vec<u32> = surface
        .vertices
        .iter()
        .map(|vertex| {
            // Adding zero makes −0 and +0 the same place.
            *places.entry(vertex.map(|value| (value + 0.0).to_bits())).or_insert_with(|| {
                mesh.vertices.push(vertex * scale);
                mesh.vertices.len() as u32 - 1
            })
        })
        .collect();
    mesh.triangles = surface.triangles.iter().map(|triangle| triangle.map(|index| merged[index as usize])).collect();
    mesh.triangles.retain(|[a, b, c]| a != b && b != c && c != a);
    mesh
}

/// `mesh`, facing outwards, if it encloses a volume.
fn solid(file: &str, mesh: TriangleMesh) -> Result<TriangleMesh, InputError> {
    if mesh.triangles.is_empty() {
        return Err(InputError::new(file, "faces", "no triangles", "the surface of a solid"));
    }
    if !mesh.is_closed() {
        let expected = "a closed surface: each edge shared by two triangles of the same orientation";
        return Err(InputError::new(file, "faces", "holes or edges with more than two triangles", expected));
    }
    let mesh = mesh.facing_outwards();
    let volume = mesh.volume();
    if !(volume.is_finite() && volume > LEAST_FILLING * mesh.aabb().size.max().powi(3)) {
        return Err(InputError::new(file, "faces", format!("a volume of {volume} m³"), "a solid with a volume"));
    }
    Ok(mesh)
}

#[cfg(test)]
mod tests {
    use super::*;
    use approx::assert_relative_eq;

    fn obj(mesh: &TriangleMesh) -> String {
        let mut text = String::new();
        for vertex in &mesh.vertices {
            writeln!(text, "v {} {} {}", vertex.x, vertex.y, vertex.z).unwrap();
        }
        for [a, b, c] in &mesh.triangles {
            writeln!(text, "f {} {} {}", a + 1, b + 1, c + 1).unwrap();
        }
        text
    }

    fn stl(mesh: &TriangleMesh) -> Vec<u8> {
        let corner = |point: Point3<f64>| stl_io::Vertex::new([point.x as f32, point.y as f32, point.z as f32]);
        let triangles: Vec<stl_io::Triangle> = mesh
            .all_corners()
            .map(|corners| stl_io::Triangle { normal: stl_io::Normal::new([0.0; 3]), vertices: corners.map(corner) })
            .collect();
        let mut bytes = Vec::new();
        stl_io::write_stl(&mut bytes, triangles.iter()).unwrap();
        bytes
    }

    #[test]
    fn both_formats_give_the_same_solid_in_metres() {
        let mesh = TriangleMesh::sphere(50.0, 2);
        for (file, bytes) in [("ball.OBJ", obj(&mesh).into_bytes()), ("ball.stl", stl(&mesh))] {
            let read = mesh_from_bytes(file, &bytes, 1e-3).unwrap();
            assert_eq!((read.vertices.len(), read.triangles.len()), (mesh.vertices.len(), mesh.triangles.len()));
            assert_relative_eq!(read.bounding_radius(), 0.05, max_relative = 1e-6);
            assert_relative_eq!(read.volume(), mesh.volume() * 1e-9, max_relative = 1e-6);
        }
    }

    #[test]
    fn groups_of_an_obj_are_told_apart() {
        let cube = obj(&TriangleMesh::sphere(0.05, 0));
        let count = TriangleMesh::sphere(0.05, 0).vertices.len();
        let shifted: String = cube
            .lines()
            .map(|line| match line.strip_prefix("f ") {
                Some(face) => {
                    let corners = face.split(' ').map(|it| (it.parse::<usize>().unwrap() + count).to_string());
                    format!("f {}\n", corners.collect::<Vec<_>>().join(" "))
                }
                None => format!("{line}\n"),
            })
            .collect();
        let text = format!("o one\n{cube}o two\n{shifted}");
        let groups = groups_from_bytes("two.obj", text.as_bytes(), 2.0).unwrap();
        assert_eq!(groups.iter().map(Vec::len).collect::<Vec<_>>(), [count; 2]);
        assert!((groups[0][0].coords.norm() - 0.1).abs() < 1e-6);
        assert!(groups_from_bytes("none.obj", b"", 1.0).is_err());
    }

    #[test]
    fn a_solid_that_is_inside_out_is_turned() {
        let mut mesh = TriangleMesh::sphere(0.05, 1);
        mesh.triangles.iter_mut().for_each(|triangle| triangle.reverse());
        assert!(mesh_from_bytes("ball.obj", obj(&mesh).as_bytes(), 1.0).unwrap().volume() > 0.0);
    }

    #[test]
    fn what_is_not_a_mesh_is_refused_with_its_fault() {
        let mut open = TriangleMesh::sphere(0.05, 1);
        open.triangles.pop();
        let flat = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\nf 1 3 2\n";
        let poem: &[u8] = b"Shall I compare thee to a summer's day?\nThou art more lovely and more temperate:\n\
            Rough winds do shake the darling buds of May,\n";
        let open = obj(&open);
        for (file, bytes, scale, field) in [
            ("poem.obj", poem, 1.0, "poem.obj: "),
            ("poem.stl", poem, 1.0, "poem.stl: content"),
            ("empty.obj", b"", 1.0, "no triangles"),
            ("empty.stl", b"", 1.0, "content"),
            ("poem.txt", poem, 1.0, "extension"),
            ("ball.obj", open.as_bytes(), 1.0, "closed"),
            ("flat.obj", flat.as_bytes(), 1.0, "volume"),
            ("nan.obj", b"v nan 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", 1.0, "finite"),
            ("range.obj", b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 9\n", 1.0, "range.obj: "),
            ("ball.obj", open.as_bytes(), 0.0, "scale"),
        ] {
            let fault = mesh_from_bytes(file, bytes, scale).unwrap_err().to_string();
            assert!(fault.contains(field), "{fault}");
        }
    }
}
