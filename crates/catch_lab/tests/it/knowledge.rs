//! Truth and knowledge do not mix: nothing that is known changes the world, and the brain of the scenario
//! `honest` is the default one.

use std::{fs, path::Path};

use catch_bot::Config;
use catch_cell::Cell;
use catch_lab::{
    scenario::setup::{Choice, Setup},
    trial,
};
use catch_recording::brain::BrainSettings;
use catch_sim::Truth;
use toml::Value;

use crate::source::root;

/// Long enough for the waiting arm to move if it were to, and for air and gravity to act on the object.
const TICKS: usize = 25;
const SCENE: (u64, u64) = (5, 3);

fn load(scenario: &str, object: Option<&str>, settings: &[String]) -> Setup {
    Setup::load(&Choice { scenario: Some(scenario), object, settings, ..Choice::default() }).unwrap()
}

/// The world before anybody acts in it.
fn world(setup: &Setup) -> Truth {
    let mut arena = setup.arena(SCENE.0, SCENE.1);
    for _ in 0..TICKS {
        let Ok(_) = arena.sense();
        let Ok(()) = arena.act(&catch_cell::Command::default());
    }
    arena.truth().clone()
}

/// The numbers within a value, by their paths, each with others that it may be.
fn numbers(path: &str, value: &Value, found: &mut Vec<(String, [Value; 3])>) {
    match value {
        Value::Table(table) => {
            for (name, value) in table {
                numbers(&format!("{path}.{name}"), value, found);
            }
        }
        Value::Float(value) => {
            found.push((path.to_owned(), [0.5 * value, 0.9 * value, 0.7 * value + 0.01].map(Value::Float)));
        }
        Value::Integer(value) => found.push((path.to_owned(), [value + 1, value - 1, 2 * value].map(Value::Integer))),
        _ => {}
    }
}

/// Checks that a throw is the same in two setups in everything that is drawn.
fn assert_same_conditions(one: &Setup, other: &Setup, what: &str) {
    for index in 0..3 {
        assert_eq!(one.conditions(SCENE.0, index), other.conditions(SCENE.0, index), "{what}");
        assert_eq!(one.release(SCENE.0, index), other.release(SCENE.0, index), "{what}");
    }
    assert_eq!(one.object, other.object, "{what}");
}

#[test]
fn no_setting_of_the_brain_changes_the_world() {
    let right = load("honest", None, &[]);
    let before = world(&right);
    let complete = right.brain_config(SCENE.0);
    let mut all = Vec::new();
    numbers("brain", &Value::try_from(&complete).unwrap(), &mut all);
    let mut changed = 0;
    for (path, values) in all {
        // Some settings allow only one kind of change.
        let settings = values.map(|value| vec![format!("{path}={value}")]);
        let choice = |settings| Setup::load(&Choice { scenario: Some("honest"), settings, ..Choice::default() });
        let Some(other) = settings.iter().find_map(|it| choice(it).ok()) else { continue };
        changed += 1;
        assert_same_conditions(&right, &other, &path);
        if changed % 10 == 0 {
            assert!(world(&other) == before, "{path} changes the world");
        }
    }
    assert!(changed > 35, "{changed} settings were changed");
}

/// Copies of a built-in object and its camera's sheet, with one number of one file multiplied.
fn with_known(folder: &Path, field: &str, factor: f64) -> Setup {
    for file in ["truth.toml", "known.toml"] {
        let text = fs::read_to_string(root().join("assets/objects/banana").join(file)).unwrap();
        fs::write(folder.join(file), text).unwrap();
    }
    let sheet = fs::read_to_string(root().join("assets/cameras/stereo7c.toml")).unwrap();
    fs::write(folder.join("camera.toml"), sheet).unwrap();
    for file in ["known.toml", "camera.toml"] {
        let text = fs::read_to_string(folder.join(file)).unwrap();
        let line = |line: &str| match line.split_once(" = ") {
            Some((name, value)) if name == field => format!("{name} = {}", factor * value.parse::<f64>().unwrap()),
            _ => line.to_owned(),
        };
        fs::write(folder.join(file), text.lines().map(line).collect::<Vec<_>>().join("\n")).unwrap();
    }
    let camera = format!("camera={}", folder.join("camera.toml").display());
    load("honest", folder.to_str(), &[camera])
}

