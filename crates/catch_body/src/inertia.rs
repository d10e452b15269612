//! Mass, centre of mass and rotational inertia of a rigid body.

use nalgebra::{Matrix3, Point3, Vector3};

use crate::pose::Pose;

/// Mass, centre of mass and inertia of a link, in the link's frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Inertia {
    /// Mass in kg.
    pub mass: f64,
    /// Centre of mass in metres.
    pub com: Point3<f64>,
    /// Rotational inertia about the centre of mass in kg·m², along the link's axes.
    pub about_com: Matrix3<f64>,
}

impl Inertia {
    /// The inertia of two bodies that are rigidly joined, both given in the same frame.
    pub fn joined(&self, other: &Self) -> Self {
        let mass = self.mass + other.mass;
        let com = Point3::from((self.com.coords * self.mass + other.com.coords * other.mass) / mass);
        let about_com = [self, other].iter().map(|it| it.about_com + it.mass * parallel_axis(&(it.com - com))).sum();
        Self { mass, com, about_com }
    }

    /// Returns whether a body can have these moments: principal moments above zero, none larger than the sum
    /// of the other two.
    pub fn is_of_a_body(&self) -> bool {
        let moments = self.about_com.symmetric_eigenvalues();
        moments.min() > 0.0 && 2.0 * moments.max() <= moments.sum() * (1.0 + 1e-9)
    }

    /// Inertia of the body in another frame: `X_AB` is the pose of the body's present frame B in the new
    /// frame A.
    pub fn transformed(&self, X_AB: &Pose) -> Self {
        let R_AB = X_AB.rotation.to_rotation_matrix();
        Self {
            mass: self.mass,
            com: X_AB * self.com,
            about_com: R_AB.matrix() * self.about_com * R_AB.matrix().transpose(),
        }
    }

    /// A solid box of uniform density, `size` along its axes, centred at `com`.
    pub fn of_box(mass: f64, size: &Vector3<f64>, com: Point3<f64>) -> Self {
        let square = size.component_mul(size);
        let diagonal = Vector3::new(square.y + square.z, square.x + square.z, square.x + square.y) * (mass / 12.0);
        Self { mass, com, about_com: Matrix3::from_diagonal(&diagonal) }
    }
}

/// Inertia of a unit point mass at `r` about the origin: |r|²·1 − r·rᵀ.
fn parallel_axis(r: &Vector3<f64>) -> Matrix3<f64> {
    Matrix3::identity() * r.norm_squared() - r * r.transpose()
}
