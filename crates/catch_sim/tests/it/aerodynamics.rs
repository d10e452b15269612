//! Aerodynamic forces, against SciPy; `tests/golden/README.md` says how the numbers were made.

use catch_cell::Cell;
use catch_sim::{
    Arena, ArenaConfig, Conditions, Equipment, FreeFlight, Release,
    aerodynamics::{Aerodynamics, AerodynamicsConfig},
};
use nalgebra::{Matrix3, Point3, Quaternion, UnitQuaternion, Vector3};
use serde::Deserialize;

use crate::setting;

#[derive(Deserialize)]
struct Golden {
    duration_s: f64,
    cases: Vec<Case>,
}

#[derive(Deserialize)]
struct Case {
    mass_kg: f64,
    inertia_kgm2: [[f64; 3]; 3],
    drag_per_m: f64,
    drag_deviation: [[f64; 3]; 3],
    magnus: f64,
    spin_decay_per_s: f64,
    wind_mps: [f64; 3],
    start_xyzw: [f64; 4],
    start_velocity_mps: [f64; 3],
    start_spin_in_body_radps: [f64; 3],
    end_position_m: [f64; 3],
    end_velocity_mps: [f64; 3],
    end_xyzw: [f64; 4],
    end_spin_radps: [f64; 3],
}

fn matrix(rows: [[f64; 3]; 3]) -> Matrix3<f64> {
    Matrix3::from_fn(|i, j| rows[i][j])
}

fn quaternion([x, y, z, w]: [f64; 4]) -> UnitQuaternion<f64> {
    UnitQuaternion::new_normalize(Quaternion::new(w, x, y, z))
}

#[test]
#[expect(clippy::print_stdout, reason = "the figures of docs/reference/checks.md")]
fn flights_in_air_are_those_of_scipy() {
    let Golden { duration_s, cases } = serde_json::from_str(include_str!("../golden/aerodynamics.json")).unwrap();
    let mut largest = [0.0f64; 4];
    for case in &cases {
        let mut object = setting::object("banana");
        (object.mass_kg, object.inertia_kgm2) = (case.mass_kg, matrix(case.inertia_kgm2));
        let mut conditions = setting::calm("banana");
        (conditions.drag_per_m, conditions.wind_mps) = (case.drag_per_m, case.wind_mps.into());
        conditions.aerodynamics = Aerodynamics {
            drag_deviation_O: matrix(case.drag_deviation),
            magnus: case.magnus,
            spin_decay_per_s: case.spin_decay_per_s,
        };
        let q_WO = quaternion(case.start_xyzw);
        let release = Release {
            q_WO,
            omega_WO: q_WO * Vector3::from(case.start_spin_in_body_radps),
            ..setting::release([0.0; 3], case.start_velocity_mps)
        };
        let steps = (duration_s * 1e3).round() as usize;
        let (X_WO, V_WO) = FreeFlight::new(&object, &release, &conditions, 1e-3).nth(steps).unwrap();
        let off = [
            (X_WO.translation.vector - Vector3::from(case.end_position_m)).norm(),
            (V_WO.linear - Vector3::from(case.end_velocity_mps)).norm(),
            X_WO.rotation.angle_to(&quaternion(case.end_xyzw)),
            (V_WO.angular - Vector3::from(case.end_spin_radps)).norm(),
        ];
        for (most, off) in largest.iter_mut().zip(off) {
            *most = most.max(off);
        }
    }
    assert_eq!(cases.len(), 20);
    println!(
        "off by at most {:.1e} m, {:.1e} m/s, {:.1e} rad, {:.1e} rad/s",
        largest[0], largest[1], largest[2], largest[3]
    );
    assert!(largest[0] < 1e-5 && largest[1] < 1e-4 && largest[2] < 1e-4 && largest[3] < 2e-3, "{largest:?}");
}

/// An object flies in the arena as in the oracle.
#[test]
fn the_arena_flies_as_free_flight_has_it() {
    let aerodynamics = AerodynamicsConfig { drag_anisotropy: 0.9, max_magnus: 0.02, max_spin_decay_per_s: 1.0 };
    let wind = [1.0, -1.0, 0.0];
    let config = ArenaConfig { drag: true, aerodynamics, wind, max_spin_radps: 25.0, ..ArenaConfig::default() };
    let (robot, object) = (setting::robot(), setting::object("banana"));
    let equipment = Equipment::new(config.clone(), robot.clone(), setting::gripper(), object.clone(), Vec::new());
    for index in 0..5 {
        let conditions = Conditions::draw(&config, &object, 3, index);
        let release = Release {
            p_WO: Point3::new(5.0, 5.0, 2.0),
            omega_WO: conditions.spin_radps,
            ..setting::release([0.0; 3], [2.0, 4.0, 4.0])
        };
        let mut arena = Arena::new(&equipment, &release, (&robot.ready_q, setting::WIDTH_M), 3, index);
        while arena.time_s() < 0.7 {
            let Ok(_) = arena.sense();
        }
        let last = *arena.truth().samples.last().unwrap();
        let step = arena.truth().samples.len() - 1;
        let (X_WO, V_WO) = FreeFlight::new(&object, &release, &conditions, config.step_s).nth(step).unwrap();
        let mut calm = conditions;
        calm.aerodynamics = Aerodynamics::default();
        let (X_calm, _) = FreeFlight::new(&object, &release, &calm, config.step_s).nth(step).unwrap();
        let off_m = |X: &catch_body::Pose| (last.X_WO.translation.vector - X.translation.vector).norm();
        assert!(off_m(&X_WO) < 1e-6 && off_m(&X_calm) > 3e-3, "{index}: {} {}", off_m(&X_WO), off_m(&X_calm));
        assert!(last.X_WO.rotation.angle_to(&X_WO.rotation) < 1e-9);
        assert!((last.V_WO.angular - V_WO.angular).norm() < 1e-9);
    }
}
