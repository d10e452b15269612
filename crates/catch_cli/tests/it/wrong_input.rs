//! Wrong input gets one clear message (what is wrong, where, what would be right), exit code 2, and leaves
//! nothing behind.

use std::{
    fs,
    path::{Path, PathBuf},
};

use tempfile::TempDir;

use crate::{catchingbot, stderr, stdout};

/// The workspace.
fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../..")
}

/// Runs the program with arguments that are wrong; returns its one line of complaint.
fn complaint(arguments: &[&str]) -> String {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("out");
    let mut all = arguments.to_vec();
    if arguments[0] == "catch" {
        all.extend(["--out", out.to_str().unwrap()]);
    }
    let output = catchingbot(&all);
    let complaint = stderr(&output);
    assert_eq!(output.status.code(), Some(2), "{arguments:?}: {complaint}");
    assert!(!complaint.contains("panicked"), "{complaint}");
    assert!(!out.exists(), "{arguments:?} left something behind");
    complaint
}

/// Checks that a fault is reported in a single line.
fn one_line(arguments: &[&str], hints: &[&str]) {
    let complaint = complaint(arguments);
    assert_eq!(complaint.lines().count(), 1, "{complaint}");
    for hint in hints {
        assert!(complaint.contains(hint), "{complaint}: should say `{hint}`");
    }
}

/// A copy of the assets, to be spoilt.
struct Spoilt {
    folder: TempDir,
}

impl Spoilt {
    fn new() -> Self {
        let folder = tempfile::tempdir().unwrap();
        copy(&root().join("assets"), folder.path());
        Self { folder }
    }

    fn path(&self, file: &str) -> PathBuf {
        self.folder.path().join(file)
    }

    /// Replaces a piece of text that occurs in a file; returns the file's path.
    fn spoil(&self, file: &str, right: &str, wrong: &str) -> String {
        let path = self.path(file);
        let text = fs::read_to_string(&path).unwrap();
        assert!(text.contains(right), "{file} has no {right}");
        fs::write(&path, text.replacen(right, wrong, 1)).unwrap();
        path.to_str().unwrap().to_owned()
    }
}

fn copy(from: &Path, to: &Path) {
    fs::create_dir_all(to).unwrap();
    for entry in fs::read_dir(from).unwrap() {
        let path = entry.unwrap().path();
        let target = to.join(path.file_name().unwrap());
        if path.is_dir() { copy(&path, &target) } else { fs::copy(&path, &target).map(drop).unwrap() }
    }
}

#[test]
fn unknown_names_list_the_known_ones() {
    one_line(
        &["catch", "--object", "tenis_ball"],
        &["--object", "`tenis_ball`", "banana", "did you mean `tennis_ball`?"],
    );
    one_line(&["catch", "--throw", "nera"], &["--throw", "far_sampled", "did you mean `near`?"]);
    one_line(&["catch", "--scenario", "papr"], &["--scenario", "did you mean `paper`?"]);
    one_line(&["catch", "--robot", "ur5"], &["--robot", "iiwa14"]);
    one_line(&["list", "--show", "bananna"], &["--show", "did you mean `banana`?"]);
}

#[test]
fn unknown_options_are_told_with_the_nearest() {
    let said = complaint(&["catch", "--sede", "3"]);
    assert!(said.contains("--sede") && said.contains("--seed"), "{said}");
    let said = complaint(&["catch", "--seed", "three"]);
    assert!(said.contains("three") && said.contains("--seed"), "{said}");
    complaint(&["cacth"]);
}

#[test]
fn missing_files_are_named() {
    one_line(&["catch", "--scenario", "no/such.toml"], &["no/such.toml", "paper"]);
    one_line(&["replay", "no/such.catch"], &["no/such.catch", "recording"]);
    one_line(&["replay", root().join("Cargo.toml").to_str().unwrap()], &["Cargo.toml", "recording written by"]);
}

