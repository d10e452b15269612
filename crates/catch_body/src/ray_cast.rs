//! Intersection of rays with meshes.

mod arm_surface;

use nalgebra::{Point3, Vector3};
use obvhs::{
    aabb::Aabb,
    bvh2::reinsertion::ReinsertionOptimizer,
    cwbvh::{CwBvh, bvh2_to_cwbvh::bvh2_to_cwbvh},
    ploc::{PlocBuilder, PlocSearchDistance, SortPrecision},
    ray::{Ray, RayHit},
};

use crate::mesh::TriangleMesh;

pub use arm_surface::{ArmSurface, SurfacePart};

/// Amount by which the boxes of the hierarchy are widened, as a fraction of the mesh's radius. They are
/// crossed in single precision, whose rounding errors stay far below this, so no triangle that the ray meets
/// is ever passed over.
const BOX_PADDING: f64 = 1e-5;

/// A mesh prepared for ray casting in its own frame.
///
/// A bounding volume hierarchy in single precision finds the triangles, which are then intersected in double
/// precision with the unchanged ray. So the answer is the one that trying every triangle would give, bit for
/// bit, however far away the ray starts.
#[derive(Debug, Clone)]
pub struct RayCaster {
    hierarchy: CwBvh,
    /// The mesh, its triangles in the order in which the leaves of the hierarchy refer to them.
    pub mesh: TriangleMesh,
    triangles: Vec<Triangle>,
    /// Centre of a ball that holds the mesh.
    pub centre: Point3<f64>,
    /// Radius of the ball around [`Self::centre`] that holds the mesh.
    pub radius: f64,
    /// Half the size of a box around the centre that holds the mesh.
    pub half_size: Vector3<f64>,
}

impl RayCaster {
    /// Prepares a mesh.
    pub fn new(mesh: &TriangleMesh) -> Self {
        let around = mesh.aabb();
        let centre = around.centre;
        let radius = mesh.vertices.iter().map(|vertex| (vertex - centre).norm()).fold(0.0, f64::max);
        let padding = Vector3::repeat(radius * BOX_PADDING);
        let boxes: Vec<Aabb> = mesh
            .all_corners()
            .map(|corners| {
                let [a, b, c] = corners.map(|corner| corner - centre);
                let single = |corner: Vector3<f64>| <[f32; 3]>::from(corner.cast::<f32>()).into();
                Aabb::new(single(a.inf(&b).inf(&c) - padding), single(a.sup(&b).sup(&c) + padding))
            })
            .collect();
        let order: Vec<u32> = (0..).take(boxes.len()).collect();
        let mut binary = PlocBuilder::with_capacity(boxes.len()).build(
            PlocSearchDistance::Medium,
            &boxes,
            order,
            SortPrecision::U64,
            0,
        );
        ReinsertionOptimizer::default().run(&mut binary, 0.1, None);
        let hierarchy = bvh2_to_cwbvh(&binary, 3, true, false);
        let order = hierarchy.primitive_indices.iter().map(|&index| index as usize);
        let triangles = order.clone().map(|index| Triangle::new(mesh.corners(index))).collect();
        let in_order = order.map(|index| mesh.triangles[index]).collect();
        let mesh = TriangleMesh { vertices: mesh.vertices.clone(), triangles: in_order };
        let half_size = (around.size / 2.0).add_scalar(radius * BOX_PADDING);
        Self { hierarchy, mesh, triangles, centre, radius, half_size }
    }

    /// Outward normal of a triangle of [`Self::mesh`], of length one.
    pub fn normal(&self, triangle: usize) -> Vector3<f64> {
        let [e1, e2] = self.triangles[triangle].edges;
        e1.cross(&e2).normalize()
    }

    /// Where a ray meets a triangle of [`Self::mesh`].
    pub fn cast_at(&self, triangle: usize, origin: &Point3<f64>, direction: &Vector3<f64>) -> Option<Hit> {
        self.triangles[triangle].intersect(origin, direction).map(|t| Hit { t, triangle })
    }

    /// The smallest t ≥ 0 at which origin + t·direction lies on the surface, seen from either side; `None` if
    /// there is none.
    ///
    /// The direction may have any length but zero: t counts in its multiples, metres for a unit vector.
    pub fn cast(&self, origin: &Point3<f64>, direction: &Vector3<f64>) -> Option<f64> {
        self.cast_within(origin, direction, f64::INFINITY).map(|hit| hit.t)
    }

