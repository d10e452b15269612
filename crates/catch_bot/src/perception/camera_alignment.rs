//! Orientations of the cameras, corrected by the arm that they see.
//!
//! A camera that is rotated by 0.05° sees an object at 7 m displaced by 6 mm, and the average of twenty of
//! them is still off by 2 mm along each axis: nothing in the flight of an object shows it. But all of them
//! see the arm, whose position the encoders measure. While it stands still, its silhouette in an image is
//! compared with the expected one; the shift between both gives the rotation of the camera. The displacement
//! of the camera does not follow from the shift, and is not needed: near the arm, where objects are caught, a
//! small displacement looks like a rotation.

use catch_body::kinematics::LinkPoses;
use catch_cell::{CameraModel, DepthFrame};
use nalgebra::{Matrix2, Point2, UnitQuaternion, Vector2, Vector3};

use super::{
    Config,
    arm_silhouette::{Crossing, Search, crossings},
    segmentation::{Background, Surroundings, is_full},
};

/// The arm's silhouette, where a line of pixels meets it, and what images show there.
#[derive(Debug, Clone, Copy)]
struct Edge {
    crossing: Crossing,
    /// Pixels within [`REACH_PX`] of the crossing that showed anything in any image, one bit each, the first
    /// in the lowest bit.
    shown: u8,
}

/// Estimate of the cameras' orientations.
#[derive(Debug, Clone)]
pub struct CameraAlignment {
    /// The cameras, turned to where they look as far as is known.
    pub cameras: Vec<CameraModel>,
    /// Silhouette of the arm in each camera.
    silhouettes: Vec<Vec<Edge>>,
    /// Link poses and gripper aperture of the arm whose silhouettes these are.
    stood: Option<(LinkPoses, f64)>,
    /// Number of each camera's images that were evaluated.
    images: Vec<usize>,
}

/// Pixels to each side of the silhouette that are looked at: several times as many as cameras are off.
const REACH_PX: usize = 3;
/// The silhouette is found to a 64th of a pixel.
const SEARCH: Search = Search { reach_px: REACH_PX, bisections: 6, steepest: 1.3 };
/// An image tells where a silhouette is to a pixel; its standard deviation is that of a uniform distribution.
const CROSSING_SD_PX: f64 = 0.289;
/// Crossings that are farther than this from what the others say are something else's, in pixels.
const OUTLIER_PX: f64 = 1.2;
/// An arm whose links have moved less than this, in metres and radians, stands still: a tenth of a pixel.
const STILL: f64 = 1e-3;
/// Images of an arm that stands still tell no more from here on.
const ENOUGH_IMAGES: usize = 8;

impl CameraAlignment {
    /// Cameras as they are `told` to stand.
    pub fn new(told: &[CameraModel]) -> Self {
        Self { cameras: told.to_vec(), silhouettes: Vec::new(), stood: None, images: vec![0; told.len()] }
    }

    /// Begins with an arm that will be waiting where `surroundings` say, which makes the first image cost no
    /// more than the others.
    pub fn before_flight(told: &[CameraModel], surroundings: &Surroundings<'_>, config: &Config) -> Self {
        let mut alignment = Self::new(told);
        if is_wanted(config) {
            alignment.silhouette(told, surroundings, config);
        }
        alignment
    }

    /// Works out where the silhouette of the arm should be.
    fn silhouette(&mut self, told: &[CameraModel], known: &Surroundings<'_>, config: &Config) {
        self.stood = Some((known.X_WL, known.width_m));
        self.silhouettes.clear();
        for camera in told {
            let background = Background::new(camera, Some(known), &camera.full_window(), config);
            let still = background.cast_all();
            self.silhouettes
                .push(silhouette(camera.width_px as usize, &still, |uv| background.depth_m(uv).is_finite()));
        }
    }

