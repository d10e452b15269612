//! Perception (paper, III-B): the object's pose from one set of depth images.
//!
//! Pixels become points, points that belong to the object are kept ([`point_cloud`]), and the reference ([`ReferenceModel`])
//! is registered to them ([`registration`]), starting from where the last trajectory says the object should be.

mod arm_edges;
pub mod camera_alignment;
pub mod camera_health;
pub mod camera_offsets;
mod detection;
mod distance_field;
mod edge_growth;
mod estimator;
mod global_registration;
mod half_turns;
mod neighbours;
mod normal_distribution;
mod normal_equations;
pub mod point_cloud;
pub mod reference;
pub mod registration;
pub mod segmentation;
pub mod silhouette;
mod silhouette_shift;
pub mod symmetry;
#[cfg(test)]
#[path = "../../tests/it/synthetic.rs"]
pub(crate) mod synthetic;
mod view;
mod viewpoint;

use std::ops::RangeInclusive;

use catch_body::Pose;
use catch_cell::CameraModel;
use nalgebra::Matrix6;
use serde::{Deserialize, Serialize};

use crate::settings::{DURATION_S, FRACTION, Faults, NOT_NEGATIVE, SettingError, Settings};
pub use camera_health::CameraStatus;
pub use distance_field::DistanceField;
pub use estimator::{ObjectFinder, PoseEstimator, SdfEstimator};
pub use point_cloud::{DepthNoise, SceneCloud};
pub use reference::ReferenceModel;
pub use registration::{Fit, Registration};
pub use segmentation::Surroundings;
pub use symmetry::{RotationGroup, Symmetry};
pub use view::{Prior, View};

/// Widths of depth edges that can be.
const EDGE_PX: RangeInclusive<f64> = 0.0..=8.0;

/// Settings of perception.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Config {
    /// Points of the reference scan closer than this to each other are thinned, in metres. 1.5 mm keeps nearly all points of
    /// a scan with 200×150 pixels per camera and bounds the work for denser ones.
    pub reference_spacing_m: f64,
    /// Spacing of the reference points that are kept for choosing grasps: 2.5 mm, the voxels of the original.
    pub grasp_spacing_m: f64,
    /// Nodes of the signed distance field next to the surface, in metres.
    pub distance_grid_m: f64,
    /// Root mean square distance up to which a turned object counts as looking the same. Measured for turns by any angle:
    /// ≤ 0.3 mm on symmetric objects, ≥ 8 mm on others.
    pub symmetry_tolerance_m: f64,
    /// The same for single rotations, such as the quarter turns of a brick, as a fraction of the largest ball that fits into the object, where that
    /// is more: what differs by less is confused from one image to the next. Half of it counts for turns by any angle, so that a can with beads
    /// is round and a hexagonal prism is not.
    pub confused_fraction: f64,
    /// Depth noise of the cameras, as their data sheet has it; none if it is not set.
    pub depth_noise: Option<DepthNoise>,
    /// Standard deviation in pixels by which the object's silhouette in an image may be off: not by the pixels' size, which is
    /// allowed for, but by the mask's and the cameras' own errors.
    pub silhouette_sd_px: f64,
    /// Silhouettes are used once the points lie further than this from the reference, root mean square in metres: below it they
    /// would add nothing but time.
    pub silhouette_above_m: f64,
    /// What the distance of a point from the reference is off by even without noise: the reference's own error, in metres.
    pub model_sd_m: f64,
    /// Fewer points than this give no pose.
    pub min_points: usize,
    /// Most iterations of one registration.
    pub max_iterations: usize,
    /// A registration has converged when a step is shorter than this in metres, and at the object's surface.
    pub step_tolerance_m: f64,
    /// Or when a step is shorter than this fraction of the pose's standard deviation.
    pub step_tolerance_sd: f64,
    /// A registration whose points lie further than this from the reference (root mean square, in metres), beside three
    /// standard deviations of the depth noise that was told, is not believed: wrong orientations left 6 mm and more.
    pub max_residual_m: f64,
    /// Where a tracked pose explains the silhouette worse than this, the mean square of its rays' residuals in standard deviations, the object is
    /// registered from all around. Right poses have 0.5 to 2, wrong ones 3 to 7.
    pub max_mismatch: f64,
    /// What every pose is taken to be off by at least, because points of one frame err together: metres.
    pub position_floor_m: f64,
    /// The same for the orientation, in radians.
    pub rotation_floor_rad: f64,
    /// How far from the predicted position the object's pixels are looked for, in metres, beside its own size.
    pub gate_m: f64,
    /// An object that has not been seen for this long is looked for everywhere, in seconds.
    pub lost_after_s: f64,
    /// Standard deviation in radians by which cameras may be turned about each axis from how they are said to stand: they are
    /// aligned on the arm that they see. Zero where they are known exactly.
    pub camera_sd_rad: f64,
    /// How far a camera must seem to have moved, in metres, to count as displaced.
    pub displaced_m: f64,
    /// Whether the cameras see the floor, the plane z = 0; not, if it is not set.
    pub floor_visible: Option<bool>,
    /// Whether depths may be missing where there is something; not, if it is not set.
    pub depth_dropout: Option<bool>,
    /// Fraction of the depth noise's variance that all pixels of one image have in common; none if it is not set.
    pub depth_common_fraction: Option<f64>,
    /// How many pixels beside a depth edge may show something else than what is there, because stereo matches windows; none if it is not
    /// set.
    pub depth_edge_px: Option<u32>,
    /// Standard deviations of depth noise by which a pixel must be nearer than what is known to be there. Of 2.4 million pixels
    /// 76 exceed four by noise alone, which are too few to hang together.
    pub background_sd: f64,
    /// And metres beside that, for errors of the arm's model and of the cameras' calibration.
    pub background_margin_m: f64,
}

