//! Pose estimation as a stage that can be exchanged, and ours.

use std::sync::Arc;

use catch_body::Pose;
use catch_cell::{CameraModel, DepthFrame};
use nalgebra::UnitQuaternion;

use super::{
    Config, Fit, ObjectPose, PerceptionStatus, ReferenceModel, SceneCloud, Surroundings, Workspace, detection,
    global_registration, registration,
};

/// What one pose is estimated from: all depth images of one capture time.
#[derive(Debug, Clone, Copy)]
pub struct View<'a> {
    /// The images. Those of unknown cameras are passed over.
    pub frames: &'a [DepthFrame],
    /// The cameras, as well as their poses are known.
    pub cameras: &'a [CameraModel],
    /// The arm at the capture time; it matters where images come without masks.
    pub surroundings: Option<&'a Surroundings<'a>>,
}

impl View<'_> {
    /// Whether an image comes without a mask.
    fn is_unlabelled(&self) -> bool {
        self.frames.iter().any(|frame| frame.mask.is_none())
    }
}

/// Estimates the object's pose from depth images (paper, III-B).
pub trait PoseEstimator {
    /// The object's pose X_WO in the images of one capture time.
    ///
    /// `prior` is the predicted X_WO; without one the object may be anywhere, in any orientation.
    ///
    /// # Errors
    /// Why there is no pose.
    fn estimate(&mut self, view: &View<'_>, prior: Option<&Pose>) -> Result<ObjectPose, PerceptionStatus>;

    /// Forgets all that it knows of the throw; the next one is another.
    fn reset(&mut self) {}
}

impl<T: PoseEstimator + ?Sized> PoseEstimator for Box<T> {
    fn estimate(&mut self, view: &View<'_>, prior: Option<&Pose>) -> Result<ObjectPose, PerceptionStatus> {
        (**self).estimate(view, prior)
    }

