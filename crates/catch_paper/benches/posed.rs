//! Planning a catch whose time and pose are given.
//!
//! `cargo bench -p catch_paper`. `catchingbot plan` measures files of such catches the same way.

#![allow(missing_docs, reason = "criterion's macro makes a public function")]

#[path = "../../catch_bot/benches/inputs/arm.rs"]
mod arm;

use catch_body::Pose;
use catch_paper::posed::{PosedPlanner, Target};
use criterion::{Criterion, criterion_group, criterion_main};
use nalgebra::{Matrix3, Rotation3, Translation3, UnitQuaternion, Vector3};

/// Case 0 of `planner_cases.json`.
fn given_pose(criterion: &mut Criterion) {
    let planner = PosedPlanner::new(arm::planner(|config| {
        (config.position_margin_rad, config.velocity_scaling, config.torque_scaling) = (0.0, 1.0, 1.0);
    }));
    let start = arm::at_rest(&planner.motion, &[1.57, 0.5, 0.0, -1.2, 0.0, 0.8, 1.57], 0.0);
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
    criterion.bench_function("given_pose/cold", |bencher| bencher.iter(|| planner.catch_at(&start, &target)));
}

criterion_group!(benches, given_pose);
criterion_main!(benches);
