//! Physics of a throw that no brain answers.

use std::path::Path;

use anyhow::Result;
use catch_cell::{Cell, Command, PixelWindow};
use catch_lab::scenario::setup::{Choice, Setup};
use catch_sim::{Arena, Truth};
use catch_view::export::mjcf;
use serde_json::{Value, json};

use super::{REPETITIONS, values};
use crate::{Options, spread::cpu_ms};

/// Duration of the throw, in seconds.
const UNTIL_S: f64 = 1.0;
/// Time of flight at which positions are compared, in seconds.
const COMPARED_S: f64 = 0.4;

/// The throw of the scenario paper, without an image.
pub fn problems(options: &Options, folder: &Path) -> Result<Value> {
    let setup = Setup::load(&Choice { scenario: Some("paper"), ..Choice::default() })?;
    let scene = folder.join("scene.xml");
    std::fs::write(&scene, mjcf::scene(&setup, options.seed, 0))?;
    let blind = Command { windows: Some(vec![PixelWindow::default(); setup.cameras.len()]), ..Command::default() };
    let (mut truth, mut least_s) = (Truth::default(), f64::INFINITY);
    for _ in 0..REPETITIONS {
        let mut arena = setup.arena(options.seed, 0);
        let Ok(_) = arena.sense();
        let before_ms = cpu_ms();
        flown(&mut arena, &blind);
        least_s = least_s.min((cpu_ms() - before_ms) * 1e-3);
        truth = arena.take_truth();
    }
    let compared = truth.samples.iter().find(|sample| sample.time_s >= COMPARED_S - 1e-6);
    let first_contact = truth.samples.iter().find(|sample| sample.contact.any());
    Ok(json!({
        "scene": scene,
        "dof": setup.robot.dof(),
        "q": values(&setup.robot, &setup.robot.ready_q),
        "until_s": UNTIL_S,
        "step_ms": setup.scenario.arena.step_s * 1e3,
        "compared_s": COMPARED_S,
        "p_WO": compared.map(|sample| <[f64; 3]>::from(sample.X_WO.translation.vector)),
        "contact_s": first_contact.map(|sample| sample.time_s),
        "time_s": least_s,
    }))
}

fn flown(arena: &mut Arena, blind: &Command) {
    while arena.time_s() < UNTIL_S - 1e-6 {
        let Ok(()) = arena.act(blind);
        let Ok(_) = arena.sense();
    }
}
