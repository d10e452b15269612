//! A robot's description as others publish it: a tree of links and joints of any kind, with gaps.
//!
//! [`Description`] holds what a file says, [`Chain`] the serial arm within it: fixed joints folded, fingers
//! taken off. Nothing is made up here; what a file does not say is `None`.

mod arm_in_tree;
mod chain;
mod folding;
mod limbs;
mod sdf_reader;
mod tree;
mod urdf_reader;

use std::collections::BTreeMap;

use nalgebra::{Matrix3, Unit, Vector3};

use catch_body::{
    Pose, TriangleMesh,
    quantity::Quantity,
    robot::Inertia,
    shape::{Capsule, Cuboid},
};

pub use chain::{Body, Chain, ChainJoint, Fingers, Selection};

/// Extents of a shape.
const EXTENT_M: Quantity = Quantity { least: 0.0, most: 1e4, unit: "m" };
/// Factors on the axes of a mesh; a mirrored one has a negative factor.
const MESH_SCALE: Quantity = Quantity { least: -1000.0, most: 1000.0, unit: "m per unit" };
/// Sides of the polygons that stand for circles.
const SIDES: u32 = 32;
/// Number of times that the triangles of an ellipsoid are divided in four, and the factor by which they are
/// enlarged so that the ellipsoid is within.
const BALL_DIVISIONS: u32 = 4;
const BALL_WIDER: f64 = 1.001;

/// A tree of links and joints.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Description {
    /// Name of the file in errors.
    pub file: String,
    /// The robot's name.
    pub name: String,
    /// The link that no joint moves.
    pub root: String,
    /// Links by their names.
    pub links: BTreeMap<String, Link>,
    /// Joints by the names of their parents.
    pub joints: BTreeMap<String, Vec<TreeJoint>>,
}

/// A link.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Link {
    /// Mass properties in the link's frame; `None` without mass.
    pub inertia: Option<Inertia>,
    /// Coulomb friction coefficient of the link's surface, if the file says one.
    pub friction: Option<f64>,
    /// Coefficient of restitution, if the file says one.
    pub restitution: Option<f64>,
    /// What the file says of the link's surface besides, each as `name = value`.
    pub unused: Vec<String>,
    /// The shape for collisions.
    pub collisions: Vec<Geometry>,
    /// The shape for the eye.
    pub visuals: Vec<Geometry>,
}

/// A shape on a link.
#[derive(Debug, Clone, PartialEq)]
pub struct Geometry {
    /// Pose of the shape's frame in the link's.
    pub X_LS: Pose,
    /// The shape.
    pub shape: Shape,
}

/// A shape around the origin of its frame.
#[derive(Debug, Clone, PartialEq)]
pub enum Shape {
    /// A box with its edges' lengths in metres.
    Cuboid(Vector3<f64>),
    /// A cylinder along z.
    Cylinder {
        /// Radius in metres.
        radius_m: f64,
        /// Length in metres.
        length_m: f64,
    },
    /// A cylinder along z with a hemisphere on each end; `length_m` is that of the cylinder.
    Capsule {
        /// Radius in metres.
        radius_m: f64,
        /// Length in metres.
        length_m: f64,
    },
    /// A ball with its radius in metres.
    Sphere(f64),
    /// An ellipsoid with its half axes in metres.
    Ellipsoid(Vector3<f64>),
    /// A mesh in a file of its own.
    Mesh {
        /// The file, as the description names it.
        file: String,
        /// Metres per unit of the file along its axes.
        scale: Vector3<f64>,
    },
}

/// A joint of a tree.
#[derive(Debug, Clone, PartialEq)]
pub struct TreeJoint {
    /// Name of the joint.
    pub name: String,
    /// Kind of the joint's motion.
    pub kind: JointKind,
    /// The link that the joint moves.
    pub child: String,
    /// Pose of that link's frame L in the parent's frame P while the joint is at zero.
    pub X_PL: Pose,
    /// Axis in the frame of the moved link.
    pub axis: Unit<Vector3<f64>>,
    /// Limits, as all that is stated leaves them.
    pub limits: StatedLimits,
    /// Viscous damping.
    pub damping: f64,
    /// Rotor inertia, reflected to the joint, in kg·m².
    pub rotor_inertia: Option<f64>,
    /// Driver of a joint that does not move on its own: the name of another joint, or of a body with which it
    /// is part of a loop.
    pub mimics: Option<String>,
}

