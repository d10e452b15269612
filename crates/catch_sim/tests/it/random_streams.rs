//! Properties of the random draws: distributions, independence of each other, and scenes that depend on
//! nothing but their number.

use std::thread;

use catch_body::dynamics;
use catch_sim::{
    ArenaConfig, Conditions, Release, Throw,
    aerodynamics::{Aerodynamics, AerodynamicsConfig},
    config::{Between, Drawn, RobotErrors},
};
use nalgebra::Vector3;

use crate::setting;

const COUNT: u64 = 2000;

/// The largest distance between the empirical distribution of numbers from 0 to 1 and the uniform one
/// (Kolmogorov–Smirnov); above 1.63/√n in one of a hundred samples.
pub fn furthest_from_uniform(mut fractions: Vec<f64>) -> f64 {
    fractions.sort_by(f64::total_cmp);
    let count = fractions.len() as f64;
    let distance = |(i, fraction): (usize, &f64)| {
        (fraction - i as f64 / count).abs().max(((i + 1) as f64 / count - fraction).abs())
    };
    fractions.iter().enumerate().map(distance).fold(0.0, f64::max)
}

fn assert_uniform(what: &str, [low, high]: [f64; 2], values: impl Iterator<Item = f64>) {
    let fractions: Vec<f64> = values.map(|value| (value - low) / (high - low)).collect();
    assert!(fractions.iter().all(|fraction| (-1e-9..=1.0 + 1e-9).contains(fraction)), "{what} beyond its range");
    let (count, furthest) = (fractions.len() as f64, furthest_from_uniform(fractions));
    assert!(furthest < 1.63 / count.sqrt(), "{what}: {furthest}");
}

fn everything() -> ArenaConfig {
    ArenaConfig {
        friction: Drawn::Between(Between { min: 0.4, max: 1.0 }),
        restitution_spread: 0.3,
        drag: true,
        drag_spread: 0.3,
        aerodynamics: AerodynamicsConfig { drag_anisotropy: 0.8, max_magnus: 0.006, max_spin_decay_per_s: 0.6 },
        max_spin_radps: 25.0,
        robot_errors: RobotErrors {
            encoder_sd_rad: 1e-4,
            encoder_step_rad: 5e-5,
            link_mass_spread: 0.03,
            link_surface_sd_m: 1e-3,
            tool_position_m: 1e-3,
            tool_rotation_deg: 0.1,
        },
        ..Default::default()
    }
}

fn random_throw() -> Throw {
    Throw::from_toml("random.toml", include_str!("../../../../assets/throws/random.toml")).unwrap()
}

fn scene(config: &ArenaConfig, index: u64) -> (Conditions, Release) {
    let object = setting::object("banana");
    let conditions = Conditions::draw(config, &object, 7, index);
    let release = random_throw().release("banana", &conditions, 7, index);
    (conditions, release)
}

#[test]
fn materials_air_and_spin_have_their_distributions() {
    let scenes: Vec<Conditions> = (0..COUNT).map(|index| scene(&everything(), index).0).collect();
    assert_uniform("friction", [0.4, 1.0], scenes.iter().map(|it| it.friction));
    assert_uniform("restitution", [0.3 * 0.7, 0.3 * 1.3], scenes.iter().map(|it| it.restitution));
    assert_uniform("drag", [0.05 * 0.7, 0.05 * 1.3], scenes.iter().map(|it| it.drag_per_m));
    assert_uniform("spin", [0.0, 25.0], scenes.iter().map(|it| it.spin_radps.norm()));
    assert_uniform("Magnus coefficient", [0.0, 0.006], scenes.iter().map(|it| it.aerodynamics.magnus));
    assert_uniform("decay of the spin", [0.0, 0.6], scenes.iter().map(|it| it.aerodynamics.spin_decay_per_s));
    // Of three numbers that add up to zero on a circle of radius r, Σx² = 3/2·r².
    let size = |it: &Conditions| it.aerodynamics.drag_deviation_O.norm() / 1.5f64.sqrt();
    assert_uniform("anisotropy of drag", [0.0, 0.8], scenes.iter().map(size));
    let along_first = |it: &Conditions| (it.aerodynamics.drag_deviation_O * Vector3::x()).x / 0.8;
    assert!(
        scenes.iter().all(|it| along_first(it).abs() <= 1.0 && it.aerodynamics.drag_deviation_O.trace().abs() < 1e-12)
    );
    for axis in 0..3 {
        let of_spin = scenes.iter().map(|it| it.spin_radps.normalize()[axis]);
        assert_uniform("axis of the spin", [-1.0, 1.0], of_spin);
        let of_orientation = (0..COUNT).map(|index| (scene(&everything(), index).1.q_WO * Vector3::x())[axis]);
        assert_uniform("orientation", [-1.0, 1.0], of_orientation);
    }
}

