//! Perception and prediction: from twenty cameras' images to a pose, from poses to a flight.
//!
//! `cargo bench -p catch_bot --bench perception`

#![allow(missing_docs, reason = "criterion's macro makes a public function")]

#[path = "../tests/it/synthetic.rs"]
mod synthetic;

use catch_body::Pose;
use catch_bot::{
    perception::{Config, ReferenceModel, Workspace, find_object},
    trajectory_prediction::{self, predict},
};
use criterion::{Criterion, criterion_group, criterion_main};
use nalgebra::{UnitQuaternion, Vector3};
use synthetic::{Noise, Normal, Shape};

/// One update while tracking, for each object and noise: images in windows, the start 2 mm and 1° off.
fn tracking(criterion: &mut Criterion) {
    let cameras = synthetic::flight_rig();
    let config = Config::default();
    for (name, shape) in Shape::all() {
        let reference = ReferenceModel::from_scan(&synthetic::scan(&shape, 200), &config);
        for noise in [Noise::Clean, Noise::Constant(0.002), Noise::Stereo7] {
            let mut normal = Normal::new(1);
            let X_WO = synthetic::pose_in_flight(&mut normal);
            let frames =
                synthetic::depth_frames(&cameras, &shape, &(X_WO * reference.X_RO.inverse()), noise, &mut normal);
            let turn = UnitQuaternion::from_scaled_axis(Vector3::new(0.01, -0.01, 0.01));
            let prior = Pose::from_parts(
                (X_WO.translation.vector + Vector3::new(0.001, -0.001, 0.001)).into(),
                turn * X_WO.rotation,
            );
            let mut workspace = Workspace::default();
            let mut update = |label: &str, prior: Option<&Pose>, config: &Config| {
                criterion.bench_function(&format!("{label}/{name}/{noise:?}"), |bencher| {
                    bencher.iter(|| find_object(&frames, &cameras, &reference, prior, None, config, &mut workspace));
                });
            };
            update("tracking", Some(&prior), &config);
            update("cold start", None, &config);
        }
    }
}

/// A new flight from 30 poses, the last flight given or not.
fn prediction(criterion: &mut Criterion) {
    let cameras = synthetic::flight_rig();
    let shape = Shape::banana();
    let reference = ReferenceModel::from_scan(&synthetic::scan(&shape, 200), &Config::default());
    let config = trajectory_prediction::Config { drag_prior_sd_per_m: Some(0.02), ..Default::default() };
    let mut normal = Normal::new(1);
    let mut workspace = Workspace::default();
    let mut poses = Vec::new();
    let mut space = trajectory_prediction::Workspace::default();
    for i in 0..30 {
        let time_s = 0.01 * f64::from(i);
        let p_WO = Vector3::new(2.6 - 2.9 * time_s, 2.6 - 4.0 * time_s, 0.5 + 3.6 * time_s - 4.905 * time_s * time_s);
        let X_WO = Pose::new(p_WO, Vector3::new(0.3, 2.0 * time_s, 0.1));
        let X_WR = X_WO * reference.X_RO.inverse();
        let mut frames = synthetic::depth_frames(&cameras, &shape, &X_WR, Noise::Constant(0.002), &mut normal);
        frames.iter_mut().for_each(|frame| frame.capture_s = time_s);
        poses.extend(find_object(&frames, &cameras, &reference, Some(&X_WO), None, &Config::default(), &mut workspace));
    }
    let flight = predict(&poses, None, reference.symmetry, &config, 1, &mut space).expect("thirty good poses");
    criterion.bench_function("prediction/tracking", |bencher| {
        bencher.iter(|| predict(&poses, Some(&flight), reference.symmetry, &config, 1, &mut space));
    });
    criterion.bench_function("prediction/start", |bencher| {
        bencher.iter(|| predict(&poses, None, reference.symmetry, &config, 1, &mut space));
    });
}

/// What is done once for an object.
fn reference(criterion: &mut Criterion) {
    for (name, shape) in Shape::all() {
        let scan = synthetic::scan(&shape, 200);
        criterion.bench_function(&format!("reference/{name}"), |bencher| {
            bencher.iter(|| ReferenceModel::from_scan(&scan, &Config::default()));
        });
    }
}

criterion_group! {
    name = benches;
    config = Criterion::default().sample_size(20).measurement_time(std::time::Duration::from_secs(1))
        .warm_up_time(std::time::Duration::from_millis(300));
    targets = tracking, prediction, reference
}
criterion_main!(benches);
