//! Random serial arms through the loader and the planner: nothing panics, and every plan keeps all limits
//! when it is recomputed.

use std::fmt::Write;

use catch_body::{Gripper, JointVector, Robot, robot::Joint, robot_file::RobotFiles};
use catch_bot::trajectory_optimization::{Config, MotionPlanner, Start};
use catch_cell::{arm::Setpoint, executor::PeakRatios};
use catch_lab::{
    assets::{Asset, Kind},
    reachability::ready::Corridor,
    scenario::setup::{Choice, Setup},
};
use catch_paper::posed::{PosedPlanner, Target};
use nalgebra::Vector3;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;

/// Catches that are asked for from each arm.
const CATCHES: usize = 4;

/// The two files of a random arm of one to eight joints: any axes and offsets, some joints parallel, ranges
/// from narrow to endless, limits over decades, heavy and light links.
fn random_files(rng: &mut Pcg64) -> [String; 2] {
    let dof = rng.random_range(1..=8);
    let (mut urdf, mut joints) = ("<robot name=\"random\">\n".to_owned(), String::new());
    let mut poses = Vec::new();
    for i in 0..=dof {
        let mass: f64 = libm::pow(10f64, rng.random_range(-1.0..1.0));
        let [a, b, c] = [0; 3].map(|_| mass * rng.random_range(0.001..0.02));
        let _ = writeln!(
            urdf,
            "<link name=\"l{i}\"><inertial><origin xyz=\"{} {} {}\"/><mass value=\"{mass}\"/><inertia ixx=\"{}\" ixy=\"0\" \
             ixz=\"0\" iyy=\"{}\" iyz=\"0\" izz=\"{}\"/></inertial></link>",
            rng.random_range(-0.1..0.1),
            rng.random_range(-0.1..0.1),
            rng.random_range(-0.1..0.1),
            a + b,
            b + c,
            c + a,
        );
    }
    let round = |it: f64| if it.abs() < 0.3 { 0.0 } else { it };
    for i in 0..dof {
        let axis: [f64; 3] = [0; 3].map(|_| round(rng.random_range(-1.0..1.0)));
        let axis = if axis == [0.0; 3] { [0.0, 0.0, 1.0] } else { axis };
        let offset: [f64; 3] = [0; 3].map(|_| round(rng.random_range(-1.0..1.0)) * 0.4);
        let rpy: [f64; 3] = [0; 3].map(|_| round(rng.random_range(-3.2..3.2)));
        let middle: f64 = rng.random_range(-1.0..1.0);
        let half = libm::pow(10f64, rng.random_range(-1.0..0.8));
        let (velocity, torque) =
            (libm::pow(10f64, rng.random_range(-0.5..1.0)), libm::pow(10f64, rng.random_range(0.5..3.0)));
        let is_endless = rng.random_bool(0.2);
        let range =
            if is_endless { String::new() } else { format!("lower=\"{}\" upper=\"{}\"", middle - half, middle + half) };
        let _ = writeln!(
            urdf,
            "<joint name=\"j{i}\" type=\"{}\"><parent link=\"l{i}\"/><child link=\"l{}\"/><origin xyz=\"{} {} {}\" rpy=\"{} {} {}\"/>\
             <axis xyz=\"{} {} {}\"/><limit {range} velocity=\"{velocity}\" effort=\"{torque}\"/></joint>",
            if is_endless { "continuous" } else { "revolute" },
            i + 1,
            offset[0],
            offset[1],
            offset[2],
            rpy[0],
            rpy[1],
            rpy[2],
            axis[0],
            axis[1],
            axis[2],
        );
        let range =
            if is_endless { "range_rad = { value = [-6.3, 6.3], assumed = true, reason = \"endless\" }\n" } else { "" };
        let acceleration = velocity * libm::pow(10f64, rng.random_range(0.0..1.5));
        let jerk =
            if rng.random_bool(0.2) { format!("max_jerk_radps3 = {}\n", acceleration * 100.0) } else { String::new() };
        let rotor = rng.random_range(0.0..1.0);
        let _ = writeln!(
            joints,
            "[joints.j{i}]\nmax_acceleration_radps2 = {acceleration}\nrotor_inertia_kgm2 = {rotor}\n{range}{jerk}"
        );
        poses.push(middle);
    }
    let toml = format!(
        "base = {{ position_m = [0.0, 0.0, 0.0], rpy_rad = [0.0, 0.0, 0.0] }}\n\
         flange = {{ position_m = [0.0, 0.05, 0.0], rpy_rad = [0.3, 0.0, 0.0] }}\n\
         poses = {{ comfortable_rad = {poses:?}, ready_rad = {poses:?} }}\n\
         collision = {{ ignored_neighbours = 2, capsules = [] }}\n{joints}"
    );
    [urdf + "</robot>\n", toml]
}

