//! The pose of one point cloud against another, or against a mesh.

use std::path::Path;

use catch_body::{InputError, Pose};
use catch_bot::perception::{
    self, Config, Fit, MIN_POINTS, MODEL_SD_M, PerceptionStatus, ReferenceModel, SceneCloud, Symmetry,
    point_cloud::ScenePoint,
};
use catch_sim::object::check_length;
use nalgebra::{Matrix6, Point3, UnitQuaternion, Vector3, distance};
use serde::{Deserialize, Serialize};

use super::{
    cloud_file::{self, CloudFile},
    registration_evidence::{Evidence, SAME_RADII, away_m},
};
use catch_lab::assets::{Asset, Kind};

/// Outcome of a registration.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum RegistrationStatus {
    /// The pose is known.
    Registered,
    /// The cloud leaves a direction of the pose open, or other poses explain it as well.
    Degenerate,
    /// The best pose leaves the points farther from the surface than their stated noise explains.
    Implausible,
    /// No pose was found; the perception's status states what was missing.
    #[serde(untagged)]
    Unregistered(PerceptionStatus),
}

/// Pose of the reference in a cloud.
#[derive(Debug, Clone, PartialEq)]
pub struct Registration {
    /// Outcome of the registration.
    pub status: RegistrationStatus,
    /// Takes points of the reference into the cloud's frame.
    pub X_CR: Option<Pose>,
    /// Inverse covariance of (rotation vector, position) in the cloud's axes.
    pub information: Option<Matrix6<f64>>,
    /// Distance of the points from the reference's surface, in metres.
    pub residual_m: Option<f64>,
    /// Rotations under which the reference looks the same: `none`, `half_turn`, `finite` (another finite
    /// group), `axis` or `sphere`.
    pub symmetry: &'static str,
}

/// Looks for `reference` in a cloud whose points have the standard deviation `noise_m`.
///
/// ```
/// use catch_body::Pose;
/// use catch_bot::perception::ReferenceModel;
/// use catch_import::cloud_registration::register;
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
    let (status, fit) = match found {
        Ok((fit, status)) => (status, Some(fit)),
        Err(status) => (RegistrationStatus::Unregistered(status), None),
    };
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

/// Brings a reference onto a cloud of points, each with the same standard deviation in metres along every
/// axis; all orientations are tried.
fn register_cloud(
    points: &[Point3<f64>],
    noise_m: f64,
    reference: &ReferenceModel,
) -> Result<(Fit, RegistrationStatus), PerceptionStatus> {
    if reference.points.is_empty() {
        return Err(PerceptionStatus::NoReference);
    }
    let points: Vec<Point3<f64>> = points.iter().copied().filter(|it| it.iter().all(|x| x.is_finite())).collect();
    let config = Config::default();
    match points.len() {
        0 => return Err(PerceptionStatus::NoPoints),
        few if few < MIN_POINTS => return Err(PerceptionStatus::TooFewPoints),
        _ => {}
    }
    let model_sd_m = libm::hypot(model_sd_m(reference), noise_m);
    let registration = perception::Registration { reference, config: &config, model_sd_m };
    let every = |most: usize| points.iter().step_by(points.len().div_ceil(most));
    let (mut fewest, mut few, mut all) = (scene(every(MOST_TRIED)), scene(every(MOST_COMPARED)), scene(points.iter()));
    let square = |points: &[ScenePoint], it: &Fit| Evidence::mean_square(points, &it.X_WO, model_sd_m, reference);
    let anchors = spread(&reference.points, ANCHORS);
    let mut tried: Vec<Fit> = registration.hypotheses(&mut fewest, &anchors).collect();
    tried.sort_by(|a, b| square(&fewest.points, a).total_cmp(&square(&fewest.points, b)));
    let mut hypotheses: Vec<Fit> = Vec::new();
    for it in &tried {
        if hypotheses.len() < FINALISTS
            && hypotheses.iter().all(|known| away_m(reference, &known.X_WO, &it.X_WO) > SAME_RADII * reference.radius_m)
        {
            hypotheses.push(*it);
        }
    }
    hypotheses = hypotheses.iter().filter_map(|it| registration.register(&mut few, &it.X_WO, false).ok()).collect();
    hypotheses.extend(registration.register_globally(&mut few, &mut fewest, &UnitQuaternion::identity()).ok());
    let start = hypotheses.iter().min_by(|a, b| square(&few.points, a).total_cmp(&square(&few.points, b)));
    let start = start.ok_or(PerceptionStatus::NotConverged)?;
    let fit = registration.register(&mut all, &start.X_WO, false)?;
    let mut evidence = Evidence::new(&few, &fit, &registration);
    let status = match evidence.is_explained(noise_m) {
        false => RegistrationStatus::Implausible,
        true if evidence.is_unique(&hypotheses) => RegistrationStatus::Registered,
        true => RegistrationStatus::Degenerate,
    };
    Ok((fit, status))
}

