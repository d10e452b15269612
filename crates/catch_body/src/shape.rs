//! Simple solids and the distances between them.

use std::f64::consts::{FRAC_PI_2, PI, TAU};

use nalgebra::{Matrix3, Point3, Translation3, UnitQuaternion, Vector3};

use crate::pose::Pose;

/// A cylinder with hemispherical ends: all points within `radius` of a segment.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Capsule {
    /// First end of the segment, in metres.
    pub from: Point3<f64>,
    /// Second end of the segment, in metres.
    pub to: Point3<f64>,
    /// Radius in metres.
    pub radius: f64,
}

/// A box along the axes of its frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Cuboid {
    /// Centre in metres.
    pub centre: Point3<f64>,
    /// Full extents in metres.
    pub size: Vector3<f64>,
}

impl Capsule {
    /// Capsule in another frame: `X_AB` is the pose of its present frame B in the new frame A.
    pub fn transformed(&self, X_AB: &Pose) -> Self {
        Self { from: X_AB * self.from, to: X_AB * self.to, radius: self.radius }
    }

    /// The middle of the segment.
    pub fn centre(&self) -> Point3<f64> {
        nalgebra::center(&self.from, &self.to)
    }

    /// Radius of the ball around [`Self::centre`] that holds the capsule.
    pub fn bounding_radius(&self) -> f64 {
        (self.to - self.from).norm() / 2.0 + self.radius
    }

    /// The frame of the capsule: its origin is the first end of the segment, which goes along z.
    pub fn frame(&self) -> Pose {
        let turn = UnitQuaternion::rotation_between(&Vector3::z(), &(self.to - self.from))
            .unwrap_or_else(|| UnitQuaternion::from_axis_angle(&Vector3::x_axis(), PI));
        Pose::from_parts(Translation3::from(self.from), turn)
    }

    /// The point of the segment below a point of the surface, and the direction from there to the surface; in
    /// [`Self::frame`]. The fractions are of the way along the surface from pole to pole, and of the turn
    /// about the segment from x towards y.
    pub fn surface_point(&self, [along, around]: [f64; 2]) -> (Point3<f64>, Vector3<f64>) {
        let length = (self.to - self.from).norm();
        let cap = FRAC_PI_2 * self.radius;
        let way = along * (length + 2.0 * cap) - cap;
        let z = way.clamp(0.0, length);
        let (up, across) = libm::sincos((way - z) / self.radius);
        let (sin, cos) = libm::sincos(TAU * around);
        (Point3::new(0.0, 0.0, z), Vector3::new(across * cos, across * sin, up))
    }

    /// Vector to a point from the nearest one of the axis.
    pub fn from_axis(&self, point: &Point3<f64>) -> Vector3<f64> {
        let along = self.to - self.from;
        let s = ((point - self.from).dot(&along) / along.norm_squared().max(f64::MIN_POSITIVE)).clamp(0.0, 1.0);
        point - (self.from + along * s)
    }

    /// Distance of a point from the surface, negative inside.
    pub fn distance_to_point(&self, point: &Point3<f64>) -> f64 {
        self.from_axis(point).norm() - self.radius
    }

    /// Distance between the surfaces of two capsules, negative where they overlap.
    ///
    /// Minimizes |p₁ + s·d₁ − p₂ − t·d₂| over the unit square: the minimum for the two lines, s clamped, then
    /// the best t, clamped, then the best s (Ericson, Real-Time Collision Detection, 5.1.9).
    pub fn distance(&self, other: &Self) -> f64 {
        let (d1, d2, r) = (self.to - self.from, other.to - other.from, self.from - other.from);
        let (a, b, e) = (d1.norm_squared(), d1.dot(&d2), d2.norm_squared());
        let (c, f) = (d1.dot(&r), d2.dot(&r));
        let best_s = |t: f64| if a > 0.0 { ((b * t - c) / a).clamp(0.0, 1.0) } else { 0.0 };
        let best_t = |s: f64| if e > 0.0 { ((b * s + f) / e).clamp(0.0, 1.0) } else { 0.0 };
        let determinant = a * e - b * b;
        // Parallel segments have the same distance over a whole range of s; any start will do.
        let s = if determinant > 1e-12 * a * e { ((b * f - c * e) / determinant).clamp(0.0, 1.0) } else { 0.0 };
        let t = best_t(s);
        let s = best_s(t);
        (r + d1 * s - d2 * t).norm() - self.radius - other.radius
    }

    /// Distance between the surfaces of a capsule and a box in the same frame; where the segment itself
    /// enters the box, minus the capsule's radius.
    ///
    /// With p(t) on the segment and h half the box's size, half the squared distance has the derivative g(t)
    /// = Σ dᵢ·(pᵢ(t) − clamp(pᵢ(t), −hᵢ, hᵢ)), which is piecewise linear and never falls. Its kinks are where
    /// the segment crosses the planes of the six faces; between the two kinks around the sign change its zero
    /// is exact.
    pub fn distance_to_cuboid(&self, cuboid: &Cuboid) -> f64 {
        let half = cuboid.size / 2.0;
        let (start, d) = (self.from - cuboid.centre, self.to - self.from);
        let excess = |t: f64| (start + d * t).zip_map(&half, |p, h| p - p.clamp(-h, h));
        let slope = |t: f64| d.dot(&excess(t));
        let (mut low, mut high) = (0.0, 1.0);
        let (mut slope_low, mut slope_high) = (slope(low), slope(high));
        let t = if slope_low >= 0.0 {
            low
        } else if slope_high <= 0.0 {
            high
        } else {
            for axis in 0..3 {
                for face in [-half[axis], half[axis]] {
                    let t = (face - start[axis]) / d[axis];
                    if t > low && t < high {
                        let slope = slope(t);
                        if slope < 0.0 { (low, slope_low) = (t, slope) } else { (high, slope_high) = (t, slope) }
                    }
                }
            }
            low + (high - low) * slope_low / (slope_low - slope_high)
        };
        excess(t).norm() - self.radius
    }
}

