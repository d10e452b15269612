//! Registration for other people's data: one bare cloud of points against a reference, without cameras or masks.

use catch_body::Pose;
use nalgebra::{Point3, UnitQuaternion, Vector3};

use super::{
    Config, PerceptionStatus, ReferenceModel,
    point_cloud::{SceneCloud, ScenePoint},
    registration::{Fit, Registration},
};

/// Brings a reference onto a cloud of points in the frame C, each with the same standard deviation in metres along every axis.
///
/// Returns X_CO with its information; times [`ReferenceModel::X_RO`]'s inverse it is the pose X_CR of the reference's own frame.
/// Without a prior all orientations are tried.
///
/// ```
/// use catch_body::Pose;
/// use catch_bot::perception::{Config, ReferenceModel, register_cloud};
/// use nalgebra::{Point3, Vector3};
///
/// // An ellipsoid of 4, 6 and 10 cm as a reference with its outward directions, and a part of it turned and moved.
/// let surface = (0..4000).map(|i| {
///     let (z, angle) = (1.0 - (f64::from(i) + 0.5) / 2000.0, 2.399963 * f64::from(i));
///     Vector3::new(angle.cos() * (1.0 - z * z).sqrt(), angle.sin() * (1.0 - z * z).sqrt(), z)
/// });
/// let points: Vec<Point3<f64>> =
///     surface.clone().map(|n| Point3::new(0.02 * n.x, 0.03 * n.y, 0.05 * n.z)).collect();
/// let outward: Vec<Vector3<f64>> = surface.map(|n| Vector3::new(n.x / 0.02, n.y / 0.03, n.z / 0.05).normalize()).collect();
/// let reference = ReferenceModel::from_points(&points, &outward, &Config::default());
/// let X_CR = Pose::new(Vector3::new(0.4, -0.2, 1.0), Vector3::new(0.2, 0.1, -0.3));
/// let cloud: Vec<Point3<f64>> = points.iter().step_by(7).map(|point| X_CR * point).collect();
///
/// let fit = register_cloud(&cloud, 0.001, &reference, None, &Config::default()).unwrap();
/// let found = fit.X_WO * reference.X_RO.inverse();
/// assert!((found.translation.vector - X_CR.translation.vector).norm() < 1e-3);
/// ```
///
/// # Errors
/// Too few points, no reference, or no pose in which the reference lies on the points.
pub fn register_cloud(
    points: &[Point3<f64>],
    sd_m: f64,
    reference: &ReferenceModel,
    prior: Option<&Pose>,
    config: &Config,
) -> Result<Fit, PerceptionStatus> {
    if reference.points.is_empty() {
        return Err(PerceptionStatus::NoReference);
    }
    let mut scene = SceneCloud::default();
    let finite = points.iter().filter(|point| point.iter().all(|value| value.is_finite()));
    // No direction is noisier than the others: all of the noise is the model's.
    scene.points.extend(finite.map(|p_W| ScenePoint {
        p_W: *p_W,
        per_depth_W: Vector3::zeros(),
        depth_sd_m: 0.0,
        image: 0,
    }));
    match scene.points.len() {
        0 => return Err(PerceptionStatus::NoPoints),
        few if few < config.min_points => return Err(PerceptionStatus::TooFewPoints),
        _ => {}
    }
    let config = Config { model_sd_m: config.model_sd_m.hypot(sd_m), ..config.clone() };
    let registration = Registration { reference, config: &config };
    let tracked = prior.and_then(|X_CO| registration.register(&mut scene, X_CO, false).ok());
    let R_CO = prior.map_or_else(UnitQuaternion::identity, |X_CO| X_CO.rotation);
    tracked.map_or_else(|| registration.register_globally(&mut scene, &mut SceneCloud::default(), &R_CO), Ok)
}
