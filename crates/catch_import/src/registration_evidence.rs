//! Evidence for a registered pose: whether its residuals are those of the stated noise, and whether no other
//! pose explains the cloud as well.
//!
//! A patch of a flat face slides in its plane, one of a can along its axis: the residuals stay the same,
//! while the normal equations see information in the roughness of the model. So poses aside are tried, not
//! believed to be ruled out.

use catch_body::{Pose, pose::left_jacobian};
use catch_bot::perception::{self, Fit, ReferenceModel, SceneCloud, Symmetry, point_cloud::ScenePoint};
use nalgebra::{Matrix6, Translation3, UnitQuaternion, Vector3, Vector6};

/// A pose, and the points that speak for it.
pub(super) struct Evidence<'a> {
    scene: SceneCloud,
    fit: &'a Fit,
    registration: &'a perception::Registration<'a>,
    /// Standard deviation of a point from the surface: as stated, or as found where that is more.
    sd_m: f64,
    mean_square: f64,
}

/// Residuals in standard deviations count as this square at most: what is farther off is not the object's.
const MOST_SQUARE: f64 = 9.0;
/// Residuals larger than the stated noise and the model's by this factor are not explained by them.
const EXPLAINED: f64 = 2.0;
/// A pose with a larger mean square of residuals, by this or by what the number of points tells at three
/// standard deviations, is worse. The model's own edges make up to 0.2 between poses of a mug whose handle is
/// hidden.
const WORSE: f64 = 0.25;
/// A pose whose standard deviation is larger than this many radii of the object in some direction is none.
const MOST_SD: f64 = 0.5;
/// Poses nearer than this many radii, or than so many of the standard deviations that the pose claims, are
/// the same.
pub(super) const SAME_RADII: f64 = 0.1;
const SAME_SD: f64 = 5.0;
/// Distances aside at which poses are tried, in radii, in the directions of which the cloud gives least
/// information.
const ASIDE_RADII: [f64; 4] = [0.1, 0.2, 0.5, 1.0];
const WEAK_DIRECTIONS: usize = 3;

impl<'a> Evidence<'a> {
    /// The evidence of a scene's points for `fit`.
    pub fn new(scene: &SceneCloud, fit: &'a Fit, registration: &'a perception::Registration<'a>) -> Self {
        let stated_m = registration.model_sd_m;
        let square = |sd_m: f64| Self::mean_square(&scene.points, &fit.X_WO, sd_m, registration.reference);
        let sd_m = stated_m * square(stated_m).max(1.0).sqrt();
        Self { scene: scene.clone(), fit, registration, sd_m, mean_square: square(sd_m) }
    }

    /// Mean square of the points' distances from the reference at a pose, in standard deviations, outliers
    /// bounded.
    pub fn mean_square(points: &[ScenePoint], X_WO: &Pose, sd_m: f64, reference: &ReferenceModel) -> f64 {
        let X_OW = X_WO.inverse();
        let square = |it: &ScenePoint| (reference.distance.at(&(X_OW * it.p_W)).0 / sd_m).powi(2).min(MOST_SQUARE);
        points.iter().map(square).sum::<f64>() / points.len().max(1) as f64
    }

    /// Returns whether noise of the standard deviation `noise_m` explains how far the points are off; zero is
    /// none stated.
    pub fn is_explained(&self, noise_m: f64) -> bool {
        noise_m == 0.0 || self.fit.residual_m <= EXPLAINED * self.registration.model_sd_m
    }

    /// Returns whether the pose is the only one: `hypotheses` at which other registrations ended are worse,
    /// and so are all poses that lie aside.
    pub fn is_unique(&mut self, hypotheses: &[Fit]) -> bool {
        !self.is_open() && !hypotheses.iter().any(|it| self.is_another(&it.X_WO)) && !self.slides()
    }

