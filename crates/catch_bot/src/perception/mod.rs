//! Perception (paper, III-B): the object's pose from one set of depth images.
//!
//! Pixels become points, points that belong to the object are kept ([`point_cloud`]), and the reference ([`ReferenceModel`])
//! is registered to them ([`registration`]), starting from where the last trajectory says the object should be.

mod acquisition;
pub mod camera_alignment;
mod cloud;
mod cold_start;
mod distance_field;
mod icp;
mod neighbours;
mod normal_equations;
pub mod point_cloud;
pub mod reference;
pub mod registration;
pub mod segmentation;
pub mod silhouette;
pub mod symmetry;
#[cfg(test)]
pub(crate) mod synthetic;
#[cfg(test)]
mod tests;
#[cfg(test)]
pub(crate) mod unlabelled;

use catch_body::Pose;
use catch_cell::{CameraModel, DepthFrame};
use nalgebra::{Matrix6, UnitQuaternion};
use serde::{Deserialize, Serialize};

pub use cloud::register_cloud;
pub use distance_field::DistanceField;
pub use point_cloud::{DepthNoise, SceneCloud};
pub use reference::ReferenceModel;
pub use registration::Fit;
pub use segmentation::Surroundings;
pub use symmetry::Symmetry;

/// How the reference is brought onto the points.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Method {
    /// Gauss–Newton on the reference's signed distance field, with outlines where depths are noisy.
    #[default]
    Sdf,
    /// The paper's: iterative closest points, point to point.
    IcpPointToPoint,
}

/// Settings of perception.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Config {
    /// How the reference is brought onto the points.
    pub method: Method,
    /// Iterations of ICP at most.
    pub max_icp_iterations: usize,
    /// ICP has converged when a step is shorter than this in metres, at the object's surface.
    pub icp_tolerance_m: f64,
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
    /// Depth noise of the cameras, as their data sheet has it.
    pub depth_noise: DepthNoise,
    /// Standard deviation in pixels by which the object's outline in an image may be off: not by the pixels' size, which is
    /// allowed for, but by the mask's and the cameras' own errors.
    pub outline_sd_px: f64,
    /// Outlines are used once the points lie further than this from the reference, root mean square in metres: below it they
    /// would add nothing but time.
    pub outline_above_m: f64,
    /// What the distance of a point from the reference is off by even without noise: the reference's own error, in metres.
    pub model_sd_m: f64,
    /// Fewer points than this give no pose.
    pub min_points: usize,
    /// Most iterations of one registration.
    pub max_iterations: usize,
    /// A registration has converged when a step is shorter than this in metres, and at the object's surface.
    pub step_tolerance_m: f64,
    /// Or when a step is shorter than this share of the pose's standard deviation.
    pub step_tolerance_sd: f64,
    /// A registration whose points lie further than this from the reference (root mean square, in metres), beside three
    /// standard deviations of the depth noise that was told, is not believed: wrong attitudes left 6 mm and more.
    pub max_residual_m: f64,
    /// What every pose is taken to be off by at least, because points of one frame err together: metres.
    pub position_floor_m: f64,
    /// The same for the attitude, in radians.
    pub rotation_floor_rad: f64,
    /// How far from the predicted position the object's pixels are looked for, in metres, beside its own size.
    pub gate_m: f64,
    /// Standard deviation in radians by which cameras may be turned about each axis from how they are said to stand: they are
    /// aligned on the arm that they see. Zero where they are known exactly.
    pub camera_sd_rad: f64,
    /// Whether the cameras see the floor, the plane z = 0.
    pub floor_visible: bool,
    /// Whether depths may be missing where there is something.
    pub depth_dropout: bool,
    /// Standard deviations of depth noise by which a pixel must be nearer than what is known to be there. Of 2.4 million pixels
    /// 76 exceed four by chance, which are too few to hang together.
    pub background_sd: f64,
    /// And metres beside that, for errors of the arm's model and of the cameras' calibration.
    pub background_margin_m: f64,
}

impl Default for Config {
    fn default() -> Self {
        Self {
            method: Method::Sdf,
            max_icp_iterations: 50,
            icp_tolerance_m: 1e-5,
            reference_spacing_m: 0.0015,
            grasp_spacing_m: 0.0025,
            distance_grid_m: 0.002,
            symmetry_tolerance_m: 0.0008,
            depth_noise: DepthNoise::default(),
            outline_sd_px: 0.015,
            outline_above_m: 0.001,
            model_sd_m: 0.0002,
            min_points: 6,
            max_iterations: 20,
            step_tolerance_m: 2e-6,
            step_tolerance_sd: 0.1,
            max_residual_m: 0.005,
            position_floor_m: 5e-5,
            rotation_floor_rad: 1e-3,
            gate_m: 0.05,
            camera_sd_rad: 0.0,
            floor_visible: false,
            depth_dropout: false,
            background_sd: 4.0,
            background_margin_m: 0.01,
        }
    }
}

/// The object's pose at one instant.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct ObjectPose {
    /// When the images were taken.
    pub capture_s: f64,
    /// Pose of the object; O has its origin at the centre of mass as the reference model estimates it.
    pub X_WO: Pose,
    /// Inverse covariance of (rotation vector in W, rad; position in W, m). Turns that cannot be seen have none.
    pub information: Matrix6<f64>,
    /// Number of points that it rests on.
    pub points: usize,
    /// Root mean square distance of those points from the reference surface, in metres.
    pub residual_m: f64,
    /// Iterations that it took.
    pub iterations: usize,
    /// Whether it was found without regard to the predicted pose.
    pub cold_started: bool,
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

