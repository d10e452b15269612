//! Features of the paper's simulator that a robot does not have: references that jump, a sensor that closes
//! the gripper, bodies that do not exist.

use catch_body::JointVector;
use catch_cell::{ArmTrajectory, BSpline, Cell, Command, TrajectoryId};
use catch_sim::{
    Arena, ArenaConfig, Conditions, Equipment, FreeFlight, GripperDriveKind, Release,
    config::{GripperTrigger, RobotController},
    free_flight::coasted,
    physics::World,
};
use nalgebra::{Point3, UnitQuaternion, Vector3};

use crate::setting;

fn senses(arena: &mut Arena, count: usize) {
    for _ in 0..count {
        let Ok(_) = arena.sense();
    }
}

#[test]
fn references_that_jump_are_followed_by_all_the_torque_that_it_takes() {
    let from = setting::robot().ready_q;
    let spline = BSpline::at_rest(0.0, from + JointVector::ith(0, 0.5));
    for takes_jumps in [false, true] {
        let robot_controller = RobotController { takes_jumps, unlimited_torque: true, ..RobotController::default() };
        let config = ArenaConfig { robot_controller, ..ArenaConfig::default() };
        let mut arena = setting::arena(&config, "tennis_ball", &setting::release([9.0, 9.0, 9.0], [0.0; 3]), &from);
        senses(&mut arena, 1);
        let arm = Some(ArmTrajectory { id: TrajectoryId(1), spline: spline.clone() });
        let Ok(()) = arena.act(&Command { arm, ..Command::default() });
        senses(&mut arena, 20);
        let truth = arena.truth();
        let by_rad = truth.samples.last().unwrap().q[0] - from[0];
        assert_eq!(truth.servo.accepted_trajectories, u32::from(takes_jumps));
        assert!((by_rad - if takes_jumps { 0.5 } else { 0.0 }).abs() < 2e-3, "{by_rad}");
        assert_eq!(truth.servo.peak_torque_ratio > 1.0, takes_jumps, "{:?}", truth.servo);
        assert_eq!(truth.servo.torque_clamped_s, 0.0);
        // Nothing is overlooked.
        assert_eq!(truth.servo.motion_violations.is_empty(), !takes_jumps);
    }
}

/// The sensor sees along the passing direction only: a ball 0.2 m aside closes the fingers, and they stay
/// closed.
#[test]
fn the_sensor_closes_the_gripper_whatever_is_commanded() {
    let robot = setting::robot();
    let X_WG = robot.gripper_pose(&robot.ready_q);
    for (aside_m, closes) in [(0.2, true), (0.3, false)] {
        let release = Release {
            p_WO: X_WG * Point3::new(0.0, aside_m, 0.2),
            v_WO: X_WG * Vector3::new(0.0, 0.0, -4.0),
            ..setting::release([0.0; 3], [0.0; 3])
        };
        let config = ArenaConfig {
            gripper: GripperDriveKind::Position,
            gripper_trigger: GripperTrigger::Proximity,
            ..ArenaConfig::default()
        };
        let mut arena = setting::arena(&config, "tennis_ball", &release, &robot.ready_q);
        senses(&mut arena, 12);
        let samples = &arena.truth().samples;
        let seen =
            samples.iter().position(|it| it.X_WG.inverse_transform_point(&it.X_WO.translation.vector.into()).z < 0.01);
        let (before, after) = samples.split_at(seen.unwrap());
        assert!(before.iter().all(|it| it.width_m > 0.1099));
        assert_eq!(after.last().unwrap().width_m < 1e-3, closes, "{}", after.last().unwrap().width_m);
        // The 22 mm on each side to a tennis ball take 3 ms.
        if closes {
            let steps = after.iter().position(|it| it.width_m < 0.067).unwrap();
            assert!((2..=4).contains(&steps), "{steps} ms");
        }
    }
}

/// A body without contact turns about its centre of mass, wherever the origin of its frame is.
#[test]
fn what_turns_about_another_centre_of_mass_keeps_it_on_its_parabola() {
    let bottle = setting::object("pill_bottle");
    let published = *bottle.as_published.unwrap();
    assert_eq!(bottle.com_O, Point3::origin());
    let com_O = published.com_O;
    assert!(com_O.coords.norm() > 0.08);
    let release =
        Release { omega_WO: Vector3::new(3.0, -2.0, 5.0), ..setting::release([0.0, 0.0, 3.0], [1.0, 2.0, 3.0]) };
    let p_WG = Point3::new(9.0, 9.0, 9.0);
    let gripper = setting::gripper();
    let mut world: World =
        setting::fixed_hand(setting::settings(0.6, 0.3), p_WG, &gripper, gripper.max_width_m, &published, &release);
    let start = world.state();
    let of_com = |state: &catch_sim::physics::WorldState| state.X_WO * com_O;
    let v = start.V_WO.linear + start.V_WO.angular.cross(&(start.X_WO * com_O.coords));
    assert!((start.V_WO.linear - release.v_WO).norm() < 1e-12);
    for step in 1..=300 {
        world.step(&setting::no_loads());
        let t = f64::from(step) * 1e-3;
        let expected = of_com(&start) + v * t + Vector3::new(0.0, 0.0, -9.81) * (t * t / 2.0);
        assert!((of_com(&world.state()) - expected).norm() < 1e-9, "{step}");
    }
    assert!((world.state().X_WO.rotation.angle_to(&start.X_WO.rotation)) > 0.5);
}