    /// Directions of (rotation, position) with their information in 1/m², rotations taken at the object's
    /// radius r: eigenvectors of diag(1/r, 1)·I·diag(1/r, 1), the least informed first. Rotations under which
    /// the object looks the same are left out: one for an axis, three for a sphere.
    fn directions(&self) -> Vec<(f64, Vector6<f64>)> {
        let unseen = match self.registration.reference.symmetry {
            Symmetry::Finite { .. } => 0,
            Symmetry::Axis { .. } => 1,
            Symmetry::Sphere => 3,
        };
        let eigen = (self.at_radius() * self.fit.information * self.at_radius()).symmetric_eigen();
        let mut directions: Vec<_> =
            (0..6).map(|i| (eigen.eigenvalues[i], self.at_radius() * eigen.eigenvectors.column(i))).collect();
        directions.sort_by(|a, b| a.0.total_cmp(&b.0));
        directions.split_off(unseen)
    }

    /// diag(1/r, 1).
    fn at_radius(&self) -> Matrix6<f64> {
        let turn = 1.0 / self.registration.reference.radius_m;
        Matrix6::from_diagonal(&Vector6::new(turn, turn, turn, 1.0, 1.0, 1.0))
    }

    /// Returns whether the normal equations themselves leave a direction open.
    fn is_open(&self) -> bool {
        let (least, _) = self.directions()[0];
        1.0 / least.max(0.0).sqrt() > MOST_SD * self.registration.reference.radius_m
    }

    /// Returns whether the object may be moved along a direction of which little is known, by itself or with
    /// what then fits best.
    fn slides(&mut self) -> bool {
        let radius_m = self.registration.reference.radius_m;
        let steps = ASIDE_RADII.into_iter().flat_map(|it| [it, -it]).map(|it| it * radius_m);
        let aside: Vec<Pose> = self
            .directions()
            .iter()
            .take(WEAK_DIRECTIONS)
            .flat_map(|&(_, twist)| steps.clone().map(move |length_m| (twist, length_m)))
            .map(|(twist, length_m)| screw(&self.fit.X_WO, &(twist * length_m)))
            .collect();
        aside.iter().any(|X_WO| {
            let refined = self.registration.register(&mut self.scene, X_WO, false);
            self.is_another(X_WO) || refined.is_ok_and(|it| self.is_another(&it.X_WO))
        })
    }

    /// Returns whether a pose is a different one, no symmetry of the object, that explains the points as
    /// well.
    fn is_another(&self, X_WO: &Pose) -> bool {
        let reference = self.registration.reference;
        let worse = f64::max(WORSE, MOST_SQUARE / self.scene.points.len() as f64);
        let square = Self::mean_square(&self.scene.points, X_WO, self.sd_m, reference);
        if square > self.mean_square + worse {
            return false;
        }
        let step = between(reference, &self.fit.X_WO, X_WO);
        let is_claimed_out = step.dot(&(self.fit.information * step)) > SAME_SD * SAME_SD;
        is_claimed_out && away_m(reference, &self.fit.X_WO, X_WO) > SAME_RADII * reference.radius_m
    }
}

/// Rotation vector, the smallest that makes the looks alike, and shift from one pose to another.
fn between(reference: &ReferenceModel, X_WA: &Pose, X_WB: &Pose) -> Vector6<f64> {
    let turn = reference.symmetry.turn_between(&X_WA.rotation, &X_WB.rotation);
    let shift = X_WB.translation.vector - X_WA.translation.vector;
    Vector6::new(turn.x, turn.y, turn.z, shift.x, shift.y, shift.z)
}

/// Distance between the looks of the object at two poses, rotations taken at its radius.
pub(super) fn away_m(reference: &ReferenceModel, X_WA: &Pose, X_WB: &Pose) -> f64 {
    let step = between(reference, X_WA, X_WB);
    libm::hypot(step.fixed_rows::<3>(3).norm(), step.fixed_rows::<3>(0).norm() * reference.radius_m)
}

/// A pose moved along a twist (ω, v) about its origin, as a screw: exp of the twist, so that what slides
/// about a distant axis stays on its circle (Murray, Li, Sastry: A mathematical introduction to robotic
/// manipulation, 2.36).
fn screw(X_WO: &Pose, twist: &Vector6<f64>) -> Pose {
    let (turn, v): (Vector3<f64>, Vector3<f64>) = (twist.fixed_rows::<3>(0).into(), twist.fixed_rows::<3>(3).into());
    Pose::from_parts(
        Translation3::from(X_WO.translation.vector + left_jacobian(&turn) * v),
        UnitQuaternion::from_scaled_axis(turn) * X_WO.rotation,
    )
}
