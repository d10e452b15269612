//! The shapes of a described robot's bodies, and capsules around them.

use std::collections::BTreeSet;

use crate::{
    capsule_fit,
    description::{Body, Geometry, Shape},
    mesh_files::MeshFiles,
};
use catch_body::{InputError, TriangleMesh, mesh_file::welded, neighbours::bounds, shape::Capsule};
use nalgebra::{Point3, Vector3};

use super::visual_mesh::seen_from_outside;

/// Greatest extent in metres of a part of an arm: anything larger is no part of one, or in other units.
const MOST_EXTENT_M: f64 = 3.0;
/// Capsules are written with so many steps per metre.
const STEPS_PER_M: f64 = 1e4;

/// The shape of a body.
#[derive(Debug, Clone, Default)]
pub struct BodyShape {
    /// Surface in the body's frame; empty if nothing is known.
    pub surface: TriangleMesh,
    /// Capsules that hold the surface.
    pub capsules: Vec<Capsule>,
    /// Reason why the capsules are assumed, if they are.
    pub assumed: Option<String>,
    /// Surface for cameras, and where it is from; `None` if nothing is known.
    pub visual: Option<(TriangleMesh, String)>,
    /// Faults of shapes that could not be read.
    pub unread: Vec<InputError>,
}

impl BodyShape {
    /// Reads the shapes of a body and fits capsules around those for collisions and what cameras see.
    ///
    /// # Errors
    /// If it has more shapes or triangles than are read.
    pub(crate) fn of(body: &Body, meshes: &mut MeshFiles) -> Result<Self, InputError> {
        let mut shape = Self::default();
        let mut read = |shapes: &[Geometry]| {
            let (surfaces, faults) = meshes.placed(&body.links[0], shapes, too_large)?;
            let all = TriangleMesh::merged(surfaces.iter().map(|it| welded(it, 1.0)));
            let is_whole = faults.is_empty();
            shape.unread.extend(faults);
            Ok::<_, InputError>((all, is_whole))
        };
        let (collisions, (visuals, is_whole)) = (read(&body.collisions)?.0, read(&body.visuals)?);
        if is_whole && !visuals.triangles.is_empty() {
            shape.visual = Some(visual(&visuals, &body.visuals));
        }
        shape.surface = if collisions.triangles.is_empty() {
            visuals
        } else {
            // Makers' shapes for collisions are often smaller than what one sees of the link.
            let mut both = collisions;
            shape.visual.iter().for_each(|(mesh, _)| both.merge(mesh));
            both
        };
        shape.capsules = capsule_fit::enclosing_capsules(&shape.surface).iter().map(rounded_outwards).collect();
        Ok(shape)
    }

    /// Returns whether each triangle of the surface is inside one of the capsules.
    pub fn is_inside(&self) -> bool {
        self.surface.all_corners().all(|corners| {
            self.capsules.iter().any(|it| corners.iter().all(|corner| it.distance_to_point(corner) <= 0.0))
        })
    }

    /// Extent of the surface in a direction from the origin of its frame, in metres.
    pub fn reach(&self, direction: &Vector3<f64>) -> Option<f64> {
        self.surface.vertices.iter().map(|it| it.coords.dot(direction)).max_by(f64::total_cmp)
    }

    /// A capsule from the body's origin to where it goes on, for a body whose shape is unknown.
    pub fn assume_capsule(&mut self, to: Point3<f64>, radius_m: f64) {
        let unread = self.unread.first().map(|it| format!(" ({}: {})", it.file, it.found)).unwrap_or_default();
        self.capsules = vec![rounded_outwards(&Capsule { from: Point3::origin(), to, radius: radius_m })];
        self.assumed =
            Some(format!("no shape of this link can be read{unread}: from its joint to the next, {radius_m} m around"));
    }
}

/// The surface for cameras, and where it is from.
fn visual(surface: &TriangleMesh, shapes: &[Geometry]) -> (TriangleMesh, String) {
    let named = shapes.iter().filter_map(|it| match &it.shape {
        Shape::Mesh { file, .. } => Some(file.as_str()),
        _ => None,
    });
    let names: BTreeSet<&str> = named.collect();
    let of = if names.is_empty() { "shapes".to_owned() } else { Vec::from_iter(names).join(", ") };
    let (mesh, cell_m) = seen_from_outside(surface);
    let (before, after) = (surface.triangles.len(), mesh.triangles.len());
    let cells = if cell_m > 0.0 { format!(", vertices within {:.1} mm joined", cell_m * 1e3) } else { String::new() };
    (mesh, format!("{of}: the outside, {after} of {before} triangles{cells}"))
}

/// The capsule with numbers of few digits that holds `capsule`.
fn rounded_outwards(capsule: &Capsule) -> Capsule {
    let round = |point: &Point3<f64>| point.map(|value| (value * STEPS_PER_M).round() / STEPS_PER_M);
    let (from, to) = (round(&capsule.from), round(&capsule.to));
    let moved = (from - capsule.from).norm().max((to - capsule.to).norm());
    Capsule { from, to, radius: ((capsule.radius + moved) * STEPS_PER_M).ceil() / STEPS_PER_M }
}

/// The fault of a surface whose groups together are larger than a part of an arm.
fn too_large(geometry: &Geometry, groups: &[TriangleMesh]) -> Option<InputError> {
    let vertices: Vec<Point3<f64>> = groups.iter().flat_map(|it| it.vertices.iter().copied()).collect();
    let (low, high) = bounds(&vertices);
    let extents_m = high - low;
    if extents_m.iter().all(|it| *it <= MOST_EXTENT_M) {
        return None;
    }
    let extent_m = extents_m.max();
    let named = if let Shape::Mesh { file, .. } = &geometry.shape { file } else { "a shape" };
    let expected = format!("at most {MOST_EXTENT_M} m: a part of an arm, in metres (`scale=\"0.001 0.001 0.001\"`)");
    Some(InputError::new(named, "extent", format!("{extent_m} m"), expected))
}

#[cfg(test)]
mod tests {
    use super::*;
    use catch_body::{Pose, shape::Cuboid};

    #[test]
    fn groups_that_are_far_apart_are_too_large_together() {
        let shape = Shape::Mesh { file: "link.obj".into(), scale: Vector3::repeat(1.0) };
        let geometry = Geometry { X_LS: Pose::identity(), shape };
        let at =
            |x: f64| TriangleMesh::cuboid(&Cuboid { centre: Point3::new(x, 0.0, 0.0), size: Vector3::repeat(0.1) });
        assert_eq!(too_large(&geometry, &[at(0.0), at(2.0)]), None);
        for far in [4.0, f64::INFINITY, f64::NAN] {
            let fault = too_large(&geometry, &[at(0.0), at(far)]).unwrap().to_string();
            assert!(fault.starts_with("link.obj: extent: found "), "{fault}");
        }
    }
}
