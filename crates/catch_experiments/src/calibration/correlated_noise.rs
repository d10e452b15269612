//! Noise that neighbouring pixels have in common, as the windows of stereo matching make it.

use catch_cell::DepthFrame;
use catch_sim::random_streams::Draws;

/// Pixels to each side that a pixel's noise is the mean of.
const REACH: usize = 3;

/// Adds noise with this standard deviation to 1/z: white noise, averaged over squares of seven pixels.
pub fn add(frame: &mut DepthFrame, sd_per_m: f64, draws: &mut Draws) {
    let (wide, high) = (frame.window.width as usize, frame.window.height as usize);
    let (padded_wide, padded_high) = (wide + 2 * REACH, high + 2 * REACH);
    let side = 2 * REACH + 1;
    // A uniform number has the standard deviation √(1/12), and the mean of as many as the square has of
    // 1/side of it.
    let scale = sd_per_m * 12.0_f64.sqrt() / side as f64;
    let white: Vec<f64> = (0..padded_wide * padded_high).map(|_| draws.unit() - 0.5).collect();
    let in_rows: Vec<f64> =
        white.chunks(padded_wide).flat_map(|row| row.windows(side).map(|it| it.iter().sum::<f64>())).collect();
    for (i, depth_m) in frame.depth_m.iter_mut().enumerate().filter(|(_, depth_m)| depth_m.is_finite()) {
        let (column, row) = (i % wide, i / wide);
        let sum: f64 = (row..row + side).map(|row| in_rows[row * wide + column]).sum();
        *depth_m = (1.0 / (1.0 / f64::from(*depth_m) + scale * sum)) as f32;
    }
}