    /// Takes in the images of one capture time and turns the cameras to what all of them tell, starting from
    /// how they were `told` to stand.
    ///
    /// Nothing happens once the arm has moved, where images have masks (sensors that tell objects apart need
    /// not show the arm), where the floor hides the arm's silhouette, and where cameras are known exactly.
    pub fn observe(
        &mut self,
        frames: &[DepthFrame],
        told: &[CameraModel],
        surroundings: Option<&Surroundings<'_>>,
        config: &Config,
    ) {
        let shows_arm =
            |frame: &DepthFrame| frame.mask.is_none() && told.get(frame.camera).is_some_and(|it| is_full(frame, it));
        let is_of_use = |images: &[usize], frame: &DepthFrame| {
            images.get(frame.camera).is_some_and(|count| *count < ENOUGH_IMAGES) && shows_arm(frame)
        };
        let is_any = is_wanted(config) && frames.iter().any(|frame| is_of_use(&self.images, frame));
        let Some(known) = surroundings.filter(|_| is_any) else { return };
        if !self.stood.as_ref().is_some_and(|stood| known.stands_as(stood, STILL)) {
            if self.images.iter().any(|count| *count > 0) {
                self.images.fill(ENOUGH_IMAGES);
                return;
            }
            self.silhouette(told, known, config);
        }
        for frame in frames {
            if !is_of_use(&self.images, frame) {
                continue;
            }
            let i = frame.camera;
            self.images[i] += 1;
            let (camera, silhouette) = (&told[i], &mut self.silhouettes[i]);
            for edge in silhouette.iter_mut() {
                edge.look(camera.width_px as usize, |pixel| {
                    let depth_m = frame.depth_m[pixel];
                    depth_m.is_finite() && depth_m > 0.0
                });
            }
            let shift_px = shift_px(silhouette, camera, config.camera_sd_rad);
            // With p_C' = p_C − δ × p_C a point on the axis moves by f·(−δ_y, δ_x) in the image.
            let turn = Vector3::new(shift_px.y, -shift_px.x, 0.0) / camera.focal_px;
            self.cameras[i].X_WC.rotation = camera.X_WC.rotation * UnitQuaternion::from_scaled_axis(turn);
        }
    }
}

/// Returns whether cameras can be aligned and need to be.
fn is_wanted(config: &Config) -> bool {
    config.camera_sd_rad > 0.0 && !config.sees_floor()
}

/// The silhouette of what `still` shows, between pixels by asking whether something `is_there`.
fn silhouette(width: usize, still: &[f32], is_there: impl Fn(&Point2<f64>) -> bool) -> Vec<Edge> {
    let shows = |[column, row]: [usize; 2]| still[row * width + column].is_finite();
    let crossings = crossings([width, still.len() / width.max(1)], &SEARCH, shows, is_there);
    crossings.into_iter().map(|crossing| Edge { crossing, shown: 0 }).collect()
}

/// Shift of the silhouette in the images, in pixels: least squares, with the standard deviation of the
/// cameras' orientations as a prior.
fn shift_px(silhouette: &[Edge], camera: &CameraModel, camera_sd_rad: f64) -> Vector2<f64> {
    let prior = Matrix2::identity() * (camera_sd_rad * camera.focal_px).powi(-2);
    let seen = |it: &Edge| Some((it.found_px()? - it.crossing.at_px, it.crossing.gradient()));
    let mut seen: Vec<(f64, Vector2<f64>)> = silhouette.iter().filter_map(seen).collect();
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

impl Edge {
    /// Notes which of its pixels show anything in an image so many pixels wide.
    fn look(&mut self, width: usize, shows: impl Fn(usize) -> bool) {
        for i in 0..2 * REACH_PX {
            let [column, row] = self.crossing.pixel(self.crossing.last + 1 - REACH_PX + i);
            self.shown |= u8::from(shows(row * width + column)) << i;
        }
    }

    /// Position of the crossing in the images, in pixels: between the pixels that show nothing and those that
    /// show something, some of which may be missing. `None` if it is not clear.
    fn found_px(&self) -> Option<f64> {
        let first = self.crossing.last + 1 - REACH_PX;
        // Pixels of the arm may be missing, but where there is nothing nothing is seen.
        let cost = |before: usize| -> usize {
            let wrong = |i: usize| match ((i < before) == self.crossing.begins, self.shown >> i & 1 == 1) {
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

    /// A line at 37.3 px between nothing and something, half of whose pixels beyond the first are missing.
    #[test]
    fn a_silhouette_is_found_although_pixels_are_missing() {
        let shown: Vec<bool> = (0..64).map(|k| k == 37 || (k > 37 && k % 2 == 0)).collect();
        let still: Vec<f32> = (0..64).map(|k| if k >= 37 { 1.0 } else { f32::INFINITY }).collect();
        let mut found = silhouette(64, &still.repeat(3), |uv| uv.x > 37.3);
        found.retain(|it| it.crossing.along_row);
        assert_eq!(found.len(), 1, "the middle one of three rows has a slope");
        let crossing = found[0].crossing;
        assert!((crossing.at_px - 37.3).abs() < 0.02 && crossing.slope == 0.0 && crossing.begins);
        assert_eq!(found[0].found_px(), None);
        found[0].look(64, |pixel| shown[pixel % 64]);
        assert_eq!(found[0].found_px(), Some(37.0));
    }
}
