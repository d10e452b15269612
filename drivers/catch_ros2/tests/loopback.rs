//! Plans reach a real node of ROS 2, which executes them as a joint_trajectory_controller does.
//! `drivers/catch_ros2/test` installs it.

#![allow(non_snake_case, missing_docs)]

use std::{
    env, fs,
    io::{BufRead, BufReader},
    path::{Path, PathBuf},
    process::{Child, ChildStdout, Command, Stdio},
    sync::mpsc,
    time::Duration,
};

use catch_body::{JointVector, Robot as Arm, robot_file::RobotFiles};
use catch_cell::{ArmTrajectory, BSpline, Cell, CellFault, TrajectoryId, cell_file::SafeBox};
use catch_driver::{cell::DrivenCell, checker::Bounds, clock::Clock, drive::Driver, enabling_key::EnablingKey, motion};
use catch_ros2::{
    Ros2,
    control::{self, Controller, SILENCE},
};
use tempfile::TempDir;

const NAME: &str = "/arm/joint_trajectory_controller";

fn fr3() -> Arm {
    let files = RobotFiles {
        urdf_file: "robot.urdf",
        urdf: include_str!("../../../assets/robots/fr3/robot.urdf"),
        toml_file: "robot.toml",
        toml: include_str!("../../../assets/robots/fr3/robot.toml"),
    };
    Arm::from_files(&files).unwrap()
}

/// The controller, as a process of its own.
struct Fake {
    child: Child,
    lines: BufReader<ChildStdout>,
    folder: TempDir,
}

impl Fake {
    /// A controller that holds the arm at `q`.
    fn start(arm: &Arm, q: &JointVector) -> Self {
        let here = Path::new(env!("CARGO_MANIFEST_DIR"));
        let folder = tempfile::tempdir().unwrap();
        let names: Vec<&str> = arm.joints.iter().map(|it| it.name.as_str()).collect();
        let q: Vec<String> = q.iter().take(arm.dof()).map(f64::to_string).collect();
        let python =
            env::var_os("ROS_PYTHON").map_or_else(|| here.join("../../target/ros2/venv/bin/python"), PathBuf::from);
        let mut child = Command::new(python)
            .arg(here.join("tests/controller.py"))
            .args([NAME, &names.join(","), &q.join(",")])
            .arg(folder.path().join("log"))
            .stdout(Stdio::piped())
            .spawn()
            .expect("drivers/catch_ros2/test installs rclpy");
        let lines = BufReader::new(child.stdout.take().unwrap());
        let mut fake = Self { child, lines, folder };
        assert_eq!(fake.line(), "ready\n");
        fake
    }

    fn line(&mut self) -> String {
        let mut line = String::new();
        self.lines.read_line(&mut line).unwrap();
        line
    }

    /// Set-points of the first joint, one for each millisecond.
    fn setpoints(&self) -> Vec<f64> {
        let log = fs::read_to_string(self.folder.path().join("log")).unwrap();
        log.lines().map(|it| it.split(' ').nth(1).unwrap().parse().unwrap()).collect()
    }
}

