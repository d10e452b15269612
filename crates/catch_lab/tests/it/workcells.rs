//! Catching among obstacles: no part touches one, and what they take away is counted.

use std::fs;

use catch_lab::{
    assets::Kind,
    reachability::oracle::Oracle,
    referee::{self, Verdict, reason::Reason},
    scenario::setup::{Choice, Setup},
    trial,
};

fn setup(robot: Option<&str>, workcell: &str, throw: &str) -> Setup {
    let choice =
        Choice { scenario: Some("paper"), robot, workcell: Some(workcell), throw: Some(throw), ..Choice::default() };
    Setup::load(&choice).unwrap()
}

fn run(setup: &Setup, index: u64) -> Verdict {
    let trial = trial::run(setup, 8, index, &mut |_, _| Ok(())).unwrap();
    referee::judge(setup, &trial)
}

#[test]
fn every_arm_catches_among_the_obstacles_of_every_workcell() {
    for workcell in Kind::Workcell.names() {
        for robot in Kind::Robot.names() {
            let setup = setup(Some(robot), workcell, "random_by_reach");
            let verdicts = [0, 1, 2].map(|index| run(&setup, index));
            for verdict in &verdicts {
                assert_ne!(verdict.reason, Some(Reason::ArmCollision), "{robot} in {workcell}: {verdict:?}");
                let clearance_m = verdict.measures.min_floor_clearance_m;
                assert!(clearance_m.is_some_and(|it| it > 0.0), "{robot} in {workcell}: {verdict:?}");
            }
            assert!(verdicts.iter().any(|it| it.caught), "{robot} in {workcell}: {verdicts:?}");
        }
    }
}

/// A wall between thrower and arm: the object meets it, and the oracle knows that nobody could have caught
/// it.
#[test]
fn an_object_behind_a_wall_is_out_of_reach_and_hits_it() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("wall.toml");
    let wall = "name = \"wall\"\ndescription = \"a wall across the throw\"\n\n[[boxes]]\nname = \"wall\"\n\
                size_m = [3.0, 0.1, 4.0]\nposition_m = [1.3, 1.3, 2.0]\nrpy_rad = [0.0, 0.0, 2.356]\n";
    fs::write(&file, wall).unwrap();
    let walled = setup(None, file.to_str().unwrap(), "near");
    let verdict = run(&walled, 0);
    assert_eq!(verdict.reason, Some(Reason::HitObstacle), "{verdict:?}");
    assert_eq!(Oracle::of(&walled).reach(&walled, 8, 0).from_release_s, None);
    // Setup without the workcell, for the same throw.
    let open = Setup::load(&Choice { scenario: Some("paper"), ..Choice::default() }).unwrap();
    assert!(run(&open, 0).caught && Oracle::of(&open).reach(&open, 8, 0).from_release_s.is_some());
}

/// An obstacle in the arm's way is a fault of the file, and named.
#[test]
fn a_workcell_in_which_the_arm_cannot_stand_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("block.toml");
    let block = "name = \"block\"\ndescription = \"where the arm is\"\n\n[[boxes]]\nname = \"block\"\n\
                 size_m = [1.0, 1.0, 1.0]\nposition_m = [0.0, 0.0, 0.5]\n";
    fs::write(&file, block).unwrap();
    let choice = Choice { scenario: Some("paper"), workcell: file.to_str(), ..Choice::default() };
    let fault = Setup::load(&choice).unwrap_err().to_string();
    assert!(fault.contains("block.toml: boxes or capsules: found `block`"), "{fault}");
}
