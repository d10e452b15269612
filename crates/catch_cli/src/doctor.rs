//! `catchingbot doctor`: the links of a real cell as its driver measures them, and what the arena catches
//! with such links.

use std::{
    collections::BTreeMap,
    fs,
    path::{Path, PathBuf},
};

use anyhow::Context;
use catch_body::{InputError, statistics::wilson95};
use catch_lab::{
    evaluation::{Cell, Evaluation},
    parallel,
    scenario::setup::Setup,
};
use catch_sim::depth_noise::{DepthModel, StereoNoise};
use clap::Args;
use serde::Deserialize;
use serde_json::{Value, json};

use crate::{
    drive::{self, DriveArguments},
    screen, whole,
};

/// File in the folder for results in which a driver leaves its findings.
const FINDINGS: &str = "doctor.json";

/// Arguments of `doctor`.
#[derive(Debug, Args)]
pub struct DoctorArguments {
    /// The cell's file: `catchingbot new cell` writes one
    #[arg(value_name = "CELL.toml")]
    cell: PathBuf,
    /// Folder for what the driver is told, and for its findings
    #[arg(long, value_name = "DIR", default_value = "out")]
    out: PathBuf,
    /// Throws of each prediction
    #[arg(long, value_name = "N", default_value_t = 50, value_parser = whole(1, 10_000))]
    trials: u64,
}

/// The part of a driver's findings that the arena can have, too.
#[derive(Debug, Deserialize)]
struct Findings {
    /// Fraction of the acceleration limit that plans may use; null: nothing may move.
    acceleration_ratio: Option<f64>,
    /// Images of each camera.
    images: BTreeMap<usize, Images>,
}

#[derive(Debug, Deserialize)]
struct Images {
    rate_hz: f64,
    latency_s: f64,
    lost: u32,
    frames: u32,
    noise: Option<Noise>,
}

#[derive(Debug, Clone, Copy, Deserialize)]
struct Noise {
    inverse_depth_sd_per_m: f64,
    common_fraction: f64,
    dropout_fraction: f64,
}

/// Lets the driver measure its links, and the arena throw with what it found.
///
/// # Errors
/// A fault in the cell's file; a driver that is missing, fails, or leaves no findings.
pub fn run(DoctorArguments { cell, out, trials }: &DoctorArguments, json: bool) -> anyhow::Result<()> {
    let (links, _) = drive::setup(cell, &[])?;
    drive::program(cell, &links)?;
    let file = out.join(FINDINGS);
    if file.exists() {
        fs::remove_file(&file).with_context(|| file.display().to_string())?;
    }
    let (cell, out) = (cell.clone(), out.clone());
    let driving = DriveArguments { cell, out, dry_run: false, watch: false };
    drive::start("doctor", &driving, json)?;
    let text = fs::read_to_string(&file).with_context(|| format!("the findings of the driver: {}", file.display()))?;
    let found: Findings = serde_json::from_str(&text).with_context(|| file.display().to_string())?;
    let no_prediction = match found.acceleration_ratio {
        None => Some("over this link nothing may move"),
        Some(_) if found.images.is_empty() => Some("no camera sent images"),
        Some(_) => None,
    };
    let mut speeds = vec![links.speed_scaling, 1.0];
    speeds.dedup();
    let mut predictions = Vec::new();
    for speed_scaling in speeds.into_iter().filter(|_| no_prediction.is_none()) {
        let ratio = found.acceleration_ratio.unwrap_or(1.0);
        let caught = predicted(&driving.cell, &found, [speed_scaling, ratio], *trials)?;
        predictions.push((speed_scaling, caught, wilson95(caught, *trials as usize)));
    }
    if json {
        let predictions = predictions.iter().map(|(speed_scaling, caught, rate_95)| {
            json!({ "speed_scaling": speed_scaling, "caught": caught, "trials": trials, "rate_95": rate_95 })
        });
        return screen::document(&json!({
            "findings": serde_json::from_str::<Value>(&text)?,
            "predictions": predictions.collect::<Value>(),
            "no_prediction": no_prediction,
        }));
    }
    if let Some(reason) = no_prediction {
        screen::line(&format!("no prediction: {reason}"))?;
    }
    for (speed_scaling, caught, rate_95) in predictions {
        let [low, high] = rate_95.map(|it| it * 100.0);
        screen::line(&format!(
            "with these figures and speed_scaling = {speed_scaling} the arena catches {caught} of {trials} throws ({low:.0} to {high:.0} %)"
        ))?;
    }
    Ok(())
}

