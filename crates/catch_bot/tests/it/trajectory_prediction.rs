//! Flights predicted from poses.

use catch_body::Pose;
use nalgebra::{Matrix3, Matrix6, Point3, Translation3, UnitQuaternion, Vector3, Vector6};

use catch_bot::{
    perception::{ObjectPose, RotationGroup, Symmetry},
    trajectory_prediction::*,
};

use crate::synthetic::Normal;

fn banana() -> Symmetry {
    Symmetry::Finite {
        group: RotationGroup::default(),
        inertia_per_kg: Matrix3::from_diagonal(&Vector3::new(0.0002, 0.0017, 0.0018)),
    }
}

/// A throw as in the paper: about 0.7 s.
fn throw(normal: &mut Normal, spin_radps: f64, drag_per_m: f64, symmetry: &Symmetry) -> FlightTrajectory {
    FlightTrajectory {
        p_WOcm: Point3::new(2.66, 2.61, 0.5) + normal.vector() * 0.05,
        v_WOcm: Vector3::new(-2.96, -4.06, 3.59) + normal.vector() * 0.1,
        w_WO: normal.vector().normalize() * spin_radps,
        inertia_per_kg: inertia_per_kg(symmetry),
        R_WO: normal.rotation(),
        drag_per_m,
        ..FlightTrajectory::default()
    }
}

/// Poses observed of a throw in `count` frames at 100 Hz, with the given standard deviations; a fraction of
/// the frames is shifted by 5 to 20 cm.
fn seen(
    throw: &FlightTrajectory,
    count: usize,
    sd_m: f64,
    sd_rad: f64,
    outliers: f64,
    normal: &mut Normal,
) -> Vec<ObjectPose> {
    let (turn, shift) = (sd_rad.powi(-2), sd_m.powi(-2));
    let information = Matrix6::from_diagonal(&Vector6::new(turn, turn, turn, shift, shift, shift));
    let poses = (0..count).map(|i| {
        let capture_s = 0.01 * i as f64;
        let X_WO = throw.pose_at(capture_s);
        let mut shift = normal.vector() * sd_m;
        let turn = UnitQuaternion::from_scaled_axis(normal.vector() * sd_rad);
        let away = normal.vector().normalize() * normal.uniform(0.05, 0.2);
        if normal.uniform(0.0, 1.0) < outliers {
            shift += away;
        }
        let X_WO = Pose::from_parts(Translation3::from(X_WO.translation.vector + shift), turn * X_WO.rotation);
        ObjectPose {
            capture_s,
            X_WO,
            information,
            points: 200,
            residual_m: sd_m,
            points_mismatch: None,
            silhouette_mismatch: None,
            iterations: 5,
            registered_globally: false,
        }
    });
    poses.collect()
}

#[test]
fn clean_poses_give_the_flight() {
    let config = Config { drag_prior_per_m: Some(0.05), ..Config::default() };
    for seed in 0..50 {
        let mut normal = Normal::new(seed);
        let throw = throw(&mut normal, 6.0, 0.05, &banana());
        let poses = seen(&throw, 20, 1e-6, 1e-6, 0.0, &mut normal);
        let flight = InformationFit::new(config.clone(), banana(), seed).predict(&poses, None).unwrap();
        let (found, truth) = (flight.pose_at(0.7), throw.pose_at(0.7));
        let off_m = (found.translation.vector - truth.translation.vector).norm();
        assert!(off_m < 1e-4 && found.rotation.angle_to(&truth.rotation) < 1e-2, "{seed}: {off_m} m, {flight:?}");
    }
}