/// Limits of a joint; `None` where nobody states one.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct StatedLimits {
    /// Lowest position; of a description that states several bounds, it may be above the highest.
    pub lower: Option<f64>,
    /// Highest position.
    pub upper: Option<f64>,
    /// Highest speed.
    pub velocity: Option<f64>,
    /// Highest acceleration.
    pub acceleration: Option<f64>,
    /// Highest jerk.
    pub jerk: Option<f64>,
    /// Highest torque or force.
    pub effort: Option<f64>,
}

impl StatedLimits {
    /// The narrower of each limit.
    pub fn narrowed(&self, other: &Self) -> Self {
        Self {
            lower: narrower(self.lower, other.lower, f64::max),
            upper: narrower(self.upper, other.upper, f64::min),
            velocity: narrower(self.velocity, other.velocity, f64::min),
            acceleration: narrower(self.acceleration, other.acceleration, f64::min),
            jerk: narrower(self.jerk, other.jerk, f64::min),
            effort: narrower(self.effort, other.effort, f64::min),
        }
    }
}

/// The narrower of two limits, as `pick` says.
pub fn narrower(one: Option<f64>, other: Option<f64>, pick: fn(f64, f64) -> f64) -> Option<f64> {
    [one, other].into_iter().flatten().reduce(pick)
}

/// Kind of a joint's motion.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum JointKind {
    /// No motion.
    Fixed,
    /// Rotation about the axis, between two ends or without any.
    Revolute,
    /// Translation along the axis.
    Prismatic,
    /// Motion in several directions.
    Other,
}

impl Description {
    /// The joints whose parent is `link`.
    pub fn joints_of(&self, link: &str) -> &[TreeJoint] {
        self.joints.get(link).map_or(&[], Vec::as_slice)
    }
}

impl Geometry {
    /// Mass properties in the link's frame, filled with `density_kgpm3`; `None` for a mesh, which is in a
    /// file of its own.
    pub fn filled(&self, density_kgpm3: f64) -> Option<Inertia> {
        // Masses, and the moments of each about its own centre of mass, as textbooks have them.
        let tau = std::f64::consts::TAU;
        let round = |mass: f64, [x, z]: [f64; 2]| (mass, Matrix3::from_diagonal(&Vector3::new(x, x, z)) * mass);
        let (mass, about_com) = match self.shape {
            Shape::Cuboid(size) => {
                let mass = density_kgpm3 * size.product();
                let squares = size.component_mul(&size);
                (mass, Matrix3::from_diagonal(&(Vector3::repeat(squares.sum()) - squares)) * (mass / 12.0))
            }
            Shape::Cylinder { radius_m: r, length_m: l } => {
                round(density_kgpm3 * tau / 2.0 * r * r * l, [(3.0 * r * r + l * l) / 12.0, r * r / 2.0])
            }
            Shape::Capsule { radius_m: r, length_m: l } => {
                let (tube, moments) =
                    round(density_kgpm3 * tau / 2.0 * r * r * l, [(3.0 * r * r + l * l) / 12.0, r * r / 2.0]);
                let across = 0.4 * r * r + l * l / 4.0 + 3.0 / 8.0 * l * r;
                let (ends, of_ends) = round(density_kgpm3 * tau * 2.0 / 3.0 * r.powi(3), [across, 0.4 * r * r]);
                (tube + ends, moments + of_ends)
            }
            Shape::Sphere(r) => round(density_kgpm3 * tau * 2.0 / 3.0 * r.powi(3), [0.4 * r * r; 2]),
            Shape::Ellipsoid(half) => {
                let mass = density_kgpm3 * tau * 2.0 / 3.0 * half.product();
                let squares = half.component_mul(&half);
                (mass, Matrix3::from_diagonal(&(Vector3::repeat(squares.sum()) - squares)) * (mass / 5.0))
            }
            Shape::Mesh { .. } => return None,
        };
        Some(Inertia { mass, com: nalgebra::Point3::origin(), about_com }.transformed(&self.X_LS))
    }