    /// Casts a ray as [`Self::cast`] does, but only as far as `limit`, which spares searching behind it. Of
    /// triangles that are equally near the first of [`Self::mesh`] is hit.
    pub fn cast_within(&self, origin: &Point3<f64>, direction: &Vector3<f64>, limit: f64) -> Option<Hit> {
        let (start, squared) = (origin - self.centre, direction.norm_squared());
        let nearest = -start.dot(direction) / squared;
        let miss = (start + direction * nearest).norm_squared();
        if self.triangles.is_empty() || miss > self.radius * self.radius * (1.0 + 1e-9) {
            return None;
        }
        let speed = squared.sqrt();
        if nearest - self.radius / speed > limit * (1.0 + 1e-9) {
            return None;
        }
        // A ray that passes the ball may still pass the box, which costs less to find out than the traversal
        // does.
        let (mut enters, mut leaves) = (f64::NEG_INFINITY, limit);
        for axis in 0..3 {
            let inverse = 1.0 / direction[axis];
            let near = (-self.half_size[axis] - start[axis]) * inverse;
            let far = (self.half_size[axis] - start[axis]) * inverse;
            // A ray within a face gives a number that is none, which neither function heeds.
            enters = enters.max(near.min(far));
            leaves = leaves.min(near.max(far));
        }
        if enters > leaves {
            return None;
        }
        // The traversal starts just outside the ball around the mesh, where single precision is fine.
        let entry = nearest - 1.5 * self.radius / speed;
        let single = |vector: Vector3<f64>| <[f32; 3]>::from(vector.cast::<f32>()).into();
        // The traversal skips boxes that begin behind a bound, which is rounded up so that rounding hides
        // nothing.
        let bound = |t: f64| ((t - entry) * speed + self.radius * BOX_PADDING) as f32;
        // Adding zero turns −0 into +0, of which the traversal would take the sign for a direction.
        let along = single((direction / speed).add_scalar(0.0));
        let ray = Ray::new(single(start + direction * entry), along, 0.0, bound(limit));

        let mut first = Hit { t: limit, triangle: 0 };
        self.hierarchy.ray_traverse(ray, &mut RayHit::none(), |_, triangle| {
            match self.cast_at(triangle, origin, direction) {
                Some(hit) if hit.is_before(&first) => {
                    first = hit;
                    bound(hit.t)
                }
                _ => f32::INFINITY,
            }
        });
        (first.t < limit).then_some(first)
    }
}

/// Where a ray meets a mesh.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Hit {
    /// Parameter of the ray, in multiples of its direction.
    pub t: f64,
    /// Number of the triangle in [`RayCaster::mesh`].
    pub triangle: usize,
}

impl Hit {
    /// Returns whether it is nearer than another, or as near and on an earlier triangle.
    pub fn is_before(&self, other: &Self) -> bool {
        self.t < other.t || (self.t == other.t && self.triangle < other.triangle)
    }
}

/// A corner and the edges from it.
#[derive(Debug, Clone, Copy)]
struct Triangle {
    corner: Point3<f64>,
    edges: [Vector3<f64>; 2],
}

impl Triangle {
    fn new([a, b, c]: [Point3<f64>; 3]) -> Self {
        Self { corner: a, edges: [b - a, c - a] }
    }

