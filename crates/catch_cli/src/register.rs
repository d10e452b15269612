//! `catchingbot register`: the pose of one cloud against another.

use std::path::{Path, PathBuf};

use catch_body::{InputError, quantity};
use catch_bot::perception::{Config, Fit, ReferenceModel, Symmetry, register_cloud};
use catch_lab::{
    VERSION,
    assets::{Asset, COMMAND_LINE, Kind, Origin},
    own_data::cloud_file::{self, CloudFile},
};
use catch_sim::object::check_length;
use clap::Args;
use nalgebra::{Matrix6, Point3, Vector3};
use serde::Serialize;

use crate::screen;

/// Arguments of `register`.
#[derive(Debug, Args)]
#[command(after_help = "\
The reference should show the object from all sides: a mesh, or a cloud with normals. Normals of a
cloud without any are taken to point away from its middle, which is right for objects that bulge
everywhere. Printed is X_CR, which takes points of the reference into the cloud's frame; what an
object looks the same under cannot be seen and is left as it is. Lengths in metres.

Examples:
  catchingbot register --cloud seen.ply --reference thing.obj
  catchingbot register --cloud seen.ply --reference banana")]
pub struct RegisterArguments {
    /// Cloud in which the object is looked for: .ply, .pcd or .xyz
    #[arg(long, value_name = "FILE")]
    cloud: PathBuf,
    /// What the object looks like: a cloud, an .obj or .stl mesh, or an object as `catch --object` takes it
    #[arg(long, value_name = "NAME|FILE")]
    reference: PathBuf,
    /// How far off the cloud's points are, as a standard deviation
    #[arg(long, value_name = "M", default_value_t = 0.0, allow_negative_numbers = true)]
    noise: f64,
    /// Print one JSON document
    #[arg(long)]
    json: bool,
}

#[derive(Serialize)]
struct PoseDocument {
    translation_m: [f64; 3],
    rotation_xyzw: [f64; 4],
}

#[derive(Serialize)]
#[allow(non_snake_case)]
struct Document {
    version: &'static str,
    /// `registered`, `degenerate` where the cloud leaves a direction of the pose open, or what was missing.
    status: serde_json::Value,
    X_CR: Option<PoseDocument>,
    /// Inverse covariance of (rotation vector, position) in the cloud's axes.
    information: Option<[[f64; 6]; 6]>,
    residual_m: Option<f64>,
    points: usize,
    symmetry: &'static str,
}

/// Registers a cloud.
///
/// # Errors
/// Files that cannot be read or hold no surface.
pub fn run(arguments: &RegisterArguments) -> anyhow::Result<()> {
    let noise_m = quantity::ERROR_M.check(COMMAND_LINE, "--noise", arguments.noise)?;
    let cloud = cloud_file::read(&arguments.cloud, false)?;
    let config = Config::default();
    let reference = reference_model(&arguments.reference, &config)?;
    let found = register_cloud(&cloud.points, noise_m, &reference, None, &config);
    let is_determined = |it: &Fit| worst_sd_m(&it.information, &reference) <= MOST_SD * reference.radius_m;
    let is_degenerate = found.as_ref().is_ok_and(|it| !is_determined(it));
    let symmetry = match reference.symmetry {
        Symmetry::Finite { group, .. } => match group.order() {
            1 => "none",
            2 => "half_turn",
            _ => "finite",
        },
        Symmetry::Axis { .. } => "axis",
        Symmetry::Sphere => "sphere",
    };
    let X_CR =
        found.as_ref().ok().filter(|_| !is_degenerate).map(|fit| fit.X_WO).map(|X_CO| X_CO * reference.X_RO.inverse());
    let document = Document {
        version: VERSION,
        status: match &found {
            Ok(_) if is_degenerate => "degenerate".into(),
            Ok(_) => "registered".into(),
            Err(status) => serde_json::to_value(status)?,
        },
        X_CR: X_CR.map(|it| PoseDocument {
            translation_m: it.translation.vector.into(),
            rotation_xyzw: it.rotation.coords.into(),
        }),
        information: found.as_ref().ok().map(|pose| rows(&pose.information)),
        residual_m: found.as_ref().ok().map(|pose| pose.residual_m),
        points: cloud.points.len(),
        symmetry,
    };
    if arguments.json {
        return screen::json(&document);
    }
    screen::fact("status", document.status.as_str().unwrap_or_default())?;
    screen::fact("points", &document.points.to_string())?;
    screen::fact("symmetry of the object", symmetry)?;
    if is_degenerate {
        let why = "the points agree with many poses: a plane, a line or a point alone shows too little";
        screen::fact("why", why)?;
    }
    if document.X_CR.is_none() {
        screen::fact(
            "what may help",
            "lengths in metres? a cloud of the object alone? more of it? --noise, if its points are off",
        )?;
    }
    if let (Some(pose), Some(residual_m)) = (&document.X_CR, document.residual_m) {
        let [x, y, z] = pose.translation_m;
        screen::fact("translation of X_CR", &format!("{x:.5} {y:.5} {z:.5} m"))?;
        let [x, y, z, w] = pose.rotation_xyzw;
        screen::fact("rotation of X_CR, xyzw", &format!("{x:.6} {y:.6} {z:.6} {w:.6}"))?;
        screen::fact("residual", &format!("{:.2} mm", residual_m * 1e3))?;
    }
    Ok(())
}

/// The surface of a reference: that of an object, about its centre of mass, or of a cloud or mesh.
fn scan_of(path: &Path) -> Result<CloudFile, InputError> {
    let is_object = path.extension().is_none_or(|it| it == "toml");
    if !is_object {
        return cloud_file::read(path, true);
    }
    let nowhere = Origin::BuiltIn(PathBuf::new());
    let asset = Asset::find(Kind::Object, &path.to_string_lossy(), &nowhere, (COMMAND_LINE, "--reference"))?;
    Ok(cloud_file::on_surface(&asset.thrown_object()?.mesh))
}

/// The object as its reference shows it.
fn reference_model(path: &Path, config: &Config) -> anyhow::Result<ReferenceModel> {
    let scan = scan_of(path)?;
    let file = path.display().to_string();
    let too_few =
        |count: usize| InputError::new(&file, "points", format!("{count} points"), "a surface of a hundred or more");
    let Some(&first) = scan.points.first().filter(|_| scan.points.len() >= LEAST_POINTS) else {
        return Err(too_few(scan.points.len()).into());
    };
    let (low, high) = scan.points.iter().fold((first, first), |(low, high), it| (low.inf(it), high.sup(it)));
    check_length(&file, "points", (high - low).amax(), "lengths are in metres")?;
    let middle = scan.points.iter().map(|point| point.coords).sum::<Vector3<f64>>() / scan.points.len() as f64;
    let outwards = scan.normals.unwrap_or_else(|| scan.points.iter().map(|point| point.coords - middle).collect());
    // Denser than the models of the brain helps nobody.
    let step = scan.points.len().div_ceil(MOST_POINTS).max(1);
    let points: Vec<Point3<f64>> = scan.points.into_iter().step_by(step).collect();
    let outwards: Vec<Vector3<f64>> = outwards.into_iter().step_by(step).collect();
    let reference = ReferenceModel::from_points(&points, &outwards, config);
    if reference.points.is_empty() || !reference.radius_m.is_finite() {
        return Err(too_few(points.len()).into());
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

/// A symmetric matrix row by row.
pub fn rows(matrix: &Matrix6<f64>) -> [[f64; 6]; 6] {
    std::array::from_fn(|i| std::array::from_fn(|j| matrix[(i, j)]))
}
