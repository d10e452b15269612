//! Cameras are aligned on the arm that they see.

use catch_body::{Pose, ray_cast::ArmSurface};
use catch_bot::perception::{Config, Surroundings, camera_alignment::CameraAlignment, segmentation::Background};
use catch_cell::{CameraModel, DepthFrame};
use nalgebra::{UnitQuaternion, Vector3};

use crate::{
    synthetic::{self, Normal},
    unlabelled::arm,
};

/// Mean angle in radians between where cameras look and where they are thought to look.
fn off_rad(cameras: &[CameraModel], truth: &[CameraModel]) -> f64 {
    let off = |(a, b): (&CameraModel, &CameraModel)| a.X_WC.rotation.angle_to(&b.X_WC.rotation);
    cameras.iter().zip(truth).map(off).sum::<f64>() / truth.len() as f64
}

/// Standard deviation in radians about each axis across the look of a camera: 0.05°.
const SD_RAD: f64 = 0.00087;

/// Errors of cameras that are rotated at random, before and after each of four images of the arm, a tenth of
/// whose pixels are missing; an object of 0.3 m beside the arm does not belong to it.
fn aligned(surroundings: &Surroundings<'_>, seed: u64) -> (f64, [f64; 4]) {
    let config = Config { camera_sd_rad: SD_RAD, ..Config::default() };
    let told = synthetic::flight_rig();
    let mut normal = Normal::new(seed);
    let turned = |camera: &CameraModel| {
        let turn = normal.vector().component_mul(&Vector3::new(SD_RAD, SD_RAD, 0.0));
        let X_CT = Pose::from_parts(Vector3::zeros().into(), UnitQuaternion::from_scaled_axis(turn));
        CameraModel { X_WC: camera.X_WC * X_CT, ..camera.clone() }
    };
    let truth: Vec<CameraModel> = told.iter().map(turned).collect();
    let mut alignment = CameraAlignment::new(&told);
    let before = off_rad(&alignment.cameras, &truth);
    let after = [0, 1, 2, 3].map(|image| {
        let frame = |(i, camera): (usize, &CameraModel)| {
            let window = camera.full_window();
            let mut depth_m = Background::new(camera, Some(surroundings), &window, &config).cast_all();
            for (pixel, depth_m) in depth_m.iter_mut().enumerate() {
                let uv = window.pixel_centre(pixel);
                if (uv.x - 160.0).abs() < 8.0 && (uv.y - 150.0).abs() < 8.0 {
                    *depth_m = 6.0;
                } else if normal.uniform(0.0, 1.0) < 0.1 {
                    *depth_m = f32::NAN;
                }
            }
            DepthFrame { camera: i, capture_s: 0.01 * f64::from(image), window, depth_m, mask: None }
        };
        let frames: Vec<DepthFrame> = truth.iter().enumerate().map(frame).collect();
        alignment.observe(&frames, &told, Some(surroundings), &config);
        off_rad(&alignment.cameras, &truth)
    });
    (before, after)
}

/// Averages over several rigs, so that no single one decides.
#[test]
fn cameras_are_turned_to_where_they_look() {
    let (robot, gripper) = arm();
    let surface = ArmSurface::new(&robot, &gripper);
    let surroundings = Surroundings { arm: &surface, X_WL: robot.link_poses(&robot.ready_q), width_m: 0.1 };
    let rigs: Vec<_> = (0..6).map(|seed| aligned(&surroundings, seed)).collect();
    let before = rigs.iter().map(|it| it.0).sum::<f64>();
    let [first, last] = [0, 3].map(|image| rigs.iter().map(|it| it.1[image]).sum::<f64>());
    assert!(rigs.iter().all(|it| it.0 > SD_RAD), "{rigs:?}");
    assert!(first < before / 3.0 && last < before / 6.0, "{rigs:?}");
    assert!(rigs.iter().all(|it| it.1[3] < it.0 / 4.0), "{rigs:?}");
}
