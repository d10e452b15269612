//! Where the cameras look, corrected by what they see of the arm.
//!
//! A camera that is turned by 0.05° sees everything at 7 m in a place 6 mm off, and what twenty of them agree on is still off by
//! 2 mm along each axis: nothing in the flight of an object tells. But all of them see the arm, and the encoders say where it is.
//! While it stands still, the outline that it has in an image is held against the one that it should have; the shift between both
//! is how far the camera is turned. How far it is displaced cannot be told from that, and need not be: near the arm, where
//! objects are caught, a small displacement looks like a turn.

use catch_body::kinematics::LinkPoses;
use catch_cell::{CameraModel, DepthFrame};
use nalgebra::{Matrix2, Point2, UnitQuaternion, Vector2, Vector3};

use super::{
    Config,
    acquisition::is_within,
    segmentation::{Background, Surroundings},
};

/// The arm's outline, where it is met on the way along a row or a column of pixels.
#[derive(Debug, Clone, Copy)]
struct Crossing {
    /// Whether on the way along a row, else along a column.
    along_row: bool,
    /// Number of that row or column.
    line: usize,
    /// The last pixel before the outline.
    last: usize,
    /// Whether the arm begins there, or else ends.
    begins: bool,
    /// Where the outline should be, in image coordinates along the line.
    at_px: f64,
    /// By how much that changes from line to line.
    slope: f64,
}

/// What is known of the cameras' attitudes.
#[derive(Debug, Clone, Default)]
pub struct CameraAlignment {
    /// For each camera, the outline of the arm.
    outlines: Vec<Vec<Crossing>>,
    /// For each camera, the pixels that showed anything in any of its images.
    shown: Vec<Vec<bool>>,
    /// Where the arm stood in the first of them.
    stood: Option<LinkPoses>,
    images: usize,
}

/// Pixels to each side of the outline that are looked at: several times as many as cameras are off.
const REACH_PX: usize = 3;
/// Steps in which an outline is found between two pixels: to a 64th.
const BISECTIONS: usize = 6;
/// Outlines more slanted than this to their line are left to the lines across.
const STEEPEST: f64 = 1.3;
/// An image tells where an outline is to a pixel; its standard deviation is that of a uniform distribution.
const CROSSING_SD_PX: f64 = 0.289;
/// Crossings that are farther than this from what the others say are something else's, in pixels.
const OUTLIER_PX: f64 = 1.2;
/// An arm whose links have moved less than this, in metres and radians, stands still: a tenth of a pixel.
const STILL: f64 = 1e-3;
/// Images of an arm that stands still tell no more from here on.
const ENOUGH_IMAGES: usize = 8;

impl CameraAlignment {
    /// Takes in the images of one capture time and turns `aligned` to what all of them tell, starting from the cameras as they
    /// were `told`. `still` are the depths of the arm in each image, as told.
    ///
    /// Nothing happens once the arm has moved, where the floor hides its outline, and where cameras need no alignment.
    pub(super) fn observe(
        &mut self,
        frames: &[DepthFrame],
        told: &[CameraModel],
        still: &[Vec<f32>],
        surroundings: Option<&Surroundings<'_>>,
        config: &Config,
        aligned: &mut [CameraModel],
    ) {
        let Some(X_WL) = surroundings.map(|known| known.X_WL).filter(|_| !config.floor_visible) else { return };
        let stands_still = is_within(STILL, self.stood.get_or_insert(X_WL), &X_WL);
        if self.images == ENOUGH_IMAGES || !stands_still {
            self.images = ENOUGH_IMAGES;
            return;
        }
        if self.outlines.is_empty() {
            let outline = |(camera, still): (&CameraModel, &Vec<f32>)| {
                let background = Background::new(camera, surroundings, &camera.full_window(), config);
                outline(camera.width_px as usize, still, &|uv| background.depth_m(uv).is_finite())
            };
            self.outlines = told.iter().zip(still).map(outline).collect();
            self.shown = still.iter().map(|still| vec![false; still.len()]).collect();
        }
        self.images += 1;
        for frame in frames.iter().filter(|frame| frame.mask.is_none()) {
            let i = frame.camera;
            let (Some(camera), Some(aligned), Some(shown)) = (told.get(i), aligned.get_mut(i), self.shown.get_mut(i))
            else {
                continue;
            };
            if frame.window != camera.full_window() || frame.depth_m.len() < shown.len() {
                continue;
            }
            for (shown, depth_m) in shown.iter_mut().zip(&frame.depth_m) {
                *shown |= depth_m.is_finite() && *depth_m > 0.0;
            }
            let shift_px = shift_px(&self.outlines[i], shown, camera, config.camera_sd_rad);
            // With p_C' = p_C − δ × p_C a point on the axis moves by f·(−δ_y, δ_x) in the image.
            let turn = Vector3::new(shift_px.y, -shift_px.x, 0.0) / camera.focal_px;
            aligned.X_WC.rotation = camera.X_WC.rotation * UnitQuaternion::from_scaled_axis(turn);
        }
    }
}

