//! The command `calibrate`: what it writes is read again, by itself too.

use std::fs;

use serde_json::Value;

use crate::{catchingbot, stderr, stdout};

#[test]
fn a_rig_is_calibrated_and_read_again() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    let first = at("first");
    let common =
        ["calibrate", "--json", "--poses", "4", "--set", "camera=d435", "--set", "arena.depth.model=near_stereo"];
    let run = |more: &[&str]| {
        let output = catchingbot(&[&common[..], more].concat());
        assert!(output.status.success(), "{}", stderr(&output));
        serde_json::from_str::<Value>(&stdout(&output)).unwrap()
    };
    let document = run(&["--rig", "d435_1", "--set", "arena.depth.calibration_sd_m=0.02", "--out", &first]);
    let camera = &document["cameras"][0];
    assert_eq!(camera["status"], "converged", "{camera}");
    assert!(camera["position_error_m"].as_f64().unwrap() < 0.004, "{camera}");
    assert_eq!(document["limit_violations"], 0);
    assert!(fs::read_to_string(at("first/calibration.html")).unwrap().contains("converged"));
    let rig = at("first/rig.toml");
    assert!(fs::read_to_string(&rig).unwrap().contains("[cameras.calibration]"));
    assert!(catchingbot(&["check", &rig]).status.success());

    let hand_eye = fs::read_to_string(at("first/camera_0.calib")).unwrap();
    assert!(hand_eye.contains("robot_base_frame: iiwa_link_0\n"), "{hand_eye}");

    // One camera by itself: flights tell it the vertical and the time.
    assert!(document["flights"].is_null());
    let refined = run(&["--rig", "d435_1", "--flights", "2", "--scenario", "honest", "--out", &at("refined")]);
    assert_eq!((&refined["flights"]["status"], &refined["flights"]["flights"]), (&"refined".into(), &2.into()));
    assert!(refined["flights"]["tilt_sd_deg"][0].as_f64().unwrap() < 0.05, "{refined}");
    assert!(refined["cameras"][0]["position_error_m"].as_f64().unwrap() < 0.004, "{refined}");

    // The files for ROS are a first guess.
    let (info, result) = (at("first/camera_0.yaml"), at("first/camera_0.calib"));
    let again = run(&["--camera-info", &info, "--hand-eye", &result, "--out", &at("second")]);
    assert_eq!(again["cameras"][0]["status"], "converged");
    assert!(again["cameras"][0]["position_error_m"].as_f64().unwrap() < 0.004);

    for (more, says) in [
        (&["--camera-info", &info][..], "--hand-eye"),
        (&["--camera-info", &result, "--hand-eye", &info], "transform.translation.x: found nothing"),
        (&["--rig", "d435_9"], "expected one of d435_1"),
        (&["--poses", "2"], "expected a whole number from 3"),
        (&["--flights", "201"], "expected a whole number from 0 to 200"),
    ] {
        let output = catchingbot(&[&common[..1], more, &["--out", &at("third")]].concat());
        assert_eq!(output.status.code(), Some(2), "{more:?}");
        assert!(stderr(&output).contains(says), "{more:?}: {}", stderr(&output));
    }
}
