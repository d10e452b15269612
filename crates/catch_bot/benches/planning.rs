//! Planning: a catch whose time and pose are given, cold and after a small change; a search over everything.
//!
//! `cargo bench -p catch_bot --bench planning`. `catchingbot plan` measures the files in `cases/` the same way.

#![allow(missing_docs, reason = "criterion's macro makes a public function")]

mod inputs;
#[path = "../tests/it/synthetic.rs"]
mod synthetic;

use catch_body::Pose;
use catch_bot::{
    grasp_selection::{self, GraspSet},
    perception::{self, ReferenceModel},
    trajectory_optimization::{CatchSearch, Incoming, Start, posed::Target},
    trajectory_prediction::FlightTrajectory,
};
use criterion::{Criterion, criterion_group, criterion_main};
use inputs::{at_rest, planner};
use nalgebra::{Matrix3, Rotation3, Translation3, UnitQuaternion, Vector3};
use synthetic::Shape;

/// Case 0 of `cases/planner_cases.json`, and the same 5 mm aside.
fn given_pose(criterion: &mut Criterion) {
    let planner = planner(|config| {
        (config.position_margin_rad, config.velocity_scaling, config.torque_scaling) = (0.0, 1.0, 1.0);
    });
    let start = at_rest(&planner, &[1.57, 0.5, 0.0, -1.2, 0.0, 0.8, 1.57], 0.0);
    let R_WG = Matrix3::new(
        0.414658374,
        -0.064322357,
        -0.907700979,
        0.442240783,
        0.886022268,
        0.13923947,
        0.795287069,
        -0.459159204,
        0.395842523,
    );
    let R_WG = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix(&R_WG));
    let target = Target {
        catch_s: 0.46387173,
        X_WG: Pose::from_parts(Translation3::new(-0.167683398, 0.467489732, 0.914942251), R_WG),
        v_WO: Vector3::new(3.577366542, -0.548760695, -1.560066398),
    };
    let plan = planner.catch_at(&start, &target).unwrap();
    let mut aside = target;
    aside.X_WG.translation.vector.x += 5e-3;
    criterion.bench_function("given_pose/cold", |bencher| bencher.iter(|| planner.catch_at(&start, &target)));
    criterion
        .bench_function("given_pose/5 mm aside", |bencher| bencher.iter(|| planner.retarget_at(&start, &aside, &plan)));
}

/// The paper's near throw from the waiting pose: time, grasp and redundancy are sought, then the flight changes by 5 mm.
fn everything(criterion: &mut Criterion) {
    let search = CatchSearch::new(planner(|_| {}));
    let start = at_rest(search.motion(), &inputs::READY, 0.07);
    let config = grasp_selection::Config::default();
    for (name, shape) in Shape::all() {
        let reference = ReferenceModel::from_scan(&synthetic::scan(&shape, 200), &perception::Config::default());
        let grasps = GraspSet::sample(&reference, search.motion().gripper(), &config);
        let flight = inputs::near_throw();
        let incoming = Incoming { flight: &flight, grasps: &grasps, config: &config };
        criterion.bench_function(&format!("search/{name}"), |bencher| {
            bencher.iter(|| search.search(&start, &incoming));
        });
        let Ok(plan) = search.search(&start, &incoming) else { continue };
        let later = Start { time_s: 0.2, state: plan.trajectory.setpoint(0.2) };
        let aside = FlightTrajectory { p_WO: flight.p_WO + Vector3::x() * 5e-3, ..flight.clone() };
        let aside = Incoming { flight: &aside, ..incoming };
        criterion.bench_function(&format!("replan/{name}"), |bencher| {
            bencher.iter(|| search.retarget(&later, &aside, &plan));
        });
    }
}

criterion_group!(benches, given_pose, everything);
criterion_main!(benches);