/// The outline of what `still` shows, between pixels by asking whether something `is_there`.
fn outline(width: usize, still: &[f32], is_there: &impl Fn(&Point2<f64>) -> bool) -> Vec<Crossing> {
    let height = still.len() / width.max(1);
    let mut crossings = Vec::new();
    for along_row in [true, false] {
        let (lines, length) = if along_row { (height, width) } else { (width, height) };
        let shows =
            |line: usize, k: usize| still[if along_row { line * width + k } else { k * width + line }].is_finite();
        let first = crossings.len();
        for line in 0..lines {
            for last in REACH_PX - 1..length.saturating_sub(REACH_PX) {
                let begins = shows(line, last + 1);
                // A clean edge: nothing on one side, the arm on the other.
                let is_clean =
                    (0..REACH_PX).all(|i| shows(line, last - i) != begins && shows(line, last + 1 + i) == begins);
                if is_clean {
                    let across = line as f64 + 0.5;
                    let at =
                        |along: f64| if along_row { Point2::new(along, across) } else { Point2::new(across, along) };
                    let (mut low, mut high) = (last as f64 + 0.5, last as f64 + 1.5);
                    for _ in 0..BISECTIONS {
                        let middle = f64::midpoint(low, high);
                        if is_there(&at(middle)) == begins { high = middle } else { low = middle }
                    }
                    let at_px = f64::midpoint(low, high);
                    crossings.push(Crossing { along_row, line, last, begins, at_px, slope: f64::NAN });
                }
            }
        }
        add_slopes(&mut crossings[first..]);
    }
    crossings.retain(|it| it.slope.abs() < STEEPEST);
    crossings
}

/// Slopes from the crossings of the same outline on the lines before and after; NaN where there are none.
fn add_slopes(crossings: &mut [Crossing]) {
    for i in 0..crossings.len() {
        let Crossing { line, begins, at_px, .. } = crossings[i];
        let belongs = |other: &&Crossing, to: usize| {
            other.line == to && other.begins == begins && (other.at_px - at_px).abs() < 1.5 * STEEPEST
        };
        let before = crossings[..i].iter().rev().take_while(|it| it.line + 1 >= line).find(|it| belongs(it, line - 1));
        let after = crossings[i..].iter().take_while(|it| it.line <= line + 1).find(|it| belongs(it, line + 1));
        if let (Some(before), Some(after)) = (before, after) {
            crossings[i].slope = (after.at_px - before.at_px) / 2.0;
        }
    }
}

/// By how much the outline is shifted in an image in which these pixels show something: least squares, with how far cameras
/// are off as a prior.
fn shift_px(outline: &[Crossing], shown: &[bool], camera: &CameraModel, camera_sd_rad: f64) -> Vector2<f64> {
    let width = camera.width_px as usize;
    let prior = Matrix2::identity() * (camera_sd_rad * camera.focal_px).powi(-2);
    let seen = |it: &Crossing| Some((it.found_px(shown, width)? - it.at_px, it.gradient()));
    let mut seen: Vec<(f64, Vector2<f64>)> = outline.iter().filter_map(seen).collect();
    let mut shift = Vector2::zeros();
    for round in 0..3 {
        if round > 0 {
            seen.retain(|(found, gradient)| (found - gradient.dot(&shift)).abs() < OUTLIER_PX);
        }
        let (mut information, mut pull) = (prior, Vector2::zeros());
        for (found, gradient) in &seen {
            information += gradient * gradient.transpose() * CROSSING_SD_PX.powi(-2);
            pull += gradient * (found * CROSSING_SD_PX.powi(-2));
        }
        shift = information.cholesky().map_or(shift, |factor| factor.solve(&pull));
    }
    shift
}

impl Crossing {
    /// How it moves along its line when the image moves by a pixel to the right, and down.
    fn gradient(&self) -> Vector2<f64> {
        if self.along_row { Vector2::new(1.0, -self.slope) } else { Vector2::new(-self.slope, 1.0) }
    }

