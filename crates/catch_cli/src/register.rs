//! `catchingbot register`: the pose of one cloud against another.

use std::path::PathBuf;

use catch_body::{Pose, quantity};
use catch_import::{
    cloud_file,
    cloud_registration::{self, RegistrationStatus},
};
use catch_recording::{name_of, whole_file::COMMAND_LINE};
use clap::Args;
use serde_json::json;

use crate::{number, screen};

/// Registers a point cloud against another, or against a mesh
///
/// The reference should show the object from all sides: a mesh, or a cloud with normals. Normals of a
/// cloud without any are taken to point away from its middle, which is right for objects that bulge
/// everywhere. The result is X_CR, which takes points of the reference into the cloud's frame;
/// rotations that do not change the object's look cannot be seen and are left out. The pose is
/// `registered` only if no other explains the points as well, and if a stated --noise explains how far
/// they are off. Lengths in metres.
///
/// Examples:
///   catchingbot register --cloud seen.ply --reference thing.obj
///   catchingbot register --cloud seen.ply --reference banana
#[derive(Debug, Args)]
#[command(verbatim_doc_comment)]
pub struct RegisterArguments {
    /// Cloud in which the object is looked for: .ply, .pcd or .xyz
    #[arg(long, value_name = "FILE")]
    cloud: PathBuf,
    /// Shape of the object: a cloud, an .obj, .stl or .ply mesh, or an object as `catch --object` takes it
    #[arg(long, value_name = "NAME|FILE")]
    reference: PathBuf,
    /// Standard deviation of the cloud's points; without it any residual counts as noise
    #[arg(long, value_name = "M", default_value_t = 0.0, value_parser = number)]
    noise: f64,
}

/// Registers a cloud.
///
/// # Errors
/// Files that cannot be read or hold no surface.
pub fn run(arguments: &RegisterArguments, json: bool) -> anyhow::Result<()> {
    let noise_m = quantity::ERROR_M.check(COMMAND_LINE, "--noise", arguments.noise)?;
    let cloud = cloud_file::read(&arguments.cloud, false)?;
    let path = &arguments.reference;
    let scan = cloud_registration::scan_of(path, (COMMAND_LINE, "--reference"))?;
    let reference = cloud_registration::reference_model(scan, &path.display().to_string())?;
    let found = cloud_registration::register(&cloud.points, noise_m, &reference);
    if json {
        let pose = |it: &Pose| json!({ "translation_m": it.translation.vector, "rotation_xyzw": it.rotation.coords });
        return screen::document(&json!({
            "status": found.status,
            "X_CR": found.X_CR.as_ref().map(pose),
            "information": found.information.map(|it| <[[f64; 6]; 6]>::from(it.transpose())),
            "residual_m": found.residual_m,
            "points": cloud.points.len(),
            "symmetry": found.symmetry,
        }));
    }
    screen::fact("status", &name_of(found.status))?;
    screen::fact("points", &cloud.points.len().to_string())?;
    screen::fact("symmetry of the object", found.symmetry)?;
    if found.status == RegistrationStatus::Degenerate {
        let why = "the points agree with many poses: a patch of a plane, of a ball or of a can's side shows too little";
        screen::fact("why", why)?;
    }
    if found.status == RegistrationStatus::Implausible {
        let why = "the nearest pose leaves the points farther off than --noise: another object, a mirrored cloud, other units?";
        screen::fact("why", why)?;
    }
    if found.X_CR.is_none() {
        screen::fact(
            "what may help",
            "lengths in metres? a cloud of the object alone? more of it? --noise, if its points are off",
        )?;
    }
    if let (Some(pose), Some(residual_m)) = (found.X_CR, found.residual_m) {
        let [x, y, z]: [f64; 3] = pose.translation.vector.into();
        screen::fact("translation of X_CR", &format!("{x:.5} {y:.5} {z:.5} m"))?;
        let [x, y, z, w]: [f64; 4] = pose.rotation.coords.into();
        screen::fact("rotation of X_CR, xyzw", &format!("{x:.6} {y:.6} {z:.6} {w:.6}"))?;
        screen::fact("residual", &format!("{:.2} mm", residual_m * 1e3))?;
    }
    Ok(())
}
