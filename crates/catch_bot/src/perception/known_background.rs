//! Depths of all that the cameras see before anything flies: of the arm that waits, of known obstacles and
//! the floor, and of what the first images show besides.

use std::sync::Arc;

use catch_body::kinematics::LinkPoses;
use catch_cell::{CameraModel, camera::among_neighbours};

use super::{
    Config,
    segmentation::{Background, Surroundings, bleeding_px, is_full, nearer_than_m},
    view::View,
};

/// Background before anything flies.
#[derive(Debug, Clone, Default)]
pub(super) struct KnownBackground {
    /// None before it is prepared.
    limits: Option<Arc<Limits>>,
    /// What each camera has shown so far.
    learned: Vec<Learned>,
}

/// For each camera and pixel of its whole image the depth in front of which the pixel shows something else.
#[derive(Debug, Clone)]
struct Limits {
    /// The arm that waits, and the opening of its gripper.
    waiting: (LinkPoses, f64),
    with_arm_m: Vec<Vec<f32>>,
    /// Depths without the arm; empty where no other background is known.
    without_arm_m: Vec<Vec<f32>>,
}

/// What the first images of a camera have shown.
#[derive(Debug, Clone, Default)]
struct Learned {
    images: usize,
    /// The least depth of each pixel; empty before the first image.
    nearest_m: Vec<f32>,
}

/// Arms whose links are nearer to where they wait than this, in metres and radians, are waiting: half of the
/// margin by which a pixel must be nearer than the background.
const WAITING: f64 = 5e-3;

impl KnownBackground {
    /// Prepares the background with an arm that will be waiting where `surroundings` say.
    pub fn before_flight(cameras: &[CameraModel], surroundings: &Surroundings<'_>, config: &Config) -> Self {
        let limits_m = |known: Option<&Surroundings<'_>>| -> Vec<Vec<f32>> {
            let of_camera = |camera: &CameraModel| {
                let background = Background::new(camera, known, &camera.full_window(), config);
                self::limits_m(&background.cast_all(), camera, config)
            };
            cameras.iter().map(of_camera).collect()
        };
        let limits = Limits {
            waiting: (surroundings.X_WL, surroundings.width_m),
            with_arm_m: limits_m(Some(surroundings)),
            without_arm_m: if config.sees_floor() { limits_m(None) } else { Vec::new() },
        };
        Self { limits: Some(Arc::new(limits)), learned: Vec::new() }
    }

    /// Learns the background from the first images of each camera. Returns whether there was any such image.
    pub fn learn(&mut self, view: &View<'_>, config: &Config) -> bool {
        let Some(limits) = self.limits.as_mut().filter(|_| config.background_images > 0) else { return false };
        let mut learns = false;
        for (_, frame) in view.seen().filter(|(_, frame)| frame.mask.is_none()) {
            let Some(camera) = view.cameras.get(frame.camera) else { continue };
            self.learned.resize_with(view.cameras.len(), Learned::default);
            let learned = &mut self.learned[frame.camera];
            if learned.images >= config.background_images || !is_full(frame, camera) {
                continue;
            }
            learns = true;
            learned.images += 1;
            learned.nearest_m.resize(frame.window.area(), f32::INFINITY);
            for (nearest_m, found_m) in learned.nearest_m.iter_mut().zip(&frame.depth_m) {
                // Not a number is nearer than nothing.
                *nearest_m = if *found_m > 0.0 { nearest_m.min(*found_m) } else { *nearest_m };
            }
            if learned.images == config.background_images {
                let limits_m = limits_m(&std::mem::take(&mut learned.nearest_m), camera, config);
                Arc::make_mut(limits).include(frame.camera, &limits_m);
            }
        }
        learns
    }

    /// The limits in a camera's image, as far as they still hold with the arm that is known.
    pub fn limits_m(&self, camera: usize, known: Option<&Surroundings<'_>>) -> Option<&[f32]> {
        let limits = self.limits.as_ref()?;
        let is_waiting = known.is_some_and(|known| known.stands_as(&limits.waiting, WAITING));
        let limits_m = if is_waiting { &limits.with_arm_m } else { &limits.without_arm_m };
        limits_m.get(camera).map(Vec::as_slice)
    }
}

impl Limits {
    /// Includes what a camera has shown beside the arm. Nobody knows what stands behind that.
    fn include(&mut self, camera: usize, learned_m: &[f32]) {
        let Self { with_arm_m, without_arm_m, .. } = self;
        let Some(with_arm_m) = with_arm_m.get_mut(camera) else { return };
        without_arm_m.resize_with(without_arm_m.len().max(camera + 1), Vec::new);
        let without_arm_m = &mut without_arm_m[camera];
        without_arm_m.resize(with_arm_m.len(), f32::INFINITY);
        for ((with_arm_m, without_arm_m), learned_m) in with_arm_m.iter_mut().zip(without_arm_m).zip(learned_m) {
            *without_arm_m = if *with_arm_m < *without_arm_m { 0.0 } else { without_arm_m.min(*learned_m) };
            *with_arm_m = with_arm_m.min(*learned_m);
        }
    }
}

/// Depths before which the pixels of an image show something else than these depths.
fn limits_m(depths_m: &[f32], camera: &CameraModel, config: &Config) -> Vec<f32> {
    let mut limits_m = among_neighbours(depths_m, camera.width_px as usize, bleeding_px(config) as usize, f32::min);
    limits_m.iter_mut().for_each(|depth_m| *depth_m = nearer_than_m(f64::from(*depth_m), config) as f32);
    limits_m
}
