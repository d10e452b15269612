//! Refinement of a calibration by thrown objects.

use nalgebra::{Matrix3, Vector3};

/// Where one image shows the object.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sighting {
    /// Which camera took it.
    pub camera: usize,
    /// Its time stamp, in seconds on the camera's clock.
    pub capture_s: f64,
    /// The object's centre of mass in C.
    pub p_C: Vector3<f64>,
    /// Covariance of that, in m².
    pub covariance_C: Matrix3<f64>,
}

/// What was seen of one throw.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Flight {
    /// In any order.
    pub sightings: Vec<Sighting>,
}
