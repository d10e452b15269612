//! A budget for speed: the instructions that each stage of a tick takes on given inputs, compared with
//! `instructions.txt`.
//!
//! `cargo bench -p catch_bot --bench instructions` counts with valgrind and fails if a stage takes over 3 %
//! more than the baseline; `-- --renew` writes a new baseline. Without valgrind it says so and passes.

#![allow(
    clippy::print_stdout,
    clippy::disallowed_methods,
    reason = "it runs valgrind, keeps a file and tells what it counted"
)]

mod inputs;
#[path = "../tests/it/synthetic.rs"]
mod synthetic;

use std::{collections::BTreeMap, f64::consts::PI, fs, hint::black_box, process::Command, sync::Arc};

use catch_bot::{
    grasp_selection::{self, GraspSet},
    perception::{
        self, DepthNoise, PoseEstimator, ReferenceModel, RotationGroup, SdfEstimator, Symmetry, View, Workspace,
    },
    trajectory_optimization::{CatchSearch, Incoming, Start, failure_counter::FailureCounter, retarget::Correction},
    trajectory_prediction::{self, AerodynamicPrior, FlightPredictor, FlightTrajectory, InformationFit, ProcessNoise},
};
use inputs::{Images, arm};
use nalgebra::{UnitQuaternion, Vector3};
use synthetic::{Noise, Shape};

const BASELINE: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/benches/instructions.txt");
/// Relative increase of a stage's instruction count over the baseline that is allowed.
const TOLERANCE: f64 = 0.03;

/// Stages by name.
const STAGES: [(&str, fn()); 12] = [
    ("registration", || perceive(Noise::Clean, true, true, false)),
    ("registration_with_silhouettes", || perceive(Noise::Stereo7, true, true, false)),
    ("registration_with_half_turn", || perceive(Noise::Stereo7, true, true, true)),
    ("segmentation", || perceive(Noise::Clean, false, true, false)),
    ("global_registration", || perceive(Noise::Clean, true, false, true)),
    ("detection", || perceive(Noise::Clean, false, false, true)),
    ("trajectory_prediction", || predict_flight(&Shape::ball(), None, &told())),
    ("trajectory_prediction_of_ball", || predict_flight(&Shape::ball(), Some(Symmetry::Sphere), &expected())),
    ("trajectory_prediction_of_bottle", || predict_flight(&Shape::Bottle, None, &expected())),
    ("trajectory_prediction_with_forces", || predict_flight(&Shape::Bottle, None, &with_forces())),
    ("catch_search", || plan(false)),
    ("replan", || plan(true)),
];

fn main() {
    let arguments: Vec<String> = std::env::args().skip(1).filter(|it| it != "--bench").collect();
    match arguments.first().map(String::as_str) {
        Some("--renew") => renew(),
        Some(name) => STAGES.iter().find(|stage| stage.0 == name).expect("the name of a stage").1(),
        None => compare(),
    }
}

/// Runs a stage twice, of which valgrind counts the second run, when buffers are as large as they need to be.
fn run<T>(mut work: impl FnMut() -> T) {
    black_box(work());
    black_box(counted(&mut work));
}

#[inline(never)]
fn counted<T>(work: &mut impl FnMut() -> T) -> T {
    work()
}

/// A pose of an object from one set of images, with masks or without, a predicted pose given or not, while it
/// is open which end of the object is which, or for one that looks the same after half a turn.
fn perceive(noise: Noise, masks: bool, tracked: bool, is_open: bool) {
    let (constant_m, quadratic_per_m) = synthetic::data_sheet(noise);
    let depth_noise = Some(DepthNoise { constant_m, quadratic_per_m });
    let config = perception::Config { depth_noise, ..Default::default() };
    let shape = Shape::banana();
    let mut reference = ReferenceModel::from_scan(&synthetic::scan(&shape, 64));
    if let (false, Symmetry::Finite { group, inertia_per_kg }) = (is_open, &mut reference.symmetry) {
        let axes = inertia_per_kg.symmetric_eigen().eigenvectors;
        *group = RotationGroup::generated([0, 1].map(|i| UnitQuaternion::from_scaled_axis(axes.column(i) * PI)));
    }
    let reference = Arc::new(reference);
    let Images { cameras, mut frames, prior } = Images::new(&shape, &reference, noise);
    frames.iter_mut().filter(|_| !masks).for_each(|frame| frame.mask = None);
    let view = View { frames: &frames, cameras: &cameras, ..View::default() };
    let mut estimator = SdfEstimator::new(config, reference, Workspace::default());
    run(|| estimator.estimate(&view, tracked.then_some(prior).into()).expect("a pose"));
}

