//! A room with people in it: what that costs, and how often the arm starts for nothing.

use anyhow::Result;
use catch_cell::{Brain, Cell};
use catch_lab::{assets::Kind, parallel, scenario::setup::Setup};
use catch_sim::{Arena, Release};

use crate::{
    Options, kept,
    rates::{self, judged},
    results::{Entry, Table},
    spread::{gained, rate},
};

/// Images of a scene in which nothing flies are those of so many seconds.
const QUIET_S: f64 = 2.0;
/// Throws of an object per trial of the page, and scenes in which nothing flies: a room takes several times
/// as long as none.
const PER_TRIAL: [f64; 2] = [0.5, 0.25];

/// Images in which nothing flies, and whether the arm moved.
fn quiet(setup: &Setup, seed: u64, index: u64) -> (usize, bool) {
    let waiting = (&setup.robot.ready_q, setup.waiting_width_m());
    let mut arena = Arena::new(setup.equipment(), &Release::out_of_sight(), waiting, seed, index);
    arena.show_before(setup.scenario.brain.perception.background_images);
    let (mut brain, mut images) = (setup.brain(seed, index), 0);
    loop {
        let Ok(observation) = arena.sense();
        images += observation.frames.len();
        let command = brain.tick(&observation, &mut ());
        if command.arm.is_some() || observation.time_s > QUIET_S {
            return (images, command.arm.is_some());
        }
        let Ok(()) = arena.act(&command);
    }
}

/// Throws in the room and without it, and false starts.
pub fn tables(options: &Options) -> Result<Vec<Table>> {
    let columns = ["object", "throws", "lab, %", "room, %", "difference, points"];
    let mut rates = Table::new("A room with people", &columns);
    let mut starts = Table::new("Nothing in flight in the room", &["object", "scenes", "images", "false starts"]);
    let [throws, scenes] = PER_TRIAL.map(|it| (it * options.trials as f64).ceil() as usize);
    for object in Kind::Object.names() {
        let name = format!("{object}-{}-{throws}-{scenes}", options.seed);
        let [in_room, quiet] = kept::part("room", &name, || of_object(object, options, [throws, scenes]))?;
        rates.rows.push(in_room);
        starts.rows.push(quiet);
    }
    Ok(vec![rates, starts])
}

/// The rows of an object: its throws in both, and scenes in which nothing flies.
fn of_object(object: &str, options: &Options, [throws, scenes]: [usize; 2]) -> Result<[Vec<Entry>; 2]> {
    let (lab, room) = (rates::setup("lab", object)?, rates::setup("room", object)?);
    let caught = |setup: &Setup| judged(setup, options.seed, 0..throws as u64, |_, verdict| verdict.caught);
    let pairs: Vec<(bool, bool)> = caught(&lab).into_iter().zip(caught(&room)).collect();
    let in_room = vec![
        Entry::text(object),
        Entry::Count(pairs.len()),
        rate(pairs.iter().filter(|it| it.0).count(), pairs.len()),
        rate(pairs.iter().filter(|it| it.1).count(), pairs.len()),
        Entry::Spread(gained(&pairs).into()),
    ];
    let quiet = parallel::map(scenes, |index| quiet(&room, options.seed, index as u64));
    let starts = vec![
        Entry::text(object),
        Entry::Count(scenes),
        Entry::Count(quiet.iter().map(|it| it.0).sum()),
        Entry::Count(quiet.iter().filter(|it| it.1).count()),
    ];
    Ok([in_room, starts])
}
