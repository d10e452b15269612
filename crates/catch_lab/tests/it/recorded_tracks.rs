//! Flights through recorded tracks: tracks made by tiny steps, with noise, outliers, gaps, hands and
//! contacts.

use catch_lab::flights::{
    flight_learning::lessons,
    flight_misses::{Misses, Reliability, Throw},
    flight_prediction::{FlightStatus, predict},
    track_file::Sighting,
};
use nalgebra::{Matrix3, Point3, Unit, UnitQuaternion, Vector3};
use rand::{RngExt, SeedableRng};
use rand_distr::StandardNormal;
use rand_pcg::Pcg64Mcg;

/// Settings of a throw that is made.
#[derive(Clone, Copy)]
struct Made {
    /// Drag along the axes of the body, in 1/m.
    drag: [f64; 3],
    /// Lift s of a = s × v in the world, in 1/s.
    lift: Vector3<f64>,
    /// Decay of the lift, in 1/s.
    lift_decay: f64,
    /// True if the object tumbles and its orientation is tracked, 2 cm beside the centre of mass.
    tumbles: bool,
    floor_m: f64,
}

const BALL: Made =
    Made { drag: [0.05; 3], lift: Vector3::new(0.0, 0.0, 0.0), lift_decay: 0.0, tumbles: false, floor_m: -9.0 };
const TUMBLING: Made = Made { drag: [0.1, 0.06, 0.03], tumbles: true, ..BALL };
const RATE_HZ: f64 = 200.0;
const ROWS: usize = 130;

/// A throw with noise of 0.5 mm and 5 mrad; z is up.
fn thrown(seed: u64, made: &Made) -> Vec<Sighting> {
    let mut random = Pcg64Mcg::seed_from_u64(seed);
    let mut normal = |sd: f64| Vector3::from_fn(|_, _| sd * random.sample::<f64, _>(StandardNormal));
    let r = if made.tumbles { Vector3::new(0.01, -0.015, 0.005) } else { Vector3::zeros() };
    let drag = Matrix3::from_diagonal(&made.drag.into());
    let (mut p, mut v) = (Vector3::new(-2.0, 0.3, 1.3) + normal(0.1), Vector3::new(5.0, 0.5, 3.6) + normal(0.3));
    let mut R = UnitQuaternion::from_euler_angles(0.2, 0.4, -0.3);
    let w = if made.tumbles { Vector3::new(6.0, 9.0, -4.0) } else { Vector3::zeros() };
    let mut rows = Vec::new();
    for i in 0..ROWS {
        let noisy = R * UnitQuaternion::from_scaled_axis(normal(0.005));
        rows.push(Sighting {
            time_s: i as f64 / RATE_HZ,
            p: Point3::from(p + R * r + normal(5e-4)),
            rotation: made.tumbles.then_some(noisy),
        });
        for _ in 0..50 {
            let h = 1.0 / RATE_HZ / 50.0;
            let force = R * (drag * (R.inverse() * v)) * v.norm();
            let lift = made.lift * libm::exp(-made.lift_decay * i as f64 / RATE_HZ) + w * 0.003;
            v += (Vector3::z() * -9.81 - force + lift.cross(&v)) * h;
            p += v * h;
            R = UnitQuaternion::from_scaled_axis(w * h) * R;
            if p.z < made.floor_m && v.z < 0.0 {
                v.z *= -0.6;
            }
        }
    }
    rows
}

/// Squared Mahalanobis distance and distance of the last row from what the first of the track say of it.
fn off(seen: &[Sighting], last: &Sighting) -> (f64, f64) {
    let found = predict(seen, &Vector3::z_axis(), None);
    assert_eq!(found.status, FlightStatus::Predicted);
    let end = found.flight.unwrap().at(last.time_s);
    let error = last.p - end.position;
    let covariance = end.covariance.fixed_view::<3, 3>(0, 0).into_owned();
    (error.dot(&covariance.cholesky().unwrap().solve(&error)), error.norm())
}

/// 95 % of χ² with three degrees of freedom.
const CHI_SQUARED_95: f64 = 7.815;