#[test]
fn misspelt_and_impossible_fields_are_named() {
    let assets = Spoilt::new();
    let scenario = assets.spoil("scenarios/paper.toml", "friction", "fricton");
    one_line(&["catch", "--scenario", &scenario], &["paper.toml", "fricton", "friction"]);
    let scenario = assets.spoil("scenarios/paper.toml", "fricton = 0.667", "friction = -0.667");
    one_line(&["catch", "--scenario", &scenario], &["paper.toml", "arena.friction", "-0.667", "0 to 100"]);
    let scenario = assets.spoil("scenarios/paper.toml", "friction = -0.667", "friction = \"high\"");
    one_line(&["catch", "--scenario", &scenario], &["paper.toml", "friction", "high"]);
    let scenario = assets.spoil("scenarios/paper.toml", "friction = \"high\"", "");
    assets.spoil("scenarios/paper.toml", "robot = \"iiwa14\"", "robot = \"iiwa15\"");
    one_line(&["catch", "--scenario", &scenario], &["paper.toml", "robot", "iiwa15", "did you mean `iiwa14`?"]);
    let object = assets.spoil("objects/banana/truth.toml", "mass_kg = 0.118", "mass_kg = 0.0");
    one_line(&["catch", "--object", &object], &["banana/truth.toml", "truth.mass_kg", "0.001 to 5"]);
}

#[test]
fn robots_without_limits_are_refused() {
    let assets = Spoilt::new();
    let robot = assets.path("robots/iiwa14/robot.toml");
    let robot = robot.to_str().unwrap();
    assets.spoil("robots/iiwa14/robot.urdf", "<limit ", "<no_limit ");
    one_line(&["catch", "--robot", robot], &["robot.urdf", "iiwa_joint_1", "limit"]);
    assets.spoil("robots/iiwa14/robot.urdf", "<no_limit ", "<limit ");
    assets.spoil("robots/iiwa14/robot.toml", "max_acceleration_radps2 = 8.57", "");
    one_line(&["catch", "--robot", robot], &["robot.toml", "max_acceleration_radps2"]);
    fs::remove_file(assets.path("robots/iiwa14/robot.urdf")).unwrap();
    one_line(&["catch", "--robot", robot], &["robot.urdf"]);
}

#[test]
fn meshes_that_are_none_are_refused() {
    let assets = Spoilt::new();
    let path = assets.path("objects/thing.toml");
    let thing = path.to_str().unwrap();
    let text = |file: &str| {
        format!(
            "name = \"thing\"\n[truth]\nmass_kg = 0.1\nrestitution = 0.3\ndrag_per_m = 0.0\n\
             shape = {{ kind = \"mesh\", file = \"{file}\" }}\n[known]\ndrag_per_m = 0.0\ndrag_sd_per_m = 0.0\n"
        )
    };
    fs::write(&path, text("no_such.stl")).unwrap();
    one_line(&["catch", "--object", thing], &["no_such.stl", "thing.toml"]);
    for file in ["poem.stl", "poem.obj", "poem.txt"] {
        fs::write(assets.path("objects").join(file), "Shall I compare thee to a summer's day?\n").unwrap();
        fs::write(&path, text(file)).unwrap();
        one_line(&["catch", "--object", thing], &[file]);
    }
    let open = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 1 4 3\n";
    fs::write(assets.path("objects/open.obj"), open).unwrap();
    fs::write(&path, text("open.obj")).unwrap();
    one_line(&["catch", "--object", thing], &["open.obj", "closed"]);
}

#[test]
fn folders_that_cannot_be_written_are_named() {
    let file = tempfile::NamedTempFile::new().unwrap();
    let output = catchingbot(&["catch", "--out", file.path().to_str().unwrap()]);
    assert_eq!(output.status.code(), Some(2));
    assert!(stderr(&output).contains("--out"), "{}", stderr(&output));
    // A folder in which nobody can write, not even an administrator.
    if cfg!(target_os = "linux") {
        for arguments in [&["catch", "--out", "/proc"][..], &["new", "object", "can", "--out", "/proc"]] {
            let output = catchingbot(arguments);
            assert_eq!((output.status.code(), stdout(&output).as_str()), (Some(2), ""), "{}", stderr(&output));
            assert!(stderr(&output).contains("--out: found `/proc"), "{}", stderr(&output));
        }
    }
}

