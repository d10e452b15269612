//! Existing files are kept: no file of a user's is overwritten, and none is written by halves.

use std::{fs, path::Path};

use crate::{catchingbot, stderr};

/// Content that a user cannot get again.
const PRECIOUS: &str = "what nobody can get again\n";

/// Names in a folder, hidden ones as well.
fn names(folder: &Path) -> Vec<String> {
    let mut names: Vec<String> =
        fs::read_dir(folder).unwrap().map(|it| it.unwrap().file_name().into_string().unwrap()).collect();
    names.sort();
    names
}

#[test]
fn nothing_is_overwritten() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    let (here, tracks) = (at(""), at("t"));
    fs::create_dir(&tracks).unwrap();
    for throw in 0..5 {
        let row = |i: u32| {
            let time_s = f64::from(i) * 0.02;
            format!("{time_s},{},0,{}\n", 3.0 * time_s + f64::from(throw), 1.0 + 3.0 * time_s - 4.905 * time_s * time_s)
        };
        let rows: String = (0..30).map(row).collect();
        fs::write(at(&format!("t/{throw}.csv")), format!("t,x,y,z\n{rows}")).unwrap();
    }
    for (file, arguments) in [
        ("rig.toml", &["calibrate", "--poses", "3", "--out", &here][..]),
        ("calibration.html", &["calibrate", "--poses", "3", "--out", &here]),
        ("camera_0.yaml", &["calibrate", "--poses", "3", "--out", &here]),
        ("rig.toml", &["place-cameras", "--trials", "3", "--spacing", "1", "--out", &here]),
        ("cameras.html", &["place-cameras", "--trials", "3", "--spacing", "1", "--out", &here]),
        ("t/0.csv", &["learn", "--tracks", &tracks, "--folds", "2", "--out", &at("t/0.csv")]),
        ("o.toml", &["new", "throw", "o", "--out", &here]),
    ] {
        let path = at(file);
        let kept = fs::read_to_string(&path).unwrap_or(PRECIOUS.to_owned());
        fs::write(&path, &kept).unwrap();
        let output = catchingbot(arguments);
        assert_eq!(output.status.code(), Some(2), "{arguments:?}: {}", stderr(&output));
        assert!(stderr(&output).contains(&format!("{file}`, which is already there")), "{}", stderr(&output));
        assert_eq!(fs::read_to_string(&path).unwrap(), kept, "{arguments:?}");
        if kept == PRECIOUS {
            fs::remove_file(&path).unwrap();
        }
    }
    assert_eq!(names(folder.path()), ["t"]);
}

/// A long work that is refused has made no folder for its results.
#[test]
fn refusals_leave_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("a/b").to_str().unwrap().to_owned();
    for arguments in [
        &["calibrate", "--rig", "nope"][..],
        &["calibrate", "--set", "arena.frame_rate_hz=10000"],
        &["place-cameras", "--scenario", "nope"],
        &["place-cameras", "--trials", "1", "--spacing", "5"],
        &["learn", "--tracks", "nowhere"],
        &["robot", "import", "no.urdf"],
    ] {
        let output = catchingbot(&[arguments, &["--out", &out]].concat());
        assert_eq!(output.status.code(), Some(2), "{arguments:?}: {}", stderr(&output));
        assert!(names(folder.path()).is_empty(), "{arguments:?} left {:?}", names(folder.path()));
    }
}

/// Files may be of no more bytes than a disk that is nearly full takes.
#[cfg(unix)]
#[test]
fn a_full_disk_leaves_nothing_by_halves() {
    let folder = tempfile::tempdir().unwrap();
    let solid = folder.path().join("solid.obj");
    fs::write(&solid, "v 0 0 0\nv .09 0 0\nv 0 .09 0\nv 0 0 .09\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n").unwrap();
    let solid = solid.to_str().unwrap();
    let out = folder.path().join("out");
    let at = |name: &str| out.join(name).to_str().unwrap().to_owned();
    for arguments in [
        &["new", "robot", "arm", "--out", &at("")][..],
        &["new", "object", "o", "--out", &at("")],
        &["object", "import", solid, "--out", &at("o.toml")],
        &["robot", "import", solid, "--no-ready", "--out", &at("arm")],
        &["place-cameras", "--trials", "1", "--spacing", "1", "--cameras", "1", "--out", &at("")],
        &["catch", "--out", &at("")],
        &["export", "--mjcf", &at("")],
    ] {
        fs::create_dir_all(&out).unwrap();
        let program = env!("CARGO_BIN_EXE_catchingbot");
        let script = "trap '' XFSZ; ulimit -f 1; exec \"$@\"";
        let output =
            std::process::Command::new("sh").args(["-c", script, "sh", program]).args(arguments).output().unwrap();
        let is_import = arguments[..2] == ["robot", "import"];
        assert_eq!(output.status.code(), Some(if is_import { 2 } else { 1 }), "{arguments:?}: {}", stderr(&output));
        let left: Vec<String> = names(&out).into_iter().filter(|it| out.join(it).is_file()).collect();
        assert!(left.is_empty(), "{arguments:?} left {left:?}");
        fs::remove_dir_all(&out).unwrap();
    }
}

#[test]
fn a_bad_place_is_wrong_input_whoever_writes_there() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("file");
    fs::write(&file, PRECIOUS).unwrap();
    let within = |name: &str| file.join(name).to_str().unwrap().to_owned();
    let folder_of_scene = folder.path().join("paper-tennis_ball-near-1-0.catch");
    fs::create_dir(&folder_of_scene).unwrap();
    let taken = folder.path().to_str().unwrap();
    for arguments in [
        &["catch", "--out", &within("")][..],
        &["catch", "--scenario", "paper", "--out", taken],
        &["eval", "--trials", "1", "--out", &within("e")],
        &["export", "--mjcf", &within("m")],
        &["new", "throw", "t", "--out", &within("n")],
        &["calibrate", "--poses", "3", "--out", &within("c")],
        &["place-cameras", "--trials", "1", "--out", &within("c")],
    ] {
        let output = catchingbot(arguments);
        assert_eq!(output.status.code(), Some(2), "{arguments:?}: {}", stderr(&output));
    }
}

/// Whoever looks at a recording where nothing can be written is told of another place.
#[cfg(target_os = "linux")]
#[test]
fn a_page_that_has_no_place_is_offered_one() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().to_str().unwrap();
    assert!(catchingbot(&["catch", "--scenario", "paper", "--out", out]).status.success());
    let recording = fs::File::open(folder.path().join("paper-tennis_ball-near-1-0.catch")).unwrap();
    let mut command = std::process::Command::new(env!("CARGO_BIN_EXE_catchingbot"));
    let output = command.args(["view", "/proc/self/fd/0", "--no-open"]).stdin(recording).output().unwrap();
    assert_eq!(output.status.code(), Some(2));
    assert!(stderr(&output).contains("a folder that can be written, such as --out DIR"), "{}", stderr(&output));
}
