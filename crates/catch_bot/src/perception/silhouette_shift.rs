//! Shift of the arm's silhouette and depth in a camera's images, recently and before.

use catch_cell::CameraModel;
use nalgebra::{Matrix4, Vector3, Vector4};

use super::{Config, arm_edges::Sight};

/// The mean shift of the arm in some images: in pixels to the right and down, and in depth by metres.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct MeanShift {
    images: f64,
    value: Vector3<f64>,
}

/// Mean shifts of one camera's images.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct ShiftHistory {
    /// Mean before, while no fault was found.
    before: MeanShift,
    /// Recent mean.
    now: MeanShift,
    /// True if the recent shift may be a displacement, which more images will decide.
    is_suspect: bool,
    /// True if the camera stands or looks elsewhere than configured, or than it did before.
    pub is_displaced: bool,
}

/// Images that tell something, and after which a new mean begins.
const MIN_IMAGES: f64 = 3.0;
const MOST_IMAGES: f64 = 32.0;
/// Images that the mean of those before counts for at most.
const MOST_BEFORE: f64 = 256.0;
/// Standard deviation of what the silhouette in one image says, in pixels.
const IMAGE_SD_PX: f64 = 0.2;
/// Least apparent displacement of a camera that counts, in metres.
pub(super) const DISPLACED_M: f64 = 0.008;
/// Standard deviations by which anything must be off.
pub(super) const SIGNIFICANT: f64 = 5.0;
/// A camera that was displaced is right again when it is off by less than this fraction of the bounds.
const RIGHT_AGAIN: f64 = 0.7;
/// A camera that has moved by more than this fraction of the bounds may have been pushed.
const SUSPECT: f64 = 0.5;
/// Standard deviations of what is not known of an image beforehand: shifts in pixels, the fraction without a
/// depth, and how far edges grow in pixels.
const PRIOR_SD: [f64; 4] = [20.0, 20.0, 0.3, 3.0];

impl MeanShift {
    /// The shift in one image, by least squares over the edges; `None` without enough of them.
    pub fn of(sight: &Sight) -> Option<Self> {
        sight.explained?;
        let prior = Matrix4::from_diagonal(&Vector4::from(PRIOR_SD).map(|sd| sd.powi(-2)));
        let found = (sight.information + prior).cholesky()?.solve(&sight.pull);
        Some(Self { images: 1.0, value: Vector3::new(found[0], found[1], sight.depth_error_m.unwrap_or(0.0)) })
    }

    fn add(&mut self, other: &Self, most: f64) {
        let images = self.images + other.images;
        if images > 0.0 {
            self.value += (other.value - self.value) * (other.images / images);
        }
        self.images = images.min(most);
    }
}

impl ShiftHistory {
    /// Adds the recent mean to the earlier one. A mean of too few images, and one that may be or is a
    /// displacement, stays as it is.
    pub fn close(&mut self) {
        if !self.is_displaced && !self.is_suspect && self.now.images >= MIN_IMAGES {
            self.before.add(&std::mem::take(&mut self.now), MOST_BEFORE);
        }
    }

    /// Takes in one image of a `camera` that sees the arm at a depth.
    pub fn add(&mut self, shift: &MeanShift, camera: &CameraModel, depth_m: f64, config: &Config) {
        self.now.add(shift, MOST_IMAGES);
        if self.now.images < MIN_IMAGES {
            return;
        }
        self.is_suspect = self.has_moved(SUSPECT, camera, depth_m, config);
        let fraction = if self.is_displaced { RIGHT_AGAIN } else { 1.0 };
        let displaced =
            self.is_off(fraction, camera, depth_m, config) || self.has_moved(fraction, camera, depth_m, config);
        if displaced && (!self.is_displaced || self.now.images >= MOST_IMAGES) {
            (self.is_displaced, self.now) = (true, MeanShift::default());
        } else if self.now.images >= MOST_IMAGES {
            self.is_displaced = false;
            self.close();
        }
    }