#[test]
fn a_recording_that_was_cut_off_says_so() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().to_str().unwrap();
    assert!(catchingbot(&["catch", "--scenario", "paper", "--json", "--out", out]).status.success());
    let path = folder.path().join("paper-tennis_ball-near-1-0.catch");
    let bytes = fs::read(&path).unwrap();
    for fraction in [0.02, 0.5, 0.999] {
        fs::write(&path, &bytes[..(bytes.len() as f64 * fraction) as usize]).unwrap();
        one_line(&["replay", path.to_str().unwrap()], &["paper-tennis_ball-near-1-0.catch", "cut off"]);
    }
    let mut damaged = bytes.clone();
    let last = damaged.len() - 6;
    damaged[last] ^= 1;
    fs::write(&path, &damaged).unwrap();
    one_line(&["replay", path.to_str().unwrap()], &["paper-tennis_ball-near-1-0.catch"]);
}

#[test]
fn check_lists_the_faults_of_all_parts() {
    let assets = Spoilt::new();
    assets.spoil("scenarios/paper.toml", "object = \"tennis_ball\"", "object = \"../objects/tennis_ball\"");
    let scenario = assets.spoil("scenarios/paper.toml", "throw = \"near\"", "throw = \"../throws/near.toml\"");
    let output = catchingbot(&["check", &scenario]);
    assert!(output.status.success(), "{}{}", stdout(&output), stderr(&output));
    assets.spoil("objects/tennis_ball/truth.toml", "restitution = 0.75", "restitution = 7.5");
    assets.spoil("throws/near.toml", "position_m = [", "position_m = [1.0, ");
    let output = catchingbot(&["check", &scenario]);
    assert_eq!(output.status.code(), Some(2));
    let said = stdout(&output);
    assert!(said.contains("truth.restitution") && said.contains("near.toml"), "{said}");
    assert!(stderr(&output).contains("2 faults"), "{}", stderr(&output));
    assets.spoil("scenarios/paper.toml", "friction = 0.667", "friction = { min = 0.9, max = 0.4 }");
    assets.spoil("scenarios/paper.toml", "drag_spread = 0.0", "drag_spread = 3.0");
    assets.spoil("scenarios/paper.toml", "clock = \"free\"", "clock = { fixed_ms = -10 }");
    let output = catchingbot(&["check", &scenario]);
    let said = stdout(&output);
    for field in ["arena.friction", "arena.drag_spread", "clock.fixed_ms", "truth.restitution"] {
        assert!(said.contains(field), "{field} is missing in {said}");
    }
    assert!(stderr(&output).contains("5 faults"), "{}", stderr(&output));

    // And all of one part.
    assets.spoil("objects/tennis_ball/truth.toml", "mass_kg = 0.058", "mass_kg = 58");
    assets.spoil("grippers/wsg50.toml", "finger_mass_kg = ", "finger_mass_kg = -");
    assets.spoil("grippers/wsg50.toml", "max_force_n = ", "max_force_n = -");
    assets.spoil("robots/iiwa14/robot.toml", "max_acceleration_radps2 = 8.57", "max_acceleration_radps2 = -8.57");
    assets.spoil("robots/iiwa14/robot.toml", "max_acceleration_radps2 = 8.57", "max_acceleration_radps2 = -8.57");
    for (file, faults) in [("objects/tennis_ball", 2), ("grippers/wsg50.toml", 2), ("robots/iiwa14", 2)] {
        let output = catchingbot(&["check", assets.path(file).to_str().unwrap()]);
        assert!(stderr(&output).contains(&format!("{faults} faults")), "{file}: {}", stdout(&output));
    }
}