/// A flight from thirty poses and the flight before.
fn predict_flight(shape: &Shape, symmetry: Option<Symmetry>, config: &trajectory_prediction::Config) {
    let reference = Arc::new(ReferenceModel::from_scan(&synthetic::scan(shape, 32)));
    let poses = inputs::poses(shape, &reference);
    let symmetry = symmetry.unwrap_or(reference.symmetry);
    let mut fit = InformationFit::new(config.clone(), symmetry, 1);
    let before = fit.predict(&poses, None).expect("a flight");
    run(|| fit.predict(&poses, Some(&before)).expect("a flight"));
}

/// Drag that is known about.
fn told() -> trajectory_prediction::Config {
    trajectory_prediction::Config { drag_prior_sd_per_m: Some(0.02), ..Default::default() }
}

/// Prediction settings with an error that successive poses have in common.
fn expected() -> trajectory_prediction::Config {
    trajectory_prediction::Config { correlated_sd_per_m: Some(3e-4), ..told() }
}

/// Prediction settings that also have forces that depend on orientation and spin.
fn with_forces() -> trajectory_prediction::Config {
    let aerodynamics = AerodynamicPrior {
        drag_deviation_sd_per_m: 0.015,
        magnus_sd: 0.0018,
        lift_sd_radps: 0.03,
        spin_decay_sd_per_s: 0.18,
        ..Default::default()
    };
    let process_noise = ProcessNoise { acceleration: 0.003, angular_acceleration: 0.0 };
    trajectory_prediction::Config { aerodynamics, process_noise, ..expected() }
}

/// A catch of the paper's near throw, or its replan after the flight has changed by 5 mm.
fn plan(again: bool) {
    let search = CatchSearch::new(arm::planner(|_| {}), None);
    let reference = ReferenceModel::from_scan(&synthetic::scan(&Shape::banana(), 64));
    let config = grasp_selection::Config::default();
    let grasps = GraspSet::sample(&reference, &search.motion.gripper, &config);
    let flight = inputs::near_throw();
    let failures = FailureCounter::default();
    let incoming = Incoming { flight: &flight, grasps: &grasps, config: &config, failures: &failures };
    let start = arm::at_rest(&search.motion, &inputs::READY, 0.07);
    if !again {
        return run(|| search.search(&start, &incoming).expect("a catch"));
    }
    let plan = search.search(&start, &incoming).expect("a catch");
    let later = Start { time_s: 0.2, state: plan.trajectory.setpoint(0.2) };
    let aside = FlightTrajectory { p_WOcm: flight.p_WOcm + Vector3::x() * 5e-3, ..flight.clone() };
    let aside = Incoming { flight: &aside, ..incoming };
    run(|| search.retarget(&Correction::new(&later, &aside, &plan, plan.catch_s)).expect("a replan"));
}

/// The instructions of each stage, if they can be counted here.
fn count() -> Option<BTreeMap<&'static str, u64>> {
    let counts = STAGES.map(|(stage, _)| {
        let output = Command::new("valgrind")
            .args(["--tool=callgrind", "--callgrind-out-file=/dev/null", "--collect-atstart=no"])
            .arg("--toggle-collect=*instructions::counted*")
            .arg(std::env::current_exe().ok()?)
            .arg(stage)
            .output()
            .ok()?;
        let said = String::from_utf8_lossy(&output.stderr);
        assert!(output.status.success(), "{stage}: {said}");
        let count = said.lines().find_map(|line| line.split_once("Collected :")?.1.trim().parse().ok());
        Some((stage, count.unwrap_or_else(|| panic!("no count in {said}"))))
    });
    counts.into_iter().collect()
}

fn renew() {
    let counts = count().expect("valgrind");
    let lines: String = counts.iter().map(|(stage, count)| format!("{stage} {count}\n")).collect();
    fs::write(BASELINE, lines).expect("a baseline that can be written");
}

fn compare() {
    let Some(counts) = count() else {
        println!("instructions were not counted: there is no valgrind");
        return;
    };
    let baseline = fs::read_to_string(BASELINE).expect("a baseline");
    let baseline: BTreeMap<&str, f64> = baseline
        .lines()
        .filter_map(|line| line.split_once(' '))
        .map(|(stage, n)| (stage, n.parse().expect("a count")))
        .collect();
    let mut slower = Vec::new();
    for (stage, count) in counts {
        let more = baseline.get(stage).map_or(f64::INFINITY, |before| count as f64 / before - 1.0);
        println!("{stage:30} {count:12} {:+6.1} %", 100.0 * more);
        if more > TOLERANCE {
            slower.push(stage);
        }
    }
    assert!(slower.is_empty(), "more instructions than the baseline allows: {}", slower.join(", "));
}
