//! The arm falling freely, against MuJoCo; `tests/golden/README.md` says how the numbers were made.

use catch_sim::physics::{World, WorldSettings};
use serde::Deserialize;

use crate::setting;

#[derive(Deserialize)]
struct Golden {
    gripper_width_m: f64,
    cases: Vec<Case>,
}

#[derive(Deserialize)]
struct Case {
    start: String,
    rotors_and_damping: bool,
    samples: Vec<Sample>,
}

#[derive(Deserialize)]
struct Sample {
    time_s: f64,
    q: Vec<f64>,
}

/// The largest joint error over a free motion in steps of this length.
fn largest_error(case: &Case, width_m: f64, step_s: f64) -> f64 {
    let (mut robot, gripper) = (setting::robot(), setting::gripper());
    // High enough that nothing reaches the floor, which the golden arm does not have.
    robot.X_WB.translation.z += 3.0;
    if !case.rotors_and_damping {
        for joint in &mut robot.joints {
            (joint.rotor_inertia, joint.damping) = (0.0, 0.0);
        }
    }
    let q = robot.joint_vector(&case.samples[0].q).unwrap();
    let (object, release) = (setting::object("tennis_ball"), setting::release([9.0, 9.0, 9.0], [0.0; 3]));
    let settings = WorldSettings { step_s, ..setting::settings(0.6, 0.0) };
    let mut world = World::new(settings, (&robot, &q), &gripper, width_m, (&object, &release));
    let mut drive = setting::ideal_drive(&gripper, width_m);
    let mut largest = 0.0f64;
    let mut step = 0u32;
    for sample in &case.samples {
        while f64::from(step) * step_s < sample.time_s - 1e-9 {
            let state = world.state();
            let mut loads = setting::no_loads();
            loads.finger_force_n = drive.forces(f64::from(step) * step_s, state.finger_m, state.finger_mps);
            world.step(&loads);
            step += 1;
        }
        largest = largest.max((world.state().q - robot.joint_vector(&sample.q).unwrap()).amax());
    }
    largest
}

fn golden() -> Golden {
    serde_json::from_str(include_str!("../golden/free_motion.json")).unwrap()
}

/// Falls with rotors and damping, as the arm is.
#[test]
fn the_arm_falls_as_in_mujoco() {
    let Golden { gripper_width_m, cases } = golden();
    let mut cases_seen = 0;
    for case in cases.iter().filter(|case| case.rotors_and_damping) {
        let error = largest_error(case, gripper_width_m, 1e-3);
        assert!(error <= 0.001, "{}: {error} rad", case.start);
        cases_seen += 1;
    }
    assert_eq!(cases_seen, 3);
}

/// Without rotors and damping the arm is chaotic: its wrist turns at tens of rad/s, and errors of integration
/// grow tenfold in 0.1 s. What remains is discretization: it vanishes in proportion to the step, as fingers
/// are at their stops.
#[test]
fn a_bare_chain_of_links_falls_as_in_mujoco() {
    let Golden { gripper_width_m, cases } = golden();
    for case in cases.iter().filter(|case| !case.rotors_and_damping) {
        let [coarse, finer] = [1e-3, 2.5e-4].map(|step_s| largest_error(case, gripper_width_m, step_s));
        assert!(coarse <= 0.012, "{}: {coarse} rad", case.start);
        assert!((0.2..0.3).contains(&(finer / coarse)), "{}: {coarse} then {finer}", case.start);
    }
}