/// Each frame is an outlier with a probability of 0.4; where hardly any are left that agree, that is said.
#[test]
fn prediction_survives_outliers_of_four_frames_in_ten() {
    const FRAMES: usize = 20;
    let config = Config::default();
    let mut without = 0;
    for seed in 0..1000 {
        let mut normal = Normal::new(seed);
        let throw = throw(&mut normal, 0.0, 0.0, &Symmetry::Sphere);
        let poses = seen(&throw, FRAMES, 0.001, 0.02, 0.4, &mut normal);
        let off_m =
            |X_WO: &Pose, time_s: f64| (X_WO.translation.vector - throw.pose_at(time_s).translation.vector).norm();
        match InformationFit::new(config.clone(), Symmetry::Sphere, seed).predict(&poses, None) {
            Ok(flight) => {
                let off_m = off_m(&flight.pose_at(0.7), 0.7);
                assert!(off_m < 0.03, "{seed}: {off_m} m");
            }
            Err(status) => {
                let agree = poses.iter().filter(|pose| off_m(&pose.X_WO, pose.capture_s) < 0.02).count();
                let is_too_few = (agree as f64) < MIN_INLIER_FRACTION * FRAMES as f64;
                assert!(status == PredictionStatus::NoAgreement && is_too_few, "{seed}: {status:?}, {agree} agree");
                without += 1;
            }
        }
    }
    // Fewer than 5 of 20 are left with a probability of 0.0003.
    assert!(without <= 3, "{without} without a flight");
}

/// A tumbling object is at the right place in each frame, and turned anyhow in a fraction of them.
#[test]
fn rotation_survives_orientations_that_are_wrong() {
    let mut off_rad: Vec<f64> = (0..100)
        .map(|seed| {
            let mut normal = Normal::new(seed);
            let throw = throw(&mut normal, 8.0, 0.0, &banana());
            let mut poses = seen(&throw, 20, 0.003, 0.05, 0.0, &mut normal);
            for pose in &mut poses {
                let anyhow = normal.rotation();
                if normal.uniform(0.0, 1.0) < 0.3 {
                    pose.X_WO.rotation = anyhow;
                }
            }
            let flight = InformationFit::new(Config::default(), banana(), seed).predict(&poses, None).unwrap();
            flight.pose_at(0.4).rotation.angle_to(&throw.pose_at(0.4).rotation)
        })
        .collect();
    off_rad.sort_by(f64::total_cmp);
    assert!(off_rad[50] < 0.15 && off_rad[90] < 0.3, "median {}, 90 % {}", off_rad[50], off_rad[90]);
}

#[test]
fn claimed_uncertainty_holds() {
    for (symmetry, sd_m, drag_sd) in
        [(Symmetry::Sphere, 0.0003, 0.0), (banana(), 0.0015, 0.0), (banana(), 0.0005, 0.02)]
    {
        let config = Config { drag_prior_per_m: Some(0.05), drag_prior_sd_per_m: Some(drag_sd), ..Config::default() };
        let mut inside = 0;
        for seed in 0..300 {
            let mut normal = Normal::new(seed);
            let drag = 0.05 + drag_sd * normal.draw();
            let throw = throw(&mut normal, 6.0, drag, &symmetry);
            let poses = seen(&throw, 20, sd_m, 0.02, 0.1, &mut normal);
            let flight = InformationFit::new(config.clone(), symmetry, seed).predict(&poses, None).unwrap();
            let error = throw.pose_at(0.7).translation.vector - flight.pose_at(0.7).translation.vector;
            let covariance = flight.covariance_at(0.7).fixed_view::<3, 3>(0, 0).into_owned();
            let square = error.dot(&covariance.cholesky().unwrap().solve(&error));
            // 95 % of χ² with three degrees of freedom.
            inside += usize::from(square < 7.815);
        }
        let fraction = f64::from(inside as u32) / 300.0;
        assert!((0.9..=0.98).contains(&fraction), "{fraction}");
    }
}

