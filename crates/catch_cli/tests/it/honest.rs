//! The honest arena: scenes that depend on their number alone, and an arm that stays safe whatever is thrown.

use std::{fs, path::Path};

use catch_cell::{Brain, Cell as _};
use catch_lab::{
    evaluation::{
        Cell, Evaluation,
        results::{Results, TRIALS_FILE},
    },
    reachability::oracle::Oracle,
    referee,
    scenario::{
        Clock,
        setup::{Choice, Setup},
    },
    trial,
};
use catch_sim::Throw;

fn honest(object: &str) -> Setup {
    Setup::load(&Choice { scenario: Some("honest"), object: Some(object), ..Choice::default() }).unwrap()
}

/// Evaluates the honest scenario into a folder, or goes on there; returns the rows in it.
fn rows(folder: &Path, first: u64, trials: u64, threads: usize) -> String {
    let evaluation = Evaluation { cells: vec![Cell::new(honest("banana"))], seed: 1, first, trials };
    let (mut results, done) = Results::open(folder, &evaluation, folder.exists()).unwrap();
    evaluation.run(done.len(), threads, &mut |row, _| results.add(&row)).unwrap();
    fs::read_to_string(folder.join(TRIALS_FILE)).unwrap()
}

#[test]
fn a_scene_gives_the_same_bytes_alone_in_a_batch_resumed_and_on_any_number_of_threads() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let batch = rows(&at("one"), 0, 4, 1);
    assert_eq!(batch.lines().count(), 4);
    assert_eq!(rows(&at("two"), 0, 4, 2), batch);
    assert_eq!(rows(&at("four"), 0, 4, 4), batch);
    let last = batch.lines().last().unwrap();
    assert_eq!(rows(&at("alone"), 3, 1, 1).trim_end(), last);
    fs::write(at("two").join(TRIALS_FILE), &batch[..batch.len() / 2]).unwrap();
    assert_eq!(rows(&at("two"), 0, 4, 2), batch);
}

/// The arm and what is drawn for it, byte for byte, on this thread and on another at the same time.
#[test]
fn everything_that_truly_happens_is_the_same_again() {
    let setup = honest("tennis_ball");
    let truth = || serde_json::to_vec(&trial::run(&setup, 3, 5, &mut |_, _| Ok(())).unwrap().truth).unwrap();
    let (here, there) = std::thread::scope(|scope| {
        let other = scope.spawn(truth);
        (truth(), other.join().unwrap())
    });
    assert!(here == there);
}

/// Commands that take 10 ms to compute arrive neither early nor late.
#[test]
fn a_clock_that_is_expected_makes_no_command_late() {
    let setup = honest("tennis_ball");
    assert_eq!(setup.scenario.clock, Clock::FixedMs(1e3 * setup.scenario.brain.control.expected_latency_s));
    let mut accepted = 0;
    for index in 0..4 {
        let servo = trial::run(&setup, 1, index, &mut |_, _| Ok(())).unwrap().truth.servo;
        assert_eq!((servo.late_trajectories, servo.rejected_trajectories), (0, 0), "throw {index}");
        accepted += servo.accepted_trajectories;
    }
    assert!(accepted > 0, "nothing was commanded");
    // An arm that expects no latency is late with all that it wants.
    let mut hasty = honest("tennis_ball");
    hasty.scenario.brain.control.expected_latency_s = 0.0;
    let late: u32 = (0..4)
        .map(|index| trial::run(&hasty, 1, index, &mut |_, _| Ok(())).unwrap().truth.servo.late_trajectories)
        .sum();
    assert!(late > 0);
}

