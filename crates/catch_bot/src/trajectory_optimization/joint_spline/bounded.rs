//! Bounded quantities of a spline's program, as combinations of its control points.

use super::MAX_POINTS;

/// A derivative's control point as a combination of the spline's own.
pub type Combination = [f64; MAX_POINTS];

/// A bounded quantity as a combination of all control points.
#[derive(Debug, Clone, Copy)]
pub struct Bounded {
    pub combination: Combination,
    /// Beyond this range the combination vanishes.
    first: usize,
    last: usize,
    pub of: Quantity,
}

#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Quantity {
    Position,
    Velocity,
    LastVelocity,
    Acceleration,
    LastAcceleration,
    Jerk,
}

impl Bounded {
    pub fn new(combination: Combination, of: Quantity) -> Self {
        let first = combination.iter().position(|it| *it != 0.0).unwrap_or(0);
        let last = combination.iter().rposition(|it| *it != 0.0).map_or(0, |it| it + 1);
        Self { combination, first, last, of }
    }

    pub fn dot(&self, points: &[f64; MAX_POINTS]) -> f64 {
        (self.first..self.last).map(|i| self.combination[i] * points[i]).sum()
    }
}
