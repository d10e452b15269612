//! The object in free flight, against laws of mechanics and against SciPy; `tests/golden/README.md` says how
//! the numbers were made.

use catch_body::{InputError, Pose, TriangleMesh, Twist};
use catch_sim::{Release, ThrownObject, free_flight::coasted, physics::World};
use nalgebra::{Matrix3, Point3, Quaternion, UnitQuaternion, Vector3};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;
use serde::Deserialize;

use crate::setting;

const FLIGHT_STEPS: u32 = 700;

/// The object far above everything, after 0.7 s in steps of 1 ms.
fn flown(object: &ThrownObject, q_WO: UnitQuaternion<f64>, omega_WO: Vector3<f64>) -> World {
    let release = Release { q_WO, omega_WO, ..setting::release([9.0, 9.0, 9.0], [1.0, -2.0, 3.0]) };
    let hand = Point3::new(0.0, 0.0, 2.0);
    let mut world = setting::fixed_hand(setting::settings(0.6, 0.5), hand, &setting::gripper(), 0.1, object, &release);
    for _ in 0..FLIGHT_STEPS {
        assert!(world.step(&setting::no_loads()));
    }
    world
}

/// Angular momentum in W and twice the energy of rotation.
fn momentum_and_energy(
    inertia: &Matrix3<f64>,
    q_WO: &UnitQuaternion<f64>,
    omega_WO: &Vector3<f64>,
) -> (Vector3<f64>, f64) {
    let L_W = q_WO * (inertia * (q_WO.inverse() * omega_WO));
    (L_W, L_W.dot(omega_WO))
}

/// A random object of one of the four kinds, 5 g to 1 kg.
fn random_object(kind: usize, random: &mut Pcg64) -> ThrownObject {
    let mut between = |low: f64, high: f64| random.random_range(low..high);
    let mass_kg = libm::exp(between(libm::log(0.005f64), 0.0));
    let half = [between(0.005, 0.08), between(0.005, 0.08), between(0.005, 0.08)];
    let shape = match kind {
        0 => format!("kind = \"ball\"\ndiameter_m = {}\nhollow = true", half[0] + 0.02),
        1 => format!("kind = \"revolution\"\nprofile_m = [[0, {}], [0.03, {}], [0.08, {}]]", half[0], half[1], half[2]),
        2 => format!(
            "kind = \"bent_tube\"\narc_radius_m = 0.1\narc_angle_deg = {}\nradii_m = [{}, {}]",
            between(20.0, 120.0),
            half[0],
            half[1]
        ),
        _ => "kind = \"mesh\"\nfile = \"brick.obj\"".to_owned(),
    };
    // A brick that is turned in its file, so that its principal axes are not those of the file.
    let turn =
        UnitQuaternion::from_scaled_axis(Vector3::new(between(-2.0, 2.0), between(-2.0, 2.0), between(-2.0, 2.0)));
    let obj = |_: &str| {
        let brick = TriangleMesh::cuboid(&catch_body::shape::Cuboid {
            centre: Point3::origin(),
            size: Vector3::from(half) * 2.0,
        });
        let vertices = brick.vertices.iter().map(|it| turn * it).map(|it| format!("v {} {} {}\n", it.x, it.y, it.z));
        let faces = brick.triangles.iter().map(|it| format!("f {} {} {}\n", it[0] + 1, it[1] + 1, it[2] + 1));
        Ok::<_, InputError>(vertices.chain(faces).collect::<String>().into_bytes())
    };
    let text = format!(
        "name = \"random\"\n[truth]\nmass_kg = {mass_kg}\nrestitution = 0.5\ndrag_per_m = 0\n\
         [truth.shape]\n{shape}\n[prior]\ndrag_per_m = 0\ndrag_sd_per_m = 0\n"
    );
    ThrownObject::from_toml("random.toml", &text, &obj).unwrap()
}

