//! Triangle meshes: the shapes of thrown objects and of the arm, and what follows from a shape.

mod simplification;
mod solids;

use std::collections::HashMap;

use nalgebra::{Matrix3, Point3, Vector3};

use crate::{inertia::Inertia, pose::Pose, shape::Cuboid};

pub use solids::TubeRing;

/// A surface of triangles.
///
/// Seen from outside the corners of a triangle run counter-clockwise. Coordinates are in metres, in the frame
/// of whatever body the mesh belongs to.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct TriangleMesh {
    /// Corner points.
    pub vertices: Vec<Point3<f64>>,
    /// Three indices into `vertices` per triangle.
    pub triangles: Vec<[u32; 3]>,
}

impl TriangleMesh {
    /// The corners of triangle `index`.
    pub fn corners(&self, index: usize) -> [Point3<f64>; 3] {
        self.triangles[index].map(|vertex| self.vertices[vertex as usize])
    }

    /// The corners of all triangles.
    pub fn all_corners(&self) -> impl Iterator<Item = [Point3<f64>; 3]> {
        (0..self.triangles.len()).map(|index| self.corners(index))
    }

    /// Transforms the surface to another frame: `X_AB` is the pose of the mesh's present frame B in the new
    /// frame A.
    pub fn transformed(mut self, X_AB: &Pose) -> Self {
        for vertex in &mut self.vertices {
            *vertex = X_AB * *vertex;
        }
        self
    }

    /// Shifts the surface by `offset_m`.
    pub fn translated(mut self, offset_m: &Vector3<f64>) -> Self {
        for vertex in &mut self.vertices {
            *vertex += offset_m;
        }
        self
    }

    /// One surface of several, which are given in the same frame, by [`merge`](Self::merge).
    pub fn merged(surfaces: impl IntoIterator<Item = Self>) -> Self {
        let first = |mut all: Self, next: Self| {
            all.merge(&next);
            all
        };
        surfaces.into_iter().reduce(first).unwrap_or_default()
    }

    /// Adds the triangles of `other`, which is given in the same frame. Neither surface is cut where they
    /// meet.
    pub fn merge(&mut self, other: &Self) {
        let first = index(self.vertices.len());
        self.vertices.extend_from_slice(&other.vertices);
        self.triangles.extend(other.triangles.iter().map(|triangle| triangle.map(|vertex| vertex + first)));
    }

    /// Radius of the smallest ball around the origin that holds the mesh.
    pub fn bounding_radius(&self) -> f64 {
        self.vertices.iter().map(|vertex| vertex.coords.norm()).fold(0.0, f64::max)
    }

    /// The smallest box along the axes that holds the mesh; a mesh without vertices has an empty one at the
    /// origin.
    pub fn aabb(&self) -> Cuboid {
        let Some(first) = self.vertices.first() else {
            return Cuboid { centre: Point3::origin(), size: Vector3::zeros() };
        };
        let low = self.vertices.iter().fold(first.coords, |low, vertex| low.inf(&vertex.coords));
        let high = self.vertices.iter().fold(first.coords, |high, vertex| high.sup(&vertex.coords));
        Cuboid { centre: Point3::from((low + high) / 2.0), size: high - low }
    }

    /// Returns whether the surface encloses a solid: as many triangles run along each edge in one direction
    /// as in the other. Mostly that is one; where parts of a solid touch along an edge it is two.
    pub fn is_closed(&self) -> bool {
        let mut uses: HashMap<(u32, u32), (u32, u32)> = HashMap::new();
        for &[a, b, c] in &self.triangles {
            for (from, to) in [(a, b), (b, c), (c, a)] {
                if from == to {
                    return false;
                }
                let (forth, back) = uses.entry((from.min(to), from.max(to))).or_default();
                *(if from < to { forth } else { back }) += 1;
            }
        }
        !uses.is_empty() && uses.values().all(|(forth, back)| forth == back)
    }

    /// The enclosed volume in m³, negative if the triangles are turned inside out.
    ///
    /// By the divergence theorem it is the sum of the signed tetrahedra from a fixed point to each triangle.
    pub fn volume(&self) -> f64 {
        let Some(apex) = self.vertices.first() else { return 0.0 };
        self.all_corners().map(|corners| tetrahedron(apex, &corners).0).sum()
    }

