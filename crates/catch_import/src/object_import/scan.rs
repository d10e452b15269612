//! The surface of an object of which there is only a scan, a point cloud without faces.

use catch_body::{
    InputError, TriangleMesh,
    neighbours::{bounds, first_in_cubes},
    shape::Cuboid,
};
use catch_bot::perception::ReferenceModel;
use nalgebra::Vector3;

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

/// The surface where the signed distance of the cloud is zero, in the cloud's own unit of `scale` metres, and
/// what was found on the way.
///
/// # Errors
/// Too few points, lengths that nothing to throw has, or points between which there is no inside.
pub(super) fn surface(file: &str, mut cloud: CloudFile, scale: f64) -> Result<(TriangleMesh, Vec<String>), InputError> {
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
) -> Result<(TriangleMesh, Vec<String>), InputError> {
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
    mesh.vertices.iter_mut().for_each(|it| it.coords = (it.coords + to_O) / scale);
    Ok((mesh, findings))
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
