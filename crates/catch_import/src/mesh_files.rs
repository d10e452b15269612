//! Meshes that a description names, each read once, and all of them bounded together.

use std::{collections::HashMap, path::PathBuf, rc::Rc};

use catch_body::{InputError, TriangleMesh, mesh_file::MOST_TRIANGLES};

/// The meshes of a description, as `read` reads the file that a name means.
pub struct MeshFiles<F> {
    read: F,
    known: HashMap<String, Result<Rc<Vec<TriangleMesh>>, InputError>>,
    triangles: usize,
}

impl<F: Fn(&str) -> Result<Vec<TriangleMesh>, InputError>> MeshFiles<F> {
    pub fn new(read: F) -> Self {
        Self { read, known: HashMap::new(), triangles: 0 }
    }

    /// The groups of a mesh.
    ///
    /// # Errors
    /// A fault of the file.
    pub fn get(&mut self, named: &str) -> Result<Rc<Vec<TriangleMesh>>, InputError> {
        let known = self.known.entry(named.to_owned());
        known.or_insert_with(|| (self.read)(named).map(Rc::new)).clone()
    }

    /// Counts the triangles of one more shape.
    ///
    /// # Errors
    /// If they are too many together with those before.
    pub fn count(&mut self, file: &str, meshes: &[TriangleMesh]) -> Result<(), InputError> {
        self.triangles += meshes.iter().map(|it| it.triangles.len()).sum::<usize>();
        if self.triangles <= MOST_TRIANGLES {
            return Ok(());
        }
        let expected = format!("at most {MOST_TRIANGLES} in all shapes, each instance counted");
        Err(InputError::new(file, "shapes", "more triangles", expected))
    }
}

/// The file that `named` means.
///
/// # Errors
/// If there is none.
pub(super) fn located(file: &std::path::Path, named: &str, expected: &str) -> Result<PathBuf, InputError> {
    let found = "no such file below or beside the folders above the description";
    super::mesh_paths::resolve(file, named).ok_or_else(|| InputError::new(named, "the file", found, expected))
}
