//! Throws that are proven to be out of reach, and throws that must not be.

#![allow(clippy::print_stdout, reason = "figures for the docs, shown by --nocapture")]

use std::thread;

use catch_bot::{
    trajectory_optimization::{PlanningFailure, Start},
    trajectory_prediction::FlightTrajectory,
};
use catch_cell::arm::Setpoint;
use nalgebra::{Point3, Vector3};
use rand::SeedableRng;
use rand_pcg::Pcg64;

use crate::{
    planning::{Desk, random_flight},
    throw_proof::{AnyCatch, ThrowProof, prove_out_of_reach},
};

/// From the paper's start pose its near throw is out of reach: at every time, in every orientation, over the
/// whole redundancy, even standing still at the catch. The flight is known from 50 ms on: six images at 100
/// Hz.
#[test]
fn the_papers_near_throw_is_out_of_reach_from_its_pose() {
    let desk = Desk::new("tennis_ball", |_| {});
    let planner = &desk.search.motion;
    let q = planner.robot.joint_vector(&[1.57, 0.5, 0.0, -1.2, 0.0, 0.8, 1.57]).unwrap();
    let start = Start { time_s: 0.05, state: Setpoint::at_rest(q) };
    let flight = FlightTrajectory {
        p_WOcm: Point3::new(1.66613, 1.63277, 0.3),
        v_WOcm: Vector3::new(-1.58705, -2.68301, 3.75643),
        ..FlightTrajectory::default()
    };
    assert_eq!(desk.search(&start, &flight).err(), Some(PlanningFailure::OutOfReach));

    // It falls to the floor after 0.84 s.
    let proven = &|begin: i32| {
        let times_s = [0.05, 0.06].map(|it| it + f64::from(begin) * 0.01);
        prove_out_of_reach(planner, 0.05, &q, &AnyCatch { flight: &flight, times_s, within_m: 0.002 }, 10_000_000)
    };
    let proofs = thread::scope(|scope| {
        let threads: Vec<_> = (0..80).map(|begin| scope.spawn(move || proven(begin))).collect();
        threads.into_iter().map(|it| it.join().unwrap()).collect::<Vec<_>>()
    });
    let pieces = proofs.iter().map(|proof| match proof {
        ThrowProof::OutOfReach { pieces } => pieces,
        left @ ThrowProof::Open { .. } => panic!("{left:?}"),
    });
    println!("proven by {} pieces", pieces.sum::<usize>());
}

/// A catch is never proven out of reach: around the catches that plans promise something is always left.
#[test]
fn no_catch_is_proven_out_of_reach() {
    let desk = Desk::new("tennis_ball", |_| {});
    let start = desk.waiting();
    let mut rng = Pcg64::seed_from_u64(6);
    let mut found = 0;
    for _ in 0..100 {
        let flight = random_flight(&mut rng);
        let Ok(plan) = desk.search(&start, &flight) else { continue };
        found += 1;
        let off_m = (plan.grasp.X_OG * desk.setup.gripper.grasp_centre()).coords.norm();
        let times_s = [plan.catch_s - 1e-6, plan.catch_s + 1e-6];
        let any = AnyCatch { flight: &flight, times_s, within_m: off_m + 1e-4 };
        let proof = prove_out_of_reach(&desk.search.motion, start.time_s, &start.state.q, &any, 10_000);
        assert!(matches!(proof, ThrowProof::Open { .. }), "{plan:?}");
    }
    assert!(found > 50, "{found}");
}
