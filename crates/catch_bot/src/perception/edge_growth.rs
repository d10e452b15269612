//! Growth of objects beyond their silhouettes in the images of stereo cameras.
//!
//! Stereo matches windows. Beside a depth edge some pixels show the nearer surface, others a depth between
//! both, so that the edge of the object's pixels is blurred, and lies somewhere beside the silhouette: alike
//! all around the object in one image.

/// Standard deviation of a single pixel's place at an edge, by the edge's width.
const BLUR_FRACTION: f64 = 0.35;
/// Expected growth of objects, by the edge's width.
const EXPECTED_FRACTION: f64 = 0.25;
/// Standard deviation of the growth, by the edge's width.
const GROWTH_SD_FRACTION: f64 = 0.5;

/// The growth of an object in one image, as it is estimated along with the pose.
#[derive(Debug, Clone, Copy)]
pub(super) struct EdgeGrowth {
    edge_px: f64,
    /// Standard deviation of a single pixel's place at the edge.
    pub place_sd_px: f64,
    /// The growth in pixels.
    pub px: f64,
}

impl EdgeGrowth {
    /// Growth that is expected for edges of this width.
    pub fn new(edge_px: u32) -> Self {
        let edge_px = f64::from(edge_px);
        Self { edge_px, place_sd_px: BLUR_FRACTION * edge_px, px: EXPECTED_FRACTION * edge_px }
    }

    /// Resets the growth to the state before any image, where pixels at sharp edges have this standard
    /// deviation.
    pub fn reset(&mut self, sharp_sd_px: f64) {
        self.place_sd_px = libm::hypot(sharp_sd_px, BLUR_FRACTION * self.edge_px);
        self.px = EXPECTED_FRACTION * self.edge_px;
    }

    /// Standard deviation of the growth that is expected; zero where edges are sharp.
    pub fn sd_px(&self) -> f64 {
        GROWTH_SD_FRACTION * self.edge_px
    }

    /// Excess of the growth over the expected one, in standard deviations.
    pub fn beyond_expected(&self) -> f64 {
        self.px / self.sd_px() - EXPECTED_FRACTION / GROWTH_SD_FRACTION
    }

    /// Takes a step of so many of them.
    pub fn step(&mut self, in_sd: f64) {
        self.px = (self.px + in_sd * self.sd_px()).clamp(-self.edge_px, 2.0 * self.edge_px);
    }
}