#[test]
fn arguments_that_cannot_be_right_say_what_would_be() {
    for (arguments, hints) in [
        (&["catch", "--seed", "-1"][..], &["'-1'", "--seed", "a whole number from 0 to"][..]),
        (&["catch", "--seed", "abc"], &["'abc'", "--seed", "a whole number from 0 to 9223372036854775807"]),
        (&["eval", "--seed", "18446744073709551615"], &["--seed", "from 0 to 9223372036854775807"]),
        (&["eval", "--trials", "-3"], &["--trials", "a whole number from 1 to"]),
        (&["eval", "--threads", "0"], &["--threads", "a whole number from 1 to"]),
        (&["eval", "--first", "18446744073709551615", "--trials", "5"], &["--first", "a whole number from 0 to"]),
        (&["ready", "--tries", "0"], &["--tries", "a whole number from 1 to"]),
        (&["predict", "--track", "no.csv", "--until", "-1"], &["no.csv"]),
        (
            &["register", "--cloud", "c.ply", "--reference", "banana", "--noise", "-1"],
            &["--noise: found -1, expected 0 to 1 m"],
        ),
        (&["register", "--cloud", "no.ply", "--reference", "banana"], &["no.ply"]),
        (
            &["catch", "--object", "cup.obj"],
            &["--object", "the shape `cup.obj`", "`catchingbot object import cup.obj --out cup`"],
        ),
        (
            &["ready", "--set", "ready_rad=[2.8, 1.2, 1.1, -1.5, 1.6, 1.4, 0.2]", "--trials", "1", "--tries", "1"],
            &["no pose", "within reach"],
        ),
        (
            &["catch", "--set", "brain.trajectory_optimization.terminal_velocity_scaling=1.5"],
            &["terminal_velocity_scaling", "0.01 to 1"],
        ),
        (&["catch", "--set", "brain.trajectory_optimization.clearance_m=0"], &["clearance_m", "0.001 to 2 m"]),
        (&["catch", "--set", "arena.step_s=1e-9"], &["arena.step_s", "0.00001 to 0.002"]),
    ] {
        let said = complaint(arguments);
        for hint in hints {
            assert!(said.contains(hint), "{arguments:?}: {said}: should say `{hint}`");
        }
    }
}

#[test]
fn every_asset_is_right_and_what_is_not_is_told() {
    let assets = Spoilt::new();
    let mut files = Vec::new();
    for kind in ["scenarios", "objects", "throws", "grippers", "cameras", "rigs", "robots"] {
        let entries = fs::read_dir(assets.path(kind)).unwrap();
        files.extend(entries.map(|entry| entry.unwrap().path().to_str().unwrap().to_owned()));
    }
    let check = |files: &[String]| {
        catchingbot(&["check"].into_iter().chain(files.iter().map(String::as_str)).collect::<Vec<_>>())
    };
    let output = check(&files);
    assert!(output.status.success(), "{}", stdout(&output));
    // Further lines about a file are indented.
    let verdicts = stdout(&output).lines().filter(|line| !line.starts_with(' ')).map(str::to_owned).collect::<Vec<_>>();
    assert!(verdicts.len() == files.len() && files.len() > 20, "{}", stdout(&output));
    assert!(verdicts.iter().all(|line| line.starts_with("right")), "{}", stdout(&output));
    let banana = stdout(&catchingbot(&["check", assets.path("objects/banana").to_str().unwrap()]));
    assert!(
        banana.contains("its convex hull has 1.67 times that; it collides as 9 convex parts of 1.00 times"),
        "{banana}"
    );

    fs::write(assets.path("empty.toml"), "").unwrap();
    for (file, right, wrong, hint) in [
        (
            "scenarios/paper.toml",
            "frame_rate_hz = 100.0",
            "frame_rate_hz = \"100\"",
            "arena.frame_rate_hz: found \"100\", expected a number",
        ),
        (
            "scenarios/as-published.toml",
            "\ngripper = \"position\"",
            "\ngripper = \"real\"",
            "brain.grasp_selection.closing_speed_mps: found 6, expected at most 0.42, the max_speed_mps of grippers/wsg50.toml",
        ),
        (
            "objects/banana/truth.toml",
            "mass_kg = 0.118",
            "mass_kg = 118",
            "truth.mass_kg: found 118, expected 0.001 to 5",
        ),
        (
            "objects/tennis_ball/truth.toml",
            "diameter_m = 0.0672",
            "diameter_m = 0.12",
            "120 mm wide at its narrowest; the gripper opens 110 mm",
        ),
        (
            "objects/tennis_ball/truth.toml",
            "diameter_m = 0.12",
            "diameter_m = \"60 mm\"",
            "truth.shape.diameter_m: found \"60 mm\", expected a number",
        ),
        ("empty.toml", "", "", "found nothing, expected the fields of a scenario"),
        ("throws/near.toml", "3.75643]", "40.0]", "expected a flight that meets the floor within 5 s"),
        ("throws/near.toml", "0.3]", "-0.3]", "in throw 0 at a height of -0.300 m, expected one above the floor"),
    ] {
        let output = check(&[assets.spoil(file, right, wrong)]);
        assert_eq!(output.status.code(), Some(2), "{file}");
        assert!(stdout(&output).contains(hint), "{}", stdout(&output));
    }
}

