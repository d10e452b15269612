//! Pose estimation as a stage that can be exchanged, and ours.

use std::sync::Arc;

use catch_body::Pose;
use nalgebra::UnitQuaternion;

use super::{
    Config, ObjectPose, PerceptionStatus, ReferenceModel, Workspace,
    half_turns::{COMPARED_AFTER, HalfTurns},
    point_cloud::SceneCloud,
    registration::{Fit, MIN_POINTS, Registration},
    segmentation::Label,
    silhouette::SILHOUETTE_ABOVE_M,
    thinning::stride,
    view::{Prior, View},
};

/// Estimates the object's pose from depth images (paper, III-B).
pub trait PoseEstimator: Send {
    /// The object's pose X_WO in W in the images of one capture time, the origin of O at the centre of mass.
    ///
    /// `view` has the images and the cameras' poses in W, `prior` what the last flight says of X_WO at that
    /// time.
    ///
    /// # Errors
    /// Why there is no pose.
    fn estimate(&mut self, view: &View<'_>, prior: Prior) -> Result<ObjectPose, PerceptionStatus>;

    /// All things in the images of one capture time that could be the object, while it is not known which one
    /// flies to the arm. `expected` are poses X_WO at that time of what was seen before, the likeliest first.
    fn estimate_all(&mut self, view: &View<'_>, expected: &[Pose], found: &mut Vec<ObjectPose>) {
        let near = expected.first().and_then(|X_WO| self.estimate(view, Prior::Pose(*X_WO)).ok());
        found.extend(near.or_else(|| self.estimate(view, Prior::Anywhere).ok()));
    }

    /// A rigid motion T in O, if the newest pose shows that all earlier ones had the object the wrong way
    /// around: it then was at X_WO·T.
    fn turned_over(&self) -> Option<Pose> {
        None
    }

    /// The pose near `X_WO` in few images, which does not change what is estimated later. `None` if there is
    /// none, or the method cannot tell.
    fn estimate_aside(&mut self, _view: &View<'_>, _X_WO: &Pose) -> Option<ObjectPose> {
        None
    }

    /// Forgets all that it knows of the throw; the next one is another.
    fn reset(&mut self) {}
}

/// Registration on the signed distance field of the reference, with silhouettes where depths are noisy.
#[derive(Debug, Clone)]
pub struct SdfEstimator {
    finder: ObjectFinder,
    half_turns: HalfTurns,
    turned_over: Option<Pose>,
}

impl SdfEstimator {
    /// Creates the estimator for a known object. The workspace holds the buffers, best those of
    /// [`Workspace::before_flight`].
    pub fn new(config: Config, reference: Arc<ReferenceModel>, workspace: Workspace) -> Self {
        let half_turns = HalfTurns::new(&reference.symmetry);
        Self { finder: ObjectFinder::new(config, reference, workspace), half_turns, turned_over: None }
    }

    /// Scene points of the last images.
    pub fn scene(&self) -> &SceneCloud {
        &self.finder.workspace.scene
    }
}

impl PoseEstimator for SdfEstimator {
    fn estimate(&mut self, view: &View<'_>, prior: Prior) -> Result<ObjectPose, PerceptionStatus> {
        self.turned_over = None;
        let mut tracked = None;
        let found = self.finder.find(view, prior, |registration, scene, X_WO| {
            let fit = register_near(registration, view, scene, X_WO);
            tracked = fit.as_ref().ok().copied();
            fit
        })?;
        let Some(fit) = tracked.filter(|_| !found.registered_globally) else {
            self.half_turns.reset();
            return Ok(found);
        };
        let ObjectFinder { config, reference, workspace, .. } = &mut self.finder;
        let registration = Registration::new(reference, config);
        // Costs compare where both rest on the same.
        let with_silhouette = fit.silhouette_residual_m.is_some();
        let register =
            |X_WO: &Pose| registration.iterate(&mut workspace.scene, X_WO, COMPARED_AFTER, with_silhouette).0;
        let Some(other) = self.half_turns.compare(&fit, register) else { return Ok(found) };
        self.turned_over = Some(fit.X_WO.inverse() * other.X_WO);
        Ok(other.pose(view, false))
    }

    fn estimate_all(&mut self, view: &View<'_>, expected: &[Pose], found: &mut Vec<ObjectPose>) {
        self.reset();
        self.finder.find_all(view, expected, found, |registration, scene, X_WO| {
            register_near(registration, view, scene, X_WO)
        });
    }