/// Points as a scene. No direction is noisier than the others: all of the noise is the model's.
pub fn scene<'a>(points: impl Iterator<Item = &'a Point3<f64>>) -> SceneCloud {
    let mut scene = SceneCloud::default();
    let seen = |p_W: &Point3<f64>| ScenePoint {
        p_W: *p_W,
        per_depth_W: Vector3::zeros(),
        depth_sd_m: 0.0,
        pixel_m: 0.0,
        image: 0,
    };
    scene.points.extend(points.map(seen));
    scene
}

/// Root mean square distance of a reference's own points from its surface, in metres. The surface is smooth
/// and on a grid, so even a cloud without noise leaves this residual.
fn model_sd_m(reference: &ReferenceModel) -> f64 {
    let step = reference.scanned.len().div_ceil(MOST_COMPARED).max(1);
    let (mut squares_m2, mut count) = (0.0, 0.0);
    for point in reference.scanned.iter().step_by(step) {
        squares_m2 += reference.distance.at(point).0.powi(2);
        count += 1.0;
    }
    (squares_m2 / f64::max(count, 1.0)).sqrt().max(MODEL_SD_M)
}

/// Points of a surface that are far from each other: each is the farthest from those before it.
fn spread(points: &[Point3<f64>], count: usize) -> Vec<Point3<f64>> {
    let mut chosen = Vec::new();
    let mut away_m = vec![f64::INFINITY; points.len()];
    while let Some(farthest) =
        (0..points.len()).max_by(|a, b| away_m[*a].total_cmp(&away_m[*b])).filter(|_| chosen.len() < count)
    {
        chosen.push(points[farthest]);
        away_m.iter_mut().zip(points).for_each(|(it, point)| *it = it.min(distance(point, &points[farthest])));
    }
    chosen
}

/// Points that poses are tried on, and compared on, at most.
const MOST_TRIED: usize = 100;
const MOST_COMPARED: usize = 400;
/// Places of the surface at which the middle of a cloud may be.
const ANCHORS: usize = 14;
/// Tried poses that are compared.
const FINALISTS: usize = 12;

/// The surface of a reference: that of an object by name or file, about its centre of mass, or of a cloud or
/// mesh. `asked_by` is the file and field that name it.
///
/// # Errors
/// A file that cannot be read or that is not what its extension says.
pub fn scan_of(path: &Path, asked_by: (&str, &str)) -> Result<CloudFile, InputError> {
    let is_object = path.extension().is_none_or(|it| it == "toml");
    if !is_object {
        return cloud_file::read(path, true);
    }
    let asset = Asset::asked(Kind::Object, &path.to_string_lossy(), asked_by)?;
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
    let mut reference = ReferenceModel::from_points(&points, &outwards);
    if reference.points.is_empty() || !reference.radius_m.is_finite() {
        return Err(too_few(points.len()));
    }
    reference.scanned = points.iter().map(|p_R| reference.X_RO.inverse_transform_point(p_R)).collect();
    Ok(reference)
}

/// Fewer points than this do not make a reference.
const LEAST_POINTS: usize = 100;
/// Points of a reference that are used at most.
const MOST_POINTS: usize = 40_000;
