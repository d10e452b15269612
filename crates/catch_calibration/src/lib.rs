//! Extrinsic calibration: where the cameras stand, from what they see of the arm.
//!
//! The arm is the target. It stands still in poses that are chosen for information ([`pose_choice`]) and
//! moves between them ([`CalibrationRun`]). Each image is compared with a rendering of the arm's known
//! surface: inverse depths along the rays of pixels, and the number of pixels shown across each silhouette.
//! All cameras are estimated together with what they have in common: joint zeros, sizes of the links, how far
//! patches of their surfaces rise (covers, cables) and the mount of the gripper, as far as these are
//! uncertain. Coarse alignment with several starts comes first ([`calibrate`]).
//!
//! Inputs are values; nothing here knows where the cameras truly are.
//!
//! Begin with [`choose_poses`](pose_choice::choose_poses), [`CalibrationRun`] (it moves the arm of any cell
//! through the poses and collects what the cameras see) and [`calibrate`]:
//!
//! ```
//! use catch_bot::trajectory_optimization::MotionPlanner;
//! use catch_calibration::{Calibration, CalibrationRun, Config, calibrate, pose_choice::choose_poses};
//! use catch_cell::{Brain, CameraModel, Cell};
//!
//! /// Where the cameras of a cell stand, which are believed to be near `guesses`.
//! fn calibrated<C: Cell>(
//!     cell: &mut C,
//!     planner: MotionPlanner,
//!     gripper: &catch_body::Gripper,
//!     guesses: &[CameraModel],
//! ) -> Result<Calibration, C::Error> {
//!     let (config, robot) = (Config::default(), planner.robot.clone());
//!     let poses = choose_poses(&config, &planner, gripper, guesses);
//!     let mut run = CalibrationRun::new(config.clone(), planner, guesses, poses);
//!     while !run.is_done() {
//!         let observation = cell.sense()?;
//!         cell.act(&run.tick(&observation, &mut ()))?;
//!     }
//!     Ok(calibrate(&config, &robot, gripper, guesses, &run.into_session()))
//! }
//! ```
//!
//! Flights of a known object refine it: [`FlightRun`] collects where single images of one throw show the
//! object, and [`flights::refine`] takes what it saw of several throws:
//!
//! ```
//! use std::sync::Arc;
//!
//! use catch_bot::Preparation;
//! use catch_calibration::{Calibration, FlightRun, flights::refine};
//! use catch_cell::{Brain, Cell};
//!
//! /// The calibration after so many throws, which somebody makes; `known` has the cameras as they are calibrated.
//! fn refined<C: Cell>(
//!     cell: &mut C,
//!     known: &Arc<Preparation>,
//!     calibration: &Calibration,
//!     throws: usize,
//! ) -> Result<Calibration, C::Error> {
//!     let mut flights = Vec::new();
//!     for _ in 0..throws {
//!         let mut run = FlightRun::new(known.clone(), calibration, 2.0);
//!         while !run.is_done() {
//!             let observation = cell.sense()?;
//!             cell.act(&run.tick(&observation, &mut ()))?;
//!         }
//!         flights.push(run.into_flight());
//!     }
//!     Ok(refine(calibration, &flights).calibration)
//! }
//! ```

mod arm_motion;
mod averaged_image;
mod coarse;
mod correlation;
mod covariance;
mod depths;
mod estimate;
mod fine;
pub mod flights;
mod measurement;
mod normal_equations;
pub mod overlay;
mod parameters;
pub mod pose_choice;
mod rendering;
mod session;
mod sightings;
mod silhouettes;
#[cfg(test)]
mod tests;

use catch_body::Pose;
use nalgebra::{DMatrix, Matrix6};
use serde::Serialize;

pub use arm_motion::{ArmSample, arm_at, arm_at_rest};
pub use averaged_image::AveragedImage;
pub use estimate::calibrate;
pub use session::{CalibrationRun, Session};
pub use sightings::FlightRun;

