//! Rooms that nobody told the brain of: what stands still in them is background, and whoever is in them no
//! object.

use catch_bot::Status;
use catch_cell::{Brain, Cell, Observation};
use catch_lab::scenario::setup::{Choice, Setup};
use catch_sim::{Arena, Release};

/// A room seen by near cameras whose poses are known.
fn setup(settings: &[&str]) -> Setup {
    let own = [
        "room=office",
        "camera=d435",
        "flight_rig=d435_lab",
        "arena.depth.model=near_stereo",
        "arena.floor_visible=true",
        "brain.perception.floor_visible=true",
    ];
    let settings: Vec<String> = own.iter().chain(settings).map(|&it| it.to_owned()).collect();
    Setup::load(&Choice { settings: &settings, throw: Some("by_hand"), ..Choice::default() }).unwrap()
}

/// The statuses of a brain while nothing flies, and whether the arm moved.
fn quiet(setup: &Setup) -> (Vec<Status>, bool) {
    let waiting = (&setup.robot.ready_q, setup.waiting_width_m());
    let mut arena = Arena::new(setup.equipment(), &Release::out_of_sight(), waiting, 3, 0);
    arena.show_before(setup.scenario.brain.perception.background_images);
    let mut brain = setup.brain(3, 0);
    let (mut statuses, mut moved) = (Vec::new(), false);
    for _ in 0..30 {
        let Ok(observation) = arena.sense();
        let command = brain.tick(&observation, &mut ());
        moved |= command.arm.is_some();
        statuses.push(brain.report().status);
        let Ok(()) = arena.act(&command);
    }
    (statuses, moved)
}

#[test]
fn furniture_is_an_object_only_to_who_has_not_seen_it_before() {
    const LEARNS: &str = "brain.perception.background_images=10";
    let (statuses, moved) = quiet(&setup(&[LEARNS]));
    assert!(!moved && statuses.iter().all(|it| *it == Status::NoObject), "{statuses:?}");
    let (statuses, _) = quiet(&setup(&[]));
    assert!(statuses.iter().any(|it| *it != Status::NoObject), "{statuses:?}");
    let (statuses, moved) = quiet(&setup(&[LEARNS, "arena.person={ nearest_m = 2.5, speed_mps = 1.0 }"]));
    assert!(!moved, "nobody threw anything: {statuses:?}");
}

/// The first observation has images from before the throw, without the thrower; the others are as ever.
#[test]
fn cameras_look_before_the_throw() {
    let images = |settings: &[&str]| -> Observation {
        let Ok(first) = setup(settings).arena(3, 0).sense();
        first
    };
    let with =
        images(&["brain.perception.background_images=4", "arena.thrower=true", "arena.depth.lost_frame_fraction=0"]);
    let without = images(&["arena.depth.lost_frame_fraction=0"]);
    let (before, now): (Vec<_>, Vec<_>) = with.frames.iter().partition(|it| it.capture_s < 0.0);
    assert_eq!((before.len(), now.len(), without.frames.len()), (8, without.frames.len(), without.frames.len()));
    assert!(with.frames.is_sorted_by_key(|it| it.capture_s));
}
