//! CPU times of perception and prediction, image set by image set.

use catch_body::ray_cast::ArmSurface;
use nalgebra::Point3;

use super::*;
use crate::unlabelled;
use catch_bot::perception::{Prior, Surroundings, camera_alignment::CameraAlignment};

/// CPU time of this thread in milliseconds.
fn cpu_ms() -> f64 {
    let time = rustix::time::clock_gettime(rustix::time::ClockId::ThreadCPUTime);
    time.tv_sec as f64 * 1e3 + time.tv_nsec as f64 * 1e-6
}

fn percentiles(mut values: Vec<f64>) -> String {
    values.sort_by(f64::total_cmp);
    let at = |fraction: f64| values.get((fraction * values.len() as f64) as usize).copied().unwrap_or(f64::NAN);
    format!("p50 {:6.3} p99 {:6.3} max {:6.3}", at(0.5), at(0.99), values.last().copied().unwrap_or(f64::NAN))
}

/// What the images are like.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Images {
    /// With masks.
    Labelled,
    /// Without, the arm in its ready pose, the throw on its way.
    Unlabelled,
    /// Without, on a way that leads past the gripper at 20 cm.
    AtArm,
}

/// CPU time of perception and prediction for each set of images of whole throws, in which the first is a cold start.
#[test]
#[ignore = "takes minutes"]
fn measured_times() {
    measure_times(Images::Labelled);
}

#[test]
#[ignore = "takes minutes"]
fn measured_times_without_labels() {
    measure_times(Images::Unlabelled);
    measure_times(Images::AtArm);
}

fn measure_times(images: Images) {
    let prediction = Config { spin_prior_sd_radps: 3.0, ..Config::default() };
    let cameras = synthetic::flight_rig();
    let (robot, gripper) = unlabelled::arm();
    let surface = ArmSurface::new(&robot, &gripper);
    let X_WL = robot.link_poses(&robot.ready_q);
    let p_WG = robot.gripper_in(&X_WL) * Point3::new(0.0, 0.2, 0.0);
    let surroundings = Surroundings { arm: &surface, X_WL, width_m: 0.1 };
    let known = (images != Images::Labelled).then_some(&surroundings);
    for (name, shape) in Shape::all() {
        let reference = Arc::new(synthetic::reference(&shape, 200));
        for noise in NOISES {
            let config = told(noise);
            let scene = unlabelled::Scene { cameras: &cameras, surroundings, config: &config, noise };
            let (mut find_ms, mut predict_ms, mut whole_ms, mut cold_ms) = (vec![], vec![], vec![], vec![]);
            let (mut iterations, mut lost, mut before_arm) = (0, 0, 0);
            for seed in 0..12 {
                let mut normal = Normal::new(seed);
                let mut throw = throw(seed % 2 == 1, 0.0, 0.0, &reference, &mut normal);
                if images == Images::AtArm {
                    throw.p_WO += p_WG.coords - throw.pose_at(0.2).translation.vector;
                }
                let mut seen = Seen::default();
                for i in 0..40 {
                    let capture_s = 0.01 * f64::from(i);
                    let X_WO = throw.pose_at(capture_s);
                    let X_WR = X_WO * reference.X_RO.inverse();
                    let mut frames = if images == Images::Labelled {
                        synthetic::depth_frames(&cameras, &shape, &X_WR, noise, &mut normal)
                    } else {
                        // As the brain asks for them.
                        let reach_m = reference.radius_m + config.gate_m;
                        let centre = Point3::from(X_WO.translation.vector);
                        let window = |camera: &CameraModel| {
                            camera.window_around(&camera.X_WC.inverse_transform_point(&centre), reach_m)
                        };
                        let windows: Vec<_> = cameras.iter().map(window).collect();
                        scene.frames(&shape, &X_WR, &windows, &mut normal).0
                    };
                    frames.iter_mut().for_each(|frame| frame.capture_s = capture_s);
                    let last = seen.poses.last().map(|pose| pose.X_WO);
                    let expected = seen.flight.as_ref().map(|flight| flight.pose_at(capture_s)).or(last);
                    let start = cpu_ms();
                    let found = seen
                        .estimator
                        .get_or_insert_with(|| {
                            SdfEstimator::new(config.clone(), reference.clone(), Workspace::default())
                        })
                        .estimate(&View { frames: &frames, cameras: &cameras, surroundings: known }, expected.into());
                    let between = cpu_ms();
                    let Ok(pose) = found else {
                        lost += 1;
                        continue;
                    };
                    seen.poses.push(pose);
                    let flight = predict(
                        &seen.poses,
                        seen.flight.as_ref(),
                        reference.symmetry,
                        &prediction,
                        seed,
                        &mut Default::default(),
                    );
                    let end = cpu_ms();
                    seen.flight = flight.ok().or(seen.flight.take());
                    if pose.registered_globally {
                        cold_ms.push(between - start);
                    } else if i > 7 {
                        iterations += pose.iterations;
                        find_ms.push(between - start);
                        predict_ms.push(end - between);
                        whole_ms.push(end - start);
                        before_arm += scene.windows_before_arm(&frames);
                    }
                }
            }
            println!(
                "{images:?} {name:7} {:16} whole {}; iterations {:.1}, lost {lost}, arm in {:.1} windows",
                format!("{noise:?}"),
                percentiles(whole_ms.clone()),
                iterations as f64 / whole_ms.len() as f64,
                before_arm as f64 / whole_ms.len() as f64
            );
            println!("        perception {}", percentiles(find_ms));
            println!("        prediction {}", percentiles(predict_ms));
            println!("        cold start {} ({})", percentiles(cold_ms.clone()), cold_ms.len());
        }
    }
}

