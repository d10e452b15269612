//! Detection delay of a camera that was pushed, in a life of many throws.

use anyhow::Result;
use catch_bot::perception::CameraStatus;
use catch_lab::{
    assets::Kind,
    parallel,
    play::{Play, PlayRow},
    referee::faulty_cameras::FaultyCamera,
    scenario::setup::Setup,
};
use catch_sim::random_streams::{Draws, Stream};
use serde::{Deserialize, Serialize};

use crate::{
    Options,
    cameras::{rigs, setup},
    kept,
    results::{Entry, Table},
    spread::{median, percent},
};

/// Displacement of a pushed camera, in a random direction.
const PUSHED_M: f64 = 0.02;
/// Time of the push on the cell's clock: after some throws, and far from where a throw begins.
const PUSHED_S: f64 = 9.0;
/// Throws of a life, at least five of them after the push: they are 4 to 10 s apart.
const THROWS: u64 = 8;
/// Throws of a rig with an object for each life.
const TRIALS_PER_LIFE: u64 = 50;

pub const LEGEND: &str = "\n\nThe last table has lives of 8 throws of the three objects in random order. After 9 s one camera, drawn at random, is pushed by 20 mm in a \
random direction; five throws or more follow. The push is *noticed* if the brain says in one of them that this camera is displaced. A camera is *named \
wrongly* in lives in which the brain names another one, or this one before the push.";

/// Result of a life.
#[derive(Serialize, Deserialize)]
struct Pushed {
    /// Number of the throw after the push that noticed it, from 1 on; `None` if none did.
    throw: Option<usize>,
    named_wrongly: bool,
}

/// A life of one camera that is pushed, drawn from a seed.
fn pushed(rig: &str, seed: u64) -> Result<Pushed> {
    let mut draws = Draws::new(Stream::Calibration, seed, 1);
    let by = draws.direction().into_inner() * PUSHED_M;
    let chosen = draws.unit();
    let load = |object: &str| -> Result<(Setup, usize)> {
        let cameras = setup(rig, object, &[])?.cameras.len();
        let camera = ((chosen * cameras as f64) as usize).min(cameras - 1);
        let fault = format!(
            "arena.camera_faults=[{{ camera = {camera}, kind = {{ pushed = {{ by_m = [{}, {}, {}] }} }}, from_s = {PUSHED_S:.1} }}]",
            by.x, by.y, by.z
        );
        Ok((setup(rig, object, &[&fault])?, camera))
    };
    let setups = Kind::Object.names().into_iter().map(load).collect::<Result<Vec<_>>>()?;
    let camera = setups[0].1;
    let setups = setups.into_iter().map(|it| it.0).collect();
    let rows = life(setups, seed)?;
    let (before, after): (Vec<_>, Vec<_>) = rows.iter().partition(|row| row.thrown_s < PUSHED_S);
    let is_it = |it: &FaultyCamera| it.camera == camera && it.status == CameraStatus::Displaced;
    // The throw during which it is pushed belongs to neither.
    let quiet = &before[..before.len().saturating_sub(1)];
    let throw = after.iter().position(|row| row.faulty_cameras.iter().any(is_it));
    let wrongly = quiet.iter().any(|row| !row.faulty_cameras.is_empty())
        || before.last().into_iter().chain(&after).any(|row| row.faulty_cameras.iter().any(|it| it.camera != camera));
    Ok(Pushed { throw: throw.map(|it| it + 1), named_wrongly: wrongly })
}

fn life(setups: Vec<Setup>, seed: u64) -> Result<Vec<PlayRow>> {
    Ok(Play { setups, throws: THROWS, every_s: 4.0, seed, folder: None }.run(&mut |_| ())?.rows)
}

/// Rigs of two cameras and more.
pub fn tables(options: &Options) -> Result<Vec<Table>> {
    let columns = ["rig", "lives", "noticed, %", "throws until then, p50", "most", "named wrongly"];
    let mut table = Table::new("Cameras pushed by 20 mm", &columns);
    let count = options.trials.div_ceil(TRIALS_PER_LIFE) as usize;
    for rig in rigs().skip(1) {
        let lives = parallel::map(count, |index| {
            let seed = options.seed + index as u64;
            kept::part("pushed", &format!("{rig}-{seed}"), || pushed(&rig, seed))
        });
        let lives = lives.into_iter().collect::<Result<Vec<_>>>()?;
        let throws: Vec<f64> = lives.iter().filter_map(|it| it.throw.map(|throw| throw as f64)).collect();
        table.rows.push(vec![
            Entry::text(&rig),
            Entry::Count(lives.len()),
            percent(throws.len(), lives.len()),
            median(&throws, 1.0),
            Entry::Number(throws.iter().copied().reduce(f64::max)),
            Entry::Count(lives.iter().filter(|it| it.named_wrongly).count()),
        ]);
    }
    Ok(vec![table])
}