/// One far camera sees where along its ray an object is to centimetres, and across it to millimetres.
#[test]
fn a_far_camera_knows_the_flight_all_along() {
    let sd_m = Vector3::new(0.06, 0.003, 0.003);
    let information = sd_m.map(|it: f64| it.powi(-2));
    for seed in 0..20 {
        let mut normal = Normal::new(seed);
        let throw = throw(&mut normal, 6.0, 0.0, &banana());
        let mut poses = seen(&throw, 50, 1e-9, 0.3, 0.0, &mut normal);
        for pose in &mut poses {
            pose.X_WO.translation.vector += normal.vector().component_mul(&sd_m);
            pose.information.fixed_view_mut::<3, 3>(3, 3).set_diagonal(&information);
        }
        let mut predictor = InformationFit::new(Config::default(), banana(), seed);
        let mut flight = None;
        for count in 10..poses.len() {
            let found = predictor.predict(&poses[..count], flight.as_ref());
            flight = Some(found.unwrap_or_else(|status| panic!("{seed}: {status:?} after {count} poses")));
        }
        let flight = flight.unwrap();
        assert!(flight.inliers as f64 > 0.95 * flight.considered as f64, "{seed}: {} agree", flight.inliers);
        let off_m = flight.pose_at(0.7).translation.vector - throw.pose_at(0.7).translation.vector;
        let covariance = flight.covariance_at(0.7).fixed_view::<3, 3>(0, 0).into_owned();
        let square = off_m.dot(&(covariance.try_inverse().unwrap() * off_m));
        assert!(square < 21.1, "{seed}: outside of the ellipsoid of 99.99 %: {off_m:?}");
    }
}

/// The axis of a bottle whose ends are confused in four of ten images is found nevertheless; less often if
/// each image is believed.
#[test]
fn confused_ends_leave_the_axis() {
    let (axis, config) = (Vector3::z_axis(), Config::default());
    let bottle = Symmetry::Axis { axis, reversible: false, axial_inertia: 1.0 };
    let half_turn = UnitQuaternion::from_scaled_axis(Vector3::x() * std::f64::consts::PI);
    let mut right = [0, 0];
    for seed in 0..50 {
        let mut normal = Normal::new(seed);
        let throw = throw(&mut normal, 6.0, 0.0, &bottle);
        let mut poses = seen(&throw, 20, 0.001, 0.05, 0.0, &mut normal);
        for pose in &mut poses {
            if normal.uniform(0.0, 1.0) < 0.4 {
                pose.X_WO.rotation *= half_turn;
            }
        }
        for (right, symmetry) in right.iter_mut().zip([bottle.with_ends_alike(), bottle]) {
            let Ok(flight) = InformationFit::new(config.clone(), symmetry, seed).predict(&poses, None) else {
                continue;
            };
            let [found, truth] = [&flight, &throw].map(|it| it.pose_at(0.1).rotation);
            *right += usize::from(bottle.with_ends_alike().turn_between(&found, &truth).norm() < 0.3);
        }
    }
    assert!(right[0] >= 48 && right[1] < right[0], "{right:?}");
}

/// Spin about the axis of a long object turns it less than spin across it. As long as poses tell nothing of
/// it, that is all that is known.
#[test]
fn what_turns_a_long_round_object_is_less_along_its_axis() {
    let (axis, config) = (Vector3::z_axis(), Config { spin_prior_sd_radps: 8.0, ..Config::default() });
    let symmetry = Symmetry::Axis { axis, reversible: false, axial_inertia: 0.4 };
    let mut found = 0;
    for seed in 0..20 {
        let mut normal = Normal::new(seed);
        let throw = throw(&mut normal, 3.0, 0.0, &symmetry);
        let poses = seen(&throw, 6, 0.001, 0.5, 0.0, &mut normal);
        let Ok(flight) = InformationFit::new(config.clone(), symmetry, seed).predict(&poses, None) else { continue };
        let axis_W = flight.R_WO * axis.into_inner();
        let covariance = flight.rotation_covariance.fixed_view::<3, 3>(3, 3).into_owned();
        let along_radps = axis_W.dot(&(covariance * axis_W)).sqrt();
        assert!((2.9..=3.2001).contains(&along_radps), "{along_radps} rad/s, seed {seed}");
        found += 1;
    }
    assert!(found > 10, "{found}");
}