#[test]
fn the_robots_errors_have_their_sizes() {
    let model = setting::robot();
    let robots: Vec<_> = (0..COUNT).map(|index| scene(&everything(), index).0.true_robot(&model)).collect();
    for joint in [0, 3, 6] {
        let ratios = robots.iter().map(|it| it.joints[joint].inertia.mass / model.joints[joint].inertia.mass);
        assert_uniform("mass of a link", [0.97, 1.03], ratios);
    }
    for robot in &robots {
        let X_LM = model.X_LG;
        let X_MG = X_LM.inverse() * robot.X_LG;
        assert!((X_MG.translation.vector.norm() - 1e-3).abs() < 1e-9);
        assert!((X_MG.rotation.angle().to_degrees() - 0.1).abs() < 1e-6);
    }
}

/// Common random numbers: what one setting does is seen nowhere else.
#[test]
fn switching_one_thing_on_changes_nothing_else() {
    let all = everything();
    let paper = ArenaConfig::default;
    for index in 0..50 {
        let (full, full_release) = scene(&all, index);
        let (calm, calm_release) = scene(&paper(), index);
        assert_eq!(calm.friction, 0.667);
        assert_eq!((calm.drag_per_m, calm.spin_radps, calm.wind_mps), (0.0, Vector3::zeros(), Vector3::zeros()));
        // Aimed through the air, the same throw leaves faster, but from the same place and in the same
        // orientation.
        assert_eq!((full_release.p_WO, full_release.q_WO), (calm_release.p_WO, calm_release.q_WO));
        assert!(full_release.v_WO.norm() > calm_release.v_WO.norm());
        let mut friction = scene(&ArenaConfig { friction: all.friction, ..paper() }, index).0;
        assert_eq!(friction.friction, full.friction);
        friction.friction = calm.friction;
        assert_eq!(friction, calm);
        let spin = scene(&ArenaConfig { max_spin_radps: 25.0, ..paper() }, index).0;
        assert_eq!(spin.spin_radps, full.spin_radps);
        let drag = scene(&ArenaConfig { drag: true, drag_spread: 0.3, ..paper() }, index).0;
        assert_eq!((drag.drag_per_m, drag.friction), (full.drag_per_m, calm.friction));
        let aerodynamics = scene(&ArenaConfig { aerodynamics: all.aerodynamics, ..paper() }, index);
        assert_eq!(aerodynamics.0.aerodynamics, full.aerodynamics);
        assert_eq!((calm.aerodynamics, aerodynamics.1), (Aerodynamics::default(), calm_release));
        let errors = scene(&ArenaConfig { robot_errors: all.robot_errors, ..paper() }, index).0;
        assert_eq!(errors.true_robot(&setting::robot()), full.true_robot(&setting::robot()));
    }
}

