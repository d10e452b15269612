//! A system that refuses threads or memory: fewer threads, or values that are refused with their bound.

use std::{fs, process::Command};

use crate::{catchingbot, stderr, stdout};

/// Stacks that no system has room for: every thread is refused.
#[cfg(target_os = "linux")]
#[test]
fn without_threads_it_goes_on() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    let program = env!("CARGO_BIN_EXE_catchingbot");
    for arguments in [
        &["eval", "--trials", "2", "--threads", "8", "--out", &at("e")][..],
        &["eval", "--scenario", "lab", "--object", "no", "--out", &at("f")],
        &["place-cameras", "--trials", "1", "--spacing", "1", "--cameras", "1", "--out", &at("p")],
    ] {
        let stack = (1_u64 << 46).to_string();
        let output = Command::new(program).args(arguments).env("RUST_MIN_STACK", stack).output().unwrap();
        let expected = if arguments.contains(&"no") { 2 } else { 0 };
        assert_eq!(output.status.code(), Some(expected), "{arguments:?}: {}", stderr(&output));
    }
    assert_eq!(fs::read_to_string(at("e/trials.jsonl")).unwrap().lines().count(), 2);
}

#[test]
fn what_takes_too_much_is_refused_with_its_bound() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    let rig = at("rig.toml");
    let camera = "[[cameras]]\nposition_m = [2.0, 2.0, 1.0]\nlook_at_m = [0.0, 0.0, 0.5]\nwidth_px = 5600\n\
                  height_px = 5700\nfocal_px = 4000.0\n";
    fs::write(&rig, camera).unwrap();
    let large = format!("flight_rig={rig}");
    for (arguments, says) in [
        (&["eval", "--threads", "100000"][..], "a whole number from 1 to 1024"),
        (&["catch", "--set", &large, "--out", &at("c")], "31920000 pixels, expected at most 8 megapixels"),
        (
            &["catch", "--set", "arena.latency_s=0.5", "--set", "arena.frame_rate_hz=1000.0", "--out", &at("e")],
            "arena.latency_s: found 0.5 s, with 5.6 GiB of images under way, expected at most 1 GiB",
        ),
        (
            &["calibrate", "--poses", "100", "--set", "arena.floor_visible=true", "--out", &at("d")],
            "expected at most 89 with these cameras",
        ),
    ] {
        let output = catchingbot(arguments);
        assert_eq!(output.status.code(), Some(2), "{arguments:?}");
        assert!(stderr(&output).contains(says), "{arguments:?}: {}", stderr(&output));
    }
}

/// CPU time must not grow with the fourth power of an object's size; 110 s were those of half a metre.
#[cfg(target_os = "linux")]
#[test]
fn large_objects_are_checked_in_time() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("big.toml");
    let ball = "name = \"big\"\n[truth]\nmass_kg = 0.5\nrestitution = 0.5\ndrag_per_m = 0.0\n[truth.shape]\nkind = \"ball\"\n\
                diameter_m = 0.5\nhollow = false\n[prior]\ndrag_per_m = 0.0\ndrag_sd_per_m = 0.0\n";
    fs::write(&path, ball).unwrap();
    let script = "ulimit -t 30; exec \"$@\"";
    let program = env!("CARGO_BIN_EXE_catchingbot");
    let output = Command::new("sh").args(["-c", script, "sh", program, "check"]).arg(&path).output().unwrap();
    // It is too wide for the gripper, which is what the check says.
    assert_eq!(output.status.code(), Some(2), "{}", stderr(&output));
    assert!(stdout(&output).contains("500 mm wide"), "{}", stdout(&output));
}
