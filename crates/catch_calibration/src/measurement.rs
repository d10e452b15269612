//! What is compared: a number that an image shows with what a rendering of the arm predicts, and how the
//! latter changes where the surface moves.

use catch_body::ray_cast::SurfacePart;
use nalgebra::Vector3;

/// One number of an image, and its prediction.
#[derive(Debug, Clone, Copy)]
pub struct Measurement {
    /// What it is.
    pub quantity: Quantity,
    /// What the image shows.
    pub found: f64,
    /// What is predicted of it.
    pub predicted: f64,
    /// How the prediction changes where the point `p_C` of the surface moves, in C: per metre.
    pub gradient_C: Vector3<f64>,
    /// That point.
    pub p_C: Vector3<f64>,
    /// Outward normal of the surface there.
    pub normal_C: Vector3<f64>,
    /// Whose surface it is.
    pub part: SurfacePart,
    /// Variance of `found` over that of a single image, inverted.
    pub weight: f64,
    /// Row and column of the image, or line across a silhouette and place along it.
    pub place: [i32; 2],
}

/// What a measurement is.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Quantity {
    /// 1/z of a pixel in 1/m.
    InverseDepth,
    /// Number of pixels around a silhouette, on a line across it, that show something.
    ShownPixels {
        /// By how much the silhouette moves from line to line, in pixels.
        slope: f64,
        /// How many of the pixels before it are so steep that they may be missing.
        grazing_px: f64,
        /// The same of the last of them, whose depth shows beyond the silhouette.
        grazing_edge: f64,
        /// Whether the line is a row.
        along_row: bool,
    },
}

impl Measurement {
    /// How much more is found than predicted.
    pub fn residual(&self) -> f64 {
        self.found - self.predicted
    }

    /// Whether it is an inverse depth.
    pub fn is_depth(&self) -> bool {
        self.quantity == Quantity::InverseDepth
    }
}
