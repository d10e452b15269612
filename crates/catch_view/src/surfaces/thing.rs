//! The look of a thrown object: a ball has a seam, a body that ends in a step a cap, and one that tapers
//! has dark tips.

use std::f64::consts::TAU;

use catch_body::{TriangleMesh, mesh::TubeRing};
use nalgebra::{Point3, Vector3};

use super::paint::{BALL, Colour, OBJECT, TIP, WHITE};

/// Slices along an object.
const SLICES: usize = 40;
/// Width of a cap and of a tip over the widest place, at most.
const NARROW: [f64; 2] = [0.84, 0.6];
/// Pieces of a seam.
const SEAM: usize = 72;

/// Meshes with their colours.
pub type Pieces = Vec<(TriangleMesh, Colour)>;

/// An object's surface in its parts.
pub fn pieces(mesh: &TriangleMesh) -> Pieces {
    let size = mesh.aabb().size;
    let centre = mesh.aabb().centre;
    let distances = || mesh.vertices.iter().map(|vertex| (vertex - centre).norm());
    let (low, high) = (distances().fold(f64::INFINITY, f64::min), distances().fold(0.0, f64::max));
    if low > 0.97 * high {
        return vec![(mesh.clone(), BALL), (seam(&centre, high), WHITE)];
    }
    let axis = size.imax();
    let across = (0..3).filter(|it| *it != axis).min_by(|a, b| size[*a].total_cmp(&size[*b])).unwrap_or(axis);
    let slice = |z: f64| (((z - centre[axis]) / size[axis] + 0.5) * SLICES as f64).clamp(0.0, SLICES as f64 - 1.0);
    // How far the surface is from its middle in each slice; triangles may be longer than a slice.
    let mut widths = [0.0_f64; SLICES];
    for corners in mesh.all_corners() {
        let at = corners.map(|it| slice(it[axis]));
        let (from, to) = (at[0].min(at[1]).min(at[2]) as usize, at[0].max(at[1]).max(at[2]) as usize);
        let width = corners.iter().map(|it| (it[across] - centre[across]).abs()).fold(0.0, f64::max);
        widths[from..=to].iter_mut().for_each(|it| *it = it.max(width));
    }
    let widest = widths.iter().copied().fold(0.0, f64::max);
    let narrower = |than: f64, backward: bool| {
        (0..SLICES).take_while(|i| widths[if backward { SLICES - 1 - i } else { *i }] < than * widest).count()
    };
    // An end that is as wide all along is a cap.
    let end = |backward: bool| {
        let count = narrower(NARROW[0], backward);
        let slices = if backward { &widths[SLICES - count..] } else { &widths[..count] };
        let (low, high) = slices.iter().fold((f64::INFINITY, 0.0_f64), |(a, b), w| (a.min(*w), b.max(*w)));
        if low > 0.9 * high { (count, WHITE) } else { (narrower(NARROW[1], backward), TIP) }
    };
    let ((first, first_colour), (last, last_colour)) = (end(false), end(true));
    let last = SLICES - last;
    let zones = [(0..first, first_colour), (last..SLICES, last_colour), (first..last, OBJECT)];
    let zone_of = |corners: [Point3<f64>; 3]| slice(corners.iter().map(|it| it[axis]).sum::<f64>() / 3.0) as usize;
    let part = |range: &std::ops::Range<usize>| {
        let triangles = mesh.all_corners().zip(&mesh.triangles).filter(|(it, _)| range.contains(&zone_of(*it)));
        let triangles = triangles.map(|(_, triangle)| *triangle).collect();
        let mut part = TriangleMesh { vertices: mesh.vertices.clone(), triangles };
        part.drop_unused_vertices();
        part
    };
    let parts = zones.iter().map(|(range, colour)| (part(range), *colour));
    parts.filter(|(mesh, _)| !mesh.triangles.is_empty()).collect()
}

/// The seam of a tennis ball: a closed curve that divides the sphere into two equal halves.
///
/// (a·cos t + b·cos 3t, a·sin t − b·sin 3t, 2·√(ab)·sin 2t) lies on the sphere of radius a + b.
fn seam(centre: &Point3<f64>, radius_m: f64) -> TriangleMesh {
    let (a, b) = (0.72 * radius_m, 0.28 * radius_m);
    let at = |i: usize| {
        let t = TAU * i as f64 / SEAM as f64;
        let height = 2.0 * (a * b).sqrt() * libm::sin(2.0 * t);
        Vector3::new(a * libm::cos(t) + b * libm::cos(3.0 * t), a * libm::sin(t) - b * libm::sin(3.0 * t), height)
    };
    let half = Vector3::new(0.028, 0.028, 0.0) * radius_m;
    let rings: Vec<TubeRing> = (0..=SEAM)
        .map(|i| {
            let out = at(i).normalize();
            let along = (at(i + 1) - at(i + SEAM - 1)).normalize();
            TubeRing { centre: centre + at(i), axes: [out, along.cross(&out)], semi_axes_m: [0.4 * half.x, half.y] }
        })
        .collect();
    TriangleMesh::tube(&rings, 6)
}
