//! How much of the depth noise the pixels of an image have in common.

use super::{
    normal_equations::{MEAN_SQUARE, weight},
    point_cloud::PointResidual,
};

/// Fractions of the depths' variance that each pixel has by itself, and that all of an image have in
/// common: those that were told, or more where the scatter within the images contradicts.
///
/// A fraction that is told wrongly costs more than the noise itself: depths of which all noise is said to
/// be common would show the shape almost exactly.
pub fn fractions(told: f64, residuals: &[PointResidual], scale: f64) -> [f64; 2] {
    let (mut scatter_m2, mut depth_m2) = (0.0, 0.0);
    for image in residuals.chunk_by(|a, b| a.image == b.image) {
        let [mut on_depth, mut on_distance, mut squares_m2] = [0.0; 3];
        for PointResidual { distance_m, sd_m, by_depth_m, .. } in image {
            let weight = weight(distance_m / sd_m, scale);
            on_depth += weight * by_depth_m * by_depth_m;
            on_distance += weight * by_depth_m * distance_m;
            // Beside what depths cause.
            let other_m2 = sd_m * sd_m - by_depth_m * by_depth_m;
            squares_m2 += weight * (distance_m * distance_m / MEAN_SQUARE - other_m2);
        }
        if on_depth > 0.0 {
            scatter_m2 += squares_m2 - on_distance * on_distance / (MEAN_SQUARE * on_depth);
            depth_m2 += on_depth * (1.0 - 1.0 / image.len() as f64);
        }
    }
    if depth_m2 <= 0.0 {
        return [1.0 - told, told];
    }
    let own = (scatter_m2 / depth_m2).clamp(0.0, 1.0);
    [own.max(1.0 - told), told.max(1.0 - own)]
}
