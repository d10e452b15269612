//! Growth of the brain's and the arena's cost with cameras and their pixels.

use anyhow::Result;
use catch_cell::Brain;
use catch_lab::{assets::Kind, scenario::setup::Setup};

use crate::{
    Options,
    cameras::{self, rigs},
    perception::look,
    results::{Entry, Table},
    spread::{cpu_ms, quantiles},
};

/// Factors on the width and height of the images of the largest rig.
const SCALES: [f64; 2] = [0.5, 2.0];
/// Throws of a condition.
const THROWS: u64 = 20;

/// Ticks with images in the first 200 ms of throws, by the number of cameras and by the size of their images.
pub fn table(options: &Options) -> Result<Table> {
    let columns = ["cameras", "image", "10⁶ pixels", "ticks", "tick, median ms", "tick, 99 %, ms", "arena, ms a throw"];
    let mut table = Table::new("Growth with cameras and pixels: near cameras without labels in `honest`", &columns);
    let rigs: Vec<String> = rigs().collect();
    let scaled = SCALES.iter().flat_map(|&scale| rigs.last().map(|rig| (rig, scale)));
    for (rig, scale) in rigs.iter().map(|rig| (rig, 1.0)).chain(scaled) {
        let object = Kind::Object.names()[0];
        let mut setup = cameras::setup(rig, object)?;
        for camera in &mut setup.cameras {
            [camera.width_px, camera.height_px] =
                [camera.width_px, camera.height_px].map(|it| (f64::from(it) * scale) as u32);
            camera.focal_px *= scale;
            camera.principal_px = camera.principal_px.map(|it| it * scale);
        }
        table.rows.push(row(&setup, options.seed));
    }
    Ok(table)
}

fn row(setup: &Setup, seed: u64) -> Vec<Entry> {
    let (mut ticks_ms, mut arena_ms) = (Vec::new(), 0.0);
    for index in 0..THROWS {
        let (began_ms, mut brain_ms) = (cpu_ms(), 0.0);
        look(setup, seed, index, &mut |brain, observation| {
            let before_ms = cpu_ms();
            let command = brain.tick(observation, &mut ());
            let tick_ms = cpu_ms() - before_ms;
            brain_ms += tick_ms;
            if !observation.frames.is_empty() {
                ticks_ms.push(tick_ms);
            }
            command
        });
        arena_ms += (cpu_ms() - began_ms - brain_ms) / THROWS as f64;
    }
    let [width, height] = setup.cameras.first().map_or([0; 2], |it| [it.width_px, it.height_px]);
    let pixels: u32 = setup.cameras.iter().map(|it| it.width_px * it.height_px).sum();
    let labels = [
        Entry::Count(setup.cameras.len()),
        Entry::text(format!("{width}×{height}")),
        Entry::Number(Some(f64::from(pixels) * 1e-6)),
        Entry::Count(ticks_ms.len()),
    ];
    let times = quantiles(&ticks_ms, [0.5, 0.99], 1.0);
    labels.into_iter().chain(times).chain([Entry::Number(Some(arena_ms))]).collect()
}
