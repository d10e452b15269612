//! Simple solids.

use nalgebra::{Point3, Vector3};

/// A cylinder with hemispherical ends: all points within `radius` of a segment.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Capsule {
    /// One end of the segment, in metres.
    pub from: Point3<f64>,
    /// Its other end.
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
