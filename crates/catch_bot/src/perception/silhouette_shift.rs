//! By how much the arm's silhouette and depth in a camera's images are off, now and before.

use catch_cell::CameraModel;
use nalgebra::{Matrix4, Vector3, Vector4};

use super::{Config, arm_edges::Sight};

/// How far off the arm is in one image.
#[derive(Debug, Clone, Copy)]
pub(super) struct Shift {
    /// In pixels to the right and down, and in depth by metres.
    value: Vector3<f64>,
}

/// The mean of some images.
#[derive(Debug, Clone, Copy, Default)]
struct Mean {
    images: f64,
    value: Vector3<f64>,
}

/// What the images of a camera said of its shift.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct ShiftHistory {
    /// Before, while nothing was wrong.
    before: Mean,
    /// Lately.
    now: Mean,
    is_displaced: bool,
}

/// Images that tell something, and after which a new mean begins.
const MIN_IMAGES: f64 = 3.0;
const MOST_IMAGES: f64 = 32.0;
/// Images that the mean of those before counts for at most.
const MOST_BEFORE: f64 = 256.0;
/// Standard deviation of what the silhouette in one image says, in pixels.
const IMAGE_SD_PX: f64 = 0.2;
/// Standard deviations by which anything must be off.
const SIGNIFICANT: f64 = 5.0;
/// A camera that was displaced is right again when it is off by less than this fraction of the bounds.
const RIGHT_AGAIN: f64 = 0.7;
/// Standard deviations of what is not known of an image beforehand: shifts in pixels, the fraction without a depth, and how far edges
/// grow in pixels.
const PRIOR_SD: [f64; 4] = [20.0, 20.0, 0.3, 3.0];

impl Shift {
    /// Least squares over the edges; `None` without enough of them.
    pub fn of(sight: &Sight) -> Option<Self> {
        sight.explained?;
        let prior = Matrix4::from_diagonal(&Vector4::from(PRIOR_SD).map(|sd| sd.powi(-2)));
        let found = (sight.information + prior).cholesky()?.solve(&sight.pull);
        Some(Self { value: Vector3::new(found[0], found[1], sight.depth_error_m.unwrap_or(0.0)) })
    }
}

impl Mean {
    fn add(&mut self, other: &Self, most: f64) {
        let images = self.images + other.images;
        if images > 0.0 {
            self.value += (other.value - self.value) * (other.images / images);
        }
        self.images = images.min(most);
    }
}

impl ShiftHistory {
    /// Whether the camera stands or looks elsewhere than it is said to, or than it did before.
    pub fn is_displaced(&self) -> bool {
        self.is_displaced
    }

    /// What was seen lately becomes what was seen before, unless something was wrong.
    pub fn close(&mut self) {
        let now = std::mem::take(&mut self.now);
        if !self.is_displaced && now.images >= MIN_IMAGES {
            self.before.add(&now, MOST_BEFORE);
        }
    }

    /// Takes in one image of a `camera` that sees the arm at a depth.
    pub fn add(&mut self, shift: Shift, camera: &CameraModel, depth_m: f64, config: &Config) {
        self.now.add(&Mean { images: 1.0, value: shift.value }, MOST_IMAGES);
        if self.now.images < MIN_IMAGES {
            return;
        }
        let displaced = self.exceeds(if self.is_displaced { RIGHT_AGAIN } else { 1.0 }, camera, depth_m, config);
        if displaced && !self.is_displaced {
            (self.is_displaced, self.now) = (true, Mean::default());
        } else if self.now.images >= MOST_IMAGES {
            self.is_displaced = displaced;
            self.close();
        }
    }

    /// Whether the images since lately are off by more than a fraction of the bounds.
    fn exceeds(&self, fraction: f64, camera: &CameraModel, depth_m: f64, config: &Config) -> bool {
        let Self { before, now, .. } = self;
        let apart_px = config.displaced_m * camera.focal_px / depth_m;
        let turned_px = SIGNIFICANT * config.camera_sd_rad * camera.focal_px;
        let noise = |images: f64| SIGNIFICANT / images.sqrt();
        let is_off = now.value.xy().norm() > fraction * (turned_px + apart_px + IMAGE_SD_PX * noise(now.images));
        if before.images < MIN_IMAGES {
            return is_off;
        }
        // Half of the noise may be common to an image.
        let common_m = config.depth_sd_m(depth_m) * config.depth_common_fraction.unwrap_or(0.0).sqrt();
        let change = now.value - before.value;
        let images = (now.images.recip() + before.images.recip()).recip();
        let has_moved = change.xy().norm() > fraction * (apart_px + IMAGE_SD_PX * noise(images))
            || change.z.abs() > fraction * (config.displaced_m + common_m * noise(images));
        is_off || has_moved
    }
}
