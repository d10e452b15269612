//! The look of a parallel gripper of which only boxes are known: a housing with a rail before it, on which
//! the fingers ride on carriages, and pads with which they hold.

use catch_body::{Gripper, TriangleMesh, shape::Cuboid};
use nalgebra::{Point3, Vector3};

use super::paint::{Colour, DARK, METAL, RUBBER};

/// Width of a bevel over the smallest extent of its box.
const BEVEL: f64 = 0.16;
/// Thickness of a pad.
const PAD_M: f64 = 0.002;

/// Meshes with their colours.
pub type Pieces = Vec<(TriangleMesh, Colour)>;

/// The housing, in G.
pub fn housing(gripper: &Gripper) -> Pieces {
    if gripper.visuals.is_some() {
        let [housing, _] = gripper.surfaces();
        return vec![(housing, DARK)];
    }
    let [x, _, z] = gripper.body_size_m;
    let rail = |z_m: f64| Cuboid {
        centre: Point3::new(0.0, gripper.palm_y_m() + 0.002, z_m),
        size: Vector3::new(0.94 * x, 0.005, 0.12 * z),
    };
    let rails = [-0.26, 0.26].map(|at| (bevelled(&rail(at * z)), METAL));
    std::iter::once((bevelled(&gripper.body()), DARK)).chain(rails).collect()
}

/// The right finger, around the centre of its box.
pub fn finger(gripper: &Gripper) -> Pieces {
    if gripper.visuals.is_some() {
        let [_, finger] = gripper.surfaces();
        return vec![(finger, METAL)];
    }
    let [x, y, z] = gripper.finger_size_m;
    let root = gripper.palm_y_m() - gripper.finger_centre_y_m;
    let carriage =
        Cuboid { centre: Point3::new(0.35 * x, root + 0.11 * y, 0.0), size: Vector3::new(1.7 * x, 0.2 * y, 1.5 * z) };
    let inner = PAD_M / 2.0 - x / 2.0;
    let [from, to] = [root + 0.45 * (y / 2.0 - root), 0.96 * y / 2.0];
    let pad = Cuboid {
        centre: Point3::new(inner, f64::midpoint(from, to), 0.0),
        size: Vector3::new(PAD_M, to - from, 0.9 * z),
    };
    // The finger leaves room for its pad.
    let bar = Cuboid { centre: Point3::new(PAD_M / 2.0, 0.0, 0.0), size: Vector3::new(x - PAD_M, y, z) };
    vec![(bevelled(&bar), METAL), (bevelled(&carriage), DARK), (bevelled(&pad), RUBBER)]
}

/// A box whose edges are bevelled: on each side a smaller rectangle, all of them joined.
fn bevelled(cuboid: &Cuboid) -> TriangleMesh {
    let bevel = BEVEL * cuboid.size.min();
    let vertex = |corner: usize, face: usize| {
        let side = |axis: usize| if corner >> axis & 1 == 0 { -1.0 } else { 1.0 };
        let half = |axis: usize| cuboid.size[axis] / 2.0 - if axis == face { 0.0 } else { bevel };
        cuboid.centre + Vector3::from_fn(|axis, _| side(axis) * half(axis))
    };
    let at = |corner: usize, face: usize| (corner * 3 + face) as u32;
    let mut triangles = Vec::new();
    let mut quad = |[a, b, c, d]: [u32; 4]| triangles.extend([[a, b, c], [a, c, d]]);
    for face in 0..3 {
        let [u, v] = [1 << ((face + 1) % 3), 1 << ((face + 2) % 3)];
        for side in [0, 1 << face] {
            let corners = [side, side | u, side | u | v, side | v].map(|corner| at(corner, face));
            quad(if side == 0 { [corners[0], corners[3], corners[2], corners[1]] } else { corners });
        }
        // Along the edges in the direction of this axis, between the two other faces.
        let [a, b] = [(face + 1) % 3, (face + 2) % 3];
        for corner in [0, u, u | v, v] {
            let far = corner | 1 << face;
            let strip = [at(corner, a), at(corner, b), at(far, b), at(far, a)];
            let flips = (corner & u != 0) == (corner & v != 0);
            quad(if flips { strip } else { [strip[3], strip[2], strip[1], strip[0]] });
        }
    }
    for corner in 0..8_usize {
        let [a, b, c] = [0, 1, 2].map(|face| at(corner, face));
        triangles.push(if corner.count_ones() % 2 == 1 { [a, b, c] } else { [a, c, b] });
    }
    let vertices = (0..24).map(|i| vertex(i / 3, i % 3)).collect();
    TriangleMesh { vertices, triangles }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bevelled_boxes_are_closed_and_face_outwards() {
        let cuboid = Cuboid { centre: Point3::new(0.1, 0.2, 0.3), size: Vector3::new(0.1, 0.2, 0.4) };
        let mesh = bevelled(&cuboid);
        assert!(mesh.is_closed());
        let whole = cuboid.size.product();
        assert!(mesh.volume() < whole && mesh.volume() > 0.9 * whole, "{} of {whole}", mesh.volume());
    }
}
