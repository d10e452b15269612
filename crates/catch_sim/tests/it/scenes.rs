//! Whole scenes: free flight, the same scene twice, catches that hold, and what happens when numbers go bad.

use std::sync::Arc;

use catch_body::{JointVector, Twist};
use catch_cell::{Cell, Command, GripperMove};
use catch_sim::{
    Arena, ArenaConfig, Release, Throw, TruthSample,
    throw::{RecordedFlight, RecordedState},
};
use nalgebra::{Point3, UnitQuaternion, Vector3};

use crate::setting;

fn arena(config: &ArenaConfig, object: &str, release: &Release) -> Arena {
    setting::arena(config, object, release, &setting::robot().ready_q)
}

fn near() -> Throw {
    Throw::from_toml("near.toml", include_str!("../../../../assets/throws/near.toml")).unwrap()
}

fn sample_at(arena: &Arena, time_s: f64) -> &TruthSample {
    arena.truth().samples.iter().find(|sample| (sample.time_s - time_s).abs() < 1e-9).unwrap()
}

/// Without air the centre of mass follows the parabola exactly, whatever the object.
#[test]
fn free_flight_is_a_parabola() {
    for object in ["tennis_ball", "banana", "pill_bottle"] {
        // From above and away from the arm.
        let mut release = near().release(object, &setting::calm(object), 0, 0);
        release.p_WO += Vector3::new(5.0, 5.0, 5.0);
        release.omega_WO = Vector3::new(3.0, -8.0, 5.0);
        let mut arena = arena(&ArenaConfig::default(), object, &release);
        for _ in 0..71 {
            let Ok(_) = arena.sense();
        }
        for sample in &arena.truth().samples {
            let t = sample.time_s;
            let expected = release.p_WO + release.v_WO * t - Vector3::z() * (0.5 * 9.81 * t * t);
            let error = (sample.X_WO.translation.vector - expected.coords).norm();
            assert!(error < 1e-6, "{object} at {t} s: {error} m");
        }
    }
}

/// A body that spins freely keeps its angular momentum and its energy.
#[test]
fn free_spin_keeps_momentum_and_energy() {
    for object in ["banana", "pill_bottle"] {
        let mut release = setting::release([5.0, 5.0, 9.0], [0.0, 0.0, 3.0]);
        release.omega_WO = Vector3::new(10.0, -15.0, 8.0);
        let inertia = setting::object(object).inertia_kgm2;
        let mut arena = arena(&ArenaConfig::default(), object, &release);
        for _ in 0..101 {
            let Ok(_) = arena.sense();
        }
        let momentum = |sample: &TruthSample| {
            let R_WO = sample.X_WO.rotation.to_rotation_matrix();
            R_WO.matrix() * inertia * R_WO.matrix().transpose() * sample.V_WO.angular
        };
        let samples = &arena.truth().samples;
        let (first, last) = (&samples[0], samples.last().unwrap());
        let drift = (momentum(last) - momentum(first)).norm() / momentum(first).norm();
        let energy = |sample: &TruthSample| sample.V_WO.angular.dot(&momentum(sample));
        let gain = (energy(last) / energy(first) - 1.0).abs();
        assert!(drift < 0.02 && gain < 0.02, "{object}: momentum off by {drift}, energy by {gain}");
    }
}

/// Drag against a fine integration of v̇ = g − k·|v|·v.
#[test]
fn drag_slows_the_object_as_it_should() {
    let config = ArenaConfig { drag: true, ..Default::default() };
    let mut release = near().release("tennis_ball", &setting::calm("tennis_ball"), 0, 0);
    release.p_WO += Vector3::new(5.0, 5.0, 5.0);
    let mut arena = arena(&config, "tennis_ball", &release);
    for _ in 0..71 {
        let Ok(_) = arena.sense();
    }
    let (mut p, mut v) = (release.p_WO.coords, release.v_WO);
    let h = 1e-6;
    for _ in 0..700_000 {
        let before = v;
        v += (Vector3::new(0.0, 0.0, -9.81) - v * (0.0187 * v.norm())) * h;
        p += (before + v) * (h / 2.0);
    }
    let error = (sample_at(&arena, 0.7).X_WO.translation.vector - p).norm();
    assert!(error < 2e-4, "{error} m");
}

/// A scene computed twice gives the same truth, byte for byte.
#[test]
fn the_same_scene_gives_the_same_truth() {
    let run = || {
        // Onto the arm, the gripper closing meanwhile: every kind of contact.
        let release = Release {
            p_WO: Point3::new(0.1, 0.05, 2.2),
            v_WO: Vector3::new(0.1, 0.0, -2.0),
            q_WO: UnitQuaternion::from_euler_angles(0.3, 0.2, 0.1),
            omega_WO: Vector3::new(4.0, 5.0, 6.0),
            path: None,
        };
        let mut arena = arena(&ArenaConfig::default(), "banana", &release);
        arena.disturb_after_contact(1.0);
        let Ok(_) = arena.sense();
        let close = GripperMove { start_s: 0.1, width_m: 0.0, speed_mps: 2.0, force_n: 60.0 };
        let Ok(()) = arena.act(&Command { gripper: Some(vec![close]), ..Default::default() });
        for _ in 0..100 {
            let Ok(_) = arena.sense();
        }
        serde_json::to_vec(arena.truth()).unwrap()
    };
    let first = run();
    let truth: catch_sim::Truth = serde_json::from_slice(&first).unwrap();
    assert!(truth.samples.iter().any(|sample| sample.contact.arm));
    assert_eq!(truth.samples.len(), 1001);
    assert!(run() == first);
}

