//! Planning: a search over catch times, grasps and postures, and replans.
//!
//! `cargo bench -p catch_bot --bench planning`.

#![allow(missing_docs, reason = "criterion's macro makes a public function")]

mod inputs;
#[path = "../tests/it/synthetic.rs"]
mod synthetic;

use catch_bot::{
    grasp_selection::{self, GraspSet},
    perception::ReferenceModel,
    trajectory_optimization::{CatchSearch, Incoming, Start, failure_counter::FailureCounter, retarget::Correction},
    trajectory_prediction::FlightTrajectory,
};
use criterion::{Criterion, criterion_group, criterion_main};
use inputs::arm::{at_rest, planner};
use nalgebra::Vector3;
use synthetic::Shape;

/// The paper's near throw from the waiting pose: time, grasp and redundancy are sought, then the flight
/// changes by 5 mm.
fn everything(criterion: &mut Criterion) {
    let search = CatchSearch::new(planner(|_| {}), None);
    let start = at_rest(&search.motion, &inputs::READY, 0.07);
    let config = grasp_selection::Config::default();
    for (name, shape) in Shape::all() {
        let reference = ReferenceModel::from_scan(&synthetic::scan(&shape, 200));
        let grasps = GraspSet::sample(&reference, &search.motion.gripper, &config);
        let flight = inputs::near_throw();
        let failures = FailureCounter::default();
        let incoming = Incoming { flight: &flight, grasps: &grasps, config: &config, failures: &failures };
        criterion.bench_function(&format!("search/{name}"), |bencher| {
            bencher.iter(|| search.search(&start, &incoming));
        });
        let Ok(plan) = search.search(&start, &incoming) else { continue };
        let later = Start { time_s: 0.2, state: plan.trajectory.setpoint(0.2) };
        let aside = FlightTrajectory { p_WOcm: flight.p_WOcm + Vector3::x() * 5e-3, ..flight.clone() };
        let aside = Incoming { flight: &aside, ..incoming };
        criterion.bench_function(&format!("replan/{name}"), |bencher| {
            bencher.iter(|| search.retarget(&Correction::new(&later, &aside, &plan, plan.catch_s)));
        });
    }
}

criterion_group!(benches, everything);
criterion_main!(benches);