#[test]
fn references_in_millimetres_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    fs::write(at("seen.xyz"), "0 0 0\n").unwrap();
    fs::write(at("mm.obj"), "v 0 0 0\nv 90 0 0\nv 0 90 0\nv 0 0 90\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n").unwrap();
    let points: Vec<String> = (0..=180).map(|i| format!("{} 0 {}\n", f64::from(i) / 2.0, i % 7)).collect();
    fs::write(at("mm.xyz"), points.concat()).unwrap();
    for (name, hint) in [("mm.obj", "`scale = 0.001`"), ("mm.xyz", "metres")] {
        let arguments = ["register", "--cloud", &at("seen.xyz"), "--reference", &at(name)];
        one_line(&arguments, &[name, "something 90.000 m long", hint]);
    }
    one_line(&["register", "--cloud", &at("seen.xyz"), "--reference", "bananna"], &["did you mean `banana`?"]);
}

#[test]
fn flights_are_followed_no_farther_than_they_can_be() {
    let folder = tempfile::tempdir().unwrap();
    let track = folder.path().join("ball.csv");
    // 7 m/s through air that brakes by k = 0.05 1/m, stepped finely.
    let (mut p, mut v, mut rows) = ([0.0, 1.0], [5.0_f64, 4.9_f64], String::from("t,x,y,z\n"));
    for step in 0..4000 {
        if step % 100 == 0 {
            rows += &format!("{},{},0,{}\n", f64::from(step) * 1e-4, p[0], p[1]);
        }
        let braking = 0.05 * libm::hypot(v[0], v[1]);
        (p, v) = (
            [p[0] + v[0] * 1e-4, p[1] + v[1] * 1e-4],
            [v[0] * (1.0 - braking * 1e-4), v[1] - (9.81 + braking * v[1]) * 1e-4],
        );
    }
    fs::write(&track, rows).unwrap();
    let track = track.to_str().unwrap();
    for at in ["-5", "1e9"] {
        one_line(&["predict", "--track", track, "--at", at], &["--at", "a time nearer to the track"]);
    }
    assert!(catchingbot(&["predict", "--track", track, "--at", "0.5"]).status.success());
}

#[test]
fn cases_that_are_none_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("cases.json");
    let path = file.to_str().unwrap();
    for (text, hint) in [
        ("{\"q_start\": [0], \"grasp_centre_y_m\": 0.1, \"cases\": []}", "cases: found [], expected one case or more"),
        ("{\"q_start\": [NaN], \"cases\": []}", "line 1, column 14: found `NaN], \"cases\": []}`"),
    ] {
        fs::write(&file, text).unwrap();
        one_line(&["plan", "--cases", path], &[hint]);
    }
}