/// Buffers of [`find_object`], kept so that finding an object need not allocate. They carry nothing from one call to the next.
#[derive(Debug, Clone, Default)]
pub struct Workspace {
    scene: SceneCloud,
    thinned: SceneCloud,
    acquisition: acquisition::Scratch,
    /// Whether the pose that is being looked at is only a place.
    is_place_only: bool,
}

impl Workspace {
    /// With what the cameras see of an arm that will be waiting where `surroundings` say while the object is looked for in images
    /// without masks, which makes the search faster and changes nothing of what it finds but at the very edge of the arm.
    pub fn before_flight(cameras: &[CameraModel], surroundings: &Surroundings<'_>, config: &Config) -> Self {
        let acquisition = acquisition::Scratch::before_flight(cameras, surroundings, config);
        Self { acquisition, ..Self::default() }
    }

    /// What the last search found in the images.
    pub fn scene(&self) -> &SceneCloud {
        &self.scene
    }
}

/// Finds the object in all depth images of one capture time.
///
/// `prior` is the predicted X_WO, from which registration starts; without one, or when it leads nowhere, the object is looked
/// for everywhere and all attitudes are tried. `surroundings` matter where images come without masks. Frames of unknown cameras
/// are passed over.
pub fn find_object(
    frames: &[DepthFrame],
    cameras: &[CameraModel],
    reference: &ReferenceModel,
    prior: Option<&Pose>,
    surroundings: Option<&Surroundings<'_>>,
    config: &Config,
    workspace: &mut Workspace,
) -> Result<ObjectPose, PerceptionStatus> {
    if reference.points.is_empty() {
        return Err(PerceptionStatus::NoReference);
    }
    let prior = prior.filter(|X_WO| X_WO.to_homogeneous().iter().all(|value| value.is_finite()));
    let tracked = prior.map(|_| find_at(frames, cameras, reference, prior, surroundings, config, workspace));
    let unlabelled = frames.iter().any(|frame| frame.mask.is_none());
    match tracked {
        Some(Ok(pose)) => Ok(pose),
        Some(Err(status)) if !unlabelled && status != PerceptionStatus::NoPoints => Err(status),
        _ if !unlabelled => find_at(frames, cameras, reference, None, surroundings, config, workspace),
        _ => {
            let place = acquisition::find(frames, cameras, reference, surroundings, config, &mut workspace.acquisition);
            let place = place.ok_or(PerceptionStatus::NoPoints)?;
            let X_WO =
                Pose::from_parts(place.coords.into(), prior.map_or(UnitQuaternion::identity(), |X_WO| X_WO.rotation));
            workspace.is_place_only = true;
            let found = find_at(frames, cameras, reference, Some(&X_WO), surroundings, config, workspace);
            workspace.is_place_only = false;
            found
        }
    }
}

/// Finds the object near `prior`, or anywhere in images with masks if there is none.
fn find_at(
    frames: &[DepthFrame],
    cameras: &[CameraModel],
    reference: &ReferenceModel,
    prior: Option<&Pose>,
    surroundings: Option<&Surroundings<'_>>,
    config: &Config,
    workspace: &mut Workspace,
) -> Result<ObjectPose, PerceptionStatus> {
    let Workspace { scene, thinned, is_place_only, .. } = workspace;
    scene.collect(frames, cameras, reference, prior, surroundings, config);
    match scene.points.len() {
        0 => return Err(PerceptionStatus::NoPoints),
        few if few < config.min_points => return Err(PerceptionStatus::TooFewPoints),
        _ => {}
    }

    // Where depths are told to be noisy outlines are needed; else a registration without them tells.
    let from_points_alone = scene.mean_noise_m() <= config.outline_above_m;
    if !from_points_alone {
        scene.collect_outline(frames, cameras, reference, config);
    }
    let mut from = |X_WO: &Pose| match config.method {
        Method::Sdf => {
            let fit = registration::register(scene, reference, X_WO, config, !from_points_alone);
            let good = fit.as_ref().is_ok_and(|fit| fit.residual_m <= config.outline_above_m);
            if good || !from_points_alone {
                return fit;
            }
            scene.collect_outline(frames, cameras, reference, config);
            if scene.outline.is_empty() { fit } else { registration::register(scene, reference, X_WO, config, true) }
        }
        Method::IcpPointToPoint => icp::register(scene, reference, X_WO, config),
    };
    let tracked = prior.filter(|_| !*is_place_only).and_then(|X_WO| from(X_WO).ok());
    let cold_started = tracked.is_none();
    let fit = match tracked {
        Some(fit) => fit,
        None => {
            if scene.outline.is_empty() {
                scene.collect_outline(frames, cameras, reference, config);
            }
            cold_start::register(scene, thinned, reference, prior, config)?
        }
    };
    let capture_s = frames.iter().map(|frame| frame.capture_s).find(|time| time.is_finite()).unwrap_or(0.0);
    Ok(ObjectPose {
        capture_s,
        X_WO: fit.X_WO,
        information: fit.information,
        points: fit.points,
        residual_m: fit.residual_m,
        iterations: fit.iterations,
        cold_started,
    })
}
