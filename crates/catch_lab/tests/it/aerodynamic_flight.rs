//! Flights with aerodynamics: against a fit by SciPy, and on tracks with outliers, gaps and contacts.

use catch_bot::trajectory_prediction::PredictionStatus;
use catch_lab::flights::{
    aerodynamics::{AerodynamicFit, FlightPrior, Noise, PARAMETERS},
    track::TrackSample,
};
use nalgebra::{Matrix3, Point3, Quaternion, UnitQuaternion, Vector3};
use serde_json::Value;

use rand::{RngExt, SeedableRng};
use rand_distr::StandardNormal;
use rand_pcg::Pcg64Mcg;

/// A prior with independent parameters.
fn prior(mean: [f64; PARAMETERS], sd: [f64; PARAMETERS], noise: [f64; 2]) -> FlightPrior {
    let mut covariance = [[0.0; PARAMETERS]; PARAMETERS];
    for (i, sd) in sd.iter().enumerate() {
        covariance[i][i] = sd * sd;
    }
    FlightPrior {
        source: "a test".into(),
        throws: 0,
        acceleration_noise: noise[0],
        angular_acceleration_noise: noise[1],
        systematic_sd_m: 0.0,
        least_noise: Noise { position_sd_m: 1e-4, orientation_sd_rad: 1e-3 },
        mean,
        covariance,
    }
}

fn broad() -> FlightPrior {
    let mut mean = [0.0; PARAMETERS];
    mean[3..6].fill(0.06);
    let sd = std::array::from_fn(|i| match i {
        0..3 => 0.02,
        3..9 => 0.05,
        9 => 0.01,
        10 => 0.3,
        _ => 0.5,
    });
    prior(mean, sd, [0.1, 0.5])
}

fn numbers<const COUNT: usize>(value: &Value) -> [f64; COUNT] {
    std::array::from_fn(|i| value[i].as_f64().unwrap())
}

#[test]
fn the_optimum_is_that_of_scipy_over_all_states_and_parameters() {
    let golden: Value = serde_json::from_str(include_str!("../golden/aerodynamic_flight.json")).unwrap();
    let number = |name: &str| golden[name].as_f64().unwrap();
    let noise = [number("acceleration_noise"), number("angular_acceleration_noise")];
    let mut fit = AerodynamicFit::new(prior(numbers(&golden["mean"]), numbers(&golden["sd"]), noise));
    (fit.most_passes, fit.step_sd) = (200, 1e-9);
    let samples: Vec<TrackSample> = golden["samples"]
        .as_array()
        .unwrap()
        .iter()
        .map(|row| {
            let [time_s, x, y, z, qx, qy, qz, qw] = numbers(row);
            sample(time_s, Point3::new(x, y, z), UnitQuaternion::from_quaternion(Quaternion::new(qw, qx, qy, qz)))
        })
        .collect();
    let noise = Noise { position_sd_m: number("position_sd_m"), orientation_sd_rad: number("orientation_sd_rad") };
    let flight = fit.fit(&samples, &Vector3::y_axis(), Some(noise)).unwrap();
    assert!(flight.converged);
    let (found, sd): ([f64; PARAMETERS], [f64; PARAMETERS]) = (flight.parameters().into(), numbers(&golden["sd"]));
    for (i, expected) in numbers::<PARAMETERS>(&golden["parameters"]).into_iter().enumerate() {
        assert!((found[i] - expected).abs() < 1e-4 * sd[i].max(1.0), "{i}: {} and {expected}", found[i]);
    }
    let end = flight.at(flight.time_s);
    assert!((end.position.coords - Vector3::from(numbers(&golden["end"]["position"]))).norm() < 1e-4);
    assert!((end.velocity - Vector3::from(numbers(&golden["end"]["velocity"]))).norm() < 1e-4);
    let [x, y, z, w] = numbers(&golden["end"]["orientation"]);
    assert!(end.orientation.angle_to(&UnitQuaternion::from_quaternion(Quaternion::new(w, x, y, z))) < 1e-4);
    // SciPy's covariance is of the same linearization but for the curvature of the robust cost.
    let claimed = flight.parameter_covariance().diagonal().map(f64::sqrt);
    for (i, expected) in numbers::<PARAMETERS>(&golden["parameter_sd"]).into_iter().enumerate() {
        assert!((claimed[i] / expected - 1.0).abs() < 0.2, "{i}: {} and {expected}", claimed[i]);
    }
}

fn sample(time_s: f64, position: Point3<f64>, orientation: UnitQuaternion<f64>) -> TrackSample {
    TrackSample { time_s, position, orientation: Some(orientation), position_sd_m: 0.0, orientation_sd_rad: 0.0 }
}

const STEP_S: f64 = 1.0 / 120.0;
const ROWS: usize = 100;

