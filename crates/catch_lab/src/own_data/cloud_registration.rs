//! The pose of one point cloud against another, or against a mesh.

use std::path::{Path, PathBuf};

use catch_body::{InputError, Pose};
use catch_bot::perception::{
    self, Config, Fit, MIN_POINTS, MODEL_SD_M, PerceptionStatus, ReferenceModel, SceneCloud, Symmetry,
    point_cloud::ScenePoint,
};
use catch_sim::object::check_length;
use nalgebra::{Matrix6, Point3, UnitQuaternion, Vector3};
use serde::{Deserialize, Serialize};

use super::cloud_file::{self, CloudFile};
use crate::assets::{Asset, Kind, Origin};

/// How far a registration got.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum RegistrationStatus {
    /// The pose is known.
    Registered,
    /// The cloud leaves a direction of the pose open.
    Degenerate,
    /// What was missing.
    #[serde(untagged)]
    Unregistered(PerceptionStatus),
}

/// Where the reference lies in a cloud.
#[derive(Debug, Clone, PartialEq)]
pub struct Registration {
    /// How far it got.
    pub status: RegistrationStatus,
    /// Takes points of the reference into the cloud's frame.
    pub X_CR: Option<Pose>,
    /// Inverse covariance of (rotation vector, position) in the cloud's axes.
    pub information: Option<Matrix6<f64>>,
    /// Distance of the points from the reference's surface, in metres.
    pub residual_m: Option<f64>,
    /// Under what the reference looks the same: `none`, `half_turn`, `finite` (another finite group), `axis` or `sphere`.
    pub symmetry: &'static str,
}

/// Brings a reference onto a cloud of points, each with the same standard deviation in metres along every axis; all orientations are tried.
fn register_cloud(points: &[Point3<f64>], sd_m: f64, reference: &ReferenceModel) -> Result<Fit, PerceptionStatus> {
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
    let config = Config::default();
    match scene.points.len() {
        0 => return Err(PerceptionStatus::NoPoints),
        few if few < MIN_POINTS => return Err(PerceptionStatus::TooFewPoints),
        _ => {}
    }
    let registration = perception::Registration { reference, config: &config, model_sd_m: MODEL_SD_M.hypot(sd_m) };
    registration.register_globally(&mut scene, &mut SceneCloud::default(), &UnitQuaternion::identity())
}

/// Looks for `reference` in a cloud whose points have the standard deviation `noise_m`.
///
/// ```
/// use catch_body::Pose;
/// use catch_bot::perception::ReferenceModel;
/// use catch_lab::own_data::cloud_registration::register;
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
/// let reference = ReferenceModel::from_points(&points, &outward);
/// let X_CR = Pose::new(Vector3::new(0.4, -0.2, 1.0), Vector3::new(0.2, 0.1, -0.3));
/// let cloud: Vec<Point3<f64>> = points.iter().step_by(7).map(|point| X_CR * point).collect();
///
/// let found = register(&cloud, 0.001, &reference).X_CR.unwrap();
/// assert!((found.translation.vector - X_CR.translation.vector).norm() < 1e-3);
/// ```
pub fn register(points: &[Point3<f64>], noise_m: f64, reference: &ReferenceModel) -> Registration {
    let found = register_cloud(points, noise_m, reference);
    let is_determined = |it: &Fit| worst_sd_m(&it.information, reference) <= MOST_SD * reference.radius_m;
    let status = match &found {
        Ok(fit) if is_determined(fit) => RegistrationStatus::Registered,
        Ok(_) => RegistrationStatus::Degenerate,
        Err(status) => RegistrationStatus::Unregistered(*status),
    };
    let fit = found.ok();
    let pose = fit.as_ref().filter(|_| status == RegistrationStatus::Registered).map(|it| it.X_WO);
    Registration {
        status,
        X_CR: pose.map(|X_CO| X_CO * reference.X_RO.inverse()),
        information: fit.as_ref().map(|it| it.information),
        residual_m: fit.as_ref().map(|it| it.residual_m),
        symmetry: match reference.symmetry {
            Symmetry::Finite { group, .. } => match group.order() {
                1 => "none",
                2 => "half_turn",
                _ => "finite",
            },
            Symmetry::Axis { .. } => "axis",
            Symmetry::Sphere => "sphere",
        },
    }
}