/// Passage of a flight: the point and time nearest to the base's axis, by fine steps, and its momentum about
/// the axis there.
fn passage(conditions: &Conditions, release: &Release) -> (f64, f64, f64, f64) {
    const STEP_S: f64 = 1e-4;
    let (mut p, mut v, mut time_s) = (release.p_WO, release.v_WO, 0.0);
    while p.coords.xy().dot(&v.xy()) < 0.0 {
        let acceleration = dynamics::gravity() + conditions.drag_mps2(&v);
        p += (v + acceleration * (STEP_S / 2.0)) * STEP_S;
        v += acceleration * STEP_S;
        time_s += STEP_S;
    }
    (p.coords.xy().norm(), p.z, time_s, p.x * v.y - p.y * v.x)
}

#[test]
fn random_throws_pass_where_they_should_in_air_and_without() {
    for (config, count) in [(everything(), 300), (ArenaConfig::default(), 300)] {
        let scenes: Vec<(Conditions, Release)> = (0..count).map(|index| scene(&config, index)).collect();
        let passages: Vec<_> = scenes.iter().map(|(conditions, release)| passage(conditions, release)).collect();
        // The fine steps see it within a millimetre and a tenth of a millisecond.
        assert_uniform("distance", [0.35 - 1e-3, 0.85 + 1e-3], passages.iter().map(|it| it.0));
        assert_uniform("height", [0.2 - 2e-3, 1.3 + 2e-3], passages.iter().map(|it| it.1));
        assert_uniform("time", [0.6 - 1e-3, 0.9 + 1e-3], passages.iter().map(|it| it.2));
        assert!(passages.iter().all(|it| it.3 < 0.0), "one passes on the wrong side");
        let place = |release: &Release| release.p_WO.coords.xy();
        assert_uniform("release", [2.0, 4.5], scenes.iter().map(|(_, it)| place(it).norm()));
        let azimuth = |release: &Release| libm::atan2(release.p_WO.y, release.p_WO.x).to_degrees();
        assert_uniform("azimuth", [15.0, 75.0], scenes.iter().map(|(_, it)| azimuth(it)));
    }
}

/// A scene has the same numbers in any order and from any thread.
#[test]
fn a_scene_depends_on_its_number_alone() {
    let config = everything();
    let forwards: Vec<_> = (0..40).map(|index| scene(&config, index)).collect();
    let mut backwards: Vec<_> = (0..40).rev().map(|index| scene(&config, index)).collect();
    backwards.reverse();
    assert_eq!(forwards, backwards);
    let on_threads: Vec<_> = thread::scope(|scope| {
        let threads: Vec<_> = (0..4)
            .map(|part| {
                scope.spawn(move || {
                    (part * 10..part * 10 + 10).map(|index| scene(&everything(), index)).collect::<Vec<_>>()
                })
            })
            .collect();
        threads.into_iter().flat_map(|thread| thread.join().unwrap()).collect()
    });
    assert_eq!(forwards, on_threads);
    let mut places: Vec<u64> = forwards.iter().map(|(_, release)| release.p_WO.x.to_bits()).collect();
    places.sort_unstable();
    places.dedup();
    assert_eq!(places.len(), 40);
}

/// A ball is braked alike from all sides, a bottle all around its axis.
#[test]
fn drag_has_the_symmetry_of_the_object() {
    let config = everything();
    for index in 0..50 {
        let deviation =
            |object: &str| Conditions::draw(&config, &setting::object(object), 7, index).aerodynamics.drag_deviation_O;
        assert!(deviation("tennis_ball").amax() < 1e-12);
        let of_bottle = deviation("pill_bottle").symmetric_eigenvalues();
        let mut sorted = [of_bottle[0], of_bottle[1], of_bottle[2]];
        sorted.sort_by(f64::total_cmp);
        let smallest_gap = (sorted[1] - sorted[0]).min(sorted[2] - sorted[1]);
        assert!(smallest_gap < 1e-9 && deviation("pill_bottle").norm() > 0.0, "{sorted:?}");
    }
}
