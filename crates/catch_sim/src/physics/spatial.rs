//! Spatial vectors and inertias in world axes, about the origin of W (Featherstone, Rigid Body Dynamics
//! Algorithms, chapter 2).

use catch_body::{Pose, robot::Inertia};
use nalgebra::{Matrix3, Vector3};

/// A motion (angular velocity, and the velocity of the body's point at the origin of W) or a force (moment
/// about the origin of W, force).
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(super) struct Spatial {
    pub angular: Vector3<f64>,
    pub linear: Vector3<f64>,
}

impl Spatial {
    /// Rotation at 1 rad/s about an axis through a point.
    pub fn about(axis: Vector3<f64>, through: &Vector3<f64>) -> Self {
        Self { angular: axis, linear: through.cross(&axis) }
    }

    /// A force at a point.
    pub fn force_at(force: Vector3<f64>, point: &Vector3<f64>) -> Self {
        Self { angular: point.cross(&force), linear: force }
    }

    /// Power of a force along a motion.
    pub fn dot(&self, other: &Self) -> f64 {
        self.angular.dot(&other.angular) + self.linear.dot(&other.linear)
    }

    /// Rate of change of a motion that is carried along by this one.
    pub fn cross_motion(&self, motion: &Self) -> Self {
        Self {
            angular: self.angular.cross(&motion.angular),
            linear: self.angular.cross(&motion.linear) + self.linear.cross(&motion.angular),
        }
    }

    /// Rate of change of a force that is carried along by this motion.
    pub fn cross_force(&self, force: &Self) -> Self {
        Self {
            angular: self.angular.cross(&force.angular) + self.linear.cross(&force.linear),
            linear: self.angular.cross(&force.linear),
        }
    }

    /// Velocity of the body's point that is at `point`.
    pub fn velocity_at(&self, point: &Vector3<f64>) -> Vector3<f64> {
        self.linear + self.angular.cross(point)
    }
}

impl std::ops::Add for Spatial {
    type Output = Self;

    fn add(self, other: Self) -> Self {
        Self { angular: self.angular + other.angular, linear: self.linear + other.linear }
    }
}

impl std::ops::Mul<f64> for Spatial {
    type Output = Self;

    fn mul(self, factor: f64) -> Self {
        Self { angular: self.angular * factor, linear: self.linear * factor }
    }
}

/// Mass, first moment and second moment of a body about the origin of W.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct SpatialInertia {
    mass_kg: f64,
    first: Vector3<f64>,
    second: Matrix3<f64>,
}

impl SpatialInertia {
    /// Spatial inertia of a body whose inertia is given in its frame L.
    pub fn of(inertia: &Inertia, X_WL: &Pose) -> Self {
        let Inertia { mass, com, about_com } = inertia.transformed(X_WL);
        let com = com.coords;
        let second = about_com + (Matrix3::identity() * com.norm_squared() - com * com.transpose()) * mass;
        Self { mass_kg: mass, first: com * mass, second }
    }

    /// Momentum of the body in a motion.
    pub fn momentum(&self, motion: &Spatial) -> Spatial {
        Spatial {
            angular: self.second * motion.angular + self.first.cross(&motion.linear),
            linear: motion.linear * self.mass_kg - self.first.cross(&motion.angular),
        }
    }
}

impl std::ops::AddAssign for SpatialInertia {
    fn add_assign(&mut self, other: Self) {
        self.mass_kg += other.mass_kg;
        self.first += other.first;
        self.second += other.second;
    }
}