impl Cuboid {
    /// Radius of the ball around the centre that holds the box.
    pub fn bounding_radius(&self) -> f64 {
        self.size.norm() / 2.0
    }

    /// Distance of the farthest corner from the origin of the frame that the box is given in.
    pub fn farthest_corner(&self) -> f64 {
        (self.centre.coords.abs() + self.size / 2.0).norm()
    }

    /// A lower bound of the distance from another box, `X_AB` being the pose of the other's frame B in this
    /// one's A: the widest gap along the 15 axes of which one separates any two boxes that do not touch; zero
    /// or less exactly where they do.
    ///
    /// (Gottschalk, Lin & Manocha, OBBTree, 1996.)
    pub fn separation(&self, X_AB: &Pose, other: &Self) -> f64 {
        let R_AB = X_AB.rotation.to_rotation_matrix();
        let between = X_AB * other.centre - self.centre;
        let gap = |axis: &Vector3<f64>| {
            let reach = axis.abs().dot(&self.size) + R_AB.inverse_transform_vector(axis).abs().dot(&other.size);
            between.dot(axis).abs() - reach / 2.0
        };
        let mut widest = f64::NEG_INFINITY;
        for (i, own) in Matrix3::identity().column_iter().enumerate() {
            widest = widest.max(gap(&own.into_owned())).max(gap(&R_AB.matrix().column(i).into_owned()));
            for edge in R_AB.matrix().column_iter() {
                // Parallel edges span no axis that the faces do not have.
                let across = own.cross(&edge).try_normalize(1e-6);
                widest = across.map_or(widest, |axis| widest.max(gap(&axis)));
            }
        }
        widest
    }

    /// Lowest coordinate of the box along z once it has been moved by `X_AB`, the pose of its frame B in the
    /// frame A whose z axis counts.
    pub fn lowest_z(&self, X_AB: &Pose) -> f64 {
        // The corner that is lowest along the direction z, seen from B.
        let z_B = X_AB.rotation.inverse() * Vector3::z();
        (X_AB * self.centre).z - z_B.abs().dot(&self.size) / 2.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::UnitQuaternion;
    use proptest::prelude::*;

    /// A convex function's minimum over [0, 1] by ternary search, to check closed forms against.
    fn minimum(function: impl Fn(f64) -> f64) -> f64 {
        let (mut low, mut high) = (0.0, 1.0);
        for _ in 0..100 {
            let (a, b) = (low + (high - low) / 3.0, high - (high - low) / 3.0);
            if function(a) < function(b) { high = b } else { low = a }
        }
        function(f64::midpoint(low, high))
    }

    fn capsules() -> impl Strategy<Value = Capsule> {
        let point = || prop::array::uniform3(prop_oneof![-0.5f64..0.5, Just(0.0), Just(0.25)]);
        (point(), point(), 0.01f64..0.1).prop_map(|(from, to, radius)| Capsule {
            from: from.into(),
            to: to.into(),
            radius,
        })
    }

    proptest! {
        #[test]
        fn distance_between_capsules_is_the_smallest_over_both_segments(one in capsules(), two in capsules()) {
            let sampled = minimum(|s| {
                let p = one.from + (one.to - one.from) * s;
                two.distance_to_point(&p)
            }) - one.radius;
            prop_assert!((one.distance(&two) - sampled).abs() < 1e-7, "{} and {sampled}", one.distance(&two));
            prop_assert!((one.distance(&two) - two.distance(&one)).abs() < 1e-9);
        }

        #[test]
        fn distance_to_a_box_is_the_smallest_over_the_segment(
            capsule in capsules(),
            centre in prop::array::uniform3(-0.2f64..0.2),
            size in prop::array::uniform3(0.01f64..0.4),
        ) {
            let cuboid = Cuboid { centre: centre.into(), size: size.into() };
            let sampled = minimum(|t| {
                let p = capsule.from + (capsule.to - capsule.from) * t - cuboid.centre;
                p.zip_map(&(cuboid.size / 2.0), |p, h| (p.abs() - h).max(0.0)).norm()
            }) - capsule.radius;
            let distance = capsule.distance_to_cuboid(&cuboid);
            prop_assert!((distance - sampled).abs() < 1e-7, "{distance} and {sampled}");
        }

        #[test]
        fn lowest_point_of_a_box_is_its_lowest_corner(
            offset in prop::array::uniform3(-1.0f64..1.0),
            turn in prop::array::uniform3(-3.0f64..3.0),
        ) {
            let X_AB = Pose::from_parts(offset.into(), UnitQuaternion::from_scaled_axis(turn.into()));
            let cuboid = Cuboid { centre: Point3::new(0.1, 0.2, -0.3), size: Vector3::new(0.3, 0.2, 0.1) };
            let corners = crate::TriangleMesh::cuboid(&cuboid).transformed(&X_AB);
            let lowest = corners.vertices.iter().map(|corner| corner.z).fold(f64::INFINITY, f64::min);
            prop_assert!((cuboid.lowest_z(&X_AB) - lowest).abs() < 1e-12);
        }
    }
}