#[test]
fn as_many_ends_are_covered_as_is_claimed() {
    // Balls that hardly spin, and table tennis balls at up to 500 rad/s; outliers and lost rows in each.
    for (spin_per_s, least) in [(0.05, 0.9), (2.5, 0.8)] {
        let covered = (0..40).filter(|&seed| {
            let mut random = Pcg64Mcg::seed_from_u64(1000 + seed);
            let mut uniform = |low: f64, high: f64| random.random_range(low..high);
            let axis = Vector3::new(uniform(-1.0, 1.0), uniform(-1.0, 1.0), uniform(-1.0, 1.0));
            let lift = axis.normalize() * uniform(0.2, 1.0) * spin_per_s;
            let mut rows = thrown(seed, &Made { drag: [uniform(0.01, 0.15); 3], lift, ..BALL });
            for _ in 0..4 {
                rows[uniform(0.0, 60.0) as usize].p.x += uniform(-0.2, 0.2);
            }
            rows.drain(20..26);
            off(&rows[..62], &rows[rows.len() - 1]).0 < CHI_SQUARED_95
        });
        let fraction = covered.count() as f64 / 40.0;
        assert!(fraction >= least, "{spin_per_s}: {fraction}");
    }
}

/// Balls, and table tennis balls whose spin of up to 500 rad/s decays, `CATCHINGBOT_TRACKS` of each.
#[test]
#[ignore = "some minutes"]
fn ellipsoids_of_many_tracks_hold_what_they_claim() {
    let count = std::env::var("CATCHINGBOT_TRACKS").ok().and_then(|it| it.parse().ok()).unwrap_or(200);
    for (spin_per_s, drag, generic) in [(0.05, [0.01, 0.15], 0.9), (2.5, [0.1, 0.14], 0.8)] {
        let throws: Vec<Throw> = (0..count)
            .map(|seed| {
                let mut random = Pcg64Mcg::seed_from_u64(70_000 + seed);
                let mut uniform = |low: f64, high: f64| random.random_range(low..high);
                let axis = Vector3::new(uniform(-1.0, 1.0), uniform(-1.0, 1.0), uniform(-1.0, 1.0));
                let lift = axis.normalize() * uniform(0.2, 1.0) * spin_per_s;
                let (drag, lift_decay) = ([uniform(drag[0], drag[1]); 3], uniform(0.0, 0.3));
                Throw {
                    samples: thrown(80_000 + seed, &Made { drag, lift, lift_decay, ..BALL }),
                    up: Vector3::z_axis(),
                }
            })
            .collect();
        let flights: Vec<_> = throws.iter().map(|it| it.flights(None, None)).collect();
        let by_generic: Misses =
            std::array::from_fn(|i| throws.iter().zip(&flights).map(|(it, of)| it.miss(of[i].as_ref()?)).collect());
        let learned = lessons(&[throws], 5, || {}).unwrap().own.swap_remove(0);
        for (misses, least) in [(by_generic, generic), (learned, 0.9)] {
            let covered = misses.map(|it| Reliability::of(&it).covered);
            let mean = covered.iter().map(|it| it[2]).sum::<f64>() / 4.0;
            assert!((least..=0.98).contains(&mean), "{spin_per_s}: {covered:?}");
        }
    }
}

#[test]
fn tumbling_objects_are_predicted_with_outliers_gaps_and_swapped_markers() {
    let swapped = UnitQuaternion::from_scaled_axis(Vector3::x() * std::f64::consts::PI);
    for seed in 0..6 {
        let rows = thrown(seed, &TUMBLING);
        for kind in ["clean", "outliers", "gap", "swapped"] {
            let mut seen = rows[..90].to_vec();
            match kind {
                "outliers" => {
                    for i in (3..90).step_by(5) {
                        seen[i].p += Vector3::new(0.3, -0.2, 0.1) * (1.0 + (i % 3) as f64);
                    }
                }
                "gap" => drop(seen.drain(35..55)),
                "swapped" => {
                    for i in [0, 1, 20, 21, 22, 41] {
                        seen[i].rotation = seen[i].rotation.map(|it| it * swapped);
                        seen[i].p.x += 0.05;
                    }
                    seen[30].p.x = f64::NAN;
                }
                _ => {}
            }
            let (square, error) = off(&seen, &rows[ROWS - 1]);
            assert!(error < 0.05 && square < 25.0, "{kind} {seed}: {error} m, {square}");
        }
    }
}

