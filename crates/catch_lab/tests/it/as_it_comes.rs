//! Images in any order and ticks without any, and an arm that refuses what the hand would do.

use std::sync::{
    Arc,
    atomic::{AtomicUsize, Ordering},
};

use catch_bot::{
    CatchingBot,
    control::{CatchPlanner, Decision, Situation, TimeGridSearch},
};
use catch_cell::{Brain, Cell, Command, DepthFrame, Observation, RejectedTrajectory, Rejection};
use catch_lab::scenario::setup::{Choice, Setup};
use proptest::prelude::*;

/// Two cameras that run freely: a tick brings images of several capture times, or none.
fn setup() -> Setup {
    Setup::load(&Choice { scenario: Some("honest"), object: Some("tennis_ball"), ..Choice::default() }).unwrap()
}

const TICKS: usize = 60;

/// Records the observations of a throw while the brain of the scenario catches.
fn sensed(setup: &Setup) -> Vec<Observation> {
    let (mut arena, mut brain) = (setup.arena(3, 1), setup.brain(3, 1));
    let tick = |_| {
        let Ok(observation) = arena.sense();
        let Ok(()) = arena.act(&brain.tick(&observation, &mut ()));
        observation
    };
    (0..TICKS).map(tick).collect()
}

fn answers(brain: &mut dyn Brain, observations: &[Observation]) -> Vec<Command> {
    observations.iter().map(|it| brain.tick(it, &mut ())).collect()
}

/// Moves the frame at each place to that with this number, modulo what is left.
fn permuted(frames: &[DepthFrame], numbers: &[usize]) -> Vec<DepthFrame> {
    let mut left = frames.to_vec();
    (0..frames.len()).map(|i| left.remove(numbers[i % numbers.len()] % left.len())).collect()
}

/// Frames of several ticks in one, as a driver hands them over that looks at its cameras less often.
fn batched(observations: &[Observation]) -> Vec<Observation> {
    let pair = |pair: &[Observation]| {
        let frames = pair.iter().flat_map(|it| it.frames.clone()).collect();
        Observation { frames, ..pair[pair.len() - 1].clone() }
    };
    observations.chunks(2).map(pair).collect()
}

#[test]
fn images_of_a_tick_may_come_in_any_order() {
    let setup = setup();
    let observations = batched(&sensed(&setup));
    let several = observations.iter().filter(|it| it.frames.windows(2).any(|it| it[0].capture_s < it[1].capture_s));
    assert!(several.count() > 10, "too few ticks have images of several times");
    let expected = answers(&mut setup.brain(3, 1), &observations);
    assert!(expected.iter().any(|it| it.arm.is_some()), "nothing was planned");
    let orders = prop::collection::vec(0usize..100, 7);
    proptest!(ProptestConfig { cases: 8, failure_persistence: None, ..ProptestConfig::default() }, |(numbers in orders)| {
        let shuffled: Vec<Observation> = observations
            .iter()
            .map(|it| Observation { frames: permuted(&it.frames, &numbers), ..it.clone() })
            .collect();
        let found = answers(&mut setup.brain(3, 1), &shuffled);
        for (tick, (found, expected)) in found.iter().zip(&expected).enumerate() {
            prop_assert!(found == expected, "another command in tick {tick}");
        }
    });
}

/// Counts how often it is asked.
struct Counting(TimeGridSearch, Arc<AtomicUsize>);

impl CatchPlanner for Counting {
    fn plan(&mut self, situation: &Situation<'_>) -> Decision {
        self.1.fetch_add(1, Ordering::Relaxed);
        self.0.plan(situation)
    }
}

#[test]
fn ticks_without_images_repeat_no_search() {
    let setup = setup();
    let known = setup.known().clone();
    let asked = Arc::new(AtomicUsize::new(0));
    let brain = || {
        asked.store(0, Ordering::Relaxed);
        let (estimator, predictor) = (Box::new(known.pose_estimator()), Box::new(known.flight_predictor(7)));
        let planner = Box::new(Counting(known.catch_planner(), asked.clone()));
        CatchingBot::with_stages(known.clone(), estimator, predictor, planner)
    };
    let observations: Vec<Observation> = sensed(&setup).into_iter().filter(|it| !it.frames.is_empty()).collect();
    let expected = answers(&mut brain(), &observations);
    let asked_with_images = asked.load(Ordering::Relaxed);
    assert!(asked_with_images > 10, "asked {asked_with_images} times");
    // Between two images the arm is read out twice more.
    let more: Vec<Observation> = observations
        .iter()
        .flat_map(|it| {
            let mut again = Observation { frames: Vec::new(), ..it.clone() };
            again.arm.rejected.clear();
            [it.clone(), again.clone(), again]
        })
        .collect();
    let found = answers(&mut brain(), &more);
    assert_eq!(asked.load(Ordering::Relaxed), asked_with_images);
    for (i, three) in found.chunks(3).enumerate() {
        assert!(three[0].arm == expected[i].arm && three[0].gripper == expected[i].gripper, "image {i}");
        assert!(three[1..].iter().all(|it| it.arm.is_none() && it.gripper.is_none()), "after image {i}");
    }
}

/// The arm declines whatever it is sent, the gripper takes all its moves: nothing will be in the hand, which
/// stays open.
#[test]
fn a_hand_does_not_close_for_an_arm_that_refuses() {
    for (object, index) in [("tennis_ball", 0), ("banana", 1), ("pill_bottle", 2)] {
        let choice = Choice { scenario: Some("honest"), object: Some(object), ..Choice::default() };
        let setup = Setup::load(&choice).unwrap();
        let (mut arena, mut brain) = (setup.arena(3, index), setup.brain(3, index));
        let (mut declined, mut closings, mut aperture_m, mut width_m) = (None, 0, f64::INFINITY, 0.0);
        for _ in 0..120 {
            let Ok(mut observation) = arena.sense();
            let reject = |id| RejectedTrajectory { id, reason: Rejection::Declined };
            observation.arm.rejected.extend(declined.take().map(reject));
            let command = brain.tick(&observation, &mut ());
            declined = command.arm.as_ref().map(|it| it.id);
            let widths = || command.gripper.iter().flatten().map(|it| it.width_m);
            closings += usize::from(widths().any(|it| it == 0.0));
            aperture_m = widths().filter(|it| *it > 0.0).fold(aperture_m, f64::min);
            width_m = observation.gripper.width_m;
            let Ok(()) = arena.act(&Command { arm: None, ..command });
        }
        assert!(closings > 0, "{object}: nothing was planned");
        // The drive follows: a finger's set-point and its place differ by less than this.
        assert!(width_m > aperture_m - 0.002, "{object}: the fingers are {width_m} m apart, not {aperture_m} m");
    }
}
