//! Images of an arm that stood still become one; of a moving arm each is one by itself.

use std::collections::VecDeque;

use catch_cell::{CameraModel, DepthFrame, PixelWindow};

use super::{ArmSample, Session, arm_at, arm_at_rest, arm_motion::STILL_RAD};

/// Largest time in seconds between images that belong together.
const APART_S: f64 = 0.5;
/// Least fraction of the images that show the same depth where something stands still.
const STILL_FRACTION: f64 = 0.6;
/// Standard deviations within which depths are the same.
const SAME_SD: f64 = 5.0;

/// Images of one camera and one pose of the arm, averaged.
#[derive(Debug, Clone)]
pub struct AveragedImage {
    /// Camera that took the images.
    pub camera: usize,
    /// Mean capture time on the camera's own clock.
    pub capture_s: f64,
    /// Number of the images.
    pub(super) count: usize,
    /// The pixels that follow: all that show something.
    pub(super) window: PixelWindow,
    /// Mean of 1/z over the images that show something, in 1/m, zero where none does; and how many do.
    inverse_m: Vec<f32>,
    shown: Vec<u8>,
}

/// Images that are averaged as they come.
#[derive(Debug, Default)]
pub struct Averaging {
    /// Images that were taken after the arm's last sample.
    early: VecDeque<DepthFrame>,
    /// The image of each camera to which the next one may belong, not yet divided by the count, and the arm
    /// in its first one.
    open: Vec<Option<(ArmSample, AveragedImage)>>,
}

impl Averaging {
    /// Takes in a full image; any other one says nothing.
    pub fn add(&mut self, frame: &DepthFrame, full: &[PixelWindow]) {
        self.open.resize(full.len(), None);
        if full.get(frame.camera) == Some(&frame.window) && frame.depth_m.len() == frame.window.area() {
            self.early.push_back(frame.clone());
        }
    }

    /// Averages what was taken before `until_s`, and gives images to which no more can belong to `session`.
    pub fn advance(&mut self, session: &mut Session, until_s: f64) {
        while let Some(frame) = self.early.pop_front_if(|it| it.capture_s < until_s) {
            let Some(arm) = arm_at(&session.arm, frame.capture_s) else { continue };
            let open = &mut self.open[frame.camera];
            let belongs = |(first, image): &&mut (ArmSample, AveragedImage)| {
                let is_near = (first.q - arm.q).amax() < STILL_RAD && frame.capture_s - first.time_s < APART_S;
                is_near && image.count < usize::from(u8::MAX)
            };
            match open.as_mut().filter(belongs) {
                Some((_, image)) => image.add(&frame),
                None => {
                    let next = (arm, AveragedImage::new(&frame));
                    session.images.extend(open.replace(next).map(|(_, image)| image.closed()));
                }
            }
        }
    }

    /// Gives all to `session`.
    pub fn end(mut self, session: &mut Session) {
        self.advance(session, f64::INFINITY);
        session.images.extend(self.open.into_iter().flatten().map(|(_, image)| image.closed()));
    }
}