/// Joints slower than this, in rad/s, stand still.
const SLOW_RADPS: f64 = 0.02;

/// Settings of a calibration.
#[derive(Debug, Clone, PartialEq)]
pub struct Config {
    /// Poses of the arm, at most.
    pub poses: usize,
    /// Images of each camera in each pose.
    pub images_per_pose: usize,
    /// Latency from an observation to the command that answers it, in seconds.
    pub expected_latency_s: f64,
    /// Standard deviation of 1/z of a pixel in 1/m, from the camera's data sheet.
    pub inverse_depth_sd_per_m: f64,
    /// Fraction of the variance of 1/z that all pixels of an image have in common.
    pub common_fraction: f64,
    /// Pixels this near to a depth edge have no depths to compare.
    pub edge_px: usize,
    /// Pixels to each side of a silhouette that are counted.
    pub silhouette_px: usize,
    /// Seed of what is drawn: candidates for poses, and starts.
    pub seed: u64,
}

impl Default for Config {
    fn default() -> Self {
        Self {
            poses: 12,
            images_per_pose: 3,
            expected_latency_s: 0.01,
            inverse_depth_sd_per_m: 0.0037,
            common_fraction: 0.5,
            edge_px: 4,
            silhouette_px: 5,
            seed: 0,
        }
    }
}

/// Outcome of the calibration of a camera.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum CalibrationStatus {
    /// The calibration converged.
    Converged,
    /// Fewer than three images show the arm.
    TooFewImages,
    /// The last step was still a large one.
    NotConverged,
    /// The images do not show what the model of the arm predicts.
    PoorFit,
    /// The images do not say where the camera is.
    Uncertain,
}

/// Result of the calibration of a camera.
#[derive(Debug, Clone, PartialEq)]
pub struct CameraCalibration {
    /// Outcome of the calibration. Unless it converged, nothing else is to be believed.
    pub status: CalibrationStatus,
    /// Pose of the camera in the world.
    pub X_WC: Pose,
    /// Covariance of X_WC·exp(ω, v): rotation about the axes of C in radians, then translation along them in
    /// metres.
    pub covariance: Matrix6<f64>,
    /// Relative error of depths: measured depths are true ones times 1 + this.
    pub depth_scale: f64,
    /// Offset to be added to the time stamps of the camera's images, in seconds.
    pub time_offset_s: f64,
    /// Standard deviation of the time offset in seconds; none where the camera saw no motion.
    pub time_offset_sd_s: Option<f64>,
    /// Residuals of the images.
    pub residuals: Residuals,
}

/// Goodness of fit of a camera's images.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize)]
pub struct Residuals {
    /// Images, those of one pose together counting as one.
    pub images: usize,
    /// Pixels whose depths were compared.
    #[serde(skip)]
    pub depths: usize,
    /// Robust standard deviation of the depths' 1/z in one image, in 1/m.
    pub inverse_depth_sd_per_m: f64,
    /// Robust standard deviation of the number of pixels on one, in one image.
    pub silhouette_sd_px: f64,
    /// Fraction of the comparisons that did not count, being outliers.
    pub outlier_fraction: f64,
}

/// Rows of each camera in [`Calibration::covariance`].
pub const CAMERA_PARAMETERS: usize = 8;

/// Result of a calibration.
#[derive(Debug, Clone, PartialEq)]
pub struct Calibration {
    /// Camera by camera.
    pub cameras: Vec<CameraCalibration>,
    /// Covariance of all cameras, [`CAMERA_PARAMETERS`] rows of each: those of
    /// [`CameraCalibration::covariance`], depth scale, and time offset in seconds. Cameras that were
    /// calibrated on one arm have its errors in common.
    pub covariance: DMatrix<f64>,
    /// Errors of the joints' zero positions in radians.
    pub joint_zero_rad: Vec<f64>,
    /// Distances of the links' surfaces outside of their models in metres.
    pub link_offset_m: Vec<f64>,
}
