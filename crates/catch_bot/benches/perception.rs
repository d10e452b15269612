//! Perception and prediction: from twenty cameras' images to a pose, from poses to a flight.
//!
//! `cargo bench -p catch_bot --bench perception`

#![allow(missing_docs, reason = "criterion's macro makes a public function")]

mod inputs;
#[path = "../tests/it/synthetic.rs"]
mod synthetic;

use std::sync::Arc;

use catch_bot::{
    perception::{Config, PoseEstimator, ReferenceModel, SdfEstimator, View, Workspace},
    trajectory_prediction::{self, FlightPredictor, InformationFit},
};
use criterion::{Criterion, criterion_group, criterion_main};
use inputs::Images;
use synthetic::{Noise, Shape};

/// One update while tracking, for each object and noise: images in windows, the start 2 mm and 1° off.
fn tracking(criterion: &mut Criterion) {
    let config = Config::default();
    for (name, shape) in Shape::all() {
        let reference = Arc::new(ReferenceModel::from_scan(&synthetic::scan(&shape, 200)));
        for noise in [Noise::Clean, Noise::Constant(0.002), Noise::Stereo7] {
            let Images { cameras, frames, prior } = Images::new(&shape, &reference, noise);
            let view = View { frames: &frames, cameras: &cameras, ..View::default() };
            let mut estimator = SdfEstimator::new(config.clone(), reference.clone(), Workspace::default());
            for (label, prior) in [("tracking", Some(prior)), ("cold start", None)] {
                criterion.bench_function(&format!("{label}/{name}/{noise:?}"), |bencher| {
                    bencher.iter(|| estimator.estimate(&view, prior.into()));
                });
            }
        }
    }
}

/// A new flight from 30 poses, the last flight given or not.
fn prediction(criterion: &mut Criterion) {
    let shape = Shape::banana();
    let reference = Arc::new(ReferenceModel::from_scan(&synthetic::scan(&shape, 200)));
    let poses = inputs::poses(&shape, &reference);
    let config = trajectory_prediction::Config { drag_prior_sd_per_m: Some(0.02), ..Default::default() };
    let mut fit = InformationFit::new(config, reference.symmetry, 1);
    let flight = fit.predict(&poses, None).expect("thirty good poses");
    criterion.bench_function("prediction/tracking", |bencher| {
        bencher.iter(|| fit.predict(&poses, Some(&flight)));
    });
    criterion.bench_function("prediction/start", |bencher| {
        bencher.iter(|| fit.predict(&poses, None));
    });
}

/// Benchmark of an object's reference model, which is built once for each object.
fn reference(criterion: &mut Criterion) {
    for (name, shape) in Shape::all() {
        let scan = synthetic::scan(&shape, 200);
        criterion.bench_function(&format!("reference/{name}"), |bencher| {
            bencher.iter(|| ReferenceModel::from_scan(&scan));
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
