//! The planner on random throws: nothing lost, nothing broken.

use std::f64::consts::PI;

use catch_bot::{
    grasp_selection::GraspSet,
    perception::ReferenceModel,
    trajectory_optimization::{CatchPlan, Config, Planner, Refusal, Start},
    trajectory_prediction::FlightTrajectory,
};
use catch_cell::arm::Setpoint;
use catch_lab::setup::{Choice, Setup};
use nalgebra::{Point3, Quaternion, UnitQuaternion, Vector3};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;

const OBJECTS: [&str; 3] = ["tennis_ball", "banana", "pill_bottle"];
/// When a flight is usually known first.
const KNOWN_S: f64 = 0.07;

/// Everything for planning catches of one object.
pub struct Desk {
    pub setup: Setup,
    pub config: catch_bot::Config,
    pub grasps: GraspSet,
    pub planner: Planner,
}

impl Desk {
    pub fn new(object: &str, change: impl Fn(&mut Config)) -> Self {
        let setup = Setup::load(&Choice { object: Some(object), ..Choice::default() }).unwrap();
        let mut config = setup.brain_config(1, 0);
        change(&mut config.trajectory_optimization);
        let reference = ReferenceModel::from_scan(&setup.reference_scan, &config.perception);
        let grasps = GraspSet::sample(&reference, &setup.gripper, &config.grasp_selection);
        let planner = Planner::new(setup.robot.clone(), setup.gripper.clone(), config.trajectory_optimization.clone());
        Self { setup, config, grasps, planner }
    }

    pub fn search(&self, start: &Start, flight: &FlightTrajectory) -> Result<CatchPlan, Refusal> {
        self.planner.search(start, flight, &self.grasps, &self.config.grasp_selection)
    }

    pub fn waiting(&self) -> Start {
        Start { time_s: KNOWN_S, state: Setpoint::at_rest(self.setup.ready_q) }
    }
}

/// A throw from 2 to 4 m away, ±30° about the waiting arm's throwers, that passes the base's axis at 0.3 to 0.8 m, in any
/// attitude.
pub fn random_flight(rng: &mut Pcg64) -> FlightTrajectory {
    let mut between = |low: f64, high: f64| rng.random_range(low..high);
    let from = PI / 4.0 + between(-0.52, 0.52);
    let (distance, height) = (between(2.0, 4.0), between(0.2, 1.2));
    let (aside, passes_at, duration) = (between(0.3, 0.8), between(0.2, 1.0), between(0.5, 0.8));
    let p_WO = Point3::new(distance * from.cos(), distance * from.sin(), height);
    // Past the axis on the side where the arm waits.
    let passed = Vector3::new(from.sin(), -from.cos(), 0.0) * aside;
    let mut v_WO = (passed - p_WO.coords) / duration;
    v_WO.z = (passes_at - height) / duration + 4.905 * duration;
    let mut normal = || between(-1.0, 1.0) + between(-1.0, 1.0) + between(-1.0, 1.0);
    let R_WO = UnitQuaternion::from_quaternion(Quaternion::new(normal(), normal(), normal(), normal() + 1e-9));
    FlightTrajectory { p_WO, v_WO, R_WO, ..FlightTrajectory::default() }
}

/// Throws that a search on a grid five times finer catches and the search does not.
fn lost(throws: usize) -> (usize, usize, Vec<(usize, Refusal)>) {
    let (mut caught, mut caught_finer, mut lost) = (0, 0, Vec::new());
    let mut times = Vec::new();
    for (o, object) in OBJECTS.iter().enumerate() {
        let desk = Desk::new(object, |_| {});
        let finer = Desk::new(object, |config| config.time_step_s /= 5.0);
        let mut rng = Pcg64::seed_from_u64(o as u64);
        for i in (o..throws).step_by(OBJECTS.len()) {
            let flight = random_flight(&mut rng);
            let before = std::time::Instant::now();
            let found = desk.search(&desk.waiting(), &flight);
            times.push((before.elapsed().as_secs_f64() * 1e3, found.as_ref().err().copied(), object));
            let found_finer = finer.search(&finer.waiting(), &flight);
            caught += usize::from(found.is_ok());
            caught_finer += usize::from(found_finer.is_ok());
            if let (Err(refusal), Ok(_)) = (found, found_finer) {
                lost.push((i, refusal));
            }
        }
    }
    times.sort_by(|a, b| a.0.total_cmp(&b.0));
    println!(
        "search: median {:.2} ms, 90 % {:.2} ms, 99 % {:.2}, max {:.2?}",
        times[throws / 2].0,
        times[throws * 9 / 10].0,
        times[throws * 99 / 100].0,
        &times[throws - 5..]
    );
    (caught, caught_finer, lost)
}

#[test]
fn a_finer_grid_finds_no_catch_that_was_missed() {
    let (caught, _, lost) = lost(90);
    assert!(caught > 30, "the throws are too hard to tell: {caught} caught");
    assert!(lost.is_empty(), "{lost:?}");
}

/// The whole of it: `cargo test --release --test it a_thousand_throws -- --ignored --nocapture`.
#[test]
#[ignore = "takes a minute"]
fn a_thousand_throws_lose_nothing() {
    let (caught, caught_finer, lost) = lost(1000);
    println!("{caught} of 1000 caught, {caught_finer} on the finer grid, lost: {lost:?}");
    assert!(lost.is_empty());
}
