//! Registration of the visible part of an object on its whole surface, from starts that are off.

use std::path::Path;

use anyhow::{Context, Result};
use catch_body::Pose;
use catch_bot::perception::{Config, ReferenceModel, Registration};
use catch_import::{cloud_file::CloudFile, cloud_registration};
use catch_lab::assets::Kind;
use catch_sim::random_streams::{Draws, Stream};
use nalgebra::{Point3, Vector3};
use serde_json::{Value, json};

use super::{measured, rows};
use crate::Options;

/// Points of a cloud, and the standard deviation of each along every axis.
const POINTS: usize = 400;
const NOISE_M: f64 = 0.001;
/// Points of an object's surface that everybody is given at most.
const SURFACE_POINTS: usize = 20_000;
/// Errors of the starts: distance in metres and angle in radians.
const STARTS: [(f64, f64); 2] = [(0.005, 0.1), (0.02, 0.5)];

/// Clouds of each built-in object, with both errors of the start.
pub fn problems(options: &Options, _: &Path) -> Result<Value> {
    let mut objects = Vec::new();
    for object in Kind::Object.names() {
        let mut scan = cloud_registration::scan_of(Path::new(object), ("experiment", "object"))?;
        let step = scan.points.len().div_ceil(SURFACE_POINTS);
        scan.points = scan.points.into_iter().step_by(step).collect();
        scan.normals = scan.normals.map(|it| it.into_iter().step_by(step).collect());
        let reference = cloud_registration::reference_model(scan.clone(), object)?;
        let mut cases = Vec::new();
        for index in 0..options.trials {
            for (start, error) in STARTS.into_iter().enumerate() {
                let mut draws = Draws::new(Stream::Sensors, options.seed, index);
                let case = case(&scan, &reference, error, &mut draws).context("a surface without normals")?;
                cases.push(json!({"start": start, "case": case}));
            }
        }
        let points: Vec<[f64; 3]> = scan.points.iter().map(|it| it.coords.into()).collect();
        let normals: Vec<[f64; 3]> = scan.normals.iter().flatten().map(|&it| it.into()).collect();
        objects.push(json!({"name": object, "points": points, "normals": normals, "cases": cases}));
    }
    let starts = STARTS.map(|(distance_m, angle_rad)| json!({"distance_m": distance_m, "angle_rad": angle_rad}));
    Ok(json!({"objects": objects, "starts": starts, "noise_m": NOISE_M}))
}

/// One cloud, its start and our pose.
fn case(scan: &CloudFile, reference: &ReferenceModel, error: (f64, f64), draws: &mut Draws) -> Option<Value> {
    let mut direction = || Vector3::from_fn(|_, _| draws.normal()).normalize();
    let (place, axis, shift, twist) = (direction(), direction(), direction(), direction());
    let X_CR = Pose::new(place, axis * draws.between([0.0, 3.0]));
    let middle = Pose::translation(place.x, place.y, place.z);
    let X_start = middle * Pose::new(shift * error.0, twist * error.1) * middle.inverse() * X_CR;
    let towards = X_CR.rotation.inverse() * -place;
    let seen: Vec<&Point3<f64>> =
        scan.points.iter().zip(scan.normals.as_ref()?).filter(|it| it.1.dot(&towards) > 0.2).map(|it| it.0).collect();
    let mut noise = || Vector3::from_fn(|_, _| NOISE_M * draws.normal());
    let step = seen.len().div_ceil(POINTS).max(1);
    let cloud: Vec<Point3<f64>> = seen.into_iter().step_by(step).map(|p_R| X_CR * p_R + noise()).collect();
    let config = Config::default();
    let registration = Registration { model_sd_m: NOISE_M, ..Registration::new(reference, &config) };
    let mut scene = cloud_registration::scene(cloud.iter());
    let start = X_start * reference.X_RO;
    let (fit, time_s) = measured(|| registration.register(&mut scene, &start, false));
    Some(json!({
        "cloud": cloud.iter().map(|it| <[f64; 3]>::from(it.coords)).collect::<Vec<_>>(),
        "X_start": rows(&X_start),
        "X_CR": rows(&X_CR),
        "ours": fit.ok().map(|fit| rows(&(fit.X_WO * reference.X_RO.inverse()))),
        "time_s": time_s,
    }))
}
