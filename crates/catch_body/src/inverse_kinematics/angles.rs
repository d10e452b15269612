//! Elements of closed forms: angles about axes, and points where axes meet (the subproblems of Paden and
//! Kahan).

use std::f64::consts::TAU;

use nalgebra::{Point3, Unit, Vector3};

use super::TOLERANCE;

/// a·cos x + b·sin x as a function of x.
#[derive(Debug, Clone, Copy)]
pub struct Sinusoid {
    phase: f64,
    amplitude: f64,
}

impl Sinusoid {
    /// The sinusoid with coefficients a and b.
    pub fn new([a, b]: [f64; 2]) -> Self {
        Self { phase: libm::atan2(b, a), amplitude: libm::hypot(a, b) }
    }

    /// The angles at which the sinusoid is `value`: two, or none.
    pub fn angles_at(self, value: f64) -> impl Iterator<Item = f64> {
        let cos = value / self.amplitude;
        let aside = (cos.abs() <= 1.0).then(|| libm::acos(cos));
        aside.into_iter().flat_map(move |aside| [self.phase + aside, self.phase - aside])
    }
}

/// Rotation of a vector about an axis, by the formula of Rodrigues.
#[derive(Debug, Clone, Copy)]
pub struct AxisRotation {
    axis: Vector3<f64>,
    sin: f64,
    cos: f64,
}

impl AxisRotation {
    /// The rotation by an angle about an axis.
    pub fn new(axis: &Vector3<f64>, angle: f64) -> Self {
        let (sin, cos) = libm::sincos(angle);
        Self { axis: *axis, sin, cos }
    }

    /// A vector after the rotation.
    pub fn of(&self, v: &Vector3<f64>) -> Vector3<f64> {
        v * self.cos + self.axis.cross(v) * self.sin + self.axis * (self.axis.dot(v) * (1.0 - self.cos))
    }

    /// The turn back.
    pub fn back(self) -> Self {
        Self { sin: -self.sin, ..self }
    }
}

/// The angle about `axis` from one direction to another, both seen along it.
pub fn angle(axis: &Vector3<f64>, from: &Vector3<f64>, to: &Vector3<f64>) -> f64 {
    let from = from - axis * axis.dot(from);
    libm::atan2(axis.dot(&from.cross(to)), from.dot(to))
}

/// An angle by as many whole turns off that it is within its range, near `from`.
pub fn turned_into(angle: f64, from: f64, [low, high]: [f64; 2]) -> Option<f64> {
    let turns = (from - angle) / TAU;
    let nearest = if turns.abs() < 0.5 { angle } else { angle + turns.round() * TAU };
    [nearest, nearest - TAU, nearest + TAU].into_iter().find(|it| (low..=high).contains(it))
}

/// Point where two axes meet, each a direction and a point on it; `None` if they do not, or are parallel.
pub fn meeting_point([(a, p), (b, r)]: [(Unit<Vector3<f64>>, Point3<f64>); 2]) -> Option<Point3<f64>> {
    let (normal, between) = (a.cross(&b), r - p);
    let meet = normal.norm() > TOLERANCE && between.dot(&normal).abs() < TOLERANCE * normal.norm();
    meet.then(|| p + a.into_inner() * (between.cross(&b).dot(&normal) / normal.norm_squared()))
}