/// CPU time of finding the object without any prior, and whether it is found: orientations off by more than 0.2 rad are wrong.
#[test]
#[ignore = "takes minutes"]
fn measured_cold_starts() {
    let cameras = synthetic::flight_rig();
    for (name, shape) in Shape::all() {
        let reference = Arc::new(synthetic::reference(&shape, 200));
        let five_mm = Noise::Constant(0.005);
        let untold = perception::Config::default();
        for (noise, config) in
            NOISES.iter().map(|noise| (*noise, told(*noise))).chain([(five_mm, told(five_mm)), (five_mm, untold)])
        {
            let (mut find_ms, mut right) = (vec![], 0);
            for seed in 0..200 {
                let mut normal = Normal::new(seed);
                let X_WO = synthetic::pose_in_flight(&mut normal);
                let X_WR = X_WO * reference.X_RO.inverse();
                let frames = synthetic::depth_frames(&cameras, &shape, &X_WR, noise, &mut normal);
                let start = cpu_ms();
                let mut estimator = SdfEstimator::new(config.clone(), reference.clone(), Workspace::default());
                let view = View { frames: &frames, cameras: &cameras, surroundings: None };
                let found = estimator.estimate(&view, Prior::Anywhere);
                find_ms.push(cpu_ms() - start);
                right += usize::from(found.is_ok_and(|found| {
                    let off_m = (found.X_WO.translation.vector - X_WO.translation.vector).norm();
                    off_m < 0.01 && reference.symmetry.turn_between(&found.X_WO.rotation, &X_WO.rotation).norm() < 0.2
                }));
            }
            let is_told = if config.depth_noise.is_none() { "untold" } else { "told" };
            println!("{name:7} {noise:?} {is_told}: {right} of {} right, {}", find_ms.len(), percentiles(find_ms));
        }
    }
}

/// CPU time of the first search without labels, in full images with the arm waiting in them: prepared for that, and when the
/// arm is somewhere else than expected.
#[test]
#[ignore = "takes minutes"]
fn measured_cold_starts_without_labels() {
    let cameras = synthetic::flight_rig();
    let (robot, gripper) = unlabelled::arm();
    let surface = ArmSurface::new(&robot, &gripper);
    let X_WL = robot.link_poses(&robot.ready_q);
    let surroundings = Surroundings { arm: &surface, X_WL, width_m: 0.1 };
    let windows: Vec<_> = cameras.iter().map(CameraModel::full_window).collect();
    for (name, shape) in Shape::all() {
        let reference = Arc::new(synthetic::reference(&shape, 200));
        for noise in NOISES {
            let config = perception::Config { camera_sd_rad: 0.001, ..told(noise) };
            let scene = unlabelled::Scene { cameras: &cameras, surroundings, config: &config, noise };
            let prepared = Workspace::before_flight(&cameras, &surroundings, &config);
            let alignment = CameraAlignment::before_flight(&cameras, &surroundings, &config);
            let (mut align_ms, mut waiting_ms, mut elsewhere_ms, mut right) = (vec![], vec![], vec![], 0);
            for seed in 0..40 {
                let mut normal = Normal::new(seed);
                let X_WO = synthetic::pose_in_flight(&mut normal);
                let (frames, _) = scene.frames(&shape, &(X_WO * reference.X_RO.inverse()), &windows, &mut normal);
                let mut alignment = alignment.clone();
                let start = cpu_ms();
                alignment.observe(&frames, &cameras, Some(&surroundings), &config);
                align_ms.push(cpu_ms() - start);
                let view = View { frames: &frames, cameras: &cameras, surroundings: Some(&surroundings) };
                for (times_ms, workspace) in
                    [(&mut waiting_ms, prepared.clone()), (&mut elsewhere_ms, Workspace::default())]
                {
                    let mut estimator = SdfEstimator::new(config.clone(), reference.clone(), workspace);
                    let start = cpu_ms();
                    let found = estimator.estimate(&view, Prior::Anywhere);
                    times_ms.push(cpu_ms() - start);
                    right += usize::from(found.is_ok_and(|found| {
                        let turn = reference.symmetry.turn_between(&found.X_WO.rotation, &X_WO.rotation);
                        (found.X_WO.translation.vector - X_WO.translation.vector).norm() < 0.01 && turn.norm() < 0.2
                    }));
                }
            }
            println!("{name:7} {noise:?}: {right} of {} right", waiting_ms.len() + elsewhere_ms.len());
            println!("        alignment     {}", percentiles(align_ms));
            println!("        waiting arm   {}", percentiles(waiting_ms));
            println!("        arm elsewhere {}", percentiles(elsewhere_ms));
        }
    }
}
