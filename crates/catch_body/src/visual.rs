//! Visual shapes: the surfaces of an arm and its gripper as cameras see them. Capsules and boxes are for
//! collisions.

use std::{
    path::{Component, Path},
    sync::Arc,
};

use serde::Deserialize;

use crate::{InputError, mesh::TriangleMesh, mesh_file, quantity};

/// Triangles of a mesh at most: their edges are about 8 mm long on a link of an arm, and bend by 0.15 mm.
pub const MOST_VISUAL_TRIANGLES: usize = 4_000;
/// Meshes of a file at most: no arm has more links.
const MOST_MESHES: usize = 16;
/// The table of a file that lists visual shapes.
const TABLE: &str = "visuals";

/// Surface of a body as cameras see it. A body without one is seen as its capsules or boxes.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Visual {
    /// The mesh, an OBJ file in metres in the body's frame with at most 4,000 triangles: a path below the
    /// folder of this file.
    pub mesh: String,
    /// Origin of the mesh, with its licence where it is known.
    pub source: String,
    /// The surface; empty until its file is read.
    #[serde(skip)]
    pub surface: Arc<TriangleMesh>,
}

/// Reads the file that a name means: what errors call it, and its content.
pub type ReadMesh<'a> = dyn Fn(&str) -> Result<(String, Vec<u8>), InputError> + 'a;

impl Visual {
    /// A surface that no file holds.
    pub fn of_surface(surface: TriangleMesh) -> Self {
        Self { mesh: String::new(), source: String::new(), surface: Arc::new(surface) }
    }

    /// The surface, if its file was read.
    pub fn mesh(&self) -> Option<&TriangleMesh> {
        (!self.surface.triangles.is_empty()).then_some(&self.surface)
    }

    /// Checks what the file says; `field` is the table's.
    ///
    /// # Errors
    /// A path out of the folder, a mesh of another format, no source.
    pub fn check(&self, file: &str, field: &str) -> Result<(), InputError> {
        if !is_below(&self.mesh) {
            let expected = "the path of an OBJ file below the folder of this file, such as visual/link1.obj";
            return Err(InputError::new(file, format!("{field}.mesh"), format!("`{}`", self.mesh), expected));
        }
        if self.source.trim().is_empty() {
            return Err(InputError::new(file, format!("{field}.source"), "nothing", "where the mesh is from"));
        }
        Ok(())
    }

    /// Reads the mesh.
    ///
    /// # Errors
    /// A fault of the file, too many triangles, or vertices that are no part of an arm's.
    pub fn read(&mut self, read: &ReadMesh) -> Result<(), InputError> {
        let (file, bytes) = read(&self.mesh)?;
        let mesh = mesh_file::surface_from_bytes(&file, &bytes, 1.0)?;
        let count = mesh.triangles.len();
        if !(1..=MOST_VISUAL_TRIANGLES).contains(&count) {
            let expected = format!(
                "1 to {MOST_VISUAL_TRIANGLES}: `catchingbot robot import` simplifies the meshes of a description"
            );
            return Err(InputError::new(&file, "faces", format!("{count} triangles"), expected));
        }
        for (i, vertex) in mesh.vertices.iter().enumerate() {
            for value in vertex.iter() {
                quantity::OFFSET_M.check(&file, format!("vertex {}", i + 1), *value)?;
            }
        }
        self.surface = Arc::new(mesh);
        Ok(())
    }
}

/// Names of the meshes in the TOML file of a robot or a gripper, those that may be read.
///
/// Whatever else is wrong with the file is found when it is parsed.
pub fn mesh_names(toml: &str) -> Vec<String> {
    let table: toml::Table = toml::from_str(toml).unwrap_or_default();
    let visuals = table.get(TABLE).and_then(toml::Value::as_table).into_iter().flat_map(toml::Table::values);
    let names = visuals.filter_map(|it| it.get("mesh")?.as_str()).filter(|it| is_below(it));
    names.take(MOST_MESHES).map(str::to_owned).collect()
}

/// Returns whether a name is the path of an OBJ file below the folder of the file that names it.
fn is_below(name: &str) -> bool {
    let path = Path::new(name);
    mesh_file::extension(name) == "obj" && path.components().all(|it| matches!(it, Component::Normal(_)))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn visual(mesh: &str, source: &str) -> Visual {
        Visual { mesh: mesh.to_owned(), source: source.to_owned(), surface: Arc::default() }
    }

    #[test]
    fn meshes_are_read_once_they_are_right() {
        let ball = mesh_file::obj_text(&[TriangleMesh::sphere(0.1, 2)]);
        let mut it = visual("visual/a.obj", "made here");
        assert!(it.mesh().is_none());
        it.read(&|name| Ok((format!("arm/{name}"), ball.clone().into_bytes()))).unwrap();
        assert_eq!(it.mesh().unwrap().triangles.len(), TriangleMesh::sphere(0.1, 2).triangles.len());
        let faults = [
            (mesh_file::obj_text(&[TriangleMesh::sphere(0.1, 6)]), "arm/a.obj: faces: found "),
            (mesh_file::obj_text(&[TriangleMesh::sphere(100.0, 2)]), "arm/a.obj: vertex 1: found "),
            ("v 0 0 0\n".to_owned(), "arm/a.obj: faces: found 0 triangles, expected 1 to 4000: `catchingbot robot"),
        ];
        for (text, expected) in faults {
            let read = |_: &str| Ok(("arm/a.obj".to_owned(), text.clone().into_bytes()));
            let fault = it.read(&read).unwrap_err().to_string();
            assert!(fault.contains(expected), "{fault}");
        }
    }

    #[test]
    fn only_files_below_the_robot_are_named() {
        for (name, source, is_right) in [
            ("visual/a.obj", "somewhere", true),
            ("../a.obj", "somewhere", false),
            ("/a.obj", "somewhere", false),
            ("a.stl", "somewhere", false),
            ("a.obj", " ", false),
        ] {
            let checked = visual(name, source).check("robot.toml", "visuals.link");
            assert_eq!(checked.is_ok(), is_right, "{name}: {checked:?}");
        }
        let toml = "[visuals.a]\nmesh = \"visual/a.obj\"\n[visuals.b]\nmesh = \"../b.obj\"\n[visuals.c]\nmesh = 1\n";
        assert_eq!(mesh_names(toml), ["visual/a.obj"]);
        assert!(mesh_names("no toml").is_empty());
    }
}
