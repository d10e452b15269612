//! Meshes that a description names, each read once, and all of them bounded together.

use std::{collections::HashMap, path::PathBuf, rc::Rc};

use catch_body::{InputError, TriangleMesh, mesh_file::MOST_TRIANGLES};
use nalgebra::Point3;

use crate::description::{Geometry, Shape};

/// The groups of a mesh file.
type Groups = Result<Vec<TriangleMesh>, InputError>;

/// The meshes of a description, as `read` reads the file that a name means.
pub struct MeshFiles<'a> {
    read: Box<dyn Fn(&str) -> Groups + 'a>,
    known: HashMap<String, Result<Rc<Vec<TriangleMesh>>, InputError>>,
    triangles: usize,
}

impl<'a> MeshFiles<'a> {
    pub fn new(read: impl Fn(&str) -> Groups + 'a) -> Self {
        Self { read: Box::new(read), known: HashMap::new(), triangles: 0 }
    }

    /// Reads shapes of the description `file` in their link's frame, the groups of a mesh file apart; those
    /// that cannot be read, or have a `fault`, are faults.
    ///
    /// # Errors
    /// If the triangles are too many together with those before.
    pub fn placed(
        &mut self,
        file: &str,
        shapes: &[Geometry],
        fault: impl Fn(&Geometry, &TriangleMesh) -> Option<InputError>,
    ) -> Result<(Vec<TriangleMesh>, Vec<InputError>), InputError> {
        let (mut all, mut faults) = (Vec::new(), Vec::new());
        for shape in shapes {
            let groups = match self.groups(shape) {
                Ok(groups) => groups,
                Err(fault) => {
                    faults.push(fault);
                    continue;
                }
            };
            if let Some(fault) = groups.iter().find_map(|it| fault(shape, it)) {
                faults.push(fault);
                continue;
            }
            self.triangles += groups.iter().map(|it| it.triangles.len()).sum::<usize>();
            if self.triangles > MOST_TRIANGLES {
                let expected = format!("at most {MOST_TRIANGLES} in all shapes, each instance counted");
                return Err(InputError::new(file, "shapes", "more triangles", expected));
            }
            all.extend(groups);
        }
        Ok((all, faults))
    }

    fn groups(&mut self, geometry: &Geometry) -> Groups {
        let Shape::Mesh { file: named, scale } = &geometry.shape else {
            return Ok(geometry.surface().into_iter().collect());
        };
        let known = self.known.entry(named.to_owned());
        let mut groups = (*known.or_insert_with(|| (self.read)(named).map(Rc::new)).clone()?).clone();
        for vertex in groups.iter_mut().flat_map(|it| &mut it.vertices) {
            *vertex = geometry.X_LS * Point3::from(vertex.coords.component_mul(scale));
        }
        Ok(groups)
    }
}

/// The file that `named` means.
///
/// # Errors
/// If there is none.
pub(super) fn located(file: &std::path::Path, named: &str, expected: &str) -> Result<PathBuf, InputError> {
    let found = "no such file beside the description, or in or below the folders above it";
    super::mesh_paths::resolve(file, named).ok_or_else(|| InputError::new(named, "the file", found, expected))
}