/// The object until something touches it, and the arm until the first trajectory may begin.
fn until_touched_and_commanded(setup: &Setup) -> Vec<String> {
    let mut arrives_s = f64::INFINITY;
    let trial = trial::run(setup, SCENE.0, SCENE.1, &mut |tick, _| {
        if tick.command.arm.is_some() {
            arrives_s = arrives_s.min(tick.observation.time_s);
        }
        Ok(())
    })
    .unwrap();
    let samples = trial.truth.samples.iter();
    let untouched = samples.clone().take_while(|it| !it.contact.any());
    let uncommanded = samples.take_while(|it| it.time_s <= arrives_s);
    let object = untouched.map(|it| format!("{:?} {:?}", it.X_WO, it.V_WO));
    object.chain(uncommanded.map(|it| format!("{:?} {:?}", it.q, it.dq))).collect()
}

#[test]
fn no_figure_of_object_or_camera_changes_the_world() {
    let folder = tempfile::tempdir().unwrap();
    let right = with_known(folder.path(), "", 1.0);
    let samples = until_touched_and_commanded(&right);
    for (field, factor) in [
        ("mass_kg", 1.4),
        ("restitution", 0.5),
        ("drag_per_m", 2.0),
        ("drag_sd_per_m", 2.0),
        ("subpixel_px", 2.0),
        ("baseline_m", 0.5),
        ("common_fraction", 0.5),
    ] {
        let wrong = with_known(folder.path(), field, factor);
        assert_ne!(right.brain_config(1), wrong.brain_config(1), "{field} is not known");
        assert_same_conditions(&right, &wrong, field);
        let seen = until_touched_and_commanded(&wrong);
        // The arm may be sent off at another time, so that one list is longer; the object's samples come
        // first.
        let same = samples.iter().zip(&seen).take(400).position(|(one, other)| one != other);
        assert_eq!(same, None, "{field} changes the world");
    }
}

#[test]
fn the_default_brain_is_that_of_honest() {
    let honest = load("honest", None, &[]);
    assert_eq!(honest.scenario.brain, BrainSettings::default());
    let known = honest.knowledge();
    let of_library = Config::default().given(&known.object.figures, known.cameras);
    let of_scenario = honest.brain_config(1).config();
    assert_eq!(of_library, of_scenario);
}

#[test]
fn the_default_brain_catches() {
    let honest = load("honest", None, &[]);
    let caught = (0..4).filter(|index| {
        let trial = trial::run(&honest, 20, *index, &mut |_, _| Ok(())).unwrap();
        catch_lab::referee::judge(&honest, &trial).caught
    });
    assert!(caught.count() >= 3);
}

/// Where the arm's surface differs from its model, cameras see it, and nothing else changes: neither the
/// motion nor what the brain is given.
#[test]
fn surfaces_of_the_arm_are_seen_and_not_known() {
    let labels = "arena.labels=false".to_owned();
    let plain = load("honest", None, std::slice::from_ref(&labels));
    let covered = load("honest", None, &[labels, "arena.robot_errors.link_surface_sd_m=0.001".to_owned()]);
    let images = |setup: &Setup| {
        let mut arena = setup.arena(SCENE.0, SCENE.1);
        let mut pixels: Vec<u32> = Vec::new();
        for _ in 0..TICKS {
            let Ok(seen) = arena.sense();
            pixels.extend(seen.frames.into_iter().flat_map(|it| it.depth_m).map(f32::to_bits));
            let Ok(()) = arena.act(&catch_cell::Command::default());
        }
        pixels
    };
    assert_eq!(images(&covered), images(&covered), "always the same");
    let [seen, bare] = [&covered, &plain].map(images);
    let differ = seen.iter().zip(&bare).filter(|(one, other)| one != other).count();
    assert!(seen.len() == bare.len() && differ > 100, "{differ} of {} pixels", seen.len());
    assert!(world(&covered) == world(&plain), "surfaces move something");
    assert_eq!((&covered.robot, &covered.gripper), (&plain.robot, &plain.gripper));
    assert_eq!(covered.sources, plain.sources);
    assert_eq!(covered.brain_config(SCENE.0), plain.brain_config(SCENE.0));
}
