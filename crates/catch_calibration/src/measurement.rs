//! Measurements: numbers that an image shows, the predictions of a rendering of the arm, and how the latter
//! change where the surface moves.

use catch_body::ray_cast::SurfacePart;
use nalgebra::Vector3;

/// A number of an image, and its prediction.
#[derive(Debug, Clone, Copy)]
pub struct Measurement {
    /// Quantity that is measured.
    pub quantity: Quantity,
    /// Value that the image shows.
    pub found: f64,
    /// Value that the rendering predicts.
    pub predicted: f64,
    /// Gradient of the prediction with respect to the point `p_C` of the surface, in C: per metre.
    pub gradient_C: Vector3<f64>,
    /// Point of the surface in C, in metres.
    pub p_C: Vector3<f64>,
    /// Outward normal of the surface there.
    pub normal_C: Vector3<f64>,
    /// Body that the surface belongs to.
    pub part: SurfacePart,
    /// Variance of `found` over that of a single image, inverted.
    pub weight: f64,
    /// Row and column of the image, or line across a silhouette and place along it.
    pub place: [i32; 2],
}

/// Quantity of a measurement.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Quantity {
    /// 1/z of a pixel in 1/m.
    InverseDepth,
    /// Number of pixels around a silhouette, on a line across it, that show something.
    ShownPixels {
        /// Displacement of the silhouette from line to line, in pixels.
        slope: f64,
        /// Number of pixels before the silhouette that the camera may lose because the surface there is
        /// steep.
        grazing_px: f64,
        /// Fraction of the last of these pixels that may be missing, whose depth shows beyond the silhouette.
        grazing_edge: f64,
        /// True if the line is a row.
        along_row: bool,
    },
}

impl Measurement {
    /// Residual: the value found less the prediction.
    pub fn residual(&self) -> f64 {
        self.found - self.predicted
    }

    /// Returns whether the measurement is an inverse depth.
    pub fn is_depth(&self) -> bool {
        self.quantity == Quantity::InverseDepth
    }
}
