//! What perception and prediction achieve together, on images of throws: tables for `docs/perception.md`.
//!
//! `cargo test --release -p catch_bot -- --ignored --nocapture measured`

#![allow(clippy::print_stdout, reason = "tests tell what they measured")]

use catch_body::Pose;
use catch_cell::{CameraModel, DepthFrame};
use nalgebra::{Translation3, Vector3};

use super::{flight::Motion, tumbling::Tumbling, *};
use crate::perception::{
    self, DepthNoise, ReferenceModel, Workspace, find_object,
    synthetic::{self, Noise, Normal, Shape},
};

/// A throw as in the paper, with the spin and drag given.
struct Throw {
    start: Motion,
    attitude: Tumbling,
    drag_per_m: f64,
}

impl Throw {
    fn new(far: bool, spin_radps: f64, drag_per_m: f64, reference: &ReferenceModel, normal: &mut Normal) -> Self {
        let (p_WO, v_WO) = if far {
            (Vector3::new(2.66613, 2.6152, 0.5), Vector3::new(-2.95994, -4.06236, 3.5882))
        } else {
            (Vector3::new(1.66613, 1.63277, 0.3), Vector3::new(-1.58705, -2.68301, 3.75643))
        };
        let (p_WO, v_WO) = (p_WO + normal.vector() * 0.05, v_WO + normal.vector() * 0.1);
        let w_WO = normal.vector().normalize() * spin_radps;
        let inertia = tumbling::inertia(&reference.symmetry);
        let attitude = Tumbling::new(normal.rotation(), &w_WO, inertia.as_ref());
        Self { start: Motion::new(p_WO, v_WO), attitude, drag_per_m }
    }

    fn pose_at(&self, time_s: f64) -> Pose {
        let p_WO = self.start.after(time_s, self.drag_per_m, false).p;
        Pose::from_parts(Translation3::from(p_WO), self.attitude.after(time_s, false).R_WO)
    }
}

/// When a throw is caught.
const CATCH_S: f64 = 0.7;

struct Setting {
    frames: [usize; 2],
    outliers: f64,
    spin_radps: f64,
    drag_per_m: f64,
    prediction: Config,
}

/// Perception that knows its cameras' noise, as a data sheet has it.
fn told(noise: Noise) -> perception::Config {
    let (constant_m, quadratic_per_m) = synthetic::data_sheet(noise);
    let depth_noise = DepthNoise { constant_m, quadratic_per_m };
    perception::Config { depth_noise, ..Default::default() }
}

/// What the brain has seen of one throw.
#[derive(Default)]
struct Seen {
    poses: Vec<ObjectPose>,
    flight: Option<FlightTrajectory>,
    workspace: Workspace,
}

/// Errors at the catch.
#[derive(Debug, Default)]
struct Errors {
    pose_mm: Vec<f64>,
    pose_deg: Vec<f64>,
    catch_mm: Vec<f64>,
    catch_deg: Vec<f64>,
    arrival_ms: Vec<f64>,
    /// eᵀΣ⁻¹e of the poses' positions and of the predicted positions at the catch.
    pose_squares: Vec<f64>,
    catch_squares: Vec<f64>,
    missing: usize,
}

/// Errors for each noise, after each of the two numbers of frames.
fn measure(shape: &Shape, noises: &[Noise], setting: &Setting, throws: u64) -> Vec<[Errors; 2]> {
    let reference = synthetic::reference(shape, 200);
    let cameras = synthetic::flight_rig();
    let mut errors: Vec<[Errors; 2]> = noises.iter().map(|_| Default::default()).collect();
    for seed in 0..throws {
        let mut normal = Normal::new(seed);
        let throw = Throw::new(seed % 2 == 1, setting.spin_radps, setting.drag_per_m, &reference, &mut normal);
        let mut seen: Vec<Seen> = noises.iter().map(|_| Seen::default()).collect();
        for i in 0..setting.frames[1] {
            let capture_s = 0.01 * i as f64;
            let X_WO = throw.pose_at(capture_s);
            let mut shown = X_WO;
            let outlier = normal.uniform(0.0, 1.0) < setting.outliers;
            let away = normal.vector().normalize() * normal.uniform(0.05, 0.2);
            if outlier {
                shown.translation.vector += away;
            }
            let X_WS = shown * reference.X_RO.inverse();
            let mut clean = synthetic::depth_frames(&cameras, shape, &X_WS, Noise::Clean, &mut normal);
            clean.iter_mut().for_each(|frame| frame.capture_s = capture_s);
            for ((noise, seen), errors) in noises.iter().zip(&mut seen).zip(&mut errors) {
                let mut frames = clean.clone();
                synthetic::add_noise(&mut frames, *noise, &mut normal);
                let late = usize::from(i >= setting.frames[0]);
                look(seen, &frames, &cameras, &reference, &told(*noise), &setting.prediction, seed);
                match seen.poses.last().filter(|pose| pose.capture_s == capture_s) {
                    Some(pose) if !outlier => errors[late].add_pose(pose, &X_WO, &reference.symmetry),
                    Some(_) => {}
                    None => errors[late].missing += 1,
                }
                if i + 1 == setting.frames[0] || i + 1 == setting.frames[1] {
                    errors[late].add_flight(seen.flight.as_ref(), &throw.pose_at(CATCH_S), &reference.symmetry);
                }
            }
        }
    }
    errors
}

