//! Many throws in one life: what is caught, put down and told apart, and that the arm becomes ready again.

use std::path::Path;

use catch_body::JointVector;
use catch_cell::executor::PeakRatios;
use catch_lab::{
    play::Play,
    recording::{self, LabReader, replay::replay},
    referee::{self, Row},
    scenario::setup::{Choice, Setup},
    trial,
};
use catch_recording::{Part, timeline::Event};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;

fn setup(object: &str, throw: &str, settings: &[&str]) -> Setup {
    let settings: Vec<String> = settings.iter().map(|&it| it.to_owned()).collect();
    let choice = Choice {
        scenario: Some("paper"),
        object: Some(object),
        throw: Some(throw),
        settings: &settings,
        ..Choice::default()
    };
    Setup::load(&choice).unwrap()
}

fn play(throw: &str, settings: &[&str], throws: u64) -> Play {
    let setups = ["tennis_ball", "banana", "pill_bottle"].map(|object| setup(object, throw, settings)).to_vec();
    Play { setups, throws, every_s: 1.0, seed: 3, folder: None }
}

#[test]
fn what_is_caught_in_one_life_is_told_apart_and_put_down() {
    let folder = tempfile::tempdir().unwrap();
    let play = Play { folder: Some(folder.path().to_owned()), ..play("near_sampled", &[], 7) };
    let mut told = 0;
    let life = play.run(&mut |_| told += 1).unwrap();
    assert_eq!((life.rows.len(), told, life.ended_early, life.violations_between), (7, 7, None, 0));
    let mut objects = Vec::new();
    for (index, row) in life.rows.iter().enumerate() {
        let verdict = &row.row.verdict;
        assert!(verdict.caught, "{index}: {:?}", verdict.reason);
        assert_eq!(row.identified.as_deref(), Some(row.row.scene.object.as_str()), "{index}");
        assert_eq!(row.placed, Some(true), "{index}");
        assert_eq!(verdict.limit_violations, 0);
        assert_shows_the_putting_down(&recording::file(folder.path(), &row.row.scene));
        objects.push(play.object(index as u64));
        // The throw as a trial of its own.
        let setup = &play.setups[play.object(index as u64)];
        let trial = trial::run_unobserved(&mut setup.brain(play.seed, index as u64), setup, play.seed, index as u64);
        let alone = Row::new(setup, play.seed, index as u64, referee::judge(setup, &trial));
        assert_eq!((row.row.scene.clone(), verdict.caught), (alone.scene, alone.verdict.caught));
        let (one, other) = (verdict.catch_time_s.unwrap(), alone.verdict.catch_time_s.unwrap());
        assert!((one - other).abs() < 0.05, "{index}: caught at {one} s, alone at {other} s");
    }
    objects.sort_unstable();
    objects.dedup();
    assert_eq!(objects.len(), 3, "each object is thrown");
    for pair in life.rows.windows(2) {
        assert!(pair[1].thrown_s >= pair[0].thrown_s + play.every_s - 1e-9);
    }
}

/// The recording of one throw of many begins with its release and ends when the object lies on the floor; it
/// is not replayed by a brain that knows no earlier throws.
fn assert_shows_the_putting_down(file: &Path) {
    let mut reader = LabReader::open(file).unwrap();
    let (mut ticks_s, mut last) = (Vec::new(), None);
    let ending = loop {
        match reader.next_part().unwrap() {
            Part::Tick(tick) => {
                ticks_s.push(tick.observation.time_s);
                last = Some(tick);
            }
            Part::Ending(ending) => break ending,
        }
    };
    let (truth, last) = (ending.ground_truth.unwrap().truth, last.unwrap());
    assert!((0.0..0.02).contains(&ticks_s[0]) && ticks_s.is_sorted(), "{ticks_s:?}");
    let [first, end] = [&truth.samples[0], truth.samples.last().unwrap()];
    assert!(first.time_s == 0.0 && (end.time_s - last.observation.time_s).abs() < 0.02 && end.X_WO.translation.z < 0.1);
    let events: Vec<Event> = ending.timeline.iter().map(|it| it.event).collect();
    assert_eq!((events[0], events[events.len() - 1]), (Event::Thrown, Event::Held));
    assert!(ending.timeline.iter().all(|it| (0.0..3.0).contains(&it.time_s)), "{:?}", ending.timeline);
    let fault = replay(file).unwrap_err().to_string();
    assert!(fault.contains("simulation.thrown_s: found a throw of many"), "{fault}");
}

/// The thrower's own pause is not the arm's, however long.
#[test]
fn a_long_pause_is_no_stuck_arm() {
    let play = Play { every_s: 65.0, ..play("near_sampled", &[], 1) };
    let life = play.run(&mut |_| ()).unwrap();
    assert_eq!((life.rows.len(), life.ended_early), (1, None));
    assert!(life.duration_s >= 65.0 - 1e-6, "{}", life.duration_s);
}

/// Fingers that close much too early catch nothing; the objects fall to the floor, and the arm goes back.
#[test]
fn after_a_miss_the_arm_is_ready_again() {
    let life = play("near_sampled", &["brain.control.gripper_latency_s=0.3"], 4).run(&mut |_| ()).unwrap();
    assert!(life.ended_early.is_none() && life.rows.len() == 4);
    assert!(life.rows.iter().all(|row| row.row.verdict.reason.is_some() && row.placed.is_none()));
    assert!(life.rows.iter().all(|row| row.identified.as_ref() == Some(&row.row.scene.object)));
}

#[test]
fn a_scenario_without_a_place_is_told() {
    let mut play = play("near_sampled", &[], 1);
    play.setups[0].scenario.place_rad = None;
    let fault = play.run(&mut |_| ()).unwrap_err().to_string();
    assert!(fault.contains("place_rad: found nothing"), "{fault}");
}

/// Each motion from rest to rest keeps all limits by the executor's own check, and its ends stand still.
#[test]
fn motions_from_rest_to_rest_keep_all_limits() {
    let setup = setup("banana", "near", &[]);
    let planner = &setup.known().search.motion;
    let robot = &planner.robot;
    let mut random = Pcg64::seed_from_u64(5);
    let mut found = 0;
    for _ in 0..200 {
        let mut pose = || {
            JointVector::from_fn(|i, _| match robot.joints.get(i) {
                Some(joint) => random.random_range(0.8 * joint.limits.lower..0.8 * joint.limits.upper),
                None => 0.0,
            })
        };
        let (from, to, via) = (pose(), pose(), robot.ready_q);
        for via in [None, Some(&via)] {
            let Some(motion) = planner.rest_to_rest(2.0, &from, via, &to, None) else { continue };
            found += 1;
            assert_eq!(PeakRatios::of(robot, &motion).violations(), []);
            for (time_s, q) in [(2.0, from), (motion.end_s(), to)] {
                let [position, velocity, acceleration] = motion.evaluate(time_s);
                assert!((position - q).amax() < 1e-12 && velocity.amax() < 1e-9 && acceleration.amax() < 1e-6);
            }
        }
    }
    assert!(found > 20, "{found} motions");
}
