//! The pose estimator on synthetic images.

use std::sync::Arc;

use catch_body::Pose;
use catch_cell::{CameraModel, DepthFrame};
use nalgebra::UnitQuaternion;

use catch_bot::perception::{
    Config, DepthNoise, ObjectPose, PerceptionStatus, PoseEstimator, ReferenceModel, SdfEstimator, Symmetry, View,
    Workspace,
};

use crate::synthetic::{self, Noise, Normal, Shape};

/// The pose in one set of images, by an estimator that has seen nothing before.
fn find(
    frames: &[DepthFrame],
    cameras: &[CameraModel],
    reference: &Arc<ReferenceModel>,
    prior: Option<&Pose>,
    config: &Config,
) -> Result<ObjectPose, PerceptionStatus> {
    let mut estimator = SdfEstimator::new(config.clone(), reference.clone(), Workspace::default());
    estimator.estimate(&View { frames, cameras, ..View::default() }, prior.copied().into())
}

/// Tracks from starts that are off by 2 cm and 10°: every pose is found, half of them within the given errors
/// in mm and degrees, all within four times as much.
fn assert_tracked(noise: Noise, config: &Config, [within_mm, within_deg]: [f64; 2]) {
    const TRIALS: usize = 30;
    let cameras = synthetic::flight_rig();
    for (name, shape) in Shape::all() {
        let reference = Arc::new(synthetic::reference(&shape, 200));
        let mut errors = [Vec::new(), Vec::new()];
        for seed in 0..TRIALS as u64 {
            let mut normal = Normal::new(seed);
            let X_WO = synthetic::pose_in_flight(&mut normal);
            let X_WR = X_WO * reference.X_RO.inverse();
            let frames = synthetic::depth_frames(&cameras, &shape, &X_WR, noise, &mut normal);
            let turn = UnitQuaternion::from_scaled_axis(normal.vector() * 0.1);
            let prior =
                Pose::from_parts((X_WO.translation.vector + normal.vector() * 0.012).into(), turn * X_WO.rotation);
            let found = find(&frames, &cameras, &reference, Some(&prior), config);
            let found = found.unwrap_or_else(|status| panic!("{name} {noise:?} {seed}: {status:?}"));
            let turn = reference.symmetry.turn_between(&found.X_WO.rotation, &X_WO.rotation);
            errors[0].push((found.X_WO.translation.vector - X_WO.translation.vector).norm() * 1e3);
            errors[1].push(turn.norm().to_degrees());
        }
        for (errors, within) in errors.iter().zip([within_mm, within_deg]) {
            let count = |most: f64| errors.iter().filter(|error| **error < most).count();
            assert!(2 * count(within) > TRIALS && count(4.0 * within) == TRIALS, "{name} {noise:?}: {errors:?}");
        }
    }
}

/// Perception that knows its cameras' noise.
fn told(noise: Noise) -> Config {
    let (constant_m, quadratic_per_m) = synthetic::data_sheet(noise);
    Config { depth_noise: Some(DepthNoise { constant_m, quadratic_per_m }), ..Config::default() }
}

#[test]
fn reference_knows_centre_and_symmetry() {
    for (name, shape) in Shape::all() {
        let reference = Arc::new(synthetic::reference(&shape, 200));
        match name {
            "ball" => assert_eq!(reference.symmetry, Symmetry::Sphere),
            "bottle" => assert!(matches!(reference.symmetry, Symmetry::Axis { reversible: false, .. })),
            _ => assert!(matches!(reference.symmetry, Symmetry::Finite { group, .. } if group.order() == 1)),
        }
    }
}

/// Compares with the integrals over the bottle's two cylinders.
#[test]
fn a_round_object_knows_how_its_inertia_along_the_axis_is_to_that_across() {
    let cylinders = [(0.0, 0.06, 0.0254_f64), (0.06, 0.0786, 0.022)];
    let mass = |(low, high, radius): &(f64, f64, f64)| (high - low) * radius.powi(2);
    let middle = |(low, high, _): &(f64, f64, f64)| f64::midpoint(*low, *high);
    let whole: f64 = cylinders.iter().map(mass).sum();
    let centre = cylinders.iter().map(|it| mass(it) * middle(it)).sum::<f64>() / whole;
    let along: f64 = cylinders.iter().map(|it| mass(it) * it.2.powi(2) / 2.0).sum();
    let across = |it: &(f64, f64, f64)| {
        mass(it) * ((3.0 * it.2.powi(2) + (it.1 - it.0).powi(2)) / 12.0 + (middle(it) - centre).powi(2))
    };
    let expected = along / cylinders.iter().map(across).sum::<f64>();
    let Symmetry::Axis { axial_inertia, .. } = synthetic::reference(&Shape::Bottle, 200).symmetry else { panic!() };
    assert!((axial_inertia / expected - 1.0).abs() < 0.02, "{axial_inertia}, {expected}");
}