/// A flight that goes on for a while and as long back ends where it began.
#[test]
fn a_free_body_coasts_back_to_where_it_came_from() {
    let mut random = Pcg64::seed_from_u64(2);
    for i in 0..20 {
        let object = random_object(i % 4, &mut random);
        let mut vector = || Vector3::from_fn(|_, _| random.random_range(-1.0..1.0));
        let X_WO = Pose::from_parts(vector().into(), UnitQuaternion::from_scaled_axis(vector() * 3.0));
        let V_WO = Twist { angular: vector() * 20.0, linear: vector() * 5.0 };
        let (X_later, V_later) = coasted(&object, (&X_WO, &V_WO), 0.3);
        let (X_back, V_back) = coasted(&object, (&X_later, &V_later), -0.3);
        let turned = X_back.rotation.angle_to(&X_WO.rotation);
        assert!(turned < 1e-3 && (V_back.angular - V_WO.angular).norm() < 0.05, "{i}: {turned} rad");
        assert!((X_back.translation.vector - X_WO.translation.vector).norm() < 1e-9);
    }
}

/// Momentum to a rounding error and energy to that of integration, whatever the shape.
#[test]
#[expect(clippy::print_stdout, reason = "the figure of docs/reference/checks.md")]
fn a_free_body_keeps_momentum_and_energy() {
    let mut random = Pcg64::seed_from_u64(1);
    let mut worst = [0.0f64; 2];
    for i in 0..100 {
        let object = random_object(i % 4, &mut random);
        let mut vector = || Vector3::from_fn(|_, _| random.random_range(-1.0..1.0));
        let q_WO = UnitQuaternion::from_scaled_axis(vector() * 3.0);
        let omega_WO = vector().normalize() * 25.0;
        let state = flown(&object, q_WO, omega_WO).state();
        let (before, energy_before) = momentum_and_energy(&object.inertia_kgm2, &q_WO, &omega_WO);
        let (after, energy_after) =
            momentum_and_energy(&object.inertia_kgm2, &state.X_WO.rotation, &state.V_WO.angular);
        let drift = (after - before).norm() / before.norm();
        let gain = (energy_after / energy_before - 1.0).abs();
        assert!(drift < 1e-9 && gain < 1e-6, "{i}: momentum off by {drift}, energy by {gain}");
        worst = [worst[0].max(drift), worst[1].max(gain)];
        let t = f64::from(FLIGHT_STEPS) * 1e-3;
        let fall = Vector3::new(9.0, 9.0, 9.0) + Vector3::new(1.0, -2.0, 3.0) * t - Vector3::z() * (9.81 / 2.0 * t * t);
        assert!((state.X_WO.translation.vector - fall).norm() < 1e-9);
        assert!((state.V_WO.linear - Vector3::new(1.0, -2.0, 3.0 - 9.81 * t)).norm() < 1e-9);
    }
    println!("angular momentum off by {:.1e} at most, energy by {:.1e}", worst[0], worst[1]);
}

#[derive(Deserialize)]
struct Golden {
    duration_s: f64,
    cases: Vec<Case>,
}

#[derive(Deserialize)]
struct Case {
    mass_kg: f64,
    inertia_kgm2: [[f64; 3]; 3],
    start_xyzw: [f64; 4],
    spin_in_body_radps: [f64; 3],
    end_xyzw: [f64; 4],
}

#[test]
#[expect(clippy::print_stdout, reason = "the figure of docs/reference/checks.md")]
fn orientation_follows_eulers_equations() {
    let Golden { duration_s, cases } = serde_json::from_str(include_str!("../golden/free_rotation.json")).unwrap();
    assert!((duration_s - f64::from(FLIGHT_STEPS) * 1e-3).abs() < 1e-12);
    let quaternion = |it: [f64; 4]| UnitQuaternion::new_normalize(Quaternion::new(it[3], it[0], it[1], it[2]));
    let mut largest = 0.0f64;
    for case in &cases {
        let mut object = setting::object("banana");
        object.mass_kg = case.mass_kg;
        object.inertia_kgm2 = Matrix3::from_fn(|i, j| case.inertia_kgm2[i][j]);
        let q_WO = quaternion(case.start_xyzw);
        let state = flown(&object, q_WO, q_WO * Vector3::from(case.spin_in_body_radps)).state();
        largest = largest.max(state.X_WO.rotation.angle_to(&quaternion(case.end_xyzw)));
    }
    assert_eq!(cases.len(), 20);
    println!("orientation off by {largest:.1e} rad at most");
    assert!(largest < 2e-5, "{largest} rad");
}