    fn turned_over(&self) -> Option<Pose> {
        self.turned_over
    }

    fn estimate_aside(&mut self, view: &View<'_>, X_WO: &Pose) -> Option<ObjectPose> {
        self.finder.collect(view, Some(X_WO)).ok()?;
        let ObjectFinder { config, reference, workspace, .. } = &mut self.finder;
        let fit = register_near(&Registration::new(reference, config), view, &mut workspace.scene, X_WO).ok()?;
        Some(fit.pose(view, false))
    }

    fn reset(&mut self) {
        self.half_turns.reset();
        self.turned_over = None;
    }
}

/// Registers near a predicted pose. Silhouettes are used where depths are configured to be noisy; else the
/// residual of a registration without them decides.
fn register_near(
    registration: &Registration<'_>,
    view: &View<'_>,
    scene: &mut SceneCloud,
    X_WO: &Pose,
) -> Result<Fit, PerceptionStatus> {
    let Registration { reference, config, .. } = *registration;
    let from_points_alone = scene.mean_noise_m() <= SILHOUETTE_ABOVE_M;
    let fit = registration.register(scene, X_WO, !from_points_alone);
    let good = fit.as_ref().is_ok_and(|fit| fit.residual_m <= SILHOUETTE_ABOVE_M);
    if good || !from_points_alone {
        return fit;
    }
    scene.collect_silhouette(view, reference, config);
    if scene.silhouette.is_empty() { fit } else { registration.register(scene, X_WO, true) }
}

/// Largest mean square of the silhouette rays' residuals of a tracked pose, in standard deviations: beyond it
/// the object is registered from all around. Right poses have 0.5 to 2, wrong ones 3 to 7.
const MAX_MISMATCH: f64 = 3.0;
/// Distance from the predicted position within which the object's pixels are searched, in metres, beside its
/// own size.
pub const GATE_M: f64 = 0.05;

/// Places at which an object that is not tracked is looked for in one set of images.
const MOST_PLACES: usize = 3;

/// Least fraction that images show of an object which is found anew: the rest is beside what was found, or
/// hidden by what stands before it.
const LEAST_SHOWN: f64 = 0.5;
/// Points of the object of which this is asked, about.
const SHOWN_POINTS: usize = 256;

/// A pose explains images much better than another if its mismatch is less than this fraction.
const MUCH_BETTER: f64 = 0.6;

/// Finds a known object in depth images: what estimators share, whatever registration near a predicted pose
/// they have.
#[derive(Debug, Clone)]
pub struct ObjectFinder {
    config: Config,
    /// Distance from the expected position within which the object's pixels are searched, in metres, beside
    /// its own size.
    gate_m: f64,
    /// The object as it is known.
    pub reference: Arc<ReferenceModel>,
    workspace: Workspace,
}

/// Brings the reference from a pose X_WO onto the scene's points.
type Register<'a> = dyn FnMut(&Registration<'_>, &mut SceneCloud, &Pose) -> Result<Fit, PerceptionStatus> + 'a;

impl ObjectFinder {
    /// Creates the finder for a known object. The workspace holds the buffers, best those of
    /// [`Workspace::before_flight`].
    pub fn new(config: Config, reference: Arc<ReferenceModel>, workspace: Workspace) -> Self {
        Self { config, gate_m: GATE_M, reference, workspace }
    }

    /// Sets the distance from the predicted position within which the object's pixels are searched, in
    /// metres.
    #[must_use]
    pub fn with_gate_m(self, gate_m: f64) -> Self {
        Self { gate_m, ..self }
    }

