//! Every object with every throw: always an outcome, never a number that is none.

use catch_lab::{
    assets::Kind,
    referee::{self, Verdict, reason::Reason},
    scenario::setup::{Choice, Setup},
    trial,
};
use catch_sim::{Truth, TruthSample};
use nalgebra::Point3;

fn run(object: &str, throw: &str, seed: u64, index: u64) -> (Truth, Verdict) {
    run_with(&[], object, throw, seed, index)
}

fn run_with(settings: &[String], object: &str, throw: &str, seed: u64, index: u64) -> (Truth, Verdict) {
    let choice =
        Choice { scenario: Some("paper"), object: Some(object), throw: Some(throw), settings, ..Choice::default() };
    let setup = Setup::load(&choice).unwrap();
    let trial = trial::run(&setup, seed, index, &mut |_, _| Ok(())).unwrap();
    let verdict = referee::judge(&setup, &trial);
    (trial.truth, verdict)
}

fn is_finite(sample: &TruthSample) -> bool {
    let TruthSample { q, dq, torque, X_WG, X_WO, V_WO, width_m, .. } = sample;
    let poses = [X_WG, X_WO].into_iter().flat_map(|it| it.translation.vector.iter().chain(it.rotation.coords.iter()));
    let mut numbers = q
        .iter()
        .chain(dq.iter())
        .chain(torque.iter())
        .chain(V_WO.linear.iter())
        .chain(V_WO.angular.iter())
        .chain(poses);
    numbers.all(|number| number.is_finite()) && width_m.is_finite()
}

/// Held, but by an arm that moves on, is no catch; nor is one that the floor helped with.
#[test]
fn a_catch_needs_an_arm_at_rest_and_no_floor() {
    let setup = Setup::load(&Choice { scenario: Some("paper"), ..Choice::default() }).unwrap();
    let mut trial = trial::run(&setup, 1, 0, &mut |_, _| Ok(())).unwrap();
    let verdict = referee::judge(&setup, &trial);
    assert!(verdict.caught);
    let still_s = verdict.contact_s.unwrap() + 0.6;
    let at = trial.truth.samples.iter().position(|sample| sample.time_s > still_s).unwrap();
    trial.truth.samples[at].dq[6] += 0.1;
    assert_eq!(referee::judge(&setup, &trial).reason, Some(Reason::MovedOn));
    trial.truth.samples[at].dq[6] -= 0.1;
    trial.truth.samples[5].contact.floor = true;
    assert_eq!(referee::judge(&setup, &trial).reason, Some(Reason::HitFloor));
}

/// Returns whether the object lies in the hand at the end and has touched nothing else, from the truth,
/// without the referee's rules.
fn is_in_hand_at_the_end(truth: &Truth, grasp_centre_G: &Point3<f64>) -> bool {
    let end = truth.samples.last().unwrap();
    let p_GO = end.X_WG.inverse_transform_point(&end.X_WO.translation.vector.into());
    let touched_else = truth.samples.iter().any(|sample| sample.contact.arm || sample.contact.floor);
    (p_GO - grasp_centre_G).norm() < 0.1 && !touched_else
}

#[test]
fn every_throw_of_every_object_has_an_outcome() {
    let grasp_centre_G =
        Setup::load(&Choice { scenario: Some("paper"), ..Choice::default() }).unwrap().gripper.grasp_centre();
    for object in Kind::Object.names() {
        for throw in Kind::Throw.names() {
            let (truth, verdict) = run(object, throw, 3, 1);
            let cell = format!("{object}, {throw}: {verdict:?}");
            assert_eq!(verdict.caught, is_in_hand_at_the_end(&truth, &grasp_centre_G), "{cell}");
            assert!(verdict.caught || !["near", "far"].contains(&throw), "{cell}");
            assert!(truth.samples.iter().all(is_finite) && truth.diverged_s.is_none(), "{cell}");
            assert_eq!(verdict.limit_violations, 0, "{cell}: {:?}", truth.servo);
            let measures = &verdict.measures;
            for clearance in [measures.min_self_clearance_m, measures.min_floor_clearance_m] {
                assert!(clearance.is_some_and(|it| it > 0.0), "{cell}");
            }
        }
    }
}

/// Fingers that close much too early catch nothing, and the truth shows it.
#[test]
fn what_is_missed_is_not_in_the_hand() {
    let grasp_centre_G =
        Setup::load(&Choice { scenario: Some("paper"), ..Choice::default() }).unwrap().gripper.grasp_centre();
    let early = ["brain.control.gripper_latency_s=0.3".to_owned()];
    for object in Kind::Object.names() {
        let (truth, verdict) = run_with(&early, object, "near", 3, 1);
        assert!(!verdict.caught && verdict.reason.is_some(), "{object}: {verdict:?}");
        assert!(!is_in_hand_at_the_end(&truth, &grasp_centre_G), "{object}: {verdict:?}");
    }
}

/// An arm that waits at the catch proves nothing.
#[test]
fn a_ball_is_caught_by_an_arm_that_moves() {
    for throw in ["near", "far"] {
        let (_, verdict) = run("tennis_ball", throw, 1, 0);
        assert!(verdict.caught && verdict.caught_paper, "{throw}: {verdict:?}");
        assert!(verdict.measures.joint_travel_rad.is_some_and(|travel| travel > 0.5), "{throw}: {verdict:?}");
    }
}

/// A banana may come so that it enters only a hand that opens wider than it waits.
#[test]
fn throws_around_those_of_the_paper_are_caught() {
    for object in ["tennis_ball", "banana", "pill_bottle"] {
        let choice =
            Choice { scenario: Some("paper"), object: Some(object), throw: Some("far_sampled"), ..Choice::default() };
        let setup = Setup::load(&choice).unwrap();
        for index in 0..5 {
            let trial = trial::run(&setup, 2, index, &mut |_, _| Ok(())).unwrap();
            let verdict = referee::judge(&setup, &trial);
            assert!(verdict.caught, "{object}, throw {index}: {verdict:?}");
        }
    }
}

/// Each built-in arm from the ready pose of its own file, not only the one for which the throws were made.
#[test]
fn every_built_in_arm_catches() {
    for robot in Kind::Robot.names() {
        for (object, throw) in
            [("tennis_ball", "near_sampled"), ("banana", "far_sampled"), ("pill_bottle", "random_by_reach")]
        {
            let choice = Choice {
                scenario: Some("paper"),
                robot: Some(robot),
                object: Some(object),
                throw: Some(throw),
                ..Choice::default()
            };
            let setup = Setup::load(&choice).unwrap();
            let verdicts = [0, 1].map(|index| {
                let trial = trial::run(&setup, 3, index, &mut |_, _| Ok(())).unwrap();
                referee::judge(&setup, &trial)
            });
            assert!(verdicts.iter().all(|it| it.limit_violations == 0), "{robot}, {throw}: {verdicts:?}");
            assert!(verdicts.iter().any(|it| it.caught), "{robot}, {throw}: {verdicts:?}");
        }
    }
}
