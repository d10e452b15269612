//! Perception (paper, III-B): the object's pose from one set of depth images.
//!
//! Pixels become points, points that belong to the object are kept ([`point_cloud`]), and the reference
//! ([`ReferenceModel`]) is registered to them ([`registration`]), starting from where the last trajectory
//! says the object should be.

mod arm_edges;
pub mod arm_silhouette;
pub mod camera_alignment;
pub mod camera_health;
pub mod camera_offsets;
mod common_noise;
mod depth_plane;
mod detection;
mod edge_growth;
mod estimator;
mod global_registration;
mod half_turns;
mod known_background;
mod normal_equations;
pub mod point_cloud;
pub mod reference;
pub mod registration;
pub mod segmentation;
pub mod silhouette;
mod silhouette_shift;
#[cfg(test)]
#[path = "../../tests/it/synthetic.rs"]
pub(crate) mod synthetic;
mod thinning;
mod view;
mod viewpoint;

use catch_body::{Pose, quantity};
use catch_cell::CameraModel;
use nalgebra::Matrix6;
use serde::{Deserialize, Serialize};

use known_background::KnownBackground;

pub use camera_health::CameraStatus;
pub use catch_body::symmetry::{RotationGroup, Symmetry};
pub use estimator::{GATE_M, ObjectFinder, PoseEstimator, SdfEstimator};
pub use point_cloud::{DepthNoise, SceneCloud};
pub use reference::{MODEL_SD_M, ReferenceModel};
pub use registration::{Fit, MAX_RESIDUAL_M, MIN_POINTS, Registration};
pub use segmentation::Surroundings;
pub use view::{Prior, View};

/// Settings of perception.
#[quantity::checked(default, deny_unknown_fields)]
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Config {
    /// Depth noise of the cameras, as their data sheet has it; none if it is not set.
    pub depth_noise: Option<DepthNoise>,
    /// Standard deviation in radians of the direction in which a camera sees the arm, from how it is said to
    /// stand: cameras are aligned on the arm that they see. A rotation that the camera's position makes up
    /// for there does not count. Zero where cameras are known exactly.
    pub camera_sd_rad: quantity::error_rad,
    /// True if the cameras see the floor, the plane z = 0; false if it is not set.
    pub floor_visible: Option<bool>,
    /// True if depths may be missing where there is a surface; false if no data sheet says so. No setting of
    /// a file, like the two after it.
    #[serde(skip)]
    pub depth_dropout: Option<bool>,
    /// Fraction of the depth noise's variance that all pixels of one image have in common; none without a
    /// data sheet.
    #[serde(skip)]
    pub depth_common_fraction: Option<f64>,
    /// Number of pixels beside a depth edge that may show another surface, because stereo matches windows;
    /// none without a data sheet.
    #[serde(skip)]
    pub depth_edge_px: Option<u32>,
    /// Images of each camera, the first ones, that show the cell before anything flies: whatever is in them
    /// is background. None by default: all beside the arm, known obstacles and the floor is then the object.
    pub background_images: quantity::background_images<usize>,
    /// Indices of cameras whose poses no calibration has found: their images are left out.
    pub uncalibrated_cameras: Vec<usize>,
}

impl Default for Config {
    fn default() -> Self {
        Self {
            depth_noise: None,
            camera_sd_rad: 0.001,
            floor_visible: None,
            depth_dropout: None,
            depth_common_fraction: None,
            depth_edge_px: None,
            background_images: 0,
            uncalibrated_cameras: Vec::new(),
        }
    }
}

impl Config {
    /// Standard deviation of a depth of `z_m`, in metres.
    pub fn depth_sd_m(&self, z_m: f64) -> f64 {
        self.depth_noise.unwrap_or_default().sd_m(z_m)
    }

    fn sees_floor(&self) -> bool {
        self.floor_visible.unwrap_or_default()
    }

    fn misses_depths(&self) -> bool {
        self.depth_dropout.unwrap_or_default()
    }

    fn edge_px(&self) -> u32 {
        self.depth_edge_px.unwrap_or_default()
    }
}

/// The object's pose at one instant.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct ObjectPose {
    /// Time at which the images were taken, in seconds on the cell's clock.
    pub capture_s: f64,
    /// Pose of the object; O has its origin at the centre of mass as the reference model estimates it.
    pub X_WO: Pose,
    /// Inverse covariance of (rotation vector in W, rad; position in W, m). Turns that cannot be seen have
    /// none.
    pub information: Matrix6<f64>,
    /// Number of points that it rests on.
    pub points: usize,
    /// Root mean square distance of those points from the reference surface, in metres.
    pub residual_m: f64,
    /// Mean square of the points' residuals in standard deviations: the mismatch between object and points.
    /// `None` where no depth shows its shape.
    pub points_mismatch: Option<f64>,
    /// Mean square of the silhouette rays' residuals in standard deviations, where these were needed, or how
    /// far depths too noisy to show a shape are tilted otherwise, if that is more. Known objects are
    /// distinguished by one of the two mismatches, not by one against the other.
    pub silhouette_mismatch: Option<f64>,
    /// Iterations that it took.
    pub iterations: usize,
    /// True if the pose was found without regard to the predicted pose.
    pub registered_globally: bool,
}

/// Reason for which there is no pose.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum PerceptionStatus {
    /// No pixel shows anything that could be the object.
    NoPoints,
    /// Too few pixels show the object.
    TooFewPoints,
    /// The reference could not be brought to lie on the points.
    NotConverged,
    /// There is no reference to look for: its scan was empty.
    NoReference,
}

/// Buffers of an [`ObjectFinder`], kept so that finding an object need not allocate. Nothing but the
/// background that the first images have shown is carried from one call to the next.
#[derive(Debug, Clone, Default)]
pub struct Workspace {
    scene: SceneCloud,
    thinned: SceneCloud,
    detector: detection::Detector,
}

impl Workspace {
    /// Prepares the background with an arm that will be waiting where `surroundings` say while the object is
    /// searched in images without masks. The search becomes faster, and its result changes only at the very
    /// edge of the arm.
    pub fn before_flight(cameras: &[CameraModel], surroundings: &Surroundings<'_>, config: &Config) -> Self {
        let mut workspace = Self::default();
        workspace.detector.background = KnownBackground::before_flight(cameras, surroundings, config);
        workspace
    }
}
