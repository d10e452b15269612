//! The program with the driver: `catchingbot doctor` from the cell's file to the predicted catch rate,
//! against a simulated arm and cameras that see a wall.

use std::{
    fs,
    path::Path,
    process::{Child, Command, Stdio},
};

use crate::server::{Server, root};

/// Two cameras of the size that the rig says, 30 images a second each, of a wall: inverse depth with the
/// noise of a stereo camera, and pixels without depth.
const CAMERAS: &str = "
import sys, time
sys.path.insert(0, sys.argv[1])
import numpy as np
from sender import Sender
random = np.random.default_rng(0)
def image():
    inverse = 0.5 + 0.004 * (np.sqrt(0.3) * random.standard_normal() + np.sqrt(0.7) * random.standard_normal((480, 848)))
    return np.where(random.random(inverse.shape) < 0.1, 0, 1 / inverse).astype(np.float32)
images = [image() for _ in range(8)]
while True:
    try:
        sender = Sender(sys.argv[2])
        for i in range(10**9):
            for camera in range(2):
                sender.send(camera, time.monotonic(), images[(i + camera) % len(images)])
            time.sleep(1 / 30)
    except OSError:
        time.sleep(0.05)
";

fn catchingbot() -> Command {
    let mut command = Command::new(root().join("target/release/catchingbot"));
    command.stderr(Stdio::inherit());
    command
}

struct Cameras(Child);

impl Drop for Cameras {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

#[test]
#[ignore = "needs franka-sim"]
fn the_doctor_measures_and_predicts() {
    let out = tempfile::tempdir().unwrap();
    let socket = out.path().join("cameras");
    let files = catch_body::robot_file::RobotFiles {
        urdf_file: "robot.urdf",
        urdf: include_str!("../../../../assets/robots/fr3/robot.urdf"),
        toml_file: "robot.toml",
        toml: include_str!("../../../../assets/robots/fr3/robot.toml"),
    };
    let server = Server::start(&catch_body::Robot::from_files(&files).unwrap().ready_q, &[]);
    let cell = out.path().join("cell.toml");
    let text = include_str!("../../../../crates/catch_cli/src/new_cell.toml");
    let arm = text.replacen("172.16.0.2", &server.address, 1);
    fs::write(&cell, arm.replace("/tmp/catchingbot-cameras", &socket.display().to_string())).unwrap();
    let here = Path::new(env!("CARGO_MANIFEST_DIR"));
    let python = here.join("../../target/franka/venv/bin/python");
    let cameras = Command::new(python).args(["-c", CAMERAS]).arg(here.join("../cameras")).arg(&socket).spawn();
    let cameras = Cameras(cameras.unwrap());
    let told = catchingbot().args(["doctor", "--trials=2", "--out"]).args([out.path(), &cell]).output().unwrap();
    drop((cameras, server));
    let told = String::from_utf8(told.stdout).unwrap();
    println!("{told}");
    let found: serde_json::Value = serde_json::from_slice(&fs::read(out.path().join("doctor.json")).unwrap()).unwrap();
    for camera in ["0", "1"] {
        let noise = &found["images"][camera]["noise"];
        let near = |name: &str, expected: f64, within: f64| {
            let figure = noise[name].as_f64().unwrap();
            assert!((figure / expected - 1.0).abs() < within, "{name} {figure}");
        };
        near("inverse_depth_sd_per_m", 0.004, 0.3);
        near("dropout_fraction", 0.1, 0.1);
    }
    assert!(found["states"].as_u64().unwrap() > 1000 && found["acceleration_ratio"].is_number());
    for speed in ["0.1", "1"] {
        let said = format!("with these figures and speed_scaling = {speed} the arena catches");
        assert!(told.contains(&said), "{speed}");
    }
}

/// What only the driver can know to be wrong ends as any wrong input does.
#[test]
#[ignore = "needs catchingbot"]
fn an_unknown_hand_is_refused() {
    let out = tempfile::tempdir().unwrap();
    let cell = out.path().join("cell.toml");
    let text = include_str!("../../../../crates/catch_cli/src/new_cell.toml");
    assert!(text.contains("\"franka_hand\"\naddress"));
    fs::write(&cell, text.replace("\"franka_hand\"\naddress", "\"robotiq\"\naddress")).unwrap();
    for command in ["drive", "doctor"] {
        let ended = catchingbot().arg(command).arg("--out").args([out.path(), &cell]).stderr(Stdio::piped()).output();
        let ended = ended.unwrap();
        let told = String::from_utf8(ended.stderr).unwrap();
        let said = "cell.toml: hand.driver: found \"robotiq\", expected franka_hand or wsg50";
        assert!(ended.status.code() == Some(2) && told.contains(said), "{told}");
    }
}
