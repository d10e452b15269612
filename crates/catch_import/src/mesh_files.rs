//! Meshes that a description names, each read once, and all of them bounded together.

use std::{collections::HashMap, path::Path};

use catch_body::{InputError, TriangleMesh, mesh_file::MOST_TRIANGLES};
use nalgebra::Point3;

use crate::{
    description::{Geometry, Shape},
    mesh_paths::resolve,
    surface_file::{self, MESH},
};

/// The groups of a mesh file.
type Groups = Result<Vec<TriangleMesh>, InputError>;

/// The meshes of a description.
pub struct MeshFiles<'a> {
    /// The description.
    file: &'a Path,
    known: HashMap<String, Groups>,
    triangles: usize,
}

impl<'a> MeshFiles<'a> {
    pub fn new(file: &'a Path) -> Self {
        Self { file, known: HashMap::new(), triangles: 0 }
    }

    /// Reads shapes of the description in their link's frame, the groups of a mesh file apart; those
    /// that cannot be read, or have a `fault`, are faults.
    ///
    /// # Errors
    /// If the triangles are too many together with those before.
    pub fn placed(
        &mut self,
        shapes: &[Geometry],
        fault: impl Fn(&Geometry, &[TriangleMesh]) -> Option<InputError>,
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
            if let Some(fault) = fault(shape, &groups) {
                faults.push(fault);
                continue;
            }
            self.triangles += groups.iter().map(|it| it.triangles.len()).sum::<usize>();
            if self.triangles > MOST_TRIANGLES {
                let expected = format!("at most {MOST_TRIANGLES} in all shapes, each instance counted");
                return Err(InputError::new(self.file.display(), "shapes", "more triangles", expected));
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
        let mut groups = known.or_insert_with(|| read(self.file, named)).clone()?;
        for vertex in groups.iter_mut().flat_map(|it| &mut it.vertices) {
            *vertex = geometry.X_LS * Point3::from(vertex.coords.component_mul(scale));
        }
        Ok(groups)
    }
}

/// The groups of the mesh that the description `file` calls `named`.
fn read(file: &Path, named: &str) -> Groups {
    let found = "no such file beside the description, or in or below the folders above it";
    let path = resolve(file, named).ok_or_else(|| InputError::new(named, "the file", found, MESH.expected))?;
    surface_file::read(&path).map(|(groups, _)| groups)
}