    /// Finds the object in all depth images of one capture time.
    ///
    /// From a predicted pose `register` brings the reference onto the scene's points; where that leads
    /// nowhere, all orientations are tried there. Without one the object is looked for everywhere, and in
    /// images with masks also if it is not where it was predicted.
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
        if self.workspace.detector.background.learn(view, &self.config) {
            return Err(PerceptionStatus::NoPoints);
        }
        let are_labelled = view.frames.iter().all(|frame| frame.mask.is_some());
        match prior.pose().map(|_| self.find_near(view, &prior, &mut register)) {
            None | Some(Err(PerceptionStatus::NoPoints)) if are_labelled => {
                self.find_near(view, &Prior::Anywhere, &mut register)
            }
            Some(found) => found,
            None => {
                let mut found = Vec::new();
                let status = self.find_elsewhere(view, &[], &mut register, &mut found);
                found.first().copied().ok_or(status)
            }
        }
    }

    /// Finds all things in images of one capture time that could be the object, each once: what is expected,
    /// at poses X_WO, and what else was not there before. Images with masks show none.
    fn find_all(
        &mut self,
        view: &View<'_>,
        expected: &[Pose],
        found: &mut Vec<ObjectPose>,
        mut register: impl FnMut(&Registration<'_>, &mut SceneCloud, &Pose) -> Result<Fit, PerceptionStatus>,
    ) {
        if self.reference.points.is_empty() || self.workspace.detector.background.learn(view, &self.config) {
            return;
        }
        for X_WO in expected {
            let near = self.find_near(view, &Prior::Pose(*X_WO), &mut register);
            let is_new = |it: &ObjectPose| it.is_explained() && !self.is_one_of(found, &it.X_WO);
            found.extend(near.ok().filter(is_new));
        }
        self.find_elsewhere(view, expected, &mut register, found);
    }

    /// Adds what could be the object at places where something is that was not there before, beside what has
    /// been found. A thing that no orientation of the object explains, such as a hand, is another one, and so
    /// is a thing of which most of the object would have to be hidden, such as a cable on the arm: some pose
    /// fits to any few points. Of those added the silhouette that fits best comes first. Returns why the last
    /// place that was left out shows no object.
    fn find_elsewhere(
        &mut self,
        view: &View<'_>,
        expected: &[Pose],
        register: &mut Register<'_>,
        found: &mut Vec<ObjectPose>,
    ) -> PerceptionStatus {
        self.workspace.detector.collect(view, &self.reference, &self.config);
        let (mut status, known, mut tried) = (PerceptionStatus::NoPoints, found.len(), 0);
        while tried < MOST_PLACES {
            let Some(place) = self.workspace.detector.next_place(view, &self.reference, &self.config) else { break };
            let mut X_WO = Pose::from(place);
            if self.is_one_of(found, &X_WO) {
                continue;
            }
            tried += 1;
            let from_m = |it: &&Pose| (it.translation.vector - place.coords).norm();
            if let Some(nearest) = expected.iter().min_by(|a, b| from_m(a).total_cmp(&from_m(b))) {
                X_WO.rotation = nearest.rotation;
            }
            match self.find_near(view, &Prior::Place(X_WO), register) {
                Err(fault) => status = fault,
                Ok(pose) if !pose.is_explained() || self.shown_fraction(view, &pose.X_WO) < LEAST_SHOWN => {
                    status = PerceptionStatus::NotConverged;
                }
                Ok(pose) if self.is_one_of(found, &pose.X_WO) => {}
                Ok(pose) => found.push(pose),
            }
        }
        let mismatch = |it: &ObjectPose| it.silhouette_mismatch.unwrap_or_default();
        found[known..].sort_by(|a, b| mismatch(a).total_cmp(&mismatch(b)));
        status
    }

    /// Returns whether something at `X_WO` is one of these, because both together have no room there.
    fn is_one_of(&self, found: &[ObjectPose], X_WO: &Pose) -> bool {
        let apart_m = |it: &ObjectPose| (it.X_WO.translation.vector - X_WO.translation.vector).norm();
        found.iter().any(|it| apart_m(it) < self.reference.radius_m)
    }

    /// Fraction of the reference's points at whose pixels the last scene shows the object, if it is at
    /// `X_WO`. Images in which none of it was found do not count.
    fn shown_fraction(&self, view: &View<'_>, X_WO: &Pose) -> f64 {
        let points = self.reference.points.iter().step_by(stride(self.reference.points.len(), SHOWN_POINTS));
        let (mut shown, mut all) = (0_usize, 0_usize);
        for (index, frame) in view.seen() {
            let Some(label) = self.workspace.scene.label_in(index, frame) else { continue };
            let Some(camera) = view.cameras.get(frame.camera) else { continue };
            let X_CO = camera.X_WC.inverse() * view.in_image(frame, X_WO);
            let pixels = points.clone().filter_map(|p_O| camera.project(&(X_CO * p_O)));
            for uv in pixels.filter(|uv| frame.window.contains(uv)) {
                all += 1;
                let [column, row] = [uv.x as u32 - frame.window.left, uv.y as u32 - frame.window.top];
                shown += usize::from(label(column as usize, row as usize) == Label::Object);
            }
        }
        shown as f64 / all.max(1) as f64
    }

    /// Collects what may be the object where it is expected, and its silhouette where depths are noisy.
    fn collect(&mut self, view: &View<'_>, expected: Option<&Pose>) -> Result<(), PerceptionStatus> {
        let Self { config, gate_m, reference, workspace: Workspace { scene, .. } } = self;
        scene.collect(view, reference, expected.map(|X_WO| (X_WO, *gate_m)), config);
        match scene.points.len() {
            0 => return Err(PerceptionStatus::NoPoints),
            few if few < MIN_POINTS => return Err(PerceptionStatus::TooFewPoints),
            _ => {}
        }
        if scene.mean_noise_m() > SILHOUETTE_ABOVE_M {
            scene.collect_silhouette(view, reference, config);
        }
        Ok(())
    }

    /// Finds the object where it is expected, or anywhere in images with masks.
    fn find_near(
        &mut self,
        view: &View<'_>,
        prior: &Prior,
        register: &mut Register<'_>,
    ) -> Result<ObjectPose, PerceptionStatus> {
        let expected = prior.pose();
        self.collect(view, expected)?;
        let Self { config, reference, workspace: Workspace { scene, thinned, .. }, .. } = self;
        let registration = Registration::new(reference, config);
        let tracked = if let Prior::Pose(X_WO) = prior { register(&registration, scene, X_WO).ok() } else { None };
        let (fit, registered_globally) = match tracked {
            Some(fit) if !fit.silhouette_mismatch.is_some_and(|it| it > MAX_MISMATCH) => (fit, false),
            _ => {
                if scene.silhouette.is_empty() {
                    scene.collect_silhouette(view, reference, config);
                }
                let R_WO = expected.map_or_else(UnitQuaternion::identity, |X_WO| X_WO.rotation);
                let anywhere = registration.register_globally(scene, thinned, &R_WO);
                // The tracked pose stays unless another one explains the images much better.
                match (tracked, anywhere) {
                    (Some(near), Ok(far)) if !far.explains_much_better(&near) => (near, false),
                    (Some(near), Err(_)) => (near, false),
                    (_, anywhere) => (anywhere?, true),
                }
            }
        };
        Ok(fit.pose(view, registered_globally))
    }
}

