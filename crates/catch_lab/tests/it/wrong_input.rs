//! Wrong input gets one clear message (what is wrong, where, what would be right), exit code 2, and leaves nothing behind.

use std::{
    fs,
    path::{Path, PathBuf},
};

use tempfile::TempDir;

use crate::{catchingbot, source::root, stderr, stdout};

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

/// The same for faults that are told in a single line.
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
    one_line(&["catch", "--scenario", &scenario], &["paper.toml", "arena.friction", "-0.667", "zero or more"]);
    let scenario = assets.spoil("scenarios/paper.toml", "friction = -0.667", "friction = \"high\"");
    one_line(&["catch", "--scenario", &scenario], &["paper.toml", "friction", "high"]);
    let scenario = assets.spoil("scenarios/paper.toml", "friction = \"high\"", "");
    assets.spoil("scenarios/paper.toml", "robot = \"iiwa14\"", "robot = \"iiwa15\"");
    one_line(&["catch", "--scenario", &scenario], &["paper.toml", "robot", "iiwa15", "did you mean `iiwa14`?"]);
    let object = assets.spoil("objects/banana.toml", "mass_kg = 0.118", "mass_kg = 0.0");
    one_line(&["catch", "--object", &object], &["banana.toml", "truth.mass_kg", "above zero"]);
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
             shape = {{ kind = \"mesh\", file = \"{file}\" }}\n[prior]\ndrag_per_m = 0.0\ndrag_sd_per_m = 0.0\n"
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
}

#[test]
fn a_recording_that_was_cut_off_says_so() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().to_str().unwrap();
    assert!(catchingbot(&["catch", "--json", "--out", out]).status.success());
    let path = folder.path().join("paper-tennis_ball-near-1-0.catch");
    let bytes = fs::read(&path).unwrap();
    for share in [0.02, 0.5, 0.999] {
        fs::write(&path, &bytes[..(bytes.len() as f64 * share) as usize]).unwrap();
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
    assets.spoil("scenarios/paper.toml", "object = \"tennis_ball\"", "object = \"../objects/tennis_ball.toml\"");
    let scenario = assets.spoil("scenarios/paper.toml", "throw = \"near\"", "throw = \"../throws/near.toml\"");
    let output = catchingbot(&["check", &scenario]);
    assert!(output.status.success(), "{}{}", stdout(&output), stderr(&output));
    assets.spoil("objects/tennis_ball.toml", "restitution = 0.75", "restitution = 7.5");
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
}
