//! Whole catches through the driver: images, arm and hand come from a scene in MuJoCo, which judges as the
//! arena does. The same throws were recorded in the arena.

use std::{env, iter, path::Path, sync::Arc};

use catch_body::robot::LimitScale;
use catch_cell::cell_file::SafeBox;
use catch_driver::{
    camera_socket, cell::DrivenCell, checker::Bounds, clock::Clock, drive, enabling_key::EnablingKey, hand::Hand,
};
use catch_franka::{allow_contact, control, franka_hand, margin};
use catch_recording::{
    RecordingReader,
    replay::{RECORDED, brain_of},
    sources::Sources,
};
use serde::de::IgnoredAny;

use crate::server::{Server, free_address, port, root};

/// Fraction of the arena's catches that there have to be at least: another engine throws, and another servo
/// moves the arm.
const LEAST_OF_ARENA: f64 = 0.5;

/// A throw in the arena and through the driver: `caught`, or why not. The error is why the driver stopped.
fn thrown(recording: &Path, folder: &Path) -> Result<[String; 2], String> {
    let known = RecordingReader::<IgnoredAny, IgnoredAny>::open(recording).unwrap().header.cell.clone();
    let unscaled = Sources { limit_scale: LimitScale::default(), ..known.sources.clone() };
    let (arm, gripper) = unscaled.parse(&RECORDED).unwrap();
    let safe_box = SafeBox { low_m: [-2.0; 3], high_m: [2.0; 3] };
    let arm = arm.carrying(&gripper);
    let bounds = Bounds { arm: arm.clone(), speed_scaling: 1.0, safe_box, margin: margin::acceleration_ratio };

    let (clock, key) = (Clock::lock_step(), EnablingKey::default());
    key.set(true);
    let socket = folder.join("cameras");
    let images = camera_socket::listen(&socket, &known.cameras, &clock).unwrap();
    let (arm_address, hand_address) = (free_address(), free_address());
    let file = recording.display().to_string();
    let place = socket.display().to_string();
    let ports = [port(&arm_address).to_owned(), port(&hand_address).to_owned()];
    let arguments = [file.as_str(), &ports[0], &ports[1], &place];
    let mut scene = Server::run("throw.py", arm_address, arguments.into_iter());
    let robot = scene.connect();
    allow_contact(&robot, &arm).unwrap();
    let hand = Hand::new(franka_hand::connect(&hand_address).unwrap(), clock.clone()).unwrap();

    let mut brain = brain_of(&known).unwrap();
    let control = control::begin(Arc::new(robot), arm, key, clock);
    let mut cell = DrivenCell::begin(control, &bounds, (Some(hand), images)).unwrap();
    drive::throw(&mut cell, &mut brain, &known, folder).map_err(|fault| fault.to_string())?;
    drop(cell);
    Ok(serde_json::from_str(&scene.line()).unwrap())
}

#[test]
#[ignore = "needs franka-sim and the Python package"]
fn objects_are_caught_through_the_driver() {
    let most = env::var("CATCHES").ok().and_then(|it| it.parse().ok()).unwrap_or(usize::MAX);
    let folder = root().join("target/franka/catches");
    let mut files: Vec<_> = folder.read_dir().unwrap().map(|it| it.unwrap().path()).collect();
    files.retain(|it| it.extension().is_some_and(|it| it == "catch"));
    files.sort();
    let files = &files[..most.min(files.len())];
    let out = tempfile::tempdir().unwrap();
    let (mut in_arena, mut through_driver, mut stopped) = (0, 0, 0);
    for (index, file) in iter::zip(0.., files) {
        match thrown(file, out.path()) {
            Ok([arena, driver]) => {
                println!("throw {index}: {arena} in the arena, {driver} through the driver");
                in_arena += usize::from(arena == "caught");
                through_driver += usize::from(driver == "caught");
            }
            Err(cause) => {
                println!("throw {index}: {cause}");
                stopped += 1;
            }
        }
    }
    println!("{} throws: {in_arena} caught in the arena, {through_driver} through the driver", files.len());
    assert!(!files.is_empty() && stopped == 0, "{stopped} stopped");
    assert!(through_driver as f64 >= LEAST_OF_ARENA * in_arena as f64);
}
