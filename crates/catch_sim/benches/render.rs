//! How long the twenty cameras take for one scene: the window around a ball beside the gripper, and full images.

#![allow(missing_docs, reason = "the macros of criterion make functions without")]

use catch_body::{Gripper, Pose, Robot, TriangleMesh, robot_file::RobotFiles};
use catch_sim::cameras::{Readout, Renderer, Scene, reference_scan, rig_from_toml};
use criterion::{Criterion, criterion_group, criterion_main};

fn render(criterion: &mut Criterion) {
    let files = RobotFiles {
        urdf_file: "robot.urdf",
        urdf: include_str!("../../../assets/robots/iiwa14/robot.urdf"),
        toml_file: "robot.toml",
        toml: include_str!("../../../assets/robots/iiwa14/robot.toml"),
    };
    let robot = Robot::from_files(&files).expect("the built-in arm is right");
    let gripper = Gripper::from_toml("wsg50.toml", include_str!("../../../assets/grippers/wsg50.toml"))
        .expect("the built-in gripper is right");
    let rig = |text| rig_from_toml("rig", text).expect("the built-in rig is right");
    let object = TriangleMesh::sphere(0.0336, 4);
    let cameras = rig(include_str!("../../../assets/rigs/paper_flight.toml"));
    let renderer = Renderer::new(&robot, &gripper, &object, false);

    let X_WL = robot.link_poses(&robot.ready_q);
    let X_WG = robot.gripper_in(&X_WL);
    for (name, X_WO) in
        [("free", Pose::translation(1.2, 1.0, 0.8)), ("in the gripper", X_WG * Pose::translation(0.0, 0.09, 0.0))]
    {
        let scene = Scene { capture_s: 0.0, X_WL: &X_WL, width_m: 0.11, X_WO: &X_WO };
        criterion.bench_function(&format!("20 labelled windows, ball {name}"), |bencher| {
            bencher.iter(|| renderer.render(&cameras, &scene, Readout::Object, true));
        });
    }
    let scene = Scene { capture_s: 0.0, X_WL: &X_WL, width_m: 0.11, X_WO: &X_WG };
    criterion.bench_function("20 full images", |bencher| {
        bencher.iter(|| renderer.render(&cameras, &scene, Readout::Full, true))
    });
    let reference = rig(include_str!("../../../assets/rigs/reference.toml"));
    criterion.bench_function("reference scan", |bencher| bencher.iter(|| reference_scan(&object, &reference)));
}

criterion_group! {
    name = benches;
    config = Criterion::default().sample_size(20);
    targets = render
}
criterion_main!(benches);