/// Plans catches within the ranges of an arm; returns how many plans there were, or what is wrong with one.
fn plans(robot: &Robot, gripper: &Gripper, rng: &mut Pcg64) -> Result<usize, String> {
    let planner = PosedPlanner::new(MotionPlanner::new(robot.clone(), gripper.clone(), Config::default()));
    let carrying = robot.clone().carrying(gripper);
    let within = |rng: &mut Pcg64, from: &JointVector, far: f64| {
        JointVector::from_fn(|i, _| {
            let Some(joint) = robot.joints.get(i) else { return 0.0 };
            let far = far * (joint.limits.upper - joint.limits.lower);
            (from[i] + rng.random_range(-far..=far)).clamp(joint.limits.lower, joint.limits.upper)
        })
    };
    let mut found = 0;
    for _ in 0..CATCHES {
        let q = within(rng, &robot.ready_q, 0.4);
        let start = Start { time_s: 0.0, state: Setpoint::at_rest(q) };
        let X_WG = carrying.gripper_pose(&within(rng, &q, 0.1));
        let v_WO = Vector3::from_fn(|_, _| rng.random_range(-4.0..4.0));
        let target = Target { catch_s: rng.random_range(0.2..1.5), X_WG, v_WO };
        if let Ok(plan) = planner.catch_at(&start, &target) {
            found += 1;
            let broken = PeakRatios::of(&carrying, &plan.spline).violations();
            if !broken.is_empty() {
                return Err(format!("a plan breaks {broken:?}"));
            }
        }
    }
    Ok(found)
}

/// Arms with numbers `first` to `first + count`; returns how many plans were checked.
fn arms(first: u64, count: u64) -> usize {
    let asset = Asset::built_in(Kind::Gripper, Kind::Gripper.names()[0]).unwrap();
    let gripper = Gripper::from_toml(&asset.file, &asset.text).unwrap();
    let mut found = 0;
    for number in first..first + count {
        let mut rng = Pcg64::seed_from_u64(number);
        let [urdf, toml] = random_files(&mut rng);
        let files = RobotFiles { urdf_file: "robot.urdf", urdf: &urdf, toml_file: "robot.toml", toml: &toml };
        let robot = Robot::from_files(&files).unwrap_or_else(|fault| panic!("arm {number}: {fault}"));
        found += plans(&robot, &gripper, &mut rng).unwrap_or_else(|fault| panic!("arm {number}: {fault}"));
    }
    found
}

#[test]
fn random_arms_keep_their_limits() {
    let found = arms(0, 150);
    assert!(found >= 30, "{found} plans only");
}

#[test]
#[ignore = "some minutes: cargo test --release -p catch_lab -- --ignored ten_thousand_random_arms"]
fn ten_thousand_random_arms_keep_their_limits() {
    let found = arms(1_000, 10_000);
    assert!(found >= 2_000, "{found} plans only");
}

/// The search for a waiting pose ends for any arm, and what it finds is a pose of the arm.
#[test]
#[ignore = "a minute, and 20 reach maps: XDG_CACHE_HOME=$(mktemp -d) cargo test --release -p catch_lab -- --ignored ready_serves"]
fn ready_serves_twenty_random_arms() {
    let folder = tempfile::tempdir().unwrap();
    let mut found = 0;
    for number in 2_000..2_020 {
        let mut rng = Pcg64::seed_from_u64(number);
        let [urdf, toml] = random_files(&mut rng);
        let arm = folder.path().join(format!("arm{number}"));
        std::fs::create_dir(&arm).unwrap();
        std::fs::write(arm.join("robot.urdf"), urdf).unwrap();
        std::fs::write(arm.join("robot.toml"), toml).unwrap();
        let setup = Setup::load(&Choice {
            scenario: Some("paper"),
            robot: arm.join("robot.toml").to_str(),
            throw: Some("random_by_reach"),
            ..Choice::default()
        })
        .unwrap_or_else(|fault| panic!("arm {number}: {fault}"));
        let setups = [setup];
        let robot = &setups[0].robot;
        let corridor = Corridor::new(&setups, 2, 1);
        let best = corridor.search(&robot.ready_q, 10, 1, &mut |_, _| ());
        if let Some(ready) = &best {
            let within_reach = corridor.within_reach(&ready.q);
            assert!(ready.caught <= within_reach && within_reach <= ready.throws, "arm {number}: {ready:?}");
            let within = |(joint, q): (&Joint, &f64)| (joint.limits.lower..=joint.limits.upper).contains(q);
            assert!(robot.joints.iter().zip(ready.q.iter()).all(within), "arm {number}: {ready:?}");
        }
        found += usize::from(best.is_some());
    }
    assert!(found >= 5, "{found} poses only");
}
