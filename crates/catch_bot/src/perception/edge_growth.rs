//! Growth of objects beyond their silhouettes in the images of stereo cameras.
//!
//! Stereo matches windows. Beside a depth edge some pixels show the nearer surface, others a depth between
//! both, so that the edge of the object's pixels is blurred, and lies somewhere beside the silhouette: alike
//! all around the object in one image.

/// Standard deviation of a single pixel's place at an edge, by the edge's width: that of the normal
/// distribution that fits best where a quarter of the pixels beside an object show it, and a tenth along its
/// edge lie between.
const BLUR_FRACTION: f64 = 0.525;
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

#[cfg(test)]
mod tests {
    use super::*;
    use catch_body::normal_distribution::bound_cost;

    /// Fraction of the pixels within the edge's width of a silhouette that show the object: on it, and
    /// beside it. Half of the depths between both surfaces count as the object's.
    const ON_IT: f64 = 0.95;
    const BESIDE_IT: f64 = 0.3;

    /// Growth and standard deviation that make what pixels show most likely, searched on a grid.
    #[test]
    fn growth_and_blur_are_the_most_likely_ones() {
        let shows = |beyond: f64| match beyond {
            it if it < -1.0 => 1.0,
            it if it < 0.0 => ON_IT,
            it if it < 1.0 => BESIDE_IT,
            _ => 0.0,
        };
        let cost = |growth: f64, sd: f64| -> f64 {
            let of_pixel = |i: i32| {
                let beyond = f64::from(i) / 100.0 + 0.005;
                let u = (beyond - growth) / sd;
                shows(beyond) * bound_cost(u) + (1.0 - shows(beyond)) * bound_cost(-u)
            };
            (-250..250).map(of_pixel).sum()
        };
        let grid = (0..20).flat_map(|growth| (4..40).map(move |sd| (f64::from(growth) / 40.0, f64::from(sd) / 40.0)));
        let (growth, sd) = grid.min_by(|a, b| cost(a.0, a.1).total_cmp(&cost(b.0, b.1))).unwrap();
        assert_eq!((growth, sd), (EXPECTED_FRACTION, BLUR_FRACTION));
    }
}
