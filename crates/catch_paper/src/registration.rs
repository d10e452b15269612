//! Pose estimation as in the paper (III-B): iterative closest points (Besl and McKay, A method for
//! registration of 3-D shapes, 1992).
//!
//! Alternates between pairing each point of the scene with the nearest point of the reference, found by an
//! hierarchy of boxes, and the rigid motion that brings the pairs together best in the least squares (Kabsch;
//! Arun, Huang and Blostein, 1987).

use std::sync::Arc;

use catch_body::Pose;
use catch_bot::perception::{
    self, Fit, GATE_M, MAX_RESIDUAL_M, MODEL_SD_M, ObjectFinder, ObjectPose, PerceptionStatus, PoseEstimator, Prior,
    ReferenceModel, Registration, SceneCloud, Symmetry, View, Workspace,
};
use nalgebra::{Matrix3, Matrix6, Point3, Rotation3, Translation3, UnitQuaternion, Vector3, Vector6};
use parry3d_f64::bounding_volume::Aabb;
use parry3d_f64::math::Vector;
use parry3d_f64::partitioning::{Bvh, BvhBuildStrategy, BvhNode};
use serde::{Deserialize, Serialize};

/// Settings of the registration.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Config {
    /// True for the registration of the authors' code, false for that of the text. The code starts from the
    /// last pose that it found, at first from the scan's own frame at the world's origin, far from the object
    /// and rotated against it; pairs all points with all of the scan; goes on until the mean distance of the
    /// pairs settles; takes whatever comes out; and keeps the orientation of the scan for an object that
    /// looks the same from all sides.
    pub as_published: bool,
}

/// Criteria at which a registration ends, and up to which it is accepted.
#[derive(Debug, Clone, Copy)]
struct Ending {
    /// Iterations at most.
    iterations: usize,
    /// Largest root mean square distance that is believed, in metres, beside three standard deviations of the
    /// depth noise.
    residual_m: f64,
}

/// A registration has converged when a step is shorter than this in metres, at the object's surface.
const TOLERANCE_M: f64 = 1e-5;
/// A registration has also converged when the mean distance of the pairs changes by less than this fraction
/// (code).
const RELATIVE_TOLERANCE: f64 = 1e-5;
/// All points of the images count, however far from the last pose (code).
const ANYWHERE_M: f64 = 3.0;

impl Config {
    fn points<'a>(&self, reference: &'a ReferenceModel) -> &'a [Point3<f64>] {
        if self.as_published { &reference.scanned } else { &reference.points }
    }

    fn gate_m(&self) -> f64 {
        if self.as_published { ANYWHERE_M } else { GATE_M }
    }

    fn ending(&self) -> Ending {
        if self.as_published {
            Ending { iterations: 1000, residual_m: 1.0 }
        } else {
            Ending { iterations: 50, residual_m: MAX_RESIDUAL_M }
        }
    }
}

/// Point-to-point ICP near the predicted pose. Images are segmented, and the pose is initialized without a
/// prior, as our own estimator does it.
#[derive(Debug, Clone)]
pub struct IcpEstimator {
    config: Config,
    hierarchy: Arc<Bvh>,
    finder: ObjectFinder,
    last_X_WO: Option<Pose>,
}

impl IcpEstimator {
    /// Creates the estimator for a known object. The workspace holds the buffers, best those of
    /// [`Workspace::before_flight`].
    pub fn new(
        config: Config,
        perception: perception::Config,
        reference: Arc<ReferenceModel>,
        workspace: Workspace,
    ) -> Self {
        let hierarchy = Arc::new(hierarchy(config.points(&reference)));
        let finder = ObjectFinder::new(perception, reference, workspace).with_gate_m(config.gate_m());
        Self { config, hierarchy, finder, last_X_WO: None }
    }
}

impl PoseEstimator for IcpEstimator {
    fn estimate(&mut self, view: &View<'_>, prior: Prior) -> Result<ObjectPose, PerceptionStatus> {
        let Self { config, hierarchy, finder, last_X_WO } = self;
        let prior = if config.as_published { Prior::Pose(last_X_WO.unwrap_or(Pose::identity())) } else { prior };
        let mut found = finder.find(view, prior, |Registration { reference, .. }, scene, X_WO| {
            Icp { config, reference, hierarchy }.register(scene, X_WO)
        })?;
        if config.as_published && finder.reference.symmetry == Symmetry::Sphere {
            // The dropped rotation leaves the object's position as it is: it is about its own centre.
            found.X_WO.rotation = UnitQuaternion::identity();
        }
        *last_X_WO = Some(found.X_WO);
        Ok(found)
    }

    fn reset(&mut self) {
        self.last_X_WO = None;
    }
}

/// The reference's points in a hierarchy of boxes, to be searched for the nearest.
fn hierarchy(points: &[Point3<f64>]) -> Bvh {
    let boxes = points.iter().map(|point| Aabb::new(vector(point), vector(point)));
    Bvh::from_iter(BvhBuildStrategy::Binned, boxes.enumerate())
}

/// The one of `points` that is nearest to `point`.
fn nearest(hierarchy: &Bvh, points: &[Point3<f64>], point: &Point3<f64>) -> Option<Point3<f64>> {
    let at = vector(point);
    let to_box = |node: &BvhNode, _| (node.mins() - at).max(at - node.maxs()).max(Vector::ZERO).length_squared();
    let to_point = |leaf: u32, _| Some((points[leaf as usize] - point).norm_squared());
    let (leaf, _) = hierarchy.find_best(f64::INFINITY, to_box, to_point)?;
    Some(points[leaf as usize])
}

fn vector(point: &Point3<f64>) -> Vector {
    Vector::new(point.x, point.y, point.z)
}