/// One tick of the brain's first half.
fn look(
    seen: &mut Seen,
    frames: &[DepthFrame],
    cameras: &[CameraModel],
    reference: &ReferenceModel,
    perception: &perception::Config,
    prediction: &Config,
    seed: u64,
) {
    let expected = seen.flight.as_ref().map(|flight| flight.pose_at(frames[0].capture_s));
    let found = find_object(frames, cameras, reference, expected.as_ref(), None, perception, &mut seen.workspace);
    let Ok(pose) = found else { return };
    seen.poses.push(pose);
    let flight = predict(&seen.poses, seen.flight.as_ref(), reference.symmetry, prediction, seed, &mut Default::default());
    seen.flight = flight.ok().or(seen.flight.take());
}

impl Errors {
    fn add_pose(&mut self, pose: &ObjectPose, truth: &Pose, symmetry: &Symmetry) {
        let error = pose.X_WO.translation.vector - truth.translation.vector;
        self.pose_mm.push(error.norm() * 1e3);
        self.pose_deg.push(symmetry.turn_between(&pose.X_WO.rotation, &truth.rotation).norm().to_degrees());
        let mut information = pose.information;
        (0..3).for_each(|i| information[(i, i)] += 1e-3);
        let covariance = information.try_inverse().unwrap().fixed_view::<3, 3>(3, 3).into_owned();
        self.pose_squares.push(error.dot(&(covariance.try_inverse().unwrap() * error)));
    }

    fn add_flight(&mut self, flight: Option<&FlightTrajectory>, truth: &Pose, symmetry: &Symmetry) {
        let Some(flight) = flight else {
            self.missing += 1;
            return;
        };
        let found = flight.pose_at(CATCH_S);
        let error = found.translation.vector - truth.translation.vector;
        self.catch_mm.push(error.norm() * 1e3);
        self.catch_deg.push(symmetry.turn_between(&found.rotation, &truth.rotation).norm().to_degrees());
        let along = flight.twist_at(CATCH_S).linear;
        self.arrival_ms.push((error.dot(&along) / along.norm_squared()).abs() * 1e3);
        let covariance = flight.covariance_at(CATCH_S).fixed_view::<3, 3>(0, 0).into_owned();
        self.catch_squares.push(error.dot(&(covariance.try_inverse().unwrap() * error)));
    }
}

fn median(values: &[f64]) -> f64 {
    let mut values = values.to_vec();
    if values.is_empty() {
        return f64::NAN;
    }
    let middle = values.len() / 2;
    *values.select_nth_unstable_by(middle, f64::total_cmp).1
}

/// Share within the 95 % ellipsoid of three dimensions.
fn coverage(squares: &[f64]) -> f64 {
    squares.iter().filter(|square| **square < 7.815).count() as f64 / squares.len().max(1) as f64 * 100.0
}

fn report(throws: u64, setting: &Setting) {
    let noises = [Noise::Clean, Noise::Constant(0.002), Noise::Stereo7];
    for (name, shape) in Shape::all() {
        for (noise, both) in noises.iter().zip(measure(&shape, &noises, setting, throws)) {
            for (frames, errors) in setting.frames.iter().zip(&both) {
                println!(
                    "{name:7} {:16} {frames:3} frames: pose {:6.3} mm {:6.3}° ({:4.1} % in 95 %); catch {:6.2} mm {:5.2}° \
                     {:5.3} ms ({:4.1} % in 95 %, {:4.2} of claimed); missing {}",
                    format!("{noise:?}"),
                    median(&errors.pose_mm),
                    median(&errors.pose_deg),
                    coverage(&errors.pose_squares),
                    median(&errors.catch_mm),
                    median(&errors.catch_deg),
                    median(&errors.arrival_ms),
                    coverage(&errors.catch_squares),
                    (median(&errors.catch_squares) / 2.366).sqrt(),
                    errors.missing
                );
            }
        }
    }
}