/// Throws that pass beyond the arm or too soon for it.
fn unreachable_throws(count: usize) {
    let text = include_str!("../../../../assets/throws/random.toml");
    let wide = text.replace("passage_distance_m = [0.35, 0.85]", "passage_distance_m = [0.35, 1.6]");
    assert_ne!(wide, text);
    let mut tried = 0;
    for object in ["tennis_ball", "banana", "pill_bottle"] {
        let mut setup = Setup::load(&Choice {
            scenario: Some("paper"),
            object: Some(object),
            throw: Some("random"),
            ..Choice::default()
        })
        .unwrap();
        setup.throw = Throw::from_toml("wide.toml", &wide).unwrap();
        let oracle = Oracle::of(&setup);
        let out_of_reach = (0..).filter(|&index| oracle.reach(&setup, 11, index).from_release_s.is_none());
        for index in out_of_reach.take(count.div_ceil(3)) {
            let trial = trial::run(&setup, 11, index, &mut |_, _| Ok(())).unwrap();
            let verdict = referee::judge(&setup, &trial);
            assert!(!verdict.caught, "{object} {index}: the oracle is wrong");
            assert_eq!(verdict.limit_violations, 0, "{object} {index}: {:?}", verdict.first_violation);
            let servo = &trial.truth.servo;
            for clearance in [servo.min_self_clearance_m, servo.min_floor_clearance_m] {
                assert!(clearance.is_some_and(|it| it > 0.0), "{object} {index}: {clearance:?}");
            }
            tried += 1;
        }
    }
    assert!(tried >= count);
}

#[test]
fn a_throw_out_of_reach_breaks_nothing() {
    unreachable_throws(60);
}

/// A thousand of them take minutes.
#[test]
#[ignore = "takes minutes"]
fn a_thousand_throws_out_of_reach_break_nothing() {
    unreachable_throws(1000);
}

/// One command arrives 5 ms late and its trajectory is refused, and so is what goes on from it, until the
/// brain notices what the arm follows.
#[test]
fn a_brain_whose_trajectory_was_refused_goes_on_from_what_the_arm_follows() {
    let setup = Setup::load(&Choice { scenario: Some("paper"), ..Choice::default() }).unwrap();
    let (mut arena, mut brain) = (setup.arena(1, 0), setup.brain(1, 0));
    let mut sent_after = None;
    for _ in 0..60 {
        let Ok(observation) = arena.sense();
        let command = brain.tick(&observation, &mut ());
        let is_late = sent_after.is_none() && observation.time_s > 0.2 && command.arm.is_some();
        if is_late {
            sent_after = Some(0);
        } else if let Some(sent) = &mut sent_after {
            *sent += u32::from(command.arm.is_some());
        }
        arena.act_after(if is_late { 0.005 } else { 0.0 }, &command);
    }
    let (servo, sent_after) = (&arena.truth().servo, sent_after.unwrap());
    assert_eq!(servo.late_trajectories, 1);
    assert!(
        sent_after > 20 && servo.rejected_trajectories <= 2,
        "{} of {sent_after} refused",
        servo.rejected_trajectories
    );
}

/// Counts the changes of the catch in ten throws of tumbling bananas: to one that holds another part of the
/// object, or holds it otherwise.
fn changes_of_catch(switching_hysteresis: f64) -> usize {
    let settings = [format!("brain.control.switching_hysteresis={switching_hysteresis}")];
    let choice = Choice { scenario: Some("honest"), object: Some("banana"), settings: &settings, ..Choice::default() };
    let setup = Setup::load(&choice).unwrap();
    let changes = (0..10).map(|index| {
        let trial = trial::run(&setup, 1, index, &mut |_, _| Ok(())).unwrap();
        let grasps: Vec<_> =
            trial.snapshots.iter().filter_map(|it| Some(it.report.as_ref()?.plan.as_ref()?.grasp.held_G)).collect();
        grasps.windows(2).filter(|pair| pair[0] != pair[1]).count()
    });
    changes.sum()
}

#[test]
fn a_catch_that_has_become_worse_gives_way() {
    let [ready, never] = [0.5, 1e9].map(changes_of_catch);
    assert!(ready >= never + 5, "{ready} changes, {never} where no gain is enough");
}