impl Drop for Fake {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// A cell with an arm of a controller. It may be slow: only a test that silences it makes it hurry.
fn cell(arm: &Arm, key: &EnablingKey) -> DrivenCell {
    let safe_box = SafeBox { low_m: [-2.0; 3], high_m: [2.0; 3] };
    let bounds = Bounds { arm: arm.clone(), speed_scaling: 0.3, safe_box, margin: Ros2::margin };
    let controller = Controller::connect(NAME, arm).unwrap();
    let control = control::begin(controller, arm.clone(), key.clone(), Clock::Host);
    let mut cell = DrivenCell::begin(control, &bounds, (None, mpsc::channel().1)).unwrap();
    cell.watchdog = Duration::from_secs(60);
    cell
}

/// No set-point is farther from the one before than the arm moves in a millisecond at full speed.
fn assert_continuous(setpoints: &[f64], arm: &Arm) {
    let most = setpoints.windows(2).map(|it| (it[1] - it[0]).abs()).fold(0.0, f64::max);
    assert!(most > 0.0 && most < arm.joints[0].limits.velocity * 1e-3, "{most} rad in a millisecond");
}

/// A plan that leaves another in mid-motion and ends at rest elsewhere. The first three control points of a
/// cubic spline with threefold first knots are its position, velocity and acceleration there.
fn turned(before: &ArmTrajectory, start_s: f64, to: JointVector) -> ArmTrajectory {
    const SPAN_S: f64 = 0.6;
    let from = before.setpoint(start_s);
    let second = from.q + from.dq * (SPAN_S / 3.0);
    let third = second + (from.dq + from.ddq * (SPAN_S / 2.0)) * (2.0 * SPAN_S / 3.0);
    let knots_s = [0.0, 0.0, 0.0, 0.0, 1.0, 2.0, 3.0, 3.0, 3.0, 3.0].map(|it| start_s + it * SPAN_S).to_vec();
    let spline = BSpline { knots_s, control_points: vec![from.q, second, third, to, to, to] };
    ArmTrajectory { id: TrajectoryId(2), spline }
}

#[test]
#[ignore = "needs rclpy"]
fn plans_are_executed_by_a_controller() {
    let arm = fr3();
    let mut fake = Fake::start(&arm, &(arm.ready_q + JointVector::ith(0, 0.5)));
    let key = EnablingKey::default();
    key.set(true);
    let mut cell = cell(&arm, &key);
    assert!((cell.sense().unwrap().arm.q[0] - arm.ready_q[0] - 0.5).abs() < 1e-9);

    // A second plan replaces the first in mid-motion.
    let now_s = cell.sense().unwrap().time_s;
    let first = motion::straight(1, now_s + 0.1, [arm.ready_q + JointVector::ith(0, 0.5), arm.ready_q], &arm, 0.2);
    cell.act(&catch_cell::Command { arm: Some(first.clone()), gripper: None, windows: None }).unwrap();
    assert!(fake.line().contains("points"));
    while cell.sense().unwrap().time_s < first.end_s() - 0.5 {}
    let second = turned(&first, cell.sense().unwrap().time_s + 0.05, arm.ready_q + JointVector::ith(0, 0.2));
    cell.act(&catch_cell::Command { arm: Some(second), gripper: None, windows: None }).unwrap();
    assert_eq!(cell.sense().unwrap().arm.rejected, []);
    assert!(fake.line().contains("points"));
    while (cell.sense().unwrap().arm.q[0] - arm.ready_q[0] - 0.2).abs() > 1e-9 {}
    assert_continuous(&fake.setpoints(), &arm);
}

#[test]
#[ignore = "needs rclpy"]
fn a_released_key_stops_the_arm_and_a_held_one_starts_it_again() {
    let arm = fr3();
    let fake = Fake::start(&arm, &(arm.ready_q + JointVector::ith(0, 0.5)));
    let key = EnablingKey::default();
    key.set(true);
    let mut stopped = cell(&arm, &key);
    let now_s = stopped.sense().unwrap().time_s;
    let way = motion::straight(1, now_s + 0.1, [arm.ready_q + JointVector::ith(0, 0.5), arm.ready_q], &arm, 0.2);
    stopped.act(&catch_cell::Command { arm: Some(way), gripper: None, windows: None }).unwrap();
    let off = |cell: &mut DrivenCell| cell.sense().map(|it| it.arm.q[0] - arm.ready_q[0]);
    while off(&mut stopped).unwrap() > 0.4 {}
    key.set(false);
    let fault = loop {
        if let Err(fault) = off(&mut stopped) {
            break fault;
        }
    };
    assert!(matches!(&fault, CellFault::ProtectiveStop { cause } if cause.contains("key was released")), "{fault}");
    drop(stopped);
    assert_continuous(&fake.setpoints(), &arm);
    key.set(true);
    let mut again = cell(&arm, &key);
    let rests = off(&mut again).unwrap();
    assert!(rests > 0.01 && rests < 0.4, "{rests}");
    assert!((off(&mut again).unwrap() - rests).abs() < 1e-9, "it stands");
    again.go_to(arm.ready_q, 1).unwrap();
    while off(&mut again).unwrap().abs() > 1e-9 {}
}

#[test]
#[ignore = "needs rclpy"]
fn a_controller_that_is_gone_is_told() {
    let arm = fr3();
    let fake = Fake::start(&arm, &arm.ready_q);
    let key = EnablingKey::default();
    key.set(true);
    let mut cell = cell(&arm, &key);
    cell.sense().unwrap();
    drop(fake);
    cell.watchdog = SILENCE;
    let fault = loop {
        if let Err(fault) = cell.sense() {
            break fault;
        }
    };
    assert!(fault.to_string().contains("arm: no state for 250 ms"), "{fault}");
}