#[test]
#[ignore = "takes minutes"]
fn measured_prediction_without_drag() {
    let prediction = Config { spin_prior_sd_radps: 3.0, ..Config::default() };
    report(48, &Setting { frames: [10, 20], outliers: 0.1, spin_radps: 0.0, drag_per_m: 0.0, prediction });
}

#[test]
#[ignore = "takes minutes"]
fn measured_prediction_with_spin_and_drag() {
    let prediction = Config { drag_prior_per_m: 0.06, drag_prior_sd_per_m: 0.02, ..Config::default() };
    report(48, &Setting { frames: [10, 20], outliers: 0.1, spin_radps: 6.0, drag_per_m: 0.05, prediction });
}

/// CPU time of this thread in milliseconds.
#[cfg(unix)]
fn cpu_ms() -> f64 {
    let time = rustix::time::clock_gettime(rustix::time::ClockId::ThreadCPUTime);
    time.tv_sec as f64 * 1e3 + time.tv_nsec as f64 * 1e-6
}

#[cfg(unix)]
fn percentiles(mut values: Vec<f64>) -> String {
    values.sort_by(f64::total_cmp);
    let at = |share: f64| values.get((share * values.len() as f64) as usize).copied().unwrap_or(f64::NAN);
    format!("p50 {:6.3} p99 {:6.3} max {:6.3}", at(0.5), at(0.99), values.last().copied().unwrap_or(f64::NAN))
}

/// CPU time of perception and prediction for each set of images of whole throws, in which the first is a cold start.
#[test]
#[cfg(unix)]
#[ignore = "takes minutes"]
fn measured_times() {
    let prediction = Config { spin_prior_sd_radps: 3.0, ..Config::default() };
    let cameras = synthetic::flight_rig();
    for (name, shape) in Shape::all() {
        let reference = synthetic::reference(&shape, 200);
        for noise in [Noise::Clean, Noise::Constant(0.002), Noise::Stereo7] {
            let config = told(noise);
            let (mut find_ms, mut predict_ms, mut whole_ms, mut cold_ms) = (vec![], vec![], vec![], vec![]);
            let (mut iterations, mut lost) = (0, 0);
            for seed in 0..12 {
                let mut normal = Normal::new(seed);
                let throw = Throw::new(seed % 2 == 1, 0.0, 0.0, &reference, &mut normal);
                let mut seen = Seen::default();
                for i in 0..40 {
                    let capture_s = 0.01 * f64::from(i);
                    let X_WS = throw.pose_at(capture_s) * reference.X_RO.inverse();
                    let mut frames = synthetic::depth_frames(&cameras, &shape, &X_WS, noise, &mut normal);
                    frames.iter_mut().for_each(|frame| frame.capture_s = capture_s);
                    let last = seen.poses.last().map(|pose| pose.X_WO);
                    let expected = seen.flight.as_ref().map(|flight| flight.pose_at(capture_s)).or(last);
                    let start = cpu_ms();
                    let found = find_object(&frames, &cameras, &reference, expected.as_ref(), None, &config, &mut seen.workspace);
                    let between = cpu_ms();
                    let Ok(pose) = found else { lost += 1; continue };
                    seen.poses.push(pose);
                    let flight = predict(&seen.poses, seen.flight.as_ref(), reference.symmetry, &prediction, seed, &mut Default::default());
                    let end = cpu_ms();
                    seen.flight = flight.ok().or(seen.flight.take());
                    if pose.cold_started {
                        cold_ms.push(between - start);
                    } else if i > 7 {
                        iterations += pose.iterations;
                        find_ms.push(between - start);
                        predict_ms.push(end - between);
                        whole_ms.push(end - start);
                    }
                }
            }
            println!("{name:7} {:16} whole {}; iterations {:.1}, lost {lost}", format!("{noise:?}"), percentiles(whole_ms.clone()), iterations as f64 / whole_ms.len() as f64);
            println!("        perception {}", percentiles(find_ms));
            println!("        prediction {}", percentiles(predict_ms));
            println!("        cold start {} ({})", percentiles(cold_ms.clone()), cold_ms.len());
        }
    }
}
