//! Registration of a point cloud that comes without images: from a file, or from a sensor with a driver of its own.

use catch_body::Pose;
use nalgebra::{Point3, Vector3};

use super::{
    Config, ObjectPose, PerceptionStatus, ReferenceModel, cold_start,
    point_cloud::{SceneCloud, ScenePoint},
    registration,
};

/// Finds the object in `points` (W, metres), all or most of which lie on it: near `prior`, or anywhere if there is none or
/// nothing is found there. `noise_m` is how far off the points are, as a standard deviation.
///
/// ```
/// use catch_body::Pose;
/// use catch_bot::perception::{Config, ReferenceModel, register_cloud};
/// use nalgebra::{Point3, Vector3};
///
/// // A ball of 40 mm, known from all sides, of which a camera sees one half.
/// let direction = |i: usize| {
///     let z = 1.0 - (2 * i + 1) as f64 / 4000.0;
///     let (sin, cos) = (i as f64 * 2.399_963).sin_cos();
///     Vector3::new(cos * (1.0 - z * z).sqrt(), sin * (1.0 - z * z).sqrt(), z)
/// };
/// let normals: Vec<_> = (0..4000).map(direction).collect();
/// let surface: Vec<_> = normals.iter().map(|normal| Point3::from(normal * 0.04)).collect();
/// let reference = ReferenceModel::from_points(&surface, &normals, &Config::default());
/// let seen: Vec<_> = surface[..2000].iter().map(|point| point + Vector3::new(1.0, 2.0, 0.5)).collect();
/// let pose = register_cloud(&seen, &reference, None, 0.0, &Config::default()).unwrap();
/// assert!((pose.X_WO.translation.vector - Vector3::new(1.0, 2.0, 0.5)).norm() < 5e-4);
/// ```
///
/// # Errors
/// What is missing: points, a reference, or agreement between them.
pub fn register_cloud(
    points: &[Point3<f64>],
    reference: &ReferenceModel,
    prior: Option<&Pose>,
    noise_m: f64,
    config: &Config,
) -> Result<ObjectPose, PerceptionStatus> {
    if reference.points.is_empty() {
        return Err(PerceptionStatus::NoReference);
    }
    // In which direction a point errs is not known of a cloud without cameras, so its noise has none.
    let finite = points.iter().filter(|point| point.coords.iter().all(|value| value.is_finite()));
    let point = |p_W: &Point3<f64>| ScenePoint { p_W: *p_W, per_depth_W: Vector3::zeros(), depth_sd_m: noise_m };
    let mut scene = SceneCloud::default();
    scene.points.extend(finite.map(point));
    match scene.points.len() {
        0 => return Err(PerceptionStatus::NoPoints),
        few if few < config.min_points => return Err(PerceptionStatus::TooFewPoints),
        _ => {}
    }
    let tracked = prior.and_then(|X_WO| registration::register(&mut scene, reference, X_WO, config, false).ok());
    let cold_started = tracked.is_none();
    let fit = match tracked {
        Some(fit) => fit,
        None => cold_start::register(&mut scene, &mut SceneCloud::default(), reference, prior, config)?,
    };
    Ok(ObjectPose {
        capture_s: 0.0,
        X_WO: fit.X_WO,
        information: fit.information,
        points: fit.points,
        residual_m: fit.residual_m,
        iterations: fit.iterations,
        cold_started,
    })
}
