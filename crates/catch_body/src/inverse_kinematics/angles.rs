//! What closed forms are made of: angles about axes, and where axes meet (the subproblems of Paden and Kahan).

use std::f64::consts::TAU;

use nalgebra::{Point3, Unit, Vector3};

use super::TOLERANCE;

/// The angles x with a·cos x + b·sin x = c: two, or none.
pub fn angles_with([a, b]: [f64; 2], c: f64) -> impl Iterator<Item = f64> {
    let (middle, cos) = (b.atan2(a), c / a.hypot(b));
    let aside = (cos.abs() <= 1.0).then(|| cos.acos());
    aside.into_iter().flat_map(move |aside| [middle + aside, middle - aside])
}

/// The angle about `axis` from one direction to another, both seen along it.
pub fn angle(axis: &Vector3<f64>, from: &Vector3<f64>, to: &Vector3<f64>) -> f64 {
    let from = from - axis * axis.dot(from);
    axis.dot(&from.cross(to)).atan2(from.dot(to))
}

/// An angle by as many whole turns off that it is within its range, near `from`.
pub fn turned_into(angle: f64, from: f64, [low, high]: [f64; 2]) -> Option<f64> {
    let nearest = angle + ((from - angle) / TAU).round() * TAU;
    [nearest, nearest - TAU, nearest + TAU].into_iter().find(|it| (low..=high).contains(it))
}

/// Where two axes meet, each a direction and a point on it; `None` if they do not, or are parallel.
pub fn meeting_point([(a, p), (b, r)]: [(Unit<Vector3<f64>>, Point3<f64>); 2]) -> Option<Point3<f64>> {
    let (normal, between) = (a.cross(&b), r - p);
    let meet = normal.norm() > TOLERANCE && between.dot(&normal).abs() < TOLERANCE * normal.norm();
    meet.then(|| p + a.into_inner() * (between.cross(&b).dot(&normal) / normal.norm_squared()))
}