    /// Mass, centre of mass and inertia of the enclosed solid at uniform density; the mesh must be closed.
    ///
    /// Each signed tetrahedron (p₀, p₁, p₂, p₃) of volume V has the first moment V·(Σ pᵢ)/4 and the second
    /// moment ∫ p·pᵀ dV = V/20·(Σ pᵢ·pᵢᵀ + (Σ pᵢ)·(Σ pᵢ)ᵀ); the inertia is tr(C)·1 − C of the summed second
    /// moment C (Blow & Binstock, How to find the inertia tensor of a 3D solid body represented by a triangle
    /// mesh, 2004).
    ///
    /// # Panics
    /// If the mesh encloses no volume, which a mesh that was read from a file or built here always does.
    pub fn mass_properties(&self, mass_kg: f64) -> Inertia {
        let (mut volume, mut first_moment, mut second_moment) = (0.0, Vector3::zeros(), Matrix3::zeros());
        // Taking the moments about a point of the mesh keeps them exact for a mesh far from the origin.
        let apex = self.vertices.first().copied().unwrap_or_default();
        for corners in self.all_corners() {
            let (part, [a, b, c]) = tetrahedron(&apex, &corners);
            let sum = a + b + c;
            volume += part;
            first_moment += sum * (part / 4.0);
            second_moment +=
                (a * a.transpose() + b * b.transpose() + c * c.transpose() + sum * sum.transpose()) * (part / 20.0);
        }
        assert!(volume > 0.0, "a mesh with mass must enclose a volume, this one has {volume} m³");
        let com = first_moment / volume;
        let covariance = (second_moment / volume - com * com.transpose()) * mass_kg;
        let about_com = Matrix3::identity() * covariance.trace() - covariance;
        Inertia { mass: mass_kg, com: apex + com, about_com }
    }

    /// Moves the surface outwards by `offset_m`: each vertex to where the planes of its triangles meet then.
    pub fn thicker(&self, offset_m: f64) -> Self {
        // Flat surroundings leave a vertex free along them: there it stays, as a weight against the planes.
        const STAYS: f64 = 1e-3;
        /// Sharp edges grow by no more than so many offsets.
        const MOST_GROWTH: f64 = 3.0;
        let mut planes = vec![(Matrix3::zeros(), Vector3::zeros()); self.vertices.len()];
        for ([a, b, c], triangle) in self.all_corners().zip(&self.triangles) {
            let normal = (b - a).cross(&(c - a));
            let unit = normal.try_normalize(0.0).unwrap_or_default();
            for vertex in triangle {
                let (normals, sum) = &mut planes[*vertex as usize];
                *normals += unit * normal.transpose();
                *sum += normal;
            }
        }
        let moved = |(vertex, (normals, sum)): (&Point3<f64>, &(Matrix3<f64>, Vector3<f64>))| {
            let stiffness = normals + Matrix3::identity() * (STAYS * normals.trace());
            let by = stiffness.cholesky().map(|it| it.solve(sum)).unwrap_or_default();
            vertex + by.cap_magnitude(MOST_GROWTH) * offset_m
        };
        Self { vertices: self.vertices.iter().zip(&planes).map(moved).collect(), triangles: self.triangles.clone() }
    }

    /// Leaves out vertices that are a corner of no triangle.
    pub fn drop_unused_vertices(&mut self) {
        let mut number = vec![u32::MAX; self.vertices.len()];
        let mut used = Vec::new();
        for corner in self.triangles.iter_mut().flatten() {
            let kept = &mut number[*corner as usize];
            if *kept == u32::MAX {
                *kept = index(used.len());
                used.push(self.vertices[*corner as usize]);
            }
            *corner = *kept;
        }
        self.vertices = used;
    }

    /// Flips the triangles, if need be, so that they face outwards.
    pub fn facing_outwards(mut self) -> Self {
        if self.volume() < 0.0 {
            for triangle in &mut self.triangles {
                triangle.swap(1, 2);
            }
        }
        self
    }
}

