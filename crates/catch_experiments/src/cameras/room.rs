//! A room with people in it: what that costs, and how often the arm starts for nothing.

use anyhow::Result;
use catch_body::statistics::paired95;
use catch_cell::{Brain, Cell};
use catch_lab::{
    assets::Kind,
    parallel, referee,
    scenario::setup::{Choice, Setup},
    trial,
};
use catch_sim::{Arena, Release};

use crate::{
    Options, kept,
    results::{Entry, Table},
    spread::rate,
};

pub const LEGEND: &str = "\n\nThe scenario `room` is `lab` among walls, furniture, a person who walks by and the person who throws, which the cameras see and the brain is not told. \
Throws are the same in both. Where nothing flies the person walks, and each motion of the arm is a false start.";

/// Images of a scene in which nothing flies are those of so many seconds.
const QUIET_S: f64 = 2.0;
/// Throws of an object per trial of the page: a room takes ten times as long as none. Scenes in which nothing
/// flies.
const PER_TRIAL: [f64; 2] = [0.1, 0.1];

fn setup(scenario: &str, object: &str) -> Result<Setup> {
    let setup = Setup::load(&Choice { scenario: Some(scenario), object: Some(object), ..Choice::default() })?;
    setup.prepare();
    Ok(setup)
}

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
    let [lab, room] = ["lab", "room"].map(|scenario| setup(scenario, object));
    let (lab, room) = (lab?, room?);
    let caught = |setup: &Setup| {
        parallel::map(throws, |index| {
            let (seed, index) = (options.seed, index as u64);
            let trial = trial::run_unobserved(&mut setup.brain(seed, index), setup, seed, index);
            referee::judge(setup, &trial).caught
        })
    };
    let pairs: Vec<(bool, bool)> = caught(&lab).into_iter().zip(caught(&room)).collect();
    let count = |those: &dyn Fn(&(bool, bool)) -> bool| pairs.iter().filter(|it| those(it)).count();
    let (gained, lost) = (count(&|it| !it.0 && it.1), count(&|it| it.0 && !it.1));
    let [from, to] = paired95(gained, lost, pairs.len());
    let difference = (gained as f64 - lost as f64) / pairs.len().max(1) as f64;
    let in_room = vec![
        Entry::text(object),
        Entry::Count(pairs.len()),
        rate(count(&|it| it.0), pairs.len()),
        rate(count(&|it| it.1), pairs.len()),
        Entry::Spread([difference, from, to].map(|it| 100.0 * it).into()),
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