/// A tumbling throw at 120 Hz with 0.5 mm and 5 mrad of noise, by tiny steps; z is up. Bounces from a floor, if there is one.
fn throw(seed: u64, floor_m: Option<f64>) -> Vec<TrackSample> {
    let mut random = Pcg64Mcg::seed_from_u64(seed);
    let drag = Matrix3::new(0.1, 0.01, 0.0, 0.01, 0.06, 0.0, 0.0, 0.0, 0.03);
    let point = Vector3::new(0.01, -0.015, 0.005);
    let (mut p, mut v) = (Vector3::new(0.0, 0.0, 1.2), Vector3::new(5.0, 0.5, 4.0));
    let (mut R, w) = (UnitQuaternion::from_euler_angles(0.2, 0.4, -0.3), Vector3::new(6.0, 9.0, -4.0));
    let mut samples = Vec::new();
    for i in 0..ROWS {
        let mut noise = |sd: f64| Vector3::from_fn(|_, _| sd * random.sample::<f64, _>(StandardNormal));
        let noisy = R * UnitQuaternion::from_scaled_axis(noise(0.005));
        samples.push(sample(i as f64 * STEP_S, Point3::from(p + R * point + noise(5e-4)), noisy));
        for _ in 0..200 {
            let h = STEP_S / 200.0;
            let force = R * (drag * (R.inverse() * v)) * v.norm();
            v += (Vector3::z() * -9.81 - force + w.cross(&v) * 0.003) * h;
            p += v * h;
            R = UnitQuaternion::from_scaled_axis(w * h) * R;
            if floor_m.is_some_and(|floor| p.z < floor && v.z < 0.0) {
                v.z *= -0.6;
            }
        }
    }
    samples
}

#[test]
fn ends_are_predicted_with_outliers_gaps_and_swapped_markers() {
    let swapped = UnitQuaternion::from_scaled_axis(Vector3::x() * std::f64::consts::PI);
    for seed in 0..10 {
        let samples = throw(seed, None);
        for kind in ["clean", "outliers", "gap", "swapped"] {
            let mut seen = samples[..60].to_vec();
            match kind {
                "outliers" => {
                    for i in (3..60).step_by(5) {
                        seen[i].position += Vector3::new(0.3, -0.2, 0.1) * (1.0 + (i % 3) as f64);
                    }
                }
                "gap" => drop(seen.drain(25..40)),
                "swapped" => {
                    for i in [0, 1, 20, 21, 22, 41] {
                        seen[i].orientation = seen[i].orientation.map(|it| it * swapped);
                        seen[i].position.x += 0.05;
                    }
                    seen[30].position.x = f64::NAN;
                }
                _ => {}
            }
            let flight = AerodynamicFit::new(broad()).fit(&seen, &Vector3::z_axis(), None).unwrap();
            assert_eq!(flight.contact_s, None, "{kind} {seed}");
            let end = flight.at(samples[ROWS - 1].time_s);
            let error = end.position - samples[ROWS - 1].position;
            assert!(error.norm() < 0.05, "{kind} {seed}: {error}");
            let covariance = end.covariance.fixed_view::<3, 3>(0, 0).into_owned();
            let square = error.dot(&covariance.cholesky().unwrap().solve(&error));
            assert!(square < 25.0, "{kind} {seed}: {square}");
        }
    }
}

#[test]
fn a_bounce_ends_the_flight() {
    let samples = throw(3, Some(1.7));
    let bounced = samples.windows(3).position(|it| {
        let rise = |i: usize| it[i + 1].position.z - it[i].position.z;
        rise(1) - rise(0) > 0.01
    });
    let bounced_s = samples[bounced.unwrap() + 1].time_s;
    let flight = AerodynamicFit::new(broad()).fit(&samples, &Vector3::z_axis(), None).unwrap();
    let contact_s = flight.contact_s.unwrap();
    assert!((contact_s - bounced_s).abs() < 0.025, "{contact_s} and {bounced_s}");
    assert!(flight.time_s < bounced_s + 1e-9);
}

#[test]
fn tracks_that_are_too_short_have_a_status() {
    let samples = throw(1, None);
    let mut fit = AerodynamicFit::new(broad());
    for count in 0..6 {
        let status = fit.fit(&samples[..count], &Vector3::z_axis(), None).map(|flight| flight.inliers);
        assert_eq!(status, Err(PredictionStatus::TooFewPoses));
    }
    let again = vec![samples[0]; 20];
    assert!(fit.fit(&again, &Vector3::z_axis(), None).is_err(), "one time only");
}

#[test]
fn positions_alone_are_enough() {
    let mut samples = throw(2, None);
    for sample in &mut samples {
        sample.orientation = None;
    }
    let flight = AerodynamicFit::new(broad()).fit(&samples[..60], &Vector3::z_axis(), None).unwrap();
    let error = flight.at(samples[ROWS - 1].time_s).position - samples[ROWS - 1].position;
    assert!(error.norm() < 0.2, "{error}");
}

#[test]
fn the_second_fit_allocates_nothing() {
    let samples = throw(4, None);
    let mut fit = AerodynamicFit::new(broad());
    let expected = fit.fit(&samples[..80], &Vector3::z_axis(), None).unwrap();
    let mut found = None;
    let allocated = allocation_counter::measure(|| {
        found = fit.fit(&samples[..80], &Vector3::z_axis(), None).ok();
    });
    assert_eq!(allocated.count_total, 0, "{allocated:?}");
    assert_eq!(found.unwrap().parameters(), expected.parameters(), "and keeps nothing");
}