#[test]
fn too_little_or_nonsense_gives_a_status() {
    let config = Config::default();
    let mut normal = Normal::new(0);
    let throw = throw(&mut normal, 0.0, 0.0, &banana());
    let mut poses = seen(&throw, 20, 0.001, 0.02, 0.0, &mut normal);
    assert_eq!(InformationFit::new(config.clone(), banana(), 0).predict(&[], None), Err(PredictionStatus::TooFewPoses));
    assert_eq!(
        InformationFit::new(config.clone(), banana(), 0).predict(&poses[..2], None),
        Err(PredictionStatus::TooFewPoses)
    );
    assert!(InformationFit::new(config.clone(), banana(), 0).predict(&poses[..3], None).is_ok());
    let same = vec![poses[0]; 10];
    assert!(InformationFit::new(config.clone(), banana(), 0).predict(&same, None).is_err());
    for pose in &mut poses[3..10] {
        pose.X_WO.translation.vector.x = f64::NAN;
    }
    let flight = InformationFit::new(config.clone(), banana(), 0).predict(&poses, None).unwrap();
    assert!(flight.pose_at(0.7).translation.vector.iter().all(|value| value.is_finite()));
    assert!((flight.pose_at(0.7).translation.vector - throw.pose_at(0.7).translation.vector).norm() < 0.03);
    for pose in &mut poses {
        pose.information.fill(f64::NAN);
    }
    assert!(InformationFit::new(config.clone(), banana(), 0).predict(&poses, None).is_err());
}

/// Root mean square error at the catch after half the flight, over the Fisher bound with the drag constant
/// unknown.
///
/// The bound's model: a point under gravity and a = −k|v|v, its position seen at 100 Hz with independent
/// normal errors of 0.5 mm along each axis; (p, v, k) unknown, nothing known beforehand.
fn drag_against_the_bound(throws: u64) -> f64 {
    let sd_m = 0.0005;
    let config = Config { drag_prior_per_m: Some(0.1), drag_prior_sd_per_m: Some(0.06), ..Config::default() };
    let (mut squares, mut bounds) = (0.0, 0.0);
    for seed in 0..throws {
        let mut normal = Normal::new(seed);
        let drag = normal.uniform(0.0, 0.2);
        let throw = throw(&mut normal, 0.0, drag, &Symmetry::Sphere);
        let poses = seen(&throw, 35, sd_m, 0.02, 0.0, &mut normal);
        let flight = InformationFit::new(config.clone(), Symmetry::Sphere, seed).predict(&poses, None).unwrap();
        let error = throw.pose_at(0.7).translation.vector - flight.pose_at(0.7).translation.vector;
        squares += error.norm_squared();

        // The covariance of (p, v, k) at the start from the derivatives of each position, carried to the
        // catch.
        let by_start = |time_s: f64| {
            let mut J = nalgebra::SMatrix::<f64, 3, 7>::zeros();
            J.fixed_view_mut::<3, 3>(0, 0).fill_with_identity();
            for i in 0..4 {
                let at = |change: f64| {
                    let mut throw = throw.clone();
                    if i < 3 {
                        throw.v_WOcm[i] += change;
                    } else {
                        throw.drag_per_m += change;
                    }
                    throw.pose_at(time_s).translation.vector
                };
                J.set_column(3 + i, &((at(1e-4) - at(-1e-4)) / 2e-4));
            }
            J
        };
        let information: nalgebra::SMatrix<f64, 7, 7> =
            poses.iter().map(|pose| by_start(pose.capture_s)).map(|J| J.transpose() * J / (sd_m * sd_m)).sum();
        let at_catch = by_start(0.7);
        bounds += (at_catch * information.try_inverse().unwrap() * at_catch.transpose()).trace();
    }
    (squares / bounds).sqrt()
}

#[test]
fn drag_is_found_as_well_as_it_can_be() {
    let ratio = drag_against_the_bound(200);
    assert!((0.7..1.3).contains(&ratio), "{ratio}");
}

