//! Inputs of pose estimation.

use catch_body::{Pose, Twist};
use catch_cell::{CameraModel, DepthFrame};
use nalgebra::UnitQuaternion;

use super::segmentation::Surroundings;

/// Depth images of one capture time, or of times between which it is known how the object moves.
#[derive(Debug, Clone, Copy, Default)]
pub struct View<'a> {
    /// The images, oldest first. Those of unknown cameras are passed over.
    pub frames: &'a [DepthFrame],
    /// The cameras, as well as their poses are known.
    pub cameras: &'a [CameraModel],
    /// True for each camera whose images are left out; false for cameras beyond the end of the list.
    pub left_out: &'a [bool],
    /// The arm at the capture time of each image, if it is known; it matters where images come without masks.
    pub surroundings: &'a [Surroundings<'a>],
    /// The object's spatial velocity, by which it moves from one capture time to another.
    pub V_WO: Twist,
}

impl<'a> View<'a> {
    /// The images that count, each with its place among all.
    pub fn seen(&self) -> impl Iterator<Item = (usize, &'a DepthFrame)> + use<'a> {
        let Self { frames, left_out, .. } = *self;
        frames.iter().enumerate().filter(|(_, frame)| left_out.get(frame.camera) != Some(&true))
    }

    /// Capture time of the images, in seconds on the cell's clock: that of the middle one.
    pub fn capture_s(&self) -> f64 {
        let middle_first = self.frames[self.frames.len() / 2..].iter().chain(self.frames);
        middle_first.map(|frame| frame.capture_s).find(|time| time.is_finite()).unwrap_or(0.0)
    }

    /// Pose of the object in an image, if it is at `X_WO` at the capture time of the view.
    pub(super) fn in_image(&self, frame: &DepthFrame, X_WO: &Pose) -> Pose {
        let elapsed_s = frame.capture_s - self.capture_s();
        if elapsed_s == 0.0 || !elapsed_s.is_finite() {
            return *X_WO;
        }
        let turn = UnitQuaternion::from_scaled_axis(self.V_WO.angular * elapsed_s);
        let p_WO = X_WO.translation.vector + self.V_WO.linear * elapsed_s;
        Pose::from_parts(p_WO.into(), turn * X_WO.rotation)
    }
}

/// Prior of the object's pose X_WO before the images are evaluated.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub enum Prior {
    /// No prior.
    #[default]
    Anywhere,
    /// Approximate pose of the object. The orientation counts only where the object looks the same from
    /// several sides.
    Place(Pose),
    /// The pose, as predicted.
    Pose(Pose),
}

impl Prior {
    /// The pose that is given, if it is a number.
    pub fn pose(&self) -> Option<&Pose> {
        match self {
            Self::Anywhere => None,
            Self::Place(X_WO) | Self::Pose(X_WO) => {
                X_WO.to_homogeneous().iter().all(|value| value.is_finite()).then_some(X_WO)
            }
        }
    }
}

impl From<Option<Pose>> for Prior {
    fn from(predicted: Option<Pose>) -> Self {
        predicted.map_or(Self::Anywhere, Self::Pose)
    }
}
