//! Meshes of simple solids. All are closed and face outwards.

use std::{
    collections::HashMap,
    f64::consts::{FRAC_PI_2, TAU},
};

use nalgebra::{Point3, Vector3};

use super::{TriangleMesh, index};
use crate::shape::{Capsule, Cuboid};

/// An elliptic cross-section of a tube.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TubeRing {
    /// Centre of the ellipse.
    pub centre: Point3<f64>,
    /// Directions of its two axes, perpendicular unit vectors; neighbouring rings should have similar ones.
    pub axes: [Vector3<f64>; 2],
    /// Half lengths along the ellipse's axes.
    pub semi_axes_m: [f64; 2],
}

impl TriangleMesh {
    /// A ball around the origin: an icosahedron whose triangles are cut into four `subdivisions` times, all
    /// vertices on the sphere.
    pub fn sphere(radius_m: f64, subdivisions: u32) -> Self {
        let golden = f64::midpoint(1.0, 5.0_f64.sqrt());
        let mut directions: Vec<Vector3<f64>> = Vec::new();
        for (a, b) in [(1.0, golden), (-1.0, golden), (1.0, -golden), (-1.0, -golden)] {
            directions.extend([Vector3::new(0.0, a, b), Vector3::new(a, b, 0.0), Vector3::new(b, 0.0, a)]);
        }
        directions.iter_mut().for_each(|direction| *direction = direction.normalize());

        // The faces of the icosahedron are the triples of neighbours; neighbours have 63.4° between them.
        let neighbours = |i: usize, j: usize| directions[i].dot(&directions[j]) > 0.4;
        let mut triangles = Vec::new();
        for a in 0..12 {
            for b in a + 1..12 {
                for c in b + 1..12 {
                    if neighbours(a, b) && neighbours(b, c) && neighbours(a, c) {
                        let outwards = directions[a].dot(&directions[b].cross(&directions[c])) > 0.0;
                        triangles.push(if outwards { [a, b, c] } else { [a, c, b] }.map(index));
                    }
                }
            }
        }

        for _ in 0..subdivisions {
            let mut middles = HashMap::new();
            let mut finer = Vec::with_capacity(triangles.len() * 4);
            for &[a, b, c] in &triangles {
                let [ab, bc, ca] = [(a, b), (b, c), (c, a)].map(|(from, to): (u32, u32)| {
                    *middles.entry((from.min(to), from.max(to))).or_insert_with(|| {
                        directions.push((directions[from as usize] + directions[to as usize]).normalize());
                        index(directions.len() - 1)
                    })
                });
                finer.extend([[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]]);
            }
            triangles = finer;
        }
        let vertices = directions.iter().map(|direction| Point3::from(direction * radius_m)).collect();
        Self { vertices, triangles }
    }

    /// A box of twelve triangles.
    pub fn cuboid(cuboid: &Cuboid) -> Self {
        let corner = |i: usize| {
            let side = |axis: usize| if i >> axis & 1 == 0 { -0.5 } else { 0.5 };
            cuboid.centre + Vector3::new(side(0), side(1), side(2)).component_mul(&cuboid.size)
        };
        let quads = [[0, 4, 6, 2], [1, 3, 7, 5], [0, 1, 5, 4], [2, 6, 7, 3], [0, 2, 3, 1], [4, 5, 7, 6]];
        let triangles = quads.iter().flat_map(|&[a, b, c, d]| [[a, b, c], [a, c, d]]).collect();
        Self { vertices: (0..8).map(corner).collect(), triangles }
    }

    /// A capsule, `segments` flat strips around its axis.
    pub fn capsule(capsule: &Capsule, segments: u32) -> Self {
        let along = capsule.to - capsule.from;
        let length = along.norm();
        let arcs = (segments / 4).max(1);
        let at = |z: f64, i: u32| {
            let angle = FRAC_PI_2 * f64::from(i) / f64::from(arcs);
            // The poles are exactly on the axis, which the cosine is not.
            let r = if i == arcs { 0.0 } else { capsule.radius * libm::cos(angle) };
            [z + capsule.radius * libm::sin(angle).copysign(if z > 0.0 { 1.0 } else { -1.0 }), r]
        };
        let lower = (0..=arcs).rev().map(|i| at(0.0, i));
        // Two equal rings would make triangles without area: a capsule of no length is a ball.
        let upper = (u32::from(length <= 0.0)..=arcs).map(|i| at(length.max(f64::MIN_POSITIVE), i));
        let profile: Vec<[f64; 2]> = lower.chain(upper).collect();
        Self::revolution(&profile, segments).transformed(&capsule.frame())
    }