/// Forces that depend on orientation and spin are found along with the flight: predictions are better than
/// without, and their errors as large as claimed.
#[test]
fn aerodynamic_forces_are_found() {
    let calm = Config { drag_prior_per_m: Some(0.05), drag_prior_sd_per_m: Some(0.01), ..Config::default() };
    let process_noise = ProcessNoise { acceleration: 0.05, angular_acceleration: 0.5 };
    let aerodynamics =
        AerodynamicPrior { drag_deviation_sd_per_m: 0.02, lift_sd_radps: 0.03, ..AerodynamicPrior::default() };
    let aware = Config { process_noise, aerodynamics, ..calm.clone() };
    let (mut errors, mut inside) = ([Vec::new(), Vec::new()], 0);
    for seed in 0..200 {
        let mut normal = Normal::new(seed);
        let mut throw = throw(&mut normal, 10.0, 0.05, &banana());
        let diagonal = normal.vector() * 0.02;
        let drag_deviation_O = Matrix3::from_diagonal(&diagonal.add_scalar(-diagonal.mean()));
        throw.forces = AerodynamicForces { drag_deviation_O, lift_W: normal.vector() * 0.03, ..throw.forces };
        let poses = seen(&throw, 40, 0.0006, 0.02, 0.1, &mut normal);
        for (config, errors) in [&calm, &aware].into_iter().zip(&mut errors) {
            let flight = InformationFit::new(config.clone(), banana(), seed).predict(&poses, None).unwrap();
            let error = throw.pose_at(0.55).translation.vector - flight.pose_at(0.55).translation.vector;
            errors.push(error.norm());
            if config.aerodynamics.any() {
                let covariance = flight.covariance_at(0.55).fixed_view::<3, 3>(0, 0).into_owned();
                inside += usize::from(error.dot(&covariance.cholesky().unwrap().solve(&error)) < 7.815);
            }
        }
    }
    let median = errors.map(|mut errors| {
        errors.sort_by(f64::total_cmp);
        errors[errors.len() / 2]
    });
    assert!(median[1] < 0.5 * median[0] && (170..=200).contains(&inside), "{median:?}, {inside} of 200 within 95 %");
}

/// Errors of throws of a spinning object whose centre of mass is not where its shape has it: the median error
/// of the object's position predicted 0.3 s later, after 300 ms, and the fraction of the true positions in
/// the 95 % ellipsoid.
fn off_centre(symmetry: &Symmetry, com_O: Vector3<f64>, com_sd_m: Option<f64>, throws: usize) -> (f64, usize) {
    let mut normal = Normal::new(77);
    let config = Config { com_sd_m, spin_prior_sd_radps: 8.3, ..Config::default() };
    let (mut errors_m, mut inside) = (Vec::new(), 0);
    for seed in 0..throws as u64 {
        let flown = FlightTrajectory { com_O, ..throw(&mut normal, 12.0, 0.0, symmetry) };
        let poses = seen(&flown, 30, 1e-3, 0.02, 0.0, &mut normal);
        let mut predictor = InformationFit::new(config.clone(), *symmetry, seed);
        let (mut found, mut last): (Option<FlightTrajectory>, _) = (None, 0.0);
        for count in FIRST_AFTER..=poses.len() {
            found = predictor.predict(&poses[..count], found.as_ref()).ok();
            last = poses[count - 1].capture_s + 0.3;
        }
        let found = found.expect("a flight");
        let error = found.pose_at(last).translation.vector - flown.pose_at(last).translation.vector;
        let covariance = found.covariance_at(last).fixed_view::<3, 3>(0, 0).into_owned();
        inside += usize::from(error.dot(&(covariance.try_inverse().unwrap() * error)) < 7.81);
        errors_m.push(error.norm());
    }
    errors_m.sort_by(f64::total_cmp);
    (errors_m[throws / 2], inside)
}

#[test]
fn a_centre_of_mass_that_is_elsewhere_is_found_in_flight() {
    let bottle = Symmetry::Axis { axis: Vector3::z_axis(), reversible: false, axial_inertia: 1.0 };
    for (symmetry, com_O) in [(bottle, Vector3::z() * 8e-3), (banana(), Vector3::new(5e-3, -4e-3, 4.8e-3))] {
        let (unaware_m, _) = off_centre(&symmetry, com_O, None, 40);
        let (aware_m, inside) = off_centre(&symmetry, com_O, Some(5e-3), 40);
        assert!(aware_m < 0.2 * unaware_m, "{aware_m}, {unaware_m}");
        assert!(inside >= 33, "{inside} of 40");
    }
}

