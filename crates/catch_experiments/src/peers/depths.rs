//! Depth images of a throw's first instant.

use std::path::Path;

use anyhow::{Context, Result};
use catch_cell::Cell;
use catch_lab::scenario::setup::{Choice, Setup};
use catch_view::export::mjcf;
use serde_json::{Value, json};

use super::{REPETITIONS, rows};
use crate::{Options, spread::cpu_ms};

/// Cameras: the scenario's own, and near ones.
const RIGS: [&str; 2] = ["", "flight_rig=\"d435_lab\""];

/// Whole images of the scenario paper, and the scenes for another engine.
pub fn problems(options: &Options, folder: &Path) -> Result<Value> {
    let scenes =
        RIGS.into_iter().enumerate().map(|(i, rig)| scene(options, rig, &folder.join(format!("scene{i}.xml"))));
    Ok(scenes.collect::<Result<Vec<_>>>()?.into())
}

fn scene(options: &Options, rig: &str, file: &Path) -> Result<Value> {
    let settings = ["arena.labels=false", rig].map(str::to_owned);
    let settings = &settings[..1 + usize::from(!rig.is_empty())];
    let setup = Setup::load(&Choice { scenario: Some("paper"), settings, ..Choice::default() })?;
    let shots = (0..REPETITIONS).map(|_| {
        let mut arena = setup.arena(options.seed, 0);
        let before_ms = cpu_ms();
        let Ok(observation) = arena.sense();
        ((cpu_ms() - before_ms) * 1e-3, observation.frames)
    });
    let (time_s, frames) = shots.min_by(|a, b| a.0.total_cmp(&b.0)).context("no image was taken")?;
    std::fs::write(file, mjcf::scene(&setup, options.seed, 0))?;
    let depths = file.with_extension("f32");
    let bytes = frames.iter().flat_map(|frame| frame.depth_m.iter().flat_map(|it| it.to_le_bytes()));
    std::fs::write(&depths, bytes.collect::<Vec<u8>>())?;
    let cameras = frames.iter().map(|frame| {
        let camera = &setup.cameras[frame.camera];
        let size = [camera.width_px, camera.height_px];
        json!({"X_WC": rows(&camera.X_WC), "size_px": size, "focal_px": camera.focal_px, "principal_px": camera.principal_px})
    });
    Ok(json!({"scene": file, "depths": depths, "time_s": time_s, "cameras": cameras.collect::<Vec<_>>()}))
}
