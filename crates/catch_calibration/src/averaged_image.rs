//! Images of an arm that stood still become one; of a moving arm each is one by itself.

use catch_cell::{CameraModel, DepthFrame};

use super::{ArmSample, Session, arm_at, arm_at_rest};

/// Joints that moved by less than this between two images, in radians, stood still.
const STILL_RAD: f64 = 1e-3;
/// Nor do images farther apart than this, in seconds, belong together.
const APART_S: f64 = 0.5;
/// Where at least this fraction of the images show the same, that stands still.
const STILL_FRACTION: f64 = 0.6;
/// It shows the same within so many standard deviations.
const SAME_SD: f64 = 5.0;

/// Images of one camera and one pose of the arm, averaged.
#[derive(Debug, Clone)]
pub struct AveragedImage {
    /// Mean capture time on the camera's own clock.
    pub capture_s: f64,
    /// How many images.
    pub count: usize,
    /// Width of the full image.
    pub width_px: usize,
    /// Mean of 1/z over those that show something, in 1/m, zero where none does.
    pub inverse_m: Vec<f32>,
    /// How many of them show something.
    pub shown: Vec<u8>,
    /// Whether the arm stood still.
    pub is_still: bool,
}

/// The images of one camera. Those that are not full ones say nothing.
pub fn averaged(camera: usize, model: &CameraModel, session: &Session) -> Vec<AveragedImage> {
    let mut images: Vec<AveragedImage> = Vec::new();
    let mut first: Option<ArmSample> = None;
    let usable = |it: &&DepthFrame| {
        it.camera == camera && it.window == model.full_window() && it.depth_m.len() == it.window.area()
    };
    for frame in session.frames.iter().filter(usable) {
        let Some(arm) = arm_at(&session.arm, frame.capture_s) else { continue };
        let belongs =
            first.is_some_and(|it| (it.q - arm.q).amax() < STILL_RAD && frame.capture_s - it.time_s < APART_S);
        match images.last_mut().filter(|it| belongs && it.count < usize::from(u8::MAX)) {
            Some(image) => image.add(frame),
            None => {
                images.push(AveragedImage::new(model.width_px as usize, frame));
                first = Some(arm);
            }
        }
    }
    for image in &mut images {
        let seen = image.inverse_m.iter_mut().zip(&image.shown).filter(|(_, shown)| **shown > 0);
        seen.for_each(|(sum, shown)| *sum /= f32::from(*shown));
        image.capture_s /= image.count as f64;
        let speed = arm_at(&session.arm, image.capture_s).map_or(0.0, |it| it.dq.amax());
        image.is_still = speed < super::SLOW_RADPS;
    }
    images
}

impl AveragedImage {
    fn new(width_px: usize, frame: &DepthFrame) -> Self {
        let pixels = frame.depth_m.len();
        let mut image = Self {
            capture_s: 0.0,
            count: 0,
            width_px,
            inverse_m: vec![0.0; pixels],
            shown: vec![0; pixels],
            is_still: false,
        };
        image.add(frame);
        image
    }

    fn add(&mut self, frame: &DepthFrame) {
        self.capture_s += frame.capture_s;
        self.count += 1;
        for ((sum, shown), depth_m) in self.inverse_m.iter_mut().zip(&mut self.shown).zip(&frame.depth_m) {
            if *depth_m > 0.0 && depth_m.is_finite() {
                *sum += 1.0 / depth_m;
                *shown += 1;
            }
        }
    }

    /// The arm as it was then, if `time_offset_s` is to be added to the camera's time stamps.
    pub fn arm(&self, samples: &[ArmSample], time_offset_s: f64) -> Option<ArmSample> {
        let at = if self.is_still { arm_at_rest } else { arm_at };
        at(samples, self.capture_s + time_offset_s)
    }

    /// The fraction of the images in which a pixel shows something else than what stands still behind the
    /// arm, whose surface is predicted at an inverse depth there or nearby: the base stands still, too, and
    /// so do the pixels by which it seems larger.
    pub fn shown_fraction(&self, pixel: usize, still: &StillImage, predicted_m: f64) -> f64 {
        let is_arm = still.shows(pixel, predicted_m as f32);
        let is_behind = !is_arm && still.shows(pixel, self.inverse_m[pixel]);
        if is_behind { 0.0 } else { f64::from(self.shown[pixel]) / self.count as f64 }
    }
}

/// What a camera sees wherever the arm is.
#[derive(Debug, Clone)]
pub struct StillImage {
    /// 1/z in 1/m; zero where nothing stands still.
    inverse_m: Vec<f32>,
    same_m: f32,
}

impl StillImage {
    /// What most images show within the noise, whose standard deviation in 1/z is `sd_per_m`.
    pub fn of(images: &[&AveragedImage], sd_per_m: f64) -> Self {
        let pixels = images.first().map_or(0, |it| it.inverse_m.len());
        let same_m = (SAME_SD * sd_per_m) as f32;
        let needed = (STILL_FRACTION * images.len() as f64).ceil() as usize;
        let mut seen = Vec::with_capacity(images.len());
        let of_pixel = |pixel: usize| {
            seen.clear();
            seen.extend(images.iter().filter(|it| it.shown[pixel] > 0).map(|it| it.inverse_m[pixel]));
            if seen.len() < needed.max(3) {
                return 0.0;
            }
            let middle = seen.len() / 2;
            let (_, median, _) = seen.select_nth_unstable_by(middle, f32::total_cmp);
            let median = *median;
            let same = seen.iter().filter(|it| (**it - median).abs() < same_m).count();
            if same < needed { 0.0 } else { median }
        };
        Self { inverse_m: (0..pixels).map(of_pixel).collect(), same_m }
    }

    /// Whether a pixel shows what stands still there.
    pub fn shows(&self, pixel: usize, inverse_m: f32) -> bool {
        let still = self.inverse_m[pixel];
        still > 0.0 && (inverse_m - still).abs() < self.same_m
    }
}