/// Number of the arena's catches with a cell's findings, at a fraction of the arm's limits.
fn predicted(
    path: &Path,
    found: &Findings,
    [speed, acceleration_ratio]: [f64; 2],
    trials: u64,
) -> Result<usize, InputError> {
    let (_, plain) = drive::setup(path, &[])?;
    let (_, mut setup) = drive::setup(path, &settings(&plain, found, speed, acceleration_ratio))?;
    if plain.scenario.arena.free_running_cameras {
        for (i, camera) in setup.cameras.iter_mut().enumerate() {
            camera.rate_hz = found.images.get(&i).map(|it| it.rate_hz).or(camera.rate_hz);
        }
    }
    setup.scenario.arena.depth.model = noise(&plain, found);
    let evaluation = Evaluation { cells: vec![Cell::new(setup)], seed: 1, first: 0, trials };
    let bar = screen::progress_bar(evaluation.total(), "throws");
    let mut caught = 0;
    evaluation.run(0, parallel::threads(), &mut |row, _| {
        caught += usize::from(row.verdict.caught);
        bar.inc(1);
        Ok(())
    })?;
    bar.finish_and_clear();
    Ok(caught)
}

/// Settings of the scenario that are figures of the links.
fn settings(plain: &Setup, found: &Findings, speed: f64, acceleration_ratio: f64) -> Vec<String> {
    let images = || found.images.values();
    let latency_s = mean(images().map(|it| it.latency_s));
    let lost: u32 = images().map(|it| it.lost).sum();
    let lost_fraction = f64::from(lost) / f64::from(lost + images().map(|it| it.frames).sum::<u32>());
    let mut settings = vec![
        format!("limit_scale.velocity={speed}"),
        format!("limit_scale.jerk={speed}"),
        format!("limit_scale.acceleration={}", speed.min(acceleration_ratio)),
        format!("arena.latency_s={}", latency_s.max(0.0)),
        format!("arena.depth.lost_frame_fraction={lost_fraction}"),
    ];
    if !plain.scenario.arena.free_running_cameras {
        let step_s = plain.scenario.arena.step_s;
        let steps = (1.0 / mean(images().map(|it| it.rate_hz)) / step_s).round().max(1.0);
        settings.push(format!("arena.frame_rate_hz={}", 1.0 / (steps * step_s)));
    }
    settings
}

/// The scenario's depth errors with the measured ones, the mean over the cameras that saw anything.
fn noise(plain: &Setup, found: &Findings) -> DepthModel {
    let expected = match &plain.scenario.arena.depth.model {
        DepthModel::Stereo(stereo) => stereo.clone(),
        _ => StereoNoise::default(),
    };
    let seen: Vec<(f64, Noise)> = found
        .images
        .iter()
        .filter_map(|(camera, it)| Some((plain.cameras.get(*camera)?.focal_px, it.noise?)))
        .collect();
    if seen.is_empty() {
        return plain.scenario.arena.depth.model.clone();
    }
    DepthModel::Stereo(StereoNoise {
        // The error of the disparity is that of the inverse depth times focal length and baseline.
        subpixel_px: mean(seen.iter().map(|(focal_px, it)| it.inverse_depth_sd_per_m * focal_px * expected.baseline_m)),
        common_fraction: mean(seen.iter().map(|(_, it)| it.common_fraction)),
        dropout_fraction: mean(seen.iter().map(|(_, it)| it.dropout_fraction)),
        ..expected
    })
}

fn mean(values: impl Iterator<Item = f64> + Clone) -> f64 {
    values.clone().sum::<f64>() / values.count() as f64
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Findings of two cameras as a driver writes them.
    const FOUND: &str = r#"{"states": 10000, "acceleration_ratio": 0.85, "images": {
        "0": {"rate_hz": 60.0, "frames": 900, "latency_s": 0.02, "lost": 100, "late": 1, "silent": 0,
              "noise": {"inverse_depth_sd_per_m": 0.004, "common_fraction": 0.4, "dropout_fraction": 0.1}},
        "1": {"rate_hz": 60.0, "frames": 900, "latency_s": 0.03, "lost": 100, "late": 0, "silent": 0, "noise": null}}}"#;

    #[test]
    fn the_arena_gets_what_was_found() {
        let folder = tempfile::tempdir().unwrap();
        let cell = folder.path().join("cell.toml");
        fs::write(&cell, include_str!("new_cell.toml")).unwrap();
        let found: Findings = serde_json::from_str(FOUND).unwrap();
        let (_, plain) = drive::setup(&cell, &[]).unwrap();
        let asked = settings(&plain, &found, 1.0, 0.85);
        let (_, setup) = drive::setup(&cell, &asked).unwrap();
        assert_eq!(setup.scenario.limit_scale.acceleration, 0.85);
        assert!((setup.scenario.arena.latency_s.bounds()[0] - 0.025).abs() < 1e-12);
        assert!((setup.scenario.arena.depth.lost_frame_fraction - 0.1).abs() < 1e-12);
        let DepthModel::Stereo(stereo) = noise(&plain, &found) else { panic!("no stereo") };
        assert!((stereo.subpixel_px - 0.004 * 433.0 * stereo.baseline_m).abs() < 1e-12);
        assert_eq!((stereo.common_fraction, stereo.dropout_fraction), (0.4, 0.1));
        assert!(stereo.flying_fraction > 0.0, "what was not measured stays");
    }
}