/// Objects laid between the fingers of the waiting arm are caught, held and survive the shaking.
#[test]
fn the_arm_holds_what_it_has_grasped() {
    let robot = setting::robot();
    let gripper = setting::gripper();
    for object in ["tennis_ball", "pill_bottle", "banana"] {
        let X_WG = robot.gripper_pose(&robot.ready_q);
        let release = Release {
            p_WO: X_WG * gripper.grasp_centre(),
            v_WO: Vector3::zeros(),
            q_WO: X_WG.rotation,
            omega_WO: Vector3::zeros(),
            path: None,
        };
        let mut arena = arena(&ArenaConfig::default(), object, &release);
        arena.disturb_after_contact(1.0);
        let Ok(_) = arena.sense();
        let close = GripperMove { start_s: 0.0, width_m: 0.0, speed_mps: 2.0, force_n: 80.0 };
        let Ok(()) = arena.act(&Command { gripper: Some(vec![close]), ..Default::default() });
        for _ in 0..160 {
            let Ok(_) = arena.sense();
        }
        let truth = arena.truth();
        let contact_s = truth.samples.iter().find(|it| it.contact.gripper()).unwrap().time_s;
        let disturbed_s = truth.disturbed_since_s.unwrap();
        assert!((disturbed_s - contact_s - 1.0).abs() < 1.5e-3, "{object}: {contact_s}, {disturbed_s}");
        let (mut fastest_still, mut fastest_shaken) = (0.0f64, 0.0f64);
        for sample in truth.samples.iter().filter(|sample| sample.time_s > 0.5) {
            assert!(sample.contact.left_finger && sample.contact.right_finger, "{object} at {}", sample.time_s);
            assert!(!sample.contact.floor && !sample.contact.arm);
            let relative = relative_speed(sample);
            let fastest = if sample.time_s <= disturbed_s { &mut fastest_still } else { &mut fastest_shaken };
            *fastest = fastest.max(relative);
        }
        assert!(fastest_still < 0.02 && fastest_shaken < 0.05, "{object}: {fastest_still}, {fastest_shaken} m/s");
        assert_eq!(truth.diverged_s, None);
    }
}

/// Speed of the object's centre of mass in the moving gripper.
fn relative_speed(sample: &TruthSample) -> f64 {
    let Twist { linear, .. } = sample.V_WO;
    let offset = sample.X_WO.translation.vector - sample.X_WG.translation.vector;
    (linear - sample.V_WG.velocity_at(&offset)).norm()
}

/// A state that is not finite stops the physics; what is sensed stays finite, and the truth tells.
#[test]
fn numbers_that_go_bad_are_contained() {
    let mut release = setting::release([5.0, 5.0, 5.0], [0.0; 3]);
    release.omega_WO = Vector3::repeat(1e200);
    let mut arena = arena(&ArenaConfig::default(), "banana", &release);
    for _ in 0..5 {
        let Ok(observation) = arena.sense();
        assert!(observation.arm.q.iter().all(|value| value.is_finite()));
    }
    let truth = arena.truth();
    assert!(truth.diverged_s.is_some());
    assert_eq!(truth.samples.len(), 41);
    let last = truth.samples.last().unwrap();
    assert!(last.X_WO.translation.vector.iter().chain(last.q.iter()).all(|value| value.is_finite()));
    assert!(last.q != JointVector::zeros());
}

/// An object that moves along a recording is where it was recorded until something touches it or the
/// recording ends.
#[test]
fn a_recorded_flight_is_followed_until_a_contact() {
    let height_m = |time_s: f64| 1.0 - 2.0 * time_s;
    let state = |i: u32| RecordedState {
        time_s: 0.1 * f64::from(i),
        position: Point3::new(5.0, 5.0, height_m(0.1 * f64::from(i))),
        velocity: Vector3::new(0.0, 0.0, -2.0),
        rotation: None,
    };
    for (ends_s, is_touched) in [(0.3, false), (1.0, true)] {
        let states: Vec<RecordedState> = (0..=10).map(state).filter(|it| it.time_s < ends_s + 0.01).collect();
        let path = RecordedFlight::new(states).map(Arc::new);
        let release = Release { path, ..setting::release([5.0, 5.0, 1.0], [0.0, 0.0, -2.0]) };
        let mut arena = arena(&ArenaConfig::default(), "tennis_ball", &release);
        while arena.time_s() < 0.6 {
            let Ok(_) = arena.sense();
        }
        let samples = &arena.truth().samples;
        let touched = samples.iter().find(|it| it.contact.any()).map_or(f64::INFINITY, |it| it.time_s);
        let mut followed = samples.iter().take_while(|it| it.time_s < ends_s.min(touched) - 1e-3);
        assert!(followed.all(|it| (it.X_WO.translation.z - height_m(it.time_s)).abs() < 1e-9));
        let last = samples.iter().take_while(|it| it.time_s < touched).last().unwrap();
        // Gravity has it again where the recording ends.
        assert_eq!(last.V_WO.linear.z < -2.05, !is_touched, "{}", last.V_WO.linear.z);
        assert!(samples.last().unwrap().V_WO.linear.z > -2.0, "the floor has stopped it");
    }
}