    /// Where it is in an image: between the pixels that show nothing and those that show something, some of which may be
    /// missing. `None` if it is not clear.
    fn found_px(&self, shown: &[bool], width: usize) -> Option<f64> {
        let first = self.last + 1 - REACH_PX;
        let shows = |k: usize| shown[if self.along_row { self.line * width + k } else { k * width + self.line }];
        // Pixels of the arm may be missing, but where there is nothing nothing is seen.
        let cost = |before: usize| -> usize {
            let wrong = |i: usize| match ((i < before) == self.begins, shows(first + i)) {
                (true, true) => 2,
                (false, false) => 1,
                _ => 0,
            };
            (0..2 * REACH_PX).map(wrong).sum()
        };
        let least = (0..=2 * REACH_PX).map(cost).min()?;
        let mut best = (0..=2 * REACH_PX).filter(|before| cost(*before) == least);
        let low = best.next()?;
        let high = best.next_back().unwrap_or(low);
        (least <= 1 && low > 0 && high < 2 * REACH_PX).then(|| (first + first + low + high) as f64 / 2.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::perception::{
        Workspace,
        synthetic::{self, Normal},
        unlabelled::arm,
    };
    use catch_body::{Pose, ray_cast::ArmSurface};

    /// Mean angle in radians between where cameras look and where they are thought to look.
    fn off_rad(cameras: &[CameraModel], truth: &[CameraModel]) -> f64 {
        let off = |(a, b): (&CameraModel, &CameraModel)| a.X_WC.rotation.angle_to(&b.X_WC.rotation);
        cameras.iter().zip(truth).map(off).sum::<f64>() / truth.len() as f64
    }

    /// Cameras that are turned by 0.05° about each axis across their own look at the arm, a tenth of whose pixels are missing; a
    /// thing of 0.3 m beside it is none of the arm's.
    #[test]
    fn cameras_are_turned_to_where_they_look() {
        const SD_RAD: f64 = 0.00087;
        let (robot, gripper) = arm();
        let surface = ArmSurface::new(&robot, &gripper);
        let surroundings = Surroundings { arm: &surface, X_WL: robot.link_poses(&robot.ready_q), width_m: 0.1 };
        let config = Config { camera_sd_rad: SD_RAD, ..Config::default() };
        let told = synthetic::flight_rig();
        let mut normal = Normal::new(1);
        let turned = |camera: &CameraModel| {
            let turn = normal.vector().component_mul(&Vector3::new(SD_RAD, SD_RAD, 0.0));
            let X_CT = Pose::from_parts(Vector3::zeros().into(), UnitQuaternion::from_scaled_axis(turn));
            CameraModel { X_WC: camera.X_WC * X_CT, ..camera.clone() }
        };
        let truth: Vec<CameraModel> = told.iter().map(turned).collect();
        let (mut workspace, mut aligned) = (Workspace::default(), told.clone());
        let before = off_rad(&aligned, &truth);
        let mut after = Vec::new();
        for image in 0..4 {
            let frame = |(i, camera): (usize, &CameraModel)| {
                let window = camera.full_window();
                let mut depth_m = Vec::new();
                Background::new(camera, Some(&surroundings), &window, &config).cast_all(&mut depth_m);
                for (pixel, depth_m) in depth_m.iter_mut().enumerate() {
                    let uv = window.pixel_centre(pixel);
                    if (uv.x - 160.0).abs() < 8.0 && (uv.y - 150.0).abs() < 8.0 {
                        *depth_m = 6.0;
                    } else if normal.uniform(0.0, 1.0) < 0.1 {
                        *depth_m = f32::NAN;
                    }
                }
                DepthFrame { camera: i, capture_s: 0.01 * f64::from(image), window, depth_m, mask: None }
            };
            let frames: Vec<DepthFrame> = truth.iter().enumerate().map(frame).collect();
            workspace.align(&frames, &told, Some(&surroundings), &config, &mut aligned);
            after.push(off_rad(&aligned, &truth));
        }
        assert!(before > SD_RAD, "{before}");
        // From 6 mm at 7 m to less than 2 mm by one image, and less than 1 mm by four.
        assert!(after[0] < before / 3.0 && after[3] < before / 6.0, "{before} → {after:?}");
    }

    /// A line at 37.3 px between nothing and something, half of whose pixels beyond the first are missing.
    #[test]
    fn an_outline_is_found_although_pixels_are_missing() {
        let shown: Vec<bool> = (0..64).map(|k| k == 37 || (k > 37 && k % 2 == 0)).collect();
        let still: Vec<f32> = (0..64).map(|k| if k >= 37 { 1.0 } else { f32::INFINITY }).collect();
        let mut found = outline(64, &still.repeat(3), &|uv| uv.x > 37.3);
        found.retain(|it| it.along_row);
        assert_eq!(found.len(), 1, "the middle one of three rows has a slope");
        assert!((found[0].at_px - 37.3).abs() < 0.02 && found[0].slope == 0.0 && found[0].begins);
        assert_eq!(found[0].found_px(&shown.repeat(3), 64), Some(37.0));
        assert_eq!(found[0].found_px(&[false; 192], 64), None);
    }
}