    /// Returns whether the recent images are off by more than a fraction of the errors that a calibration may
    /// have.
    fn is_off(&self, fraction: f64, camera: &CameraModel, depth_m: f64, config: &Config) -> bool {
        let apart_px = DISPLACED_M * camera.focal_px / depth_m;
        let turned_px = SIGNIFICANT * config.camera_sd_rad * camera.focal_px;
        let noise_px = IMAGE_SD_PX * SIGNIFICANT / self.now.images.sqrt();
        self.now.value.xy().norm() > fraction * (turned_px + apart_px + noise_px)
    }

    /// Returns whether the recent images differ from those before by more than a fraction of the bounds.
    fn has_moved(&self, fraction: f64, camera: &CameraModel, depth_m: f64, config: &Config) -> bool {
        let Self { before, now, .. } = self;
        if before.images < MIN_IMAGES {
            return false;
        }
        let apart_px = DISPLACED_M * camera.focal_px / depth_m;
        // Half of the noise may be common to an image.
        let common_m = config.depth_sd_m(depth_m) * config.depth_common_fraction.unwrap_or(0.0).sqrt();
        let noise = SIGNIFICANT * (now.images.recip() + before.images.recip()).sqrt();
        let change = now.value - before.value;
        change.xy().norm() > fraction * (apart_px + IMAGE_SD_PX * noise)
            || change.z.abs() > fraction * (DISPLACED_M + common_m * noise)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::perception::synthetic::Normal;
    use catch_body::Pose;

    /// Far away, where two centimetres are a pixel.
    const DEPTH_M: f64 = 7.0;

    fn camera() -> CameraModel {
        CameraModel {
            X_WC: Pose::identity(),
            width_px: 640,
            height_px: 480,
            focal_px: 350.0,
            principal_px: [320.0, 240.0],
            rate_hz: None,
            sheet: None,
        }
    }

    /// A throw in which the camera gives so many images, off by `mean_px` to the right. Whether it is
    /// displaced afterwards.
    fn throw(history: &mut ShiftHistory, images: usize, mean_px: f64, normal: &mut Normal) -> bool {
        let config = Config { camera_sd_rad: 0.001, ..Config::default() };
        let mut named = false;
        for _ in 0..images {
            let mut value = normal.vector().component_mul(&Vector3::new(IMAGE_SD_PX, IMAGE_SD_PX, 1e-3));
            value.x += mean_px;
            history.add(&MeanShift { images: 1.0, value }, &camera(), DEPTH_M, &config);
            named |= history.is_displaced;
        }
        history.close();
        named
    }

    /// The calibration is off by half a pixel, which is as it was before.
    fn long_waiting(throws: usize, normal: &mut Normal) -> ShiftHistory {
        let mut history = ShiftHistory::default();
        for i in 0..throws {
            assert!(!throw(&mut history, 1 + 5 * i % 12, 0.5, normal), "throw {i}");
        }
        history
    }

    #[test]
    fn a_camera_that_stays_is_never_named() {
        for seed in 0..20 {
            let mut normal = Normal::new(seed);
            let history = long_waiting(2000, &mut normal);
            assert!(history.before.images > 100.0, "{history:?}");
        }
    }

    /// However few images the first throw after it has, and the next ones.
    #[test]
    fn a_push_of_a_pixel_is_named_after_few_throws() {
        for seed in 0..200 {
            for (throws_before, images) in [(4, [3, 3, 3, 3, 3]), (40, [3, 3, 3, 3, 3]), (40, [2, 4, 4, 4, 4])] {
                let mut normal = Normal::new(seed);
                let mut history = long_waiting(throws_before, &mut normal);
                let named = images.iter().position(|images| throw(&mut history, *images, 1.5, &mut normal));
                assert!(named.is_some_and(|it| it < 4), "{seed}, {throws_before} throws before: {named:?}");
            }
        }
    }

    #[test]
    fn a_camera_that_is_put_back_is_right_again() {
        let mut normal = Normal::new(1);
        let mut history = long_waiting(40, &mut normal);
        assert!((0..4).any(|_| throw(&mut history, 4, 1.5, &mut normal)));
        (0..20).for_each(|_| assert!(throw(&mut history, 4, 1.5, &mut normal)));
        (0..20).for_each(|_| {
            throw(&mut history, 4, 0.5, &mut normal);
        });
        assert!(!history.is_displaced, "{history:?}");
    }
}