/// The surface of a reference: that of an object by name or file, about its centre of mass, or of a cloud or mesh. `asked_by` is the file and
/// field that name it.
///
/// # Errors
/// A file that cannot be read or that is not what its extension says.
pub fn scan_of(path: &Path, asked_by: (&str, &str)) -> Result<CloudFile, InputError> {
    let is_object = path.extension().is_none_or(|it| it == "toml");
    if !is_object {
        return cloud_file::read(path, true);
    }
    let nowhere = Origin::BuiltIn(PathBuf::new());
    let asset = Asset::find(Kind::Object, &path.to_string_lossy(), &nowhere, asked_by)?;
    Ok(cloud_file::on_surface(&asset.thrown_object()?.mesh))
}

/// The object as its reference shows it; `file` names the reference in errors.
///
/// # Errors
/// Too few points, or lengths that are not in metres.
pub fn reference_model(scan: CloudFile, file: &str) -> Result<ReferenceModel, InputError> {
    let too_few =
        |count: usize| InputError::new(file, "points", format!("{count} points"), "a surface of a hundred or more");
    let Some(&first) = scan.points.first().filter(|_| scan.points.len() >= LEAST_POINTS) else {
        return Err(too_few(scan.points.len()));
    };
    let (low, high) = scan.points.iter().fold((first, first), |(low, high), it| (low.inf(it), high.sup(it)));
    check_length(file, "points", (high - low).amax(), "lengths are in metres")?;
    let middle = scan.points.iter().map(|point| point.coords).sum::<Vector3<f64>>() / scan.points.len() as f64;
    let outwards = scan.normals.unwrap_or_else(|| scan.points.iter().map(|point| point.coords - middle).collect());
    // Denser than the models of the brain helps nobody.
    let step = scan.points.len().div_ceil(MOST_POINTS).max(1);
    let points: Vec<Point3<f64>> = scan.points.into_iter().step_by(step).collect();
    let outwards: Vec<Vector3<f64>> = outwards.into_iter().step_by(step).collect();
    let reference = ReferenceModel::from_points(&points, &outwards);
    if reference.points.is_empty() || !reference.radius_m.is_finite() {
        return Err(too_few(points.len()));
    }
    Ok(reference)
}

/// A pose whose uncertainty is larger than this many radii of the object in some direction is none.
const MOST_SD: f64 = 0.5;

/// The largest standard deviation of a pose in any direction that can be seen, rotations taken at the object's radius.
///
/// With the lever r the information of (rotation, position) is diag(1/r, 1)·I·diag(1/r, 1), in 1/m². A rotation under which the
/// object looks the same has none, so its smallest eigenvalues are left aside: one for an axis, three for a sphere.
fn worst_sd_m(information: &Matrix6<f64>, reference: &ReferenceModel) -> f64 {
    let unseen = match reference.symmetry {
        Symmetry::Finite { .. } => 0,
        Symmetry::Axis { .. } => 1,
        Symmetry::Sphere => 3,
    };
    let scale = Matrix6::from_fn(|i, j| match (i == j, i < 3) {
        (true, true) => 1.0 / reference.radius_m,
        (true, false) => 1.0,
        _ => 0.0,
    });
    let mut eigenvalues: Vec<f64> = (scale * information * scale).symmetric_eigenvalues().iter().copied().collect();
    eigenvalues.sort_by(f64::total_cmp);
    1.0 / eigenvalues[unseen].max(0.0).sqrt()
}

/// Fewer points than this do not make a reference.
const LEAST_POINTS: usize = 100;
/// Points of a reference that are used at most.
const MOST_POINTS: usize = 40_000;