/// The signed volume of the tetrahedron from `apex` to a triangle, and the triangle's corners relative to
/// `apex`.
fn tetrahedron(apex: &Point3<f64>, corners: &[Point3<f64>; 3]) -> (f64, [Vector3<f64>; 3]) {
    let [a, b, c] = corners.map(|corner| corner - apex);
    (a.dot(&b.cross(&c)) / 6.0, [a, b, c])
}

/// A count of vertices as an index.
fn index(count: usize) -> u32 {
    u32::try_from(count).expect("a mesh has fewer than 2³² vertices")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::shape::Capsule;
    use approx::assert_relative_eq;
    use nalgebra::UnitQuaternion;
    use proptest::prelude::*;
    use std::f64::consts::PI;

    fn moments(inertia: &Inertia) -> [f64; 3] {
        [inertia.about_com[(0, 0)], inertia.about_com[(1, 1)], inertia.about_com[(2, 2)]]
    }

    #[test]
    fn mass_properties_of_a_cuboid_are_exact() {
        let cuboid = Cuboid { centre: Point3::new(0.4, -0.2, 0.1), size: Vector3::new(0.1, 0.2, 0.3) };
        let mesh = TriangleMesh::cuboid(&cuboid);
        assert!(mesh.is_closed());
        assert_relative_eq!(mesh.aabb().centre, cuboid.centre, epsilon = 1e-12);
        assert_relative_eq!(mesh.aabb().size, cuboid.size, epsilon = 1e-12);
        let inertia = mesh.mass_properties(2.0);
        let expected = Inertia::of_box(2.0, &cuboid.size, cuboid.centre);
        assert_relative_eq!(inertia.com, expected.com, epsilon = 1e-12);
        assert_relative_eq!(inertia.about_com, expected.about_com, epsilon = 1e-12);
    }

    #[test]
    fn mass_properties_of_a_sphere_approach_the_closed_form() {
        let (mass, radius) = (0.058, 0.0336);
        let mesh = TriangleMesh::sphere(radius, 5);
        assert!(mesh.is_closed());
        assert_relative_eq!(mesh.volume(), 4.0 / 3.0 * PI * radius.powi(3), max_relative = 2e-3);
        let inertia = mesh.mass_properties(mass);
        assert!(inertia.com.coords.norm() < 1e-12);
        for moment in moments(&inertia) {
            assert_relative_eq!(moment, 0.4 * mass * radius * radius, max_relative = 2e-3);
        }
    }

    #[test]
    fn mass_properties_of_a_cylinder_approach_the_closed_form() {
        let (mass, radius, length) = (0.1, 0.0254, 0.0786);
        let mesh = TriangleMesh::revolution(&[[0.01, radius], [0.01 + length, radius]], 200);
        assert!(mesh.is_closed());
        let inertia = mesh.mass_properties(mass);
        assert_relative_eq!(inertia.com, Point3::new(0.0, 0.0, 0.01 + length / 2.0), epsilon = 1e-12);
        let across = mass * (3.0 * radius * radius + length * length) / 12.0;
        for (moment, expected) in moments(&inertia).iter().zip([across, across, 0.5 * mass * radius * radius]) {
            assert_relative_eq!(*moment, expected, max_relative = 1e-3);
        }
    }

    #[test]
    fn capsule_has_the_volume_of_a_cylinder_and_a_ball() {
        let capsule = Capsule { from: Point3::new(0.1, 0.2, 0.3), to: Point3::new(0.1, 0.5, 0.7), radius: 0.1 };
        let mesh = TriangleMesh::capsule(&capsule, 128);
        assert!(mesh.is_closed());
        assert_relative_eq!(mesh.volume(), PI * 0.01 * 0.5 + 4.0 / 3.0 * PI * 0.001, max_relative = 2e-3);
        let furthest = mesh.vertices.iter().map(|p| (p - capsule.from).norm()).fold(0.0, f64::max);
        assert_relative_eq!(furthest, 0.6, epsilon = 1e-9);
    }

    #[test]
    fn a_bent_tube_is_closed_and_has_the_volume_of_its_torus_segment() {
        let (bend, radius) = (0.1, 0.02);
        let rings: Vec<TubeRing> = (0..=64)
            .map(|i| {
                let angle = PI / 2.0 * f64::from(i) / 64.0;
                let outwards = Vector3::new(libm::cos(angle), libm::sin(angle), 0.0);
                TubeRing {
                    centre: Point3::from(outwards * bend),
                    axes: [outwards, Vector3::z()],
                    semi_axes_m: [radius; 2],
                }
            })
            .collect();
        let mesh = TriangleMesh::tube(&rings, 64);
        assert!(mesh.is_closed());
        // Pappus: the area of the disc times the way of its centre.
        assert_relative_eq!(mesh.volume(), PI * radius * radius * bend * PI / 2.0, max_relative = 2e-3);
    }

    #[test]
    fn a_surface_below_a_capsule_is_as_deep_as_stated_and_closed() {
        let capsule = Capsule { from: Point3::new(0.1, 0.2, 0.3), to: Point3::new(0.1, 0.5, 0.7), radius: 0.1 };
        let ring = |i: u32| (0..24).map(|k| f64::from((7 * i + k) % 30)).collect();
        let depths_mm: Vec<Vec<f64>> = std::iter::once(vec![3.0]).chain((0..20).map(ring)).chain([vec![5.0]]).collect();
        let mesh = TriangleMesh::below_capsule(&capsule, &depths_mm);
        for (vertex, depth_mm) in mesh.vertices.iter().zip(depths_mm.concat()) {
            assert_relative_eq!(capsule.distance_to_point(vertex), -depth_mm * 1e-3, epsilon = 1e-12);
        }
        assert!(mesh.is_closed());
        let none: Vec<Vec<f64>> = depths_mm.iter().map(|it| vec![0.0; it.len()]).collect();
        let whole = TriangleMesh::capsule(&capsule, 128).volume();
        assert_relative_eq!(TriangleMesh::below_capsule(&capsule, &none).volume(), whole, max_relative = 0.03);
    }

    #[test]
    fn a_thicker_solid_is_larger_all_around() {
        let size = Vector3::new(0.1, 0.2, 0.3);
        let cuboid = TriangleMesh::cuboid(&Cuboid { centre: Point3::new(0.3, 0.0, 0.1), size });
        for offset_m in [0.01, -0.004] {
            let thicker = cuboid.thicker(offset_m).aabb();
            assert_relative_eq!(thicker.size, size.add_scalar(2.0 * offset_m), epsilon = 1e-4);
            let capsule = Capsule { from: Point3::origin(), to: Point3::new(0.0, 0.1, 0.3), radius: 0.05 };
            let mesh = TriangleMesh::capsule(&capsule, 48).thicker(offset_m);
            let off_m = mesh.vertices.iter().map(|it| (capsule.distance_to_point(it) - offset_m).abs());
            assert!(off_m.fold(0.0, f64::max) < 2e-4);
        }
        assert_eq!(cuboid.thicker(0.0), cuboid);
    }

    #[test]
    fn a_missing_triangle_opens_a_mesh() {
        let mut mesh = TriangleMesh::sphere(1.0, 1);
        mesh.triangles.pop();
        assert!(!mesh.is_closed());
        assert!(!TriangleMesh::default().is_closed());
    }

    proptest! {
        /// Moving a solid moves its mass properties as it moves any rigid body.
        #[test]
        fn mass_properties_move_with_the_mesh(
            offset in prop::array::uniform3(-5.0f64..5.0),
            turn in prop::array::uniform3(-3.0f64..3.0),
        ) {
            let X_AB = Pose::from_parts(offset.into(), UnitQuaternion::from_scaled_axis(turn.into()));
            let mesh = TriangleMesh::revolution(&[[-0.1, 0.0], [0.0, 0.05], [0.2, 0.03]], 7);
            let expected = mesh.mass_properties(0.3).transformed(&X_AB);
            let inertia = mesh.transformed(&X_AB).mass_properties(0.3);
            prop_assert!((inertia.com - expected.com).norm() < 1e-12);
            prop_assert!((inertia.about_com - expected.about_com).norm() < 1e-12);
        }
    }
}
