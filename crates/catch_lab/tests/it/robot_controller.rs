//! Robot controllers that are not ideal, and limits of the jerk: what they reject, how often catches succeed,
//! what is never sent.

use std::fs;

use catch_cell::{BSpline, Brain, Cell, Command, Rejection, TrajectoryId};
use catch_lab::{
    referee,
    scenario::setup::{Choice, Setup},
    trial,
};

use crate::{planning::OBJECTS, source::root};

/// Time stamps that are off by up to half a millisecond, states in single precision, an interpolator 2 ms
/// behind, and every tenth trajectory declined.
const HOSTILE: [&str; 1] = ["arena.robot_controller.inexact=true"];

/// Counts the catches of 21 sampled throws, and lists the reasons of rejected trajectories.
fn sampled_throws(settings: &[&str]) -> (usize, Vec<Rejection>) {
    let settings: Vec<String> = settings.iter().map(|&it| it.to_owned()).collect();
    let (mut caught, mut rejections) = (0, Vec::new());
    for object in OBJECTS {
        let setup = Setup::load(&Choice {
            scenario: Some("paper"),
            object: Some(object),
            settings: &settings,
            ..Choice::default()
        })
        .unwrap();
        let throws = ["near_sampled", "far_sampled"].map(|throw| setup.thrown(throw).unwrap());
        for index in 0..7 {
            let setup = &throws[index % 2];
            let trial = trial::run(setup, 5, index as u64, &mut |tick, _| {
                rejections.extend(tick.observation.arm.rejected.iter().map(|it| it.reason));
                Ok(())
            })
            .unwrap();
            assert_eq!(trial.truth.servo.discontinuous_trajectories, 0, "{object} {index}");
            let verdict = referee::judge(setup, &trial);
            assert_eq!(verdict.limit_violations, 0, "{object} {index}");
            caught += usize::from(verdict.caught);
        }
    }
    (caught, rejections)
}

#[test]
fn a_hostile_controller_costs_no_catches() {
    let (exact, rejections) = sampled_throws(&[]);
    assert_eq!(rejections, []);
    assert!(exact >= 20, "{exact} of 21 caught with exact telemetry");
    let (caught, rejections) = sampled_throws(&HOSTILE);
    assert!(caught as f64 >= 0.97 * exact as f64, "{caught} caught, {exact} with exact telemetry");
    assert!(rejections.len() > 40 && rejections.iter().all(|it| *it == Rejection::Declined), "{rejections:?}");
}

/// A brain after a reset returns the commands of a new one, under identifiers that have not been used.
#[test]
fn a_brain_that_was_reset_is_as_good_as_new() {
    let setup = Setup::load(&Choice { scenario: Some("paper"), ..Choice::default() }).unwrap();
    let commands = |brain: &mut dyn Brain| -> Vec<Command> {
        let mut arena = setup.arena(1, 0);
        let tick = |_| {
            let Ok(observation) = arena.sense();
            let command = brain.tick(&observation, &mut ());
            let Ok(()) = arena.act(&command);
            command
        };
        (0..90).map(tick).collect()
    };
    let mut brain = setup.brain(1, 0);
    let first = commands(&mut brain);
    let used = first.iter().filter_map(|it| it.arm.as_ref()).map(|it| it.id.0).max().unwrap();
    brain.reset();
    let mut again = commands(&mut brain);
    for trajectory in again.iter_mut().filter_map(|it| it.arm.as_mut()) {
        trajectory.id = TrajectoryId(trajectory.id.0.checked_sub(used).unwrap());
    }
    assert!(again == first, "a command differs after a reset");
}

/// A copy of the arm that states limits of the jerk which bind: it catches, and no command breaks one.
#[test]
fn an_arm_with_limits_of_the_jerk_catches() {
    let folder = tempfile::tempdir().unwrap();
    let robot = root().join("assets/robots/iiwa14");
    fs::copy(robot.join("robot.urdf"), folder.path().join("robot.urdf")).unwrap();
    let text = fs::read_to_string(robot.join("robot.toml")).unwrap();
    let text = text.replace("max_acceleration_radps2", "max_jerk_radps3 = 500.0\nmax_acceleration_radps2");
    let toml = folder.path().join("robot.toml");
    fs::write(&toml, text).unwrap();
    let throw = |robot: Option<&str>, object: &str, index: u64| {
        let choice = Choice {
            scenario: Some("paper"),
            robot,
            object: Some(object),
            throw: Some("near_sampled"),
            ..Choice::default()
        };
        let setup = Setup::load(&choice).unwrap();
        let mut highest: f64 = 0.0;
        let trial = trial::run(&setup, 1, index, &mut |tick, _| {
            highest = tick.command.arm.iter().map(|it| highest_jerk(&it.spline)).fold(highest, f64::max);
            Ok(())
        })
        .unwrap();
        (referee::judge(&setup, &trial), highest)
    };
    let mut caught = 0;
    for (index, object) in (0..).zip(OBJECTS.iter().cycle().take(6)) {
        let (verdict, highest) = throw(toml.to_str(), object, index);
        assert_eq!(verdict.limit_violations, 0, "{object}: {:?}", verdict.first_violation);
        assert!(highest <= 500.0, "{highest} rad/s³");
        caught += usize::from(verdict.caught);
    }
    assert!(caught >= 5, "{caught} of 6 caught");
    let (_, highest) = throw(None, OBJECTS[0], 0);
    assert!(highest > 500.0, "the limit does not bind: {highest} rad/s³ without it");
}

fn highest_jerk(spline: &BSpline) -> f64 {
    let jerk = |[start_s, end_s]: [f64; 2]| {
        let [first, last] = [start_s, end_s].map(|time_s| spline.evaluate(time_s)[2]);
        ((last - first) / (end_s - start_s)).amax()
    };
    spline.spans().map(jerk).fold(0.0, f64::max)
}