/// Inputs of a registration.
struct Icp<'a> {
    config: &'a Config,
    reference: &'a ReferenceModel,
    hierarchy: &'a Bvh,
}

impl Icp<'_> {
    /// Brings the reference from `X_WO` onto the scene's points, point to point.
    fn register(&self, scene: &SceneCloud, X_WO: &Pose) -> Result<Fit, PerceptionStatus> {
        let Self { config, reference, .. } = *self;
        let ending = config.ending();
        let mut X_WO = *X_WO;
        let (points, count) = (config.points(reference), scene.points.len() as f64);
        let mut iterations = 0;
        let mut converged = false;
        let (mut squares, mut distance_m) = (0.0, f64::INFINITY);
        while iterations < ending.iterations && !converged {
            iterations += 1;
            let before_m = distance_m;
            let moved;
            (moved, squares, distance_m) = self.step(scene, points, &X_WO).ok_or(PerceptionStatus::NoReference)?;
            let length = (moved.translation.vector - X_WO.translation.vector).norm()
                + moved.rotation.angle_to(&X_WO.rotation) * reference.radius_m;
            converged = if config.as_published {
                (before_m - distance_m).abs() < RELATIVE_TOLERANCE * distance_m
            } else {
                length < TOLERANCE_M
            };
            X_WO = moved;
        }
        let residual_m = (squares / count).sqrt();
        let finite = X_WO.to_homogeneous().iter().all(|value| value.is_finite());
        if !finite || residual_m > ending.residual_m + 3.0 * scene.mean_noise_m() {
            return Err(PerceptionStatus::NotConverged);
        }
        // Each pair tells of all three coordinates as much as it is off by.
        let along = count / residual_m.max(MODEL_SD_M).powi(2);
        let turn = along * reference.radius_m.powi(2) / 3.0;
        let observable = X_WO.rotation.to_rotation_matrix() * reference.symmetry.observable();
        let mut information = Matrix6::from_diagonal(&Vector6::new(0.0, 0.0, 0.0, along, along, along));
        information.fixed_view_mut::<3, 3>(0, 0).copy_from(&(observable * observable.transpose() * turn));
        Ok(Fit {
            X_WO,
            information,
            points: scene.points.len(),
            residual_m,
            noise_m: scene.mean_noise_m(),
            silhouette_residual_m: None,
            points_mismatch: Some((residual_m / MODEL_SD_M).powi(2)),
            silhouette_mismatch: None,
            robust_cost: count * libm::log(residual_m.max(1e-9)),
            iterations,
        })
    }

    /// Pose after all points were paired anew, the sum of the squared distances of the pairs before it, and
    /// their mean distance.
    ///
    /// Sums over all pairs: means, and the covariance Σ (o − ō)(w − w̄)ᵀ = Σ o·wᵀ − n·ō·w̄ᵀ.
    fn step(&self, scene: &SceneCloud, points: &[Point3<f64>], X_WO: &Pose) -> Option<(Pose, f64, f64)> {
        let (mut mean_O, mut mean_W, mut products) = (Vector3::zeros(), Vector3::zeros(), Matrix3::zeros());
        let (mut squares, mut distances, count) = (0.0, 0.0, scene.points.len() as f64);
        let origin = X_WO.translation.vector;
        for point in &scene.points {
            let p_O = X_WO.inverse_transform_point(&point.p_W);
            let paired = nearest(self.hierarchy, points, &p_O)?;
            let from_origin = point.p_W.coords - origin;
            mean_O += paired.coords;
            mean_W += from_origin;
            products += paired.coords * from_origin.transpose();
            squares += (p_O - paired).norm_squared();
            distances += (p_O - paired).norm();
        }
        mean_O /= count;
        mean_W /= count;
        let R_WO = turn(&(products - mean_O * mean_W.transpose() * count)).unwrap_or(X_WO.rotation);
        let moved = Pose::from_parts(Translation3::from(origin + mean_W - R_WO * mean_O), R_WO);
        Some((moved, squares, distances / count))
    }
}

/// Covariances below this are rounding, in m².
const LEAST_COVARIANCE_M2: f64 = 1e-9;

/// The rotation R that brings the o of pairs (o, w) onto the w best, from their covariance Σ (o − ō)(w − w̄)ᵀ
/// = U·S·Vᵀ: R = V·diag(1, 1, det)·Uᵀ. `None` where all pair with one point, as they do from far away: that
/// tells of no orientation.
fn turn(covariance: &Matrix3<f64>) -> Option<UnitQuaternion<f64>> {
    let svd = covariance.svd(true, true);
    let (u, v_t) = (svd.u?, svd.v_t?);
    if svd.singular_values.max() < LEAST_COVARIANCE_M2 {
        return None;
    }
    let handed = (v_t.transpose() * u.transpose()).determinant().signum();
    let R = v_t.transpose() * Matrix3::from_diagonal(&Vector3::new(1.0, 1.0, handed)) * u.transpose();
    Some(UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(R)))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Rounding errors of pairs with one point give no rotation; the rotation of pairs with several points is
    /// found.
    #[test]
    fn pairs_with_one_point_tell_of_no_turn() {
        assert_eq!(turn(&(Matrix3::new(8.0, 1.0, 0.0, -2.0, 0.5, 3.0, 0.0, 1.0, 0.2) * 1e-14)), None);
        let R = UnitQuaternion::from_euler_angles(0.4, -0.8, 2.0);
        let points = [Vector3::new(0.1, 0.0, 0.02), Vector3::new(-0.05, 0.07, 0.0), Vector3::new(-0.05, -0.07, -0.02)];
        let covariance: Matrix3<f64> = points.iter().map(|o| o * (R * o).transpose()).sum();
        assert!(turn(&covariance).unwrap().angle_to(&R) < 1e-9);
    }
}