    /// The ray parameter t ≥ 0 where the ray crosses the triangle, from either side.
    ///
    /// Solves o + t·d = a + u·e₁ + v·e₂ by Cramer's rule (Möller & Trumbore, Fast, minimum storage
    /// ray/triangle intersection, 1997).
    fn intersect(&self, origin: &Point3<f64>, direction: &Vector3<f64>) -> Option<f64> {
        // A ray through an edge must hit at least one of its two triangles, whatever the rounding.
        const SLACK: f64 = 1e-9;
        const WITHIN: std::ops::RangeInclusive<f64> = -SLACK..=1.0 + SLACK;
        let [e1, e2] = self.edges;
        let p = direction.cross(&e2);
        // A ray within the triangle's plane makes this infinite and what follows undefined, which is within
        // no range.
        let inverse = 1.0 / e1.dot(&p);
        let s = origin - self.corner;
        let u = s.dot(&p) * inverse;
        if !WITHIN.contains(&u) {
            return None;
        }
        let q = s.cross(&e1);
        let v = direction.dot(&q) * inverse;
        if !(v >= -SLACK && WITHIN.contains(&(u + v))) {
            return None;
        }
        let t = e2.dot(&q) * inverse;
        (t >= 0.0 && t.is_finite()).then_some(t)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::shape::{Capsule, Cuboid};
    use proptest::prelude::*;
    use std::sync::LazyLock;

    fn meshes() -> Vec<TriangleMesh> {
        let capsule = Capsule { from: Point3::new(0.1, 0.0, 0.2), to: Point3::new(0.1, 0.3, 0.2), radius: 0.05 };
        let mut two =
            TriangleMesh::cuboid(&Cuboid { centre: Point3::new(0.0, 0.3, 0.0), size: Vector3::new(0.3, 0.1, 0.2) });
        two.merge(&TriangleMesh::capsule(&capsule, 24));
        let single = TriangleMesh {
            vertices: vec![Point3::origin(), Point3::new(0.1, 0.0, 0.0), Point3::new(0.0, 0.1, 0.0)],
            triangles: vec![[0, 1, 2]],
        };
        vec![
            TriangleMesh::sphere(0.05, 3),
            TriangleMesh::cuboid(&Cuboid { centre: Point3::origin(), size: Vector3::repeat(0.2) }),
            two,
            single,
        ]
    }

    fn brute_force(mesh: &TriangleMesh, origin: &Point3<f64>, direction: &Vector3<f64>) -> Option<f64> {
        mesh.all_corners()
            .filter_map(|corners| Triangle::new(corners).intersect(origin, direction))
            .min_by(f64::total_cmp)
    }

    #[test]
    fn nothing_is_hit_where_nothing_is() {
        let caster = RayCaster::new(&TriangleMesh::default());
        assert_eq!(caster.cast(&Point3::origin(), &Vector3::x()), None);
    }

    /// Axis-parallel rays in the planes of faces and along edges are where hierarchies go wrong.
    #[test]
    fn grazing_rays_hit_what_every_triangle_tried_alone_would() {
        for mesh in meshes() {
            let caster = RayCaster::new(&mesh);
            let mut targets = mesh.vertices.clone();
            targets.extend(mesh.all_corners().map(|[a, b, _]| nalgebra::center(&a, &b)));
            for target in targets {
                for direction in [Vector3::x(), -Vector3::y(), Vector3::z(), Vector3::new(1.0, 1.0, 0.0)] {
                    let origin = target - direction * 3.0;
                    assert_eq!(caster.cast(&origin, &direction), brute_force(&mesh, &origin, &direction));
                }
            }
        }
    }

    proptest! {
        #[test]
        fn cast_is_brute_force_bit_for_bit(
            origin in prop::array::uniform3(-1.0f64..1.0),
            away in prop_oneof![Just(0.1), Just(1.0), Just(7.0)],
            target in prop::array::uniform3(-0.2f64..0.2),
            length in 0.1f64..10.0,
        ) {
            let origin = Point3::from(origin) * away;
            let direction = (Point3::from(target) - origin) * length;
            static PREPARED: LazyLock<Vec<(TriangleMesh, RayCaster)>> =
                LazyLock::new(|| meshes().into_iter().map(|mesh| (mesh.clone(), RayCaster::new(&mesh))).collect());
            for (mesh, caster) in PREPARED.iter() {
                let expected = brute_force(mesh, &origin, &direction);
                prop_assert_eq!(caster.cast(&origin, &direction), expected);
                for limit in [0.5, 1.0, 1.0 + 1e-12].map(|part| part * expected.unwrap_or(1.0)) {
                    let before = expected.filter(|t| *t < limit);
                    prop_assert_eq!(caster.cast_within(&origin, &direction, limit).map(|hit| hit.t), before);
                }
            }
        }

        /// The distance from 7 m is that of the ball, but for its facets, which are 10 µm inside the sphere.
        #[test]
        fn far_sphere_is_where_it_is(direction in prop::array::uniform3(-1.0f64..1.0), offset in prop::array::uniform3(-0.02f64..0.02)) {
            let direction = Vector3::from(direction);
            prop_assume!(direction.norm() > 0.1);
            let direction = direction.normalize();
            let radius = 0.05;
            static BALL: LazyLock<RayCaster> = LazyLock::new(|| RayCaster::new(&TriangleMesh::sphere(0.05, 5)));
            let origin = Point3::from(offset) - direction * 7.0;
            // |o + t·d|² = r²
            let along = -origin.coords.dot(&direction);
            let expected = along - (along * along - origin.coords.norm_squared() + radius * radius).sqrt();
            let found = BALL.cast(&origin, &direction).unwrap();
            prop_assert!((found - expected).abs() < 20e-6, "{} µm off", (found - expected) * 1e6);
        }
    }
}