/// Prediction from one sample of a tumbling bottle whose centre of mass lies 87 mm from O: the origin of O,
/// from its velocity there, by `coasted` and from the release on by `FreeFlight`.
#[test]
fn free_flight_is_that_of_the_centre_of_mass() {
    let published = *setting::object("pill_bottle").as_published.unwrap();
    let release = Release {
        q_WO: UnitQuaternion::from_euler_angles(0.4, 1.0, -0.7),
        omega_WO: Vector3::new(9.0, -14.0, 5.0),
        ..setting::release([5.0, 5.0, 5.0], [1.0, 2.0, 3.0])
    };
    for drag in [false, true] {
        let config = ArenaConfig { published_bodies: true, drag, ..ArenaConfig::default() };
        let equipment =
            Equipment::new(config.clone(), setting::robot(), setting::gripper(), published.clone(), Vec::new());
        let mut arena = Arena::new(&equipment, &release, (&setting::robot().ready_q, setting::WIDTH_M), 0, 0);
        senses(&mut arena, 41);
        let samples = &arena.truth().samples;
        let conditions = Conditions::draw(&config, &published, 0, 0);
        for (sample, (X_WO, V_WO)) in samples.iter().zip(FreeFlight::new(&published, &release, &conditions, 1e-3)) {
            let off_m = (sample.X_WO.translation.vector - X_WO.translation.vector).norm();
            assert!(off_m < 1e-6, "{off_m} m after {} s", sample.time_s);
            assert!((sample.V_WO.linear - V_WO.linear).norm() < 1e-5);
        }
        let [from, to] = [&samples[50], &samples[300]];
        let (X_WO, V_WO) = coasted(&published, (&from.X_WO, &from.V_WO), to.time_s - from.time_s);
        let off_m = (X_WO.translation.vector - to.X_WO.translation.vector).norm();
        assert_eq!(off_m < 1e-6, !drag, "{off_m} m in 0.25 s");
        assert_eq!((V_WO.linear - to.V_WO.linear).norm() < 1e-5, !drag);
        // The origin itself is no body in free fall.
        let t = to.time_s - from.time_s;
        let as_if = from.X_WO.translation.vector + from.V_WO.linear * t + Vector3::new(0.0, 0.0, -9.81) * (t * t / 2.0);
        assert!((as_if - to.X_WO.translation.vector).norm() > 0.02);
    }
}

/// The authors' banana bulges the other way, and is seen from the origin of their frame. The box is that of
/// their mesh.
#[test]
fn the_published_banana_has_the_box_of_the_authors_mesh() {
    let banana = setting::object("banana");
    let published = banana.as_published.as_deref().unwrap();
    let from_origin: Vec<Vector3<f64>> =
        published.mesh.vertices.iter().map(|vertex| vertex - published.origin_O).collect();
    let corner = |of: fn(f64, f64) -> f64| from_origin.iter().copied().reduce(|a, b| a.zip_map(&b, of)).unwrap();
    let (low, high) = (Vector3::new(-0.0151, -0.0082, -0.0852), Vector3::new(0.0151, 0.0533, 0.0906));
    assert!((corner(f64::min) - low).amax() < 2e-3 && (corner(f64::max) - high).amax() < 2e-3);
    assert!((published.com_O - published.origin_O - Vector3::new(0.0, 0.0236, -0.0134)).norm() < 1e-12);
    assert!(published.mesh.vertices != banana.mesh.vertices);
}

/// The arena of the scenario `as-published`.
fn as_published() -> ArenaConfig {
    let scenario: toml::Table = toml::from_str(include_str!("../../../../assets/scenarios/as-published.toml")).unwrap();
    scenario["arena"].clone().try_into().unwrap()
}

/// A controller that computes by a lighter arm's dynamics lets the arm sag, against inertias that are not
/// those of that arm either: within a tenth as fast as in Drake 1.24, where joints 2 and 4 are at these
/// velocities after 49 ms.
#[test]
fn an_arm_that_is_taken_for_another_sags_as_in_the_papers_simulator() {
    let start = setting::robot().joint_vector(&[1.57, 0.5, 0.0, -1.2, 0.0, 0.8, 1.57]).unwrap();
    let release = setting::release([9.0, 9.0, 9.0], [0.0; 3]);
    let mut arena = setting::arena(&as_published(), "tennis_ball", &release, &start);
    senses(&mut arena, 12);
    let sample = arena.truth().samples.iter().find(|sample| sample.time_s > 0.0485).unwrap();
    for (joint, expected_radps) in [(1, 0.0797), (3, -0.0738)] {
        let ratio = sample.dq[joint] / expected_radps;
        assert!((0.9..1.1).contains(&ratio), "{joint}: {ratio}");
    }
}
