//! Perception (paper, III-B): the object's pose from one set of depth images.
//!
//! Pixels become points, points that belong to the object are kept, and the reference scan is registered to them, starting
//! from where the last trajectory says the object should be.

use catch_body::Pose;
use catch_cell::ReferenceScan;
use nalgebra::{Matrix6, Point3, Vector3};
use serde::{Deserialize, Serialize};

/// Settings of perception.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Config {}

/// The object's pose at one instant.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct ObjectPose {
    /// When the images were taken.
    pub capture_s: f64,
    /// Pose of the object; O has its origin at the centre of mass as the reference model estimates it.
    pub X_WO: Pose,
    /// Inverse covariance of (rotation vector in W, rad; position in W, m).
    pub information: Matrix6<f64>,
    /// Number of points that it rests on.
    pub points: usize,
    /// Root mean square distance of those points from the reference surface, in metres.
    pub residual_m: f64,
}

/// The object as the brain knows it: oriented points of its surface.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct ReferenceModel {
    /// Points of the surface in O, metres.
    pub points: Vec<Point3<f64>>,
    /// Outward unit normals, one per point.
    pub normals: Vec<Vector3<f64>>,
    /// Pose of O in the frame R of the scan.
    pub X_RO: Pose,
    /// Radius of a sphere around the origin of O that holds the object.
    pub radius_m: f64,
}

impl ReferenceModel {
    /// Builds the model from a scan.
    pub fn from_scan(scan: &ReferenceScan, config: &Config) -> Self {
        let _ = (scan, config);
        Self::default()
    }
}