#[test]
fn a_banana_with_ends_alike_looks_the_same_after_half_a_turn() {
    let reference = synthetic::reference(&Shape::bent(0.0), 200);
    assert!(
        matches!(reference.symmetry, Symmetry::Finite { group, .. }
            if group.order() == 2 && group.rotations()[0].axis().is_some_and(|axis| axis.y.abs() > 0.999)),
        "{:?}",
        reference.symmetry
    );
}

/// The bottle's edges are right-angled; a mean over all neighbours rounds them by 0.7–1 mm.
#[test]
fn edges_are_not_rounded() {
    let reference = synthetic::reference(&Shape::Bottle, 200);
    for [radius, height] in [[0.0254, 0.0], [0.0254, 0.06], [0.022, 0.0786]] {
        let distances = (0..50).map(|i| {
            let (sin, cos) = libm::sincos(0.04 * std::f64::consts::PI * f64::from(i));
            let on_edge = nalgebra::Point3::new(radius * cos, radius * sin, height);
            reference.distance.at(&(reference.X_RO.inverse() * on_edge)).0
        });
        let mean_m = distances.sum::<f64>() / 50.0;
        assert!(mean_m.abs() < 0.0006, "{radius} {height}: {mean_m}");
    }
}

#[test]
fn clean_frames_give_the_pose() {
    assert_tracked(Noise::Clean, &Config::default(), [0.1, 0.1]);
}

#[test]
fn frames_with_noise_give_the_pose() {
    let noise = Noise::Constant(0.002);
    assert_tracked(noise, &told(noise), [0.6, 1.0]);
}

#[test]
fn outlines_give_the_pose_where_depths_do_not() {
    assert_tracked(Noise::Stereo7, &told(Noise::Stereo7), [1.5, 2.5]);
}

#[test]
fn finds_the_object_without_prior() {
    for (name, shape) in Shape::all() {
        let reference = Arc::new(synthetic::reference(&shape, 200));
        let cameras = synthetic::flight_rig();
        for seed in 0..30 {
            let mut normal = Normal::new(seed);
            let X_WO = synthetic::pose_in_flight(&mut normal);
            let noise = if seed % 2 == 0 { Noise::Clean } else { Noise::Constant(0.005) };
            let X_WR = X_WO * reference.X_RO.inverse();
            let frames = synthetic::depth_frames(&cameras, &shape, &X_WR, noise, &mut normal);
            let found = find(&frames, &cameras, &reference, None, &Config::default());
            let found = found.unwrap_or_else(|status| panic!("{name} {seed}: {status:?}"));
            let off_m = (found.X_WO.translation.vector - X_WO.translation.vector).norm();
            let turn = reference.symmetry.turn_between(&found.X_WO.rotation, &X_WO.rotation).norm();
            assert!(off_m < 0.006 && turn < 0.2, "{name} {seed}: {off_m} m, {turn} rad, {found:?}");
        }
    }
}

#[test]
fn what_shows_nothing_gives_a_status() {
    let reference = Arc::new(synthetic::reference(&Shape::ball(), 100));
    let cameras = synthetic::flight_rig();
    let config = Config::default();
    let find = |frames: &[DepthFrame], prior: Option<&Pose>| find(frames, &cameras, &reference, prior, &config);
    assert_eq!(find(&[], None), Err(PerceptionStatus::NoPoints));
    let mut frames =
        synthetic::depth_frames(&cameras, &Shape::ball(), &Pose::identity(), Noise::Clean, &mut Normal::new(0));
    let nan = Pose::translation(f64::NAN, 0.0, 0.0);
    assert!(find(&frames, Some(&nan)).is_ok());
    let mut one_point = frames[..1].to_vec();
    one_point[0].mask.iter_mut().flatten().enumerate().for_each(|(i, mask)| *mask = i == 90);
    one_point[0].depth_m.fill(7.0);
    assert_eq!(find(&one_point, None), Err(PerceptionStatus::TooFewPoints));
    for frame in &mut frames {
        frame.depth_m.fill(f32::NAN);
    }
    assert_eq!(find(&frames, Some(&Pose::identity())), Err(PerceptionStatus::NoPoints));
    frames[0].camera = 99;
    frames[1].depth_m.clear();
    assert_eq!(find(&frames, None), Err(PerceptionStatus::NoPoints));
    assert_eq!(ReferenceModel::from_scan(&Default::default()), ReferenceModel::default());
}