/// Without spin the centre of mass cannot be seen, and nothing is lost by not knowing it.
#[test]
fn without_spin_an_unknown_centre_of_mass_costs_nothing() {
    let config = Config { com_sd_m: Some(5e-3), spin_prior_sd_radps: 8.3, ..Config::default() };
    let mut normal = Normal::new(78);
    let flown = FlightTrajectory { com_O: Vector3::x() * 5e-3, ..throw(&mut normal, 0.0, 0.0, &banana()) };
    let poses = seen(&flown, 30, 1e-3, 0.02, 0.0, &mut normal);
    let found = InformationFit::new(config, banana(), 1).predict(&poses, None).unwrap();
    let error_m = (found.pose_at(0.6).translation.vector - flown.pose_at(0.6).translation.vector).norm();
    assert!(error_m < 5e-3 && found.position_sd_at(0.6) < 5e-3, "{error_m}, {}", found.position_sd_at(0.6));
    let sd_m = found.com_covariance.fixed_rows::<3>(6).diagonal().map(f64::sqrt);
    assert!(sd_m.min() > 4e-3, "{sd_m}");
}

/// A spin that is seen tells the direction of the Magnus force and how fast it decays: with that, positions
/// and orientations are predicted better than by a force of any direction and noise of the rotation.
#[test]
fn a_seen_spin_tells_its_lift_and_its_decay() {
    let of = |aerodynamics: AerodynamicPrior, angular_acceleration: f64| Config {
        drag_prior_per_m: Some(0.05),
        drag_prior_sd_per_m: Some(0.01),
        process_noise: ProcessNoise { acceleration: 0.003, angular_acceleration },
        aerodynamics,
        ..Config::default()
    };
    let any_force = AerodynamicPrior { lift_sd_radps: 0.03, ..AerodynamicPrior::default() };
    let of_spin = AerodynamicPrior {
        magnus: 0.003,
        magnus_sd: 0.0018,
        spin_decay_per_s: 0.3,
        spin_decay_sd_per_s: 0.18,
        ..any_force
    };
    let configs = [of(any_force, 3.0), of(of_spin, 0.3)];
    let (mut errors, mut inside) = ([const { [const { Vec::new() }; 2] }; 2], 0);
    for seed in 0..100 {
        let mut normal = Normal::new(seed);
        let mut throw = throw(&mut normal, 15.0, 0.05, &banana());
        throw.forces.magnus = 0.003 + 0.0015 * normal.vector().x;
        throw.spin_decay_per_s = (0.3 + 0.15 * normal.vector().x).max(0.0);
        let poses = seen(&throw, 40, 0.0006, 0.02, 0.0, &mut normal);
        for (config, [positions, rotations]) in configs.iter().zip(&mut errors) {
            let mut previous = None;
            for count in [38, 39, 40] {
                let known = &poses[..count];
                previous = Some(
                    InformationFit::new(config.clone(), banana(), seed).predict(known, previous.as_ref()).unwrap(),
                );
            }
            let (flight, X_WO) = (previous.unwrap(), throw.pose_at(0.65));
            let error = X_WO.translation.vector - flight.pose_at(0.65).translation.vector;
            positions.push(error.norm());
            rotations.push(banana().turn_between(&flight.pose_at(0.65).rotation, &X_WO.rotation).norm());
            if config.aerodynamics.magnus > 0.0 {
                let covariance = flight.covariance_at(0.65).fixed_view::<3, 3>(0, 0).into_owned();
                inside += usize::from(error.dot(&covariance.cholesky().unwrap().solve(&error)) < 7.815);
            }
        }
    }
    let [[any_m, any_rad], [spin_m, spin_rad]] = errors.map(|each| {
        each.map(|mut errors| {
            errors.sort_by(f64::total_cmp);
            errors[errors.len() / 2]
        })
    });
    assert!(spin_m < 0.7 * any_m && spin_rad < 0.7 * any_rad, "{any_m} {spin_m} m, {any_rad} {spin_rad} rad");
    assert!((85..=100).contains(&inside), "{inside} of 100 within 95 %");
}
