//! Benchmark of all cameras' images of one scene, exact and with every model of their errors: the windows
//! around a ball, those that a brain asks for, and full images. Processor time is measured, so that other
//! programs disturb little.

#![allow(missing_docs, reason = "the macros of criterion make functions without")]

use std::time::{Duration, Instant};

use catch_body::{Gripper, Pose, Robot, TriangleMesh, robot_file::RobotFiles};
use catch_cell::{PixelWindow, reference_scan, rig_from_toml};
use catch_sim::{
    cameras::{DepthCameras, Readout, Renderer, Scene},
    depth_noise::{DepthConfig, DepthModel, GaussianNoise},
};
use criterion::{Criterion, criterion_group, criterion_main};

/// Time that this thread spent on a processor, where the system tells; else the time on the wall.
fn processor_time(started: Instant) -> Duration {
    let told = std::fs::read_to_string("/proc/thread-self/schedstat").ok();
    let nanoseconds = told.and_then(|text| text.split_whitespace().next()?.parse().ok());
    nanoseconds.map_or_else(|| started.elapsed(), Duration::from_nanos)
}

fn timed<T>(criterion: &mut Criterion, name: &str, mut work: impl FnMut() -> T) {
    let started = Instant::now();
    criterion.bench_function(name, |bencher| {
        bencher.iter_custom(|times| {
            let before = processor_time(started);
            for _ in 0..times {
                std::hint::black_box(work());
            }
            processor_time(started) - before
        });
    });
}

fn render(criterion: &mut Criterion) {
    let files = RobotFiles {
        urdf_file: "robot.urdf",
        urdf: include_str!("../../../assets/robots/iiwa14/robot.urdf"),
        toml_file: "robot.toml",
        toml: include_str!("../../../assets/robots/iiwa14/robot.toml"),
    };
    let gripper = Gripper::from_toml("wsg50.toml", include_str!("../../../assets/grippers/wsg50.toml"))
        .expect("the built-in gripper is right");
    let robot = Robot::from_files(&files).expect("the built-in arm is right").with_mount_of(&gripper);
    let rig = |text| rig_from_toml("rig", text).expect("the built-in rig is right");
    let object = TriangleMesh::sphere(0.0336, 4);
    let far = rig(include_str!("../../../assets/rigs/paper_flight.toml"));
    let near = rig(include_str!("../../../assets/rigs/d435_4.toml"));
    let stereo = |text| DepthModel::Stereo(toml::from_str(text).expect("the built-in figures are right"));
    let models = [
        ("20 perfect", &far, DepthModel::Perfect),
        ("20 gaussian", &far, DepthModel::Gaussian(GaussianNoise { sd_m: 0.002 })),
        ("20 stereo7", &far, stereo(include_str!("../../../assets/depth_errors/stereo7.toml"))),
        ("20 stereo7c", &far, stereo(include_str!("../../../assets/depth_errors/stereo7c.toml"))),
        ("4 near_stereo", &near, stereo(include_str!("../../../assets/depth_errors/near_stereo.toml"))),
    ];

    let X_WL = robot.link_poses(&robot.ready_q);
    let X_WG = robot.gripper_in(&X_WL);
    let free = Pose::translation(1.2, 1.0, 0.8);
    let held = X_WG * Pose::translation(0.0, 0.09, 0.0);
    for (name, rig, model) in models {
        let depth = DepthConfig { model, ..DepthConfig::default() };
        let cameras = DepthCameras::new(rig, &depth, 0, 0);
        let exposures = || (0..rig.len()).map(|camera| (camera, 7));
        for floor_visible in [false, true] {
            let renderer = Renderer::new(&robot, &gripper, &object, floor_visible);
            let floor = if floor_visible { "floor" } else { "no floor" };
            for (place, X_WO) in [("free", free), ("in the gripper", held)] {
                let scene = Scene { capture_s: 0.0, X_WL, width_m: 0.11, X_WO };
                // A brain that knows the object within 5 cm asks for windows around it.
                let window = |camera: &catch_cell::CameraModel| {
                    let centre_C = camera.X_WC.inverse_transform_point(&X_WO.translation.vector.into());
                    camera.window_around(&centre_C, 0.0336 + 0.05)
                };
                let windows: Vec<PixelWindow> = cameras.cameras().iter().map(window).collect();
                timed(criterion, &format!("{name}, {floor}, ball {place}, labelled"), || {
                    cameras.capture(&renderer, &scene, exposures(), Readout::Object, true)
                });
                timed(criterion, &format!("{name}, {floor}, ball {place}, windows"), || {
                    cameras.capture(&renderer, &scene, exposures(), Readout::Windows(&windows), false)
                });
            }
            let scene = Scene { capture_s: 0.0, X_WL, width_m: 0.11, X_WO: free };
            timed(criterion, &format!("{name}, {floor}, full images"), || {
                cameras.capture(&renderer, &scene, exposures(), Readout::Full, false)
            });
        }
    }
    let reference = rig(include_str!("../../../assets/rigs/reference.toml"));
    timed(criterion, "reference scan", || reference_scan(&object, &reference));
}

criterion_group! {
    name = benches;
    config = Criterion::default().sample_size(10).measurement_time(Duration::from_secs(1)).warm_up_time(Duration::from_millis(200));
    targets = render
}
criterion_main!(benches);