impl AveragedImage {
    fn new(frame: &DepthFrame) -> Self {
        let pixels = frame.depth_m.len();
        let mut image = Self {
            camera: frame.camera,
            capture_s: 0.0,
            count: 0,
            window: frame.window,
            inverse_m: vec![0.0; pixels],
            shown: vec![0; pixels],
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

    /// The mean of all that was added, without the borders that show nothing.
    fn closed(self) -> Self {
        let [wide, high] = [self.window.width as usize, self.window.height as usize];
        let (mut columns, mut rows) = (wide..0, high..0);
        for (i, _) in self.shown.iter().enumerate().filter(|(_, shown)| **shown > 0) {
            let (column, row) = (i % wide, i / wide);
            columns = columns.start.min(column)..columns.end.max(column + 1);
            rows = rows.start.min(row)..row + 1;
        }
        let window = PixelWindow {
            left: columns.start as u32,
            top: rows.start as u32,
            width: columns.len() as u32,
            height: rows.len() as u32,
        };
        let kept = || rows.clone().flat_map(|row| row * wide + columns.start..row * wide + columns.end);
        let mean = |i: usize| if self.shown[i] > 0 { self.inverse_m[i] / f32::from(self.shown[i]) } else { 0.0 };
        Self {
            capture_s: self.capture_s / self.count as f64,
            window,
            inverse_m: kept().map(mean).collect(),
            shown: kept().map(|i| self.shown[i]).collect(),
            ..self
        }
    }

    /// Mean of 1/z in a column and row of the image over the images that show something, and how many do.
    pub fn at(&self, column: usize, row: usize) -> (f32, u8) {
        let PixelWindow { left, top, width, height } = self.window;
        let (x, y) = (column.wrapping_sub(left as usize), row.wrapping_sub(top as usize));
        if x >= width as usize || y >= height as usize {
            return (0.0, 0);
        }
        let i = y * width as usize + x;
        (self.inverse_m[i], self.shown[i])
    }

    /// Returns whether the arm stood still.
    pub fn is_still(&self, samples: &[ArmSample]) -> bool {
        arm_at(samples, self.capture_s).map_or(0.0, |it| it.dq.amax()) < super::SLOW_RADPS
    }

    /// The arm as it was then, if `time_offset_s` is to be added to the camera's time stamps.
    pub fn arm(&self, samples: &[ArmSample], time_offset_s: f64) -> Option<ArmSample> {
        let at = if self.is_still(samples) { arm_at_rest } else { arm_at };
        at(samples, self.capture_s + time_offset_s)
    }

    /// The fraction of the images in which a pixel shows something else than what stands still behind the
    /// arm, whose surface is predicted at an inverse depth there or nearby: the base stands still, too, and
    /// so do the pixels by which it seems larger.
    pub fn shown_fraction(&self, [column, row]: [usize; 2], still: &StillImage, predicted_m: f64) -> f64 {
        let (inverse_m, shown) = self.at(column, row);
        let is_arm = still.shows([column, row], predicted_m as f32);
        let is_behind = !is_arm && still.shows([column, row], inverse_m);
        if is_behind { 0.0 } else { f64::from(shown) / self.count as f64 }
    }
}

/// Depths that a camera sees wherever the arm is.
#[derive(Debug, Clone)]
pub struct StillImage {
    /// 1/z in 1/m, row by row; zero where nothing stands still.
    inverse_m: Vec<f32>,
    width_px: usize,
    same_m: f32,
}

impl StillImage {
    /// Depths that most images show within the noise, whose standard deviation in 1/z is `sd_per_m`.
    pub fn of(camera: &CameraModel, images: &[&AveragedImage], sd_per_m: f64) -> Self {
        let width_px = camera.width_px as usize;
        let same_m = (SAME_SD * sd_per_m) as f32;
        let needed = (STILL_FRACTION * images.len() as f64).ceil() as usize;
        let mut seen = Vec::with_capacity(images.len());
        let of_pixel = |pixel: usize| {
            seen.clear();
            let of_images = images.iter().map(|it| it.at(pixel % width_px, pixel / width_px));
            seen.extend(of_images.filter(|(_, shown)| *shown > 0).map(|(inverse_m, _)| inverse_m));
            if seen.len() < needed.max(3) {
                return 0.0;
            }
            let middle = seen.len() / 2;
            let (_, median, _) = seen.select_nth_unstable_by(middle, f32::total_cmp);
            let median = *median;
            let same = seen.iter().filter(|it| (**it - median).abs() < same_m).count();
            if same < needed { 0.0 } else { median }
        };
        Self { inverse_m: (0..camera.full_window().area()).map(of_pixel).collect(), width_px, same_m }
    }

    /// Returns whether a pixel shows the surface that stands still there.
    pub fn shows(&self, [column, row]: [usize; 2], inverse_m: f32) -> bool {
        let still = self.inverse_m[row * self.width_px + column];
        still > 0.0 && (inverse_m - still).abs() < self.same_m
    }
}
