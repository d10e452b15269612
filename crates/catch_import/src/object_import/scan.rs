//! The surface of an object of which there is only a scan, a point cloud without faces.

use catch_body::{
    InputError, TriangleMesh,
    neighbours::{PointGrid, bounds, first_in_cubes},
    shape::Cuboid,
};
use catch_bot::perception::ReferenceModel;
use nalgebra::{Point3, Vector3};

use super::normal_signs::orient;
use crate::{
    cloud_file::CloudFile, cloud_registration::reference_model, isosurface::isosurface, mesh_repair::without_specks,
};

/// Edge of the cubes in which the surface is looked for, in metres.
const SPACING_M: f64 = 0.0015;
/// Distance beyond the thinned points of a model, on both sides together, within which the surface may be.
const ROOM_M: f64 = 0.01;
/// Pieces with less volume than this fraction of the largest one's are specks.
const SPECK: f64 = 0.05;

/// A surface that was made from points.
pub(super) struct Scanned {
    /// The surface, in the unit of the points.
    pub surface: TriangleMesh,
    /// Findings on the way.
    pub findings: Vec<String>,
    /// Width of the widest part of the surface on which no point lies, in metres.
    pub gap_m: f64,
}

/// The surface where the signed distance of the cloud is zero, in the cloud's own unit of `scale` metres.
///
/// # Errors
/// Too few points, lengths that nothing to throw has, or points between which there is no inside.
pub(super) fn surface(file: &str, mut cloud: CloudFile, scale: f64) -> Result<Scanned, InputError> {
    let mut findings = vec![format!("{file}: a cloud of {} points", cloud.points.len())];
    if cloud.normals.is_none() {
        findings.push("the cloud has no normals: the surface is taken to face away from the middle everywhere".into());
    }
    cloud.points.iter_mut().for_each(|it| it.coords *= scale);
    let mut cloud = thinned(cloud);
    findings.extend(orient(file, &mut cloud)?);
    let reference = reference_model(cloud, file)?;
    between(file, &reference, scale, findings)
}

/// The surface of a scanned object, in its own unit of `scale` metres, with what was found so far.
///
/// # Errors
/// No inside.
pub(super) fn between(
    file: &str,
    reference: &ReferenceModel,
    scale: f64,
    mut findings: Vec<String>,
) -> Result<Scanned, InputError> {
    let to_O = reference.X_RO.translation.vector;
    let (low, high) = bounds(&reference.points);
    let around = Cuboid { centre: nalgebra::center(&low, &high), size: high - low + Vector3::repeat(ROOM_M) };
    let mut mesh = TriangleMesh::default();
    if !reference.points.is_empty() {
        mesh = isosurface(&around, SPACING_M, |p_O| reference.distance.at(p_O).0);
    }
    if mesh.triangles.is_empty() || mesh.volume() <= 0.0 {
        let expected = "points all around a solid, best with normals nx, ny and nz that point outwards";
        return Err(InputError::new(file, "points", "no inside between them", expected));
    }
    findings.push(format!("the surface between them has {} triangles", mesh.triangles.len()));
    let specks = without_specks(&mut mesh, SPECK);
    if specks > 0 {
        findings.push(format!("specks left out, each under {:.0} % of the largest piece: {specks}", SPECK * 100.0));
    }
    let gap_m = gap_m(&mesh.vertices, &reference.points);
    mesh.vertices.iter_mut().for_each(|it| it.coords = (it.coords + to_O) / scale);
    Ok(Scanned { surface: mesh, findings, gap_m })
}

/// Width of the widest gap: twice the largest distance between a vertex of the surface and the point that is
/// nearest to it.
fn gap_m(vertices: &[Point3<f64>], points: &[Point3<f64>]) -> f64 {
    let grid = PointGrid::new(points, ROOM_M);
    let to_nearest_m = |vertex: &Point3<f64>| {
        let mut radius_m = ROOM_M;
        loop {
            let mut least_m = f64::INFINITY;
            grid.near(vertex, radius_m, |i| least_m = least_m.min(nalgebra::distance(vertex, &points[i])));
            if least_m <= radius_m || radius_m > 1.0 {
                return least_m;
            }
            radius_m *= 2.0;
        }
    };
    2.0 * vertices.iter().map(to_nearest_m).fold(0.0, f64::max)
}

/// Thins a cloud to one point per cube of the edge [`SPACING_M`]: where points lie much closer than others
/// their noise would bend the surface.
fn thinned(cloud: CloudFile) -> CloudFile {
    let kept: Vec<usize> = first_in_cubes(&cloud.points, SPACING_M).collect();
    CloudFile {
        points: kept.iter().map(|&i| cloud.points[i]).collect(),
        normals: cloud.normals.map(|normals| kept.iter().map(|&i| normals[i]).collect()),
    }
}

/// The longest side of the box around a cloud, in its unit.
pub(super) fn length(cloud: &CloudFile) -> f64 {
    let (low, high) = bounds(&cloud.points);
    (high - low).max()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Points of a ball with a radius of 30 mm, about 2 mm apart, below a height.
    fn ball(below_m: f64) -> CloudFile {
        let golden_rad = std::f64::consts::PI * (3.0 - 5.0_f64.sqrt());
        let direction = |i: u32| {
            let z = 1.0 - (2.0 * f64::from(i) + 1.0) / 3000.0;
            let (turn, radius) = (golden_rad * f64::from(i), (1.0 - z * z).sqrt());
            Vector3::new(radius * libm::cos(turn), radius * libm::sin(turn), z)
        };
        let normals: Vec<_> = (0..3000).map(direction).filter(|it| 0.03 * it.z < below_m).collect();
        let points = normals.iter().map(|it| Point3::from(it * 0.03)).collect();
        CloudFile { points, normals: Some(normals) }
    }

    #[test]
    fn a_part_that_a_scan_does_not_show_is_a_gap() {
        let whole = surface("ball.ply", ball(0.03), 1.0).unwrap();
        assert!(whole.gap_m < 0.006, "{}", whole.gap_m);
        assert!((whole.surface.aabb().size.max() - 0.06).abs() < 0.001);
        // The rim of what is left has a diameter of 52 mm.
        let cut = surface("ball.ply", ball(0.015), 1.0).unwrap();
        assert!(cut.gap_m > 0.03, "{}", cut.gap_m);
    }
}