    /// The surface in the link's frame; `None` for a mesh, which is in a file of its own. Circles become
    /// polygons around them.
    pub fn surface(&self) -> Option<TriangleMesh> {
        // So that the polygon's sides touch the circle.
        let wider = 1.0 / libm::cos(std::f64::consts::PI / f64::from(SIDES));
        let along_z = |radius: f64, length_m: f64| {
            let half = Vector3::z() * (length_m / 2.0);
            TriangleMesh::capsule(&Capsule { from: (-half).into(), to: half.into(), radius: radius * wider }, SIDES)
        };
        let mesh = match self.shape {
            Shape::Cuboid(size) => TriangleMesh::cuboid(&Cuboid { centre: nalgebra::Point3::origin(), size }),
            Shape::Cylinder { radius_m, length_m } => {
                let (r, h) = (radius_m * wider, length_m / 2.0);
                TriangleMesh::revolution(&[[-h, r], [h, r]], SIDES)
            }
            Shape::Capsule { radius_m, length_m } => along_z(radius_m, length_m),
            Shape::Sphere(radius_m) => along_z(radius_m, 1e-9),
            Shape::Ellipsoid(half_axes) => {
                let mut ball = TriangleMesh::sphere(1.0, BALL_DIVISIONS);
                ball.vertices.iter_mut().for_each(|it| it.coords.component_mul_assign(&(half_axes * BALL_WIDER)));
                ball
            }
            Shape::Mesh { .. } => return None,
        };
        Some(mesh.transformed(&self.X_LS))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    impl TreeJoint {
        /// A joint that does not move, its child where its parent is.
        pub fn fixed(name: String, child: &str) -> Self {
            Self {
                name,
                kind: JointKind::Fixed,
                child: child.to_owned(),
                X_PL: Pose::identity(),
                axis: Vector3::z_axis(),
                limits: StatedLimits::default(),
                damping: 0.0,
                rotor_inertia: None,
                mimics: None,
            }
        }
    }

    #[test]
    fn surfaces_are_closed_and_hold_their_shapes() {
        let pi = std::f64::consts::PI;
        let solids = [
            (Shape::Cuboid(Vector3::new(0.1, 0.2, 0.3)), 0.006),
            (Shape::Cylinder { radius_m: 0.05, length_m: 0.3 }, pi * 0.0025 * 0.3),
            (Shape::Sphere(0.1), 4.0 / 3.0 * pi * 1e-3),
            (Shape::Capsule { radius_m: 0.1, length_m: 0.2 }, pi * 0.01 * (0.2 + 0.4 / 3.0)),
            (Shape::Ellipsoid(Vector3::new(0.1, 0.2, 0.3)), 4.0 / 3.0 * pi * 6e-3),
        ];
        let X_LS = Pose::new(Vector3::new(0.1, 0.2, 0.3), Vector3::new(0.4, 0.5, 0.6));
        for (shape, volume) in solids {
            let geometry = Geometry { X_LS, shape };
            let surface = geometry.surface().unwrap();
            let filled = geometry.filled(1000.0).unwrap();
            assert!((filled.mass / (1000.0 * volume) - 1.0).abs() < 1e-9, "{geometry:?}");
            let off = filled.about_com / filled.mass - surface.mass_properties(1.0).about_com;
            assert!(off.norm() < 0.04 * (filled.about_com / filled.mass).norm(), "{geometry:?}: {off}");
            assert!(surface.is_closed());
            let ratio = surface.volume() / volume;
            assert!((0.99..1.03).contains(&ratio), "{ratio}");
        }
    }
}
