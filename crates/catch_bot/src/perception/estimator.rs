//! Pose estimation as a stage that can be exchanged, and ours.

use std::sync::Arc;

use catch_body::Pose;
use nalgebra::UnitQuaternion;

use super::{
    Config, ObjectPose, PerceptionStatus, ReferenceModel, Workspace,
    point_cloud::SceneCloud,
    registration::{Fit, Registration},
    view::{Prior, View},
};

/// Estimates the object's pose from depth images (paper, III-B).
pub trait PoseEstimator {
    /// The object's pose X_WO in W in the images of one capture time, the origin of O at the centre of mass.
    ///
    /// `view` has the images and the cameras' poses in W, `prior` what the last flight says of X_WO at that time.
    ///
    /// # Errors
    /// Why there is no pose.
    fn estimate(&mut self, view: &View<'_>, prior: Prior) -> Result<ObjectPose, PerceptionStatus>;

    /// Forgets all that it knows of the throw; the next one is another.
    fn reset(&mut self) {}
}

impl<T: PoseEstimator + ?Sized> PoseEstimator for Box<T> {
    fn estimate(&mut self, view: &View<'_>, prior: Prior) -> Result<ObjectPose, PerceptionStatus> {
        (**self).estimate(view, prior)
    }

    fn reset(&mut self) {
        (**self).reset();
    }
}

/// Registration on the signed distance field of the reference, with silhouettes where depths are noisy.
#[derive(Debug, Clone)]
pub struct SdfEstimator(ObjectFinder);

impl SdfEstimator {
    /// For a known object. The workspace holds the buffers, best those of [`Workspace::before_flight`].
    pub fn new(config: Config, reference: Arc<ReferenceModel>, workspace: Workspace) -> Self {
        Self(ObjectFinder::new(config, reference, workspace))
    }

    /// What was found in the last images.
    pub fn scene(&self) -> &SceneCloud {
        &self.0.workspace.scene
    }
}

impl PoseEstimator for SdfEstimator {
    fn estimate(&mut self, view: &View<'_>, prior: Prior) -> Result<ObjectPose, PerceptionStatus> {
        self.0.find(view, prior, |registration, scene, X_WO| {
            // Where depths are configured to be noisy silhouettes are needed; else a registration without them tells.
            let Registration { reference, config } = *registration;
            let from_points_alone = scene.mean_noise_m() <= config.silhouette_above_m;
            let fit = registration.register(scene, X_WO, !from_points_alone);
            let good = fit.as_ref().is_ok_and(|fit| fit.residual_m <= config.silhouette_above_m);
            if good || !from_points_alone {
                return fit;
            }
            scene.collect_silhouette(view, reference, config);
            if scene.silhouette.is_empty() { fit } else { registration.register(scene, X_WO, true) }
        })
    }
}

/// A pose explains images much better than another if its mismatch is less than this fraction.
const MUCH_BETTER: f64 = 0.6;

/// Finds a known object in depth images: what estimators share, whatever registration near a predicted pose they have.
#[derive(Debug, Clone)]
pub struct ObjectFinder {
    config: Config,
    reference: Arc<ReferenceModel>,
    workspace: Workspace,
}

/// Brings the reference from a pose X_WO onto the scene's points.
type Register<'a> = dyn FnMut(&Registration<'_>, &mut SceneCloud, &Pose) -> Result<Fit, PerceptionStatus> + 'a;

impl ObjectFinder {
    /// For a known object. The workspace holds the buffers, best those of [`Workspace::before_flight`].
    pub fn new(config: Config, reference: Arc<ReferenceModel>, workspace: Workspace) -> Self {
        Self { config, reference, workspace }
    }

    /// The object as it is known.
    pub fn reference(&self) -> &ReferenceModel {
        &self.reference
    }

    /// Finds the object in all depth images of one capture time.
    ///
    /// From a predicted pose `register` brings the reference onto the scene's points; without one, or when it leads nowhere, the
    /// object is looked for everywhere and all orientations are tried.
    ///
    /// # Errors
    /// Why there is no pose.
    pub fn find(
        &mut self,
        view: &View<'_>,
        prior: Prior,
        mut register: impl FnMut(&Registration<'_>, &mut SceneCloud, &Pose) -> Result<Fit, PerceptionStatus>,
    ) -> Result<ObjectPose, PerceptionStatus> {
        if self.reference.points.is_empty() {
            return Err(PerceptionStatus::NoReference);
        }
        let expected = prior.pose();
        let found = expected.map(|_| self.find_near(view, &prior, &mut register));
        let unlabelled = view.is_unlabelled();
        match found {
            Some(Ok(pose)) => Ok(pose),
            Some(Err(status)) if !unlabelled && status != PerceptionStatus::NoPoints => Err(status),
            _ if !unlabelled => self.find_near(view, &Prior::Anywhere, &mut register),
            _ => {
                let place = self.workspace.detector.find(view, &self.reference, &self.config);
                let place = place.ok_or(PerceptionStatus::NoPoints)?;
                let R_WO = expected.map_or(UnitQuaternion::identity(), |X_WO| X_WO.rotation);
                self.find_near(view, &Prior::Place(Pose::from_parts(place.coords.into(), R_WO)), &mut register)
            }
        }
    }

    /// Finds the object where it is expected, or anywhere in images with masks.
    fn find_near(
        &mut self,
        view: &View<'_>,
        prior: &Prior,
        register: &mut Register<'_>,
    ) -> Result<ObjectPose, PerceptionStatus> {
        let Self { config, reference, workspace: Workspace { scene, thinned, .. } } = self;
        let expected = prior.pose();
        scene.collect(view, reference, expected, config);
        match scene.points.len() {
            0 => return Err(PerceptionStatus::NoPoints),
            few if few < config.min_points => return Err(PerceptionStatus::TooFewPoints),
            _ => {}
        }
        if scene.mean_noise_m() > config.silhouette_above_m {
            scene.collect_silhouette(view, reference, config);
        }
        let registration = Registration { reference, config };
        let tracked = match prior {
            Prior::Pose(X_WO) => register(&registration, scene, X_WO).ok(),
            Prior::Place(_) | Prior::Anywhere => None,
        };
        let is_unexplained = |fit: &Fit| fit.silhouette_residual_m.is_some() && fit.mismatch > config.max_mismatch;
        let (fit, registered_globally) = match tracked {
            Some(fit) if !is_unexplained(&fit) => (fit, false),
            _ => {
                if scene.silhouette.is_empty() {
                    scene.collect_silhouette(view, reference, config);
                }
                let R_WO = expected.map_or_else(UnitQuaternion::identity, |X_WO| X_WO.rotation);
                let anywhere = registration.register_globally(scene, thinned, &R_WO);
                // What was tracked stays unless another pose explains the images much better.
                match (tracked, anywhere) {
                    (Some(near), Ok(far)) if far.mismatch > MUCH_BETTER * near.mismatch => (near, false),
                    (Some(near), Err(_)) => (near, false),
                    (_, anywhere) => (anywhere?, true),
                }
            }
        };
        // Where images are not explained, they tell that much less of the pose.
        let told = if is_unexplained(&fit) { fit.mismatch.recip() } else { 1.0 };
        Ok(ObjectPose {
            capture_s: view.capture_s(),
            X_WO: fit.X_WO,
            information: fit.information * told,
            points: fit.points,
            residual_m: fit.residual_m,
            mismatch: fit.mismatch,
            iterations: fit.iterations,
            registered_globally,
        })
    }
}
