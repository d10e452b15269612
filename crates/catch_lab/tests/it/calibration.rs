//! Cameras are calibrated on the arm, and what cannot be calibrated is said.

use catch_body::{Pose, Robot};
use catch_calibration::{CalibrationStatus, Config, calibrate};
use catch_cell::CameraModel;
use catch_lab::scenario::setup::{
    Choice, Setup,
    calibration::{self, ArenaSession},
};
use nalgebra::{UnitQuaternion, Vector3};

fn setup() -> Setup {
    let settings = [
        "flight_rig=\"d435_1\"",
        "camera=d435",
        "arena.depth.model=\"near_stereo\"",
        "arena.depth.calibration_sd_m=0",
        "arena.depth.calibration_sd_rad=0",
    ]
    .map(str::to_owned);
    Setup::load(&Choice { scenario: Some("honest"), settings: &settings, ..Choice::default() }).unwrap()
}

/// Cameras as they are believed to stand: 50 mm and 5° off.
fn guesses(setup: &Setup) -> Vec<CameraModel> {
    let p = Vector3::new(0.03, -0.04, 0.0);
    let turn = Vector3::new(-0.6, 0.64, 0.48) * 5.0_f64.to_radians();
    let off = Pose::from_parts(p.into(), UnitQuaternion::from_scaled_axis(turn));
    setup.cameras.iter().map(|camera| CameraModel { X_WC: camera.X_WC * off, ..camera.clone() }).collect()
}

fn few_poses(setup: &Setup) -> Config {
    Config { poses: 6, ..calibration::config(&setup.knowledge(), setup.scenario.arena.frame_rate_hz, 3) }
}

/// From 50 mm and 5°, the clock being off by 4 ms, with half the poses; and what the same session gives where
/// the model of the arm is wrong, and where a camera was blind.
#[test]
fn a_near_camera_finds_its_place_or_says_that_it_does_not() {
    const CLOCK_S: f64 = 0.004;
    let setup = setup();
    let (guesses, config) = (guesses(&setup), few_poses(&setup));
    let ArenaSession { mut session, limit_violations, robot_time_s, poses } =
        calibration::run_session(&setup, &config, &guesses, (5, 0), &mut |_| ());
    assert_eq!((limit_violations, poses.len()), (0, 6));
    assert!(robot_time_s < 40.0, "{robot_time_s}");
    // One before the arm moves, one of it at rest and one on the way for each pose, whatever the cameras'
    // rates: they take memory.
    assert!(session.images.len() <= 1 + 2 * poses.len(), "{}", session.images.len());
    session.images.iter_mut().for_each(|image| image.capture_s -= CLOCK_S);

    let found = calibrate(&config, &setup.robot, &setup.gripper, &guesses, &session);
    assert_eq!(calibrate(&config, &setup.robot, &setup.gripper, &guesses, &session), found, "always the same");
    let camera = &found.cameras[0];
    let off = camera.X_WC.inv_mul(&setup.cameras[0].X_WC);
    assert_eq!(camera.status, CalibrationStatus::Converged, "{camera:?}");
    assert!(off.translation.vector.norm() < 0.0015 && off.rotation.angle() < 0.04_f64.to_radians(), "{off}");
    assert!((camera.time_offset_s - CLOCK_S).abs() < 0.001, "{camera:?}");
    assert!(camera.depth_scale.abs() < 0.002, "{camera:?}");

    let offset_m = found.link_offset_m.iter().fold(0.0_f64, |most, it| most.max(it.abs()));
    assert!(offset_m < 0.001, "{:?}", found.link_offset_m);

    // Capsules around the links are not what cameras see.
    let unaware = Robot { visuals: Default::default(), ..setup.robot.clone() };
    let wrong = calibrate(&config, &unaware, &setup.gripper, &guesses, &session);
    assert_ne!(wrong.cameras[0].status, CalibrationStatus::Converged, "{wrong:?}");

    session.images.clear();
    let blind = calibrate(&config, &setup.robot, &setup.gripper, &guesses, &session);
    assert_eq!(blind.cameras[0].status, CalibrationStatus::TooFewImages);
}