    /// The surface that lies below a capsule by `depths_mm`: rings of equally many points from pole to pole,
    /// at equal distances along the capsule, the poles being one point each.
    pub fn below_capsule(capsule: &Capsule, depths_mm: &[Vec<f64>]) -> Self {
        let X_LC = capsule.frame();
        let mut mesh = Self::default();
        let mut previous: Option<Vec<u32>> = None;
        for (i, ring) in depths_mm.iter().enumerate() {
            let first = index(mesh.vertices.len());
            let along = i as f64 / (depths_mm.len() - 1) as f64;
            mesh.vertices.extend(ring.iter().enumerate().map(|(k, depth_mm)| {
                let (axis, outwards) = capsule.surface_point([along, k as f64 / ring.len() as f64]);
                X_LC * (axis + outwards * (capsule.radius - depth_mm * 1e-3))
            }));
            let ring: Vec<u32> = (first..index(mesh.vertices.len())).collect();
            if let Some(previous) = previous.replace(ring.clone()) {
                mesh.join_rings(&previous, &ring);
            }
        }
        mesh
    }

    /// The solid that a `profile` of points (z, r) sweeps around the z axis, cut into `segments` flat strips.
    /// Ends at a radius above zero are closed by a disc.
    pub fn revolution(profile: &[[f64; 2]], segments: u32) -> Self {
        let rings: Vec<TubeRing> = profile
            .iter()
            .map(|&[z, r]| TubeRing {
                centre: Point3::new(0.0, 0.0, z),
                axes: [Vector3::x(), Vector3::y()],
                semi_axes_m: [r; 2],
            })
            .collect();
        Self::tube(&rings, segments)
    }

    /// A tube through elliptic cross-sections, `segments` flat strips around it, its ends closed. A ring
    /// whose half axes are zero is a single point.
    pub fn tube(rings: &[TubeRing], segments: u32) -> Self {
        let segments = segments.max(3);
        let mut mesh = Self::default();
        let mut previous: Option<Vec<u32>> = None;
        for (i, ring) in rings.iter().enumerate() {
            let current = mesh.add_ring(ring, segments);
            if let Some(previous) = &previous {
                mesh.join_rings(previous, &current);
            }
            if i == 0 || i + 1 == rings.len() {
                let centre = mesh.add_ring(&TubeRing { semi_axes_m: [0.0; 2], ..*ring }, segments);
                if current.len() > 1 && i == 0 {
                    mesh.join_rings(&centre, &current);
                } else if current.len() > 1 {
                    mesh.join_rings(&current, &centre);
                } else {
                    mesh.vertices.pop();
                }
            }
            previous = Some(current);
        }
        mesh.facing_outwards()
    }

    /// Adds a ring's vertices and returns their indices: one if the ring is a point.
    fn add_ring(&mut self, ring: &TubeRing, segments: u32) -> Vec<u32> {
        let first = index(self.vertices.len());
        if ring.semi_axes_m == [0.0; 2] {
            self.vertices.push(ring.centre);
            return vec![first];
        }
        for i in 0..segments {
            let (sin, cos) = libm::sincos(TAU * f64::from(i) / f64::from(segments));
            let [a, b] = ring.semi_axes_m;
            self.vertices.push(ring.centre + ring.axes[0] * (a * cos) + ring.axes[1] * (b * sin));
        }
        (first..first + segments).collect()
    }

    /// Spans triangles between two rings, of which one may be a point.
    fn join_rings(&mut self, lower: &[u32], upper: &[u32]) {
        let segments = lower.len().max(upper.len());
        for i in 0..segments {
            let at = |ring: &[u32], i: usize| ring[i % ring.len()];
            let (a, b, c, d) = (at(lower, i), at(lower, i + 1), at(upper, i + 1), at(upper, i));
            if a != b {
                self.triangles.push([a, b, c]);
            }
            if c != d {
                self.triangles.push([a, c, d]);
            }
        }
    }
}