impl ObjectPose {
    /// Returns whether the silhouettes are those of the object or, where there are none, its points lie on
    /// it: within a millimetre, or within their stated errors.
    fn is_explained(&self) -> bool {
        let is_small = |mismatch: f64| mismatch <= MAX_MISMATCH;
        match self.silhouette_mismatch {
            Some(mismatch) => is_small(mismatch),
            None => self.residual_m <= SILHOUETTE_ABOVE_M || self.points_mismatch.is_none_or(is_small),
        }
    }
}

impl Fit {
    /// Returns whether this pose explains the silhouettes much better than the other, which always holds
    /// against one without silhouettes.
    fn explains_much_better(&self, other: &Self) -> bool {
        let [ours, others] = [self, other].map(|it| it.silhouette_mismatch.unwrap_or(f64::INFINITY));
        ours <= MUCH_BETTER * others
    }

    /// The pose in the images. Where these are not explained, they tell that much less of it.
    fn pose(&self, view: &View<'_>, registered_globally: bool) -> ObjectPose {
        let told = self.silhouette_mismatch.filter(|it| *it > MAX_MISMATCH).map_or(1.0, f64::recip);
        ObjectPose {
            capture_s: view.capture_s(),
            X_WO: self.X_WO,
            information: self.information * told,
            points: self.points,
            residual_m: self.residual_m,
            points_mismatch: self.points_mismatch,
            silhouette_mismatch: self.silhouette_mismatch,
            iterations: self.iterations,
            registered_globally,
        }
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::Point3;

    use super::*;
    use crate::tracker::tracks::tests::pose;

    #[test]
    fn silhouettes_explain_a_pose_or_else_points_do() {
        let is_explained = |residual_m, points_mismatch, silhouette_mismatch| {
            let pose = pose(0.0, Point3::origin());
            ObjectPose { residual_m, points_mismatch, silhouette_mismatch, ..pose }.is_explained()
        };
        // Points of a person far away, among which the object was fitted.
        assert!(!is_explained(0.125, Some(4.6), None));
        assert!(is_explained(0.06, Some(0.8), None), "within their stated errors");
        assert!(is_explained(0.0008, Some(9.0), None), "within a millimetre");
        assert!(is_explained(0.125, Some(4.6), Some(0.6)), "the silhouette tells more");
        assert!(!is_explained(0.0008, Some(0.8), Some(3.1)));
    }
}