impl Default for Config {
    fn default() -> Self {
        Self {
            reference_spacing_m: 0.0015,
            grasp_spacing_m: 0.0025,
            distance_grid_m: 0.0025,
            symmetry_tolerance_m: 0.0008,
            confused_fraction: 0.08,
            depth_noise: None,
            silhouette_sd_px: 0.015,
            silhouette_above_m: 0.001,
            model_sd_m: 0.0002,
            min_points: 6,
            max_iterations: 20,
            step_tolerance_m: 2e-6,
            step_tolerance_sd: 0.1,
            max_residual_m: 0.005,
            max_mismatch: 3.0,
            position_floor_m: 5e-5,
            rotation_floor_rad: 1e-3,
            gate_m: 0.05,
            lost_after_s: 0.05,
            camera_sd_rad: 0.001,
            displaced_m: 0.008,
            floor_visible: None,
            depth_dropout: None,
            depth_common_fraction: None,
            depth_edge_px: None,
            background_sd: 4.0,
            background_margin_m: 0.01,
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

impl Settings for Config {
    fn faults(&self) -> Vec<SettingError> {
        Faults::default()
            .values(
                &(1e-4..=0.05),
                [("reference_spacing_m", self.reference_spacing_m), ("grasp_spacing_m", self.grasp_spacing_m)],
            )
            .values(&(5e-4..=0.05), [("distance_grid_m", self.distance_grid_m)])
            .values(
                &NOT_NEGATIVE,
                [
                    ("symmetry_tolerance_m", self.symmetry_tolerance_m),
                    ("confused_fraction", self.confused_fraction),
                    ("silhouette_sd_px", self.silhouette_sd_px),
                    ("silhouette_above_m", self.silhouette_above_m),
                    ("model_sd_m", self.model_sd_m),
                    ("step_tolerance_m", self.step_tolerance_m),
                    ("step_tolerance_sd", self.step_tolerance_sd),
                    ("max_residual_m", self.max_residual_m),
                    ("max_mismatch", self.max_mismatch),
                    ("position_floor_m", self.position_floor_m),
                    ("rotation_floor_rad", self.rotation_floor_rad),
                    ("gate_m", self.gate_m),
                    ("camera_sd_rad", self.camera_sd_rad),
                    ("background_sd", self.background_sd),
                    ("background_margin_m", self.background_margin_m),
                ],
            )
            .values(&(1e-3..=1.0), [("displaced_m", self.displaced_m)])
            .values(&DURATION_S, [("lost_after_s", self.lost_after_s)])
            .options(
                &NOT_NEGATIVE,
                [
                    ("depth_noise.constant_m", self.depth_noise.map(|it| it.constant_m)),
                    ("depth_noise.quadratic_per_m", self.depth_noise.map(|it| it.quadratic_per_m)),
                ],
            )
            .options(&FRACTION, [("depth_common_fraction", self.depth_common_fraction)])
            .options(&EDGE_PX, [("depth_edge_px", self.depth_edge_px.map(f64::from))])
            .counts([("min_points", self.min_points), ("max_iterations", self.max_iterations)])
            .all()
    }
}

/// The object's pose at one instant.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct ObjectPose {
    /// When the images were taken, in seconds on the cell's clock.
    pub capture_s: f64,
    /// Pose of the object; O has its origin at the centre of mass as the reference model estimates it.
    pub X_WO: Pose,
    /// Inverse covariance of (rotation vector in W, rad; position in W, m). Turns that cannot be seen have none.
    pub information: Matrix6<f64>,
    /// Number of points that it rests on.
    pub points: usize,
    /// Root mean square distance of those points from the reference surface, in metres.
    pub residual_m: f64,
    /// How badly the object explains the points: the mean square of their residuals in standard deviations.
    /// `None` where no depth tells its shape.
    #[serde(default)]
    pub points_mismatch: Option<f64>,
    /// The same of the silhouette's rays, where these were needed. Known objects are told apart by either,
    /// not by one against the other.
    #[serde(default)]
    pub silhouette_mismatch: Option<f64>,
    /// Iterations that it took.
    pub iterations: usize,
    /// Whether it was found without regard to the predicted pose.
    pub registered_globally: bool,
}

/// Why there is no pose.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum PerceptionStatus {
    /// No pixel shows anything that could be the object.
    NoPoints,
    /// Too few pixels do.
    TooFewPoints,
    /// The reference could not be brought to lie on the points.
    NotConverged,
    /// There is no reference to look for: its scan was empty.
    NoReference,
}

/// Buffers of an [`ObjectFinder`], kept so that finding an object need not allocate. They carry nothing from one call to the next.
#[derive(Debug, Clone, Default)]
pub struct Workspace {
    scene: SceneCloud,
    thinned: SceneCloud,
    detector: detection::Detector,
}

impl Workspace {
    /// With what the cameras see of an arm that will be waiting where `surroundings` say while the object is looked for in images
    /// without masks, which makes the search faster and changes nothing of what it finds but at the very edge of the arm.
    pub fn before_flight(cameras: &[CameraModel], surroundings: &Surroundings<'_>, config: &Config) -> Self {
        let detector = detection::Detector::before_flight(cameras, surroundings, config);
        Self { detector, ..Self::default() }
    }
}