#[test]
fn rest_in_a_hand_is_left_out() {
    for (made, before) in [BALL, TUMBLING].iter().flat_map(|made| [5, 20, 30, 50, 80, 120].map(|it| (made, it))) {
        let rows = thrown(5, made);
        let mut random = Pcg64Mcg::seed_from_u64(7);
        let mut normal = || 5e-4 * random.sample::<f64, _>(StandardNormal);
        let rest = (0..before).map(|i| Sighting {
            time_s: (i as f64 - f64::from(before)) / RATE_HZ,
            p: rows[0].p + Vector3::new(normal(), normal(), normal()),
            rotation: rows[0].rotation,
        });
        let seen: Vec<Sighting> = rest.chain(rows[..81].iter().copied()).collect();
        let (_, error) = off(&seen, &rows[ROWS - 1]);
        assert!(error < 0.05, "{before} rows before: {error}");
    }
}

#[test]
fn rows_that_repeat_or_are_zero_do_not_count() {
    let rows = thrown(6, &BALL);
    let (_, expected) = off(&rows[..81], &rows[ROWS - 1]);
    for lost in [1, 4, 8, 15, 25, 32] {
        for scattered in [false, true] {
            let mut seen = rows[..81].to_vec();
            for i in 0..lost {
                let at = if scattered { 2 * i + 5 } else { 30 + i };
                seen[at].p = Point3::origin();
            }
            let (_, error) = off(&seen, &rows[ROWS - 1]);
            assert!(error < expected + 0.01, "{lost} of 81: {error}");
        }
    }
    // A log five times as fast as the tracker.
    let held: Vec<Sighting> = rows[..81]
        .iter()
        .flat_map(|row| (0..5).map(|i| Sighting { time_s: row.time_s + f64::from(i) * 1e-3, ..*row }))
        .collect();
    let (square, error) = off(&held, &rows[ROWS - 1]);
    assert!(error < 0.02 && square < 14.2, "{error} m, {square}");
    let still = vec![Sighting { p: Point3::new(1.0, 2.0, 3.0), ..rows[0] }; 30];
    assert_eq!(predict(&still, &Vector3::z_axis(), None).status, FlightStatus::NoGravity);
    assert_eq!(predict(&rows[..3], &Vector3::z_axis(), None).status, FlightStatus::TooFewSightings);
}

#[test]
fn a_status_is_evidence() {
    let axes = (0..3).flat_map(|axis| [1.0, -1.0].map(|sign| Unit::new_unchecked(Vector3::ith(axis, sign))));
    for made in [BALL, Made { lift: Vector3::new(0.3, 1.5, -0.5), ..BALL }, TUMBLING] {
        let rows = &thrown(8, &made)[..90];
        for up in axes.clone() {
            let status = predict(rows, &up, None).status;
            let expected = if up == Vector3::z_axis() { FlightStatus::Predicted } else { FlightStatus::NoGravity };
            assert_eq!(status, expected, "{up:?}, tumbling: {}", made.tumbles);
        }
        let millimetres: Vec<Sighting> = rows.iter().map(|it| Sighting { p: it.p * 1e3, ..*it }).collect();
        assert_eq!(predict(&millimetres, &Vector3::z_axis(), None).status, FlightStatus::NoGravity);
    }
    let mut random = Pcg64Mcg::seed_from_u64(9);
    let noisy: Vec<Sighting> = thrown(9, &BALL)
        .iter()
        .map(|it| Sighting { p: it.p + Vector3::from_fn(|_, _| 0.05 * random.sample::<f64, _>(StandardNormal)), ..*it })
        .collect();
    assert_eq!(predict(&noisy, &Vector3::z_axis(), None).status, FlightStatus::Implausible);
}

#[test]
fn a_bounce_ends_the_flight() {
    let rows = thrown(3, &Made { floor_m: 1.5, ..TUMBLING });
    let turns = rows.windows(3).find(|it| it[1].p.z < it[0].p.z - 0.005 && it[2].p.z > it[1].p.z);
    let lowest = turns.unwrap()[1].time_s;
    let found = predict(&rows, &Vector3::z_axis(), None);
    let contact_s = found.contact_s.unwrap();
    assert!((contact_s - lowest).abs() < 0.03, "{contact_s} and {lowest}");
    assert!(found.flight.unwrap().time_s <= contact_s);
}

#[test]
fn objects_of_high_drag_are_learned_from() {
    let throws: Vec<Throw> = (0..6)
        .map(|seed| Throw { samples: thrown(seed, &Made { drag: [0.8; 3], ..BALL }), up: Vector3::z_axis() })
        .collect();
    let prior = lessons(&[throws], 2, || {}).unwrap().prior;
    assert_eq!(prior.throws, 6);
    let drag = libm::exp(prior.mean[3]);
    assert!((drag - 0.8).abs() < 0.03, "{drag}");
}
