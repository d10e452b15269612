//! Surfaces of the arm as they truly are: thicker or thinner than in any model, and with covers, cables and
//! labels on them.

use catch_body::{MAX_JOINTS, Robot, TriangleMesh, visual::Visual};
use nalgebra::{Point3, UnitQuaternion, Vector3};

use crate::random_streams::Draws;

/// Covers, cables and labels on each link.
const PATCHES: usize = 2;
/// Half the lengths and widths of a patch, in metres.
const HALF_SIZE_M: [f64; 2] = [0.01, 0.04];
/// Patches rise up to so many standard deviations of a link's surface: 15 mm where that is 1 mm.
const MOST_RISE_SD: f64 = 15.0;
/// Flat strips around a capsule that is seen as a link, as many as of a link in the model.
const SEGMENTS: u32 = 48;
/// Halvings of an icosahedron's edges with which a patch is round.
const ROUND: u32 = 2;

/// The arm as cameras see it, each link's surface off by a normal deviation of `sd_m`, with patches on it.
/// What it collides with stays as it is.
pub(crate) fn drawn(model: &Robot, sd_m: f64, draws: &mut Draws) -> Robot {
    let offset_m: [f64; MAX_JOINTS + 1] = std::array::from_fn(|_| sd_m * draws.normal());
    let mut robot = model.clone().with_thicker_links(|link| offset_m[link]);
    for link in 0..=robot.dof() {
        let bare = robot.link_surface(link, SEGMENTS);
        let mut surface = bare.clone();
        for _ in 0..PATCHES {
            if let Some(patch) = patch(&bare, MOST_RISE_SD * sd_m, draws) {
                surface.merge(&patch);
            }
        }
        robot.visuals.insert(link, Visual::of_surface(surface));
    }
    robot.capsules.clone_from(&model.capsules);
    robot
}

/// An ellipsoid around a point of a surface, anywhere on it with the same density, that rises by up to
/// `most_m`.
fn patch(surface: &TriangleMesh, most_m: f64, draws: &mut Draws) -> Option<TriangleMesh> {
    let area = |[a, b, c]: [Point3<f64>; 3]| (b - a).cross(&(c - a)).norm();
    let whole: f64 = surface.all_corners().map(area).sum();
    let (mut left, [u, v]) = (whole * draws.unit(), [draws.unit().sqrt(), draws.unit()]);
    let size = Vector3::new(draws.between(HALF_SIZE_M), draws.between(HALF_SIZE_M), draws.between([0.0, most_m]));
    let turn = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), draws.between([0.0, std::f64::consts::PI]));
    let [a, b, c] = surface.all_corners().find(|corners| {
        left -= area(*corners);
        left <= 0.0
    })?;
    let normal = (b - a).cross(&(c - a)).try_normalize(0.0)?;
    let at = a + ((b - a) * (1.0 - v) + (c - a) * v) * u;
    // Opposite directions have no rotation of their own; any half turn will do.
    let upright = UnitQuaternion::rotation_between(&Vector3::z(), &normal)
        .unwrap_or_else(|| UnitQuaternion::from_axis_angle(&Vector3::x_axis(), std::f64::consts::PI));
    let mut round = TriangleMesh::sphere(1.0, ROUND);
    for vertex in &mut round.vertices {
        *vertex = at + upright * (turn * vertex.coords.component_mul(&size));
    }
    Some(round)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random_streams::Stream;
    use catch_body::shape::Capsule;

    /// A surface rises by no more than the greatest patch and four deviations, and somewhere it does rise.
    #[test]
    fn surfaces_are_off_by_what_is_drawn() {
        let capsule = Capsule { from: Point3::origin(), to: Point3::new(0.0, 0.0, 0.3), radius: 0.06 };
        let mesh = TriangleMesh::capsule(&capsule, SEGMENTS);
        let mut highest = 0.0_f64;
        for index in 0..200 {
            let patch = patch(&mesh, 0.015, &mut Draws::new(Stream::LinkSurfaces, 1, index)).unwrap();
            let height = |it: &Point3<f64>| capsule.distance_to_point(it);
            let rise = patch.vertices.iter().map(height).fold(f64::MIN, f64::max);
            // On a round surface the ends of a flat patch stand off by l²/(2·r).
            assert!(rise < 0.015 + 0.04 * 0.04 / (2.0 * 0.06), "{rise}");
            highest = highest.max(rise);
        }
        assert!(highest > 0.012, "{highest}");
    }
}
