//! Meshes that a description names, each read once, and all of them bounded together.

use std::{collections::HashMap, path::Path};

use catch_body::{InputError, TriangleMesh, mesh_file::MOST_TRIANGLES};
use nalgebra::Point3;

use crate::{
    description::{Geometry, Shape},
    mesh_paths::resolve,
    surface_file::{self, MESH},
};

/// Shapes at a time at most.
const MOST_SHAPES: usize = 500;

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

    /// Reads shapes of the description in the frame of their link, the groups of a mesh file apart; those
    /// that cannot be read, or have a `fault`, are faults.
    ///
    /// # Errors
    /// If the shapes are too many, or the triangles together with those before.
    pub fn placed(
        &mut self,
        link: &str,
        shapes: &[Geometry],
        fault: impl Fn(&Geometry, &[TriangleMesh]) -> Option<InputError>,
    ) -> Result<(Vec<TriangleMesh>, Vec<InputError>), InputError> {
        let file = self.file.display();
        let too_many = |found: String, expected: String| {
            Err(InputError::new(&file, format!("link {link}"), found, format!("at most {expected}")))
        };
        if shapes.len() > MOST_SHAPES {
            return too_many(format!("{} shapes", shapes.len()), MOST_SHAPES.to_string());
        }
        let (mut all, mut faults) = (Vec::new(), Vec::new());
        for shape in shapes {
            match self.groups(shape).and_then(|groups| fault(shape, &groups).map_or(Ok(groups), Err)) {
                Ok(groups) => {
                    self.triangles += groups.iter().map(|it| it.triangles.len()).sum::<usize>();
                    all.extend(groups);
                }
                Err(fault) => faults.push(fault),
            }
            if self.triangles > MOST_TRIANGLES {
                let expected = format!("{MOST_TRIANGLES} in all shapes, each instance counted");
                return too_many("more triangles".to_owned(), expected);
            }
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
