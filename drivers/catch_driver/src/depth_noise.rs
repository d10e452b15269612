//! Noise of depth images of a scene that stands still, by the differences of one image and the next.

use serde::Serialize;

/// Every so many pixels are looked at.
const STRIDE: usize = 7;
/// Pixels that both images have to see.
const FEWEST: usize = 50;
/// Standard deviation of normally distributed values over the median of their distances from their median.
const SD_OF_MEDIAN: f64 = 1.4826;

/// Figures of a camera's noise. A stereo camera has an error of the disparity, which is that of the inverse
/// depth times focal length and baseline.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct NoiseFigures {
    /// Standard deviation of the inverse depth, in 1/m.
    pub inverse_depth_sd_per_m: f64,
    /// Fraction of its variance that all pixels of an image have in common.
    pub common_fraction: f64,
    /// Fraction of the pixels that an image saw and the next one did not.
    pub dropout_fraction: f64,
}

/// Gathers images of a camera.
#[derive(Debug, Clone, Default)]
pub struct DepthNoise {
    before: Vec<f64>,
    pairs: usize,
    own_variance: f64,
    common_variance: f64,
    seen: usize,
    missing: usize,
}

impl DepthNoise {
    /// Takes notice of an image; zero is no depth.
    pub fn add(&mut self, depth_m: &[f32]) {
        let now: Vec<f64> = depth_m.iter().step_by(STRIDE).map(|it| 1.0 / f64::from(*it)).collect();
        // An image has no difference from none.
        let pairs: Vec<[f64; 2]> = self.before.iter().zip(&now).map(|(a, b)| [*a, *b]).collect();
        let is_seen = |it: &f64| it.is_finite() && *it > 0.0;
        let seen: Vec<[f64; 2]> = pairs.into_iter().filter(|[before, _]| is_seen(before)).collect();
        let mut changes: Vec<f64> = seen.iter().filter(|it| is_seen(&it[1])).map(|[a, b]| b - a).collect();
        self.before = now;
        if changes.len() < FEWEST {
            return;
        }
        self.seen += seen.len();
        self.missing += seen.len() - changes.len();
        let common = median(&mut changes);
        let mut distances: Vec<f64> = changes.iter().map(|it| (it - common).abs()).collect();
        let own = SD_OF_MEDIAN * median(&mut distances);
        // A difference has twice the variance of each.
        self.own_variance += own * own / 2.0;
        self.common_variance += common * common / 2.0;
        self.pairs += 1;
    }

    /// What the images tell. None: there were none, or they saw nothing.
    pub fn figures(&self) -> Option<NoiseFigures> {
        let pairs = (self.pairs > 0).then_some(self.pairs as f64)?;
        let variance = (self.own_variance + self.common_variance) / pairs;
        Some(NoiseFigures {
            inverse_depth_sd_per_m: variance.sqrt(),
            common_fraction: if variance > 0.0 { self.common_variance / pairs / variance } else { 0.0 },
            dropout_fraction: self.missing as f64 / self.seen as f64,
        })
    }
}

fn median(values: &mut [f64]) -> f64 {
    let middle = values.len() / 2;
    *values.select_nth_unstable_by(middle, f64::total_cmp).1
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Evenly distributed in 0..1: the fractional parts of multiples of an irrational number, mixed.
    fn random(state: &mut u64) -> f64 {
        *state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (*state >> 11) as f64 / (1_u64 << 53) as f64
    }

    fn normal(state: &mut u64) -> f64 {
        (0..12).map(|_| random(state)).sum::<f64>() - 6.0
    }

    #[test]
    fn the_noise_of_images_is_found() {
        let (sd, common, dropout) = (0.004, 0.3_f64, 0.1);
        let (mut noise, mut state) = (DepthNoise::default(), 1);
        for _ in 0..200 {
            let all = normal(&mut state);
            let depth = |i: u32| {
                let own = normal(&mut state);
                let missing = random(&mut state) < dropout || i.is_multiple_of(9);
                let inverse = 0.3 + f64::from(i) * 1e-5 + sd * (common.sqrt() * all + (1.0 - common).sqrt() * own);
                if missing { 0.0 } else { (1.0 / inverse) as f32 }
            };
            noise.add(&(0..7000).map(depth).collect::<Vec<f32>>());
        }
        let found = noise.figures().unwrap();
        assert!((found.inverse_depth_sd_per_m / sd - 1.0).abs() < 0.1, "{found:?}");
        assert!((found.common_fraction - common).abs() < 0.08, "{found:?}");
        assert!((found.dropout_fraction - dropout).abs() < 0.01, "{found:?}");
    }

    #[test]
    fn a_camera_that_sees_nothing_has_no_figures() {
        let mut noise = DepthNoise::default();
        (0..3).for_each(|_| noise.add(&[0.0; 7000]));
        assert_eq!(noise.figures(), None);
    }
}