    fn reset(&mut self) {
        (**self).reset();
    }
}

/// Registration on the signed distance field of the reference, with silhouettes where depths are noisy.
#[derive(Debug, Clone)]
pub struct SdfEstimator {
    config: Config,
    reference: Arc<ReferenceModel>,
    workspace: Workspace,
}

impl SdfEstimator {
    /// For a known object. The workspace holds the buffers, best those of [`Workspace::before_flight`].
    pub fn new(config: Config, reference: Arc<ReferenceModel>, workspace: Workspace) -> Self {
        Self { config, reference, workspace }
    }
}

impl PoseEstimator for SdfEstimator {
    fn estimate(&mut self, view: &View<'_>, prior: Option<&Pose>) -> Result<ObjectPose, PerceptionStatus> {
        let View { frames, cameras, surroundings } = *view;
        find_object(frames, cameras, &self.reference, prior, surroundings, &self.config, &mut self.workspace)
    }
}

/// Finds the object in all depth images of one capture time.
///
/// `prior` is the predicted X_WO, from which registration starts; without one, or when it leads nowhere, the object is looked
/// for everywhere and all orientations are tried. `surroundings` matter where images come without masks. Frames of unknown cameras
/// are passed over.
///
/// # Errors
/// Why there is no pose.
pub fn find_object(
    frames: &[DepthFrame],
    cameras: &[CameraModel],
    reference: &ReferenceModel,
    prior: Option<&Pose>,
    surroundings: Option<&Surroundings<'_>>,
    config: &Config,
    workspace: &mut Workspace,
) -> Result<ObjectPose, PerceptionStatus> {
    let view = View { frames, cameras, surroundings };
    estimate_with(&view, reference, prior, config, workspace, |scene, X_WO| {
        // Where depths are configured to be noisy silhouettes are needed; else a registration without them tells.
        let from_points_alone = scene.mean_noise_m() <= config.silhouette_above_m;
        let fit = registration::register(scene, reference, X_WO, config, !from_points_alone);
        let good = fit.as_ref().is_ok_and(|fit| fit.residual_m <= config.silhouette_above_m);
        if good || !from_points_alone {
            return fit;
        }
        scene.collect_silhouette(frames, cameras, reference, config);
        if scene.silhouette_rays.is_empty() {
            fit
        } else {
            registration::register(scene, reference, X_WO, config, true)
        }
    })
}

/// Finds the object as [`find_object`] does, but for the registration near a prior: `register` brings the reference from a pose
/// X_WO onto the scene's points.
///
/// # Errors
/// Why there is no pose.
pub fn estimate_with(
    view: &View<'_>,
    reference: &ReferenceModel,
    prior: Option<&Pose>,
    config: &Config,
    workspace: &mut Workspace,
    mut register: impl FnMut(&mut SceneCloud, &Pose) -> Result<Fit, PerceptionStatus>,
) -> Result<ObjectPose, PerceptionStatus> {
    if reference.points.is_empty() {
        return Err(PerceptionStatus::NoReference);
    }
    let mut search = Search { view, reference, config, workspace };
    let prior = prior.filter(|X_WO| X_WO.to_homogeneous().iter().all(|value| value.is_finite()));
    let tracked = prior.map(|_| search.find_at(prior, Some(&mut register)));
    let unlabelled = view.is_unlabelled();
    match tracked {
        Some(Ok(pose)) => Ok(pose),
        Some(Err(status)) if !unlabelled && status != PerceptionStatus::NoPoints => Err(status),
        _ if !unlabelled => search.find_at(None, Some(&mut register)),
        _ => {
            let View { frames, cameras, surroundings } = *view;
            let buffers = &mut search.workspace.detection;
            let place = detection::find(frames, cameras, reference, surroundings, config, buffers);
            let place = place.ok_or(PerceptionStatus::NoPoints)?;
            let X_WO =
                Pose::from_parts(place.coords.into(), prior.map_or(UnitQuaternion::identity(), |X_WO| X_WO.rotation));
            // Only a place, from which nothing is registered.
            search.find_at(Some(&X_WO), None)
        }
    }
}

/// Brings the reference from a pose X_WO onto the scene's points.
type Register<'a> = dyn FnMut(&mut SceneCloud, &Pose) -> Result<Fit, PerceptionStatus> + 'a;

/// One call's circumstances.
struct Search<'a> {
    view: &'a View<'a>,
    reference: &'a ReferenceModel,
    config: &'a Config,
    workspace: &'a mut Workspace,
}

impl Search<'_> {
    /// Finds the object near `prior`, or anywhere in images with masks if there is none. Without `register` the prior is only a
    /// place.
    fn find_at(
        &mut self,
        prior: Option<&Pose>,
        register: Option<&mut Register<'_>>,
    ) -> Result<ObjectPose, PerceptionStatus> {
        let View { frames, cameras, surroundings } = *self.view;
        let (reference, config) = (self.reference, self.config);
        let Workspace { scene, thinned, .. } = &mut *self.workspace;
        scene.collect(frames, cameras, reference, prior, surroundings, config);
        match scene.points.len() {
            0 => return Err(PerceptionStatus::NoPoints),
            few if few < config.min_points => return Err(PerceptionStatus::TooFewPoints),
            _ => {}
        }
        if scene.mean_noise_m() > config.silhouette_above_m {
            scene.collect_silhouette(frames, cameras, reference, config);
        }
        let tracked = prior.zip(register).and_then(|(X_WO, register)| register(scene, X_WO).ok());
        let registered_globally = tracked.is_none();
        let fit = match tracked {
            Some(fit) => fit,
            None => {
                if scene.silhouette_rays.is_empty() {
                    scene.collect_silhouette(frames, cameras, reference, config);
                }
                global_registration::register(scene, thinned, reference, prior, config)?
            }
        };
        let capture_s = frames.iter().map(|frame| frame.capture_s).find(|time| time.is_finite()).unwrap_or(0.0);
        Ok(ObjectPose {
            capture_s,
            X_WO: fit.X_WO,
            information: fit.information,
            points: fit.points,
            residual_m: fit.residual_m,
            silhouette_residual_m: fit.silhouette_residual_m,
            iterations: fit.iterations,
            registered_globally,
        })
    }
}
