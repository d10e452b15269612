//! Files and arguments that once made the program panic, hang, swell or call nonsense right, and how refusals
//! are told.

use std::{fs, process::Command};

use serde_json::Value;

use crate::{catchingbot, stderr, stdout};

/// A built-in file with a piece of text replaced, checked as `check` does it.
fn checked(name: &str, file: &str, right: &str, wrong: &str) -> String {
    let folder = tempfile::tempdir().unwrap();
    let text = stdout(&catchingbot(&["list", "--show", name]));
    assert!(text.contains(right), "{name} has no {right}");
    let path = folder.path().join(file);
    fs::write(&path, text.replacen(right, wrong, 1)).unwrap();
    let output = catchingbot(&["check", path.to_str().unwrap()]);
    assert_eq!(output.status.code(), Some(2), "{right} → {wrong} is right: {}", stdout(&output));
    assert!(!stderr(&output).contains("panicked"), "{}", stderr(&output));
    stdout(&output)
}

#[test]
fn nonsense_is_refused_with_its_field() {
    for (name, file, right, wrong, field) in [
        ("wsg50", "g.toml", "finger_size_m = [0.012", "finger_size_m = [1e300", "finger_size_m[0]"),
        ("wsg50", "g.toml", "finger_centre_y_m = 0.077", "finger_centre_y_m = nan", "finger_centre_y_m"),
        ("wsg50", "g.toml", "body_mass_kg = 0.989", "body_mass_kg = 1e9", "body_mass_kg"),
        ("pill_bottle", "o.toml", "[[0.0, 0.0254]", "[[0.0, 1e300]", "truth.shape.profile_m[0][1]"),
        ("pill_bottle", "o.toml", "[[0.0, 0.0254]", "[[0.0, 1e-200]", "truth.shape.profile_m"),
        ("pill_bottle", "o.toml", "[[0.0, 0.0254]", "[[0.0, 0.0254, 7.0]", "truth.shape.profile_m[0]"),
        ("banana", "o.toml", "arc_radius_m = 0.1008", "arc_radius_m = 1e200", "truth.shape.arc_radius_m"),
        ("banana", "o.toml", "drag_per_m = 0.05", "drag_per_m = 1e300", "truth.drag_per_m"),
        ("paper", "s.toml", "frame_rate_hz = 100.0", "frame_rate_hz = 1e-9", "arena.frame_rate_hz"),
        ("paper", "s.toml", "wind = [0.0, 0.0, 0.0]", "wind = [1e300, 0.0, 0.0]", "arena.wind"),
        ("paper", "s.toml", "wind = [0.0, 0.0, 0.0]", "wind = [0.0, 0.0, 0.0, 7.0]", "arena.wind"),
        ("paper", "s.toml", "max_spin_radps = 0.0", "max_spin_radps = 1e300", "arena.max_spin_radps"),
        ("near", "t.toml", "position_m = [", "position_m = [0.0, ", "motion.position_m"),
        ("near", "t.toml", "spin_radps = [0.0", "spin_radps = [1e300", "motion.spin_radps[0]"),
    ] {
        let said = checked(name, file, right, wrong);
        assert!(said.contains(field), "{wrong}: {said}");
    }
}

#[test]
fn endless_and_large_files_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let large = folder.path().join("large.toml");
    fs::write(&large, "# x\n".repeat(500_000)).unwrap();
    let large = large.to_str().unwrap();
    let mut files = vec![(large, "at most 1 MiB")];
    if cfg!(target_os = "linux") {
        files.push(("/dev/zero", "a regular file"));
    }
    for (file, said) in files {
        for arguments in [["check", file, "--json"], ["replay", file, "--json"], ["--scenario", file, "--json"]] {
            let output = catchingbot(&arguments);
            assert_eq!(output.status.code(), Some(2), "{arguments:?}");
            let told = format!("{}{}", stdout(&output), stderr(&output));
            assert!(told.contains(said) || arguments[0] == "replay", "{arguments:?}: {told}");
        }
    }
}

/// The document of a command that fails with `--json`, in whatever way: its fields are always the same.
fn failure(arguments: &[&str]) -> Value {
    let folder = tempfile::tempdir().unwrap();
    let program = env!("CARGO_BIN_EXE_catchingbot");
    let output = Command::new(program).args(arguments).arg("--json").current_dir(folder.path()).output().unwrap();
    let document: Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(output.status.code(), Some(2), "{arguments:?}: {document}");
    assert_eq!(document["exit_code"], 2);
    assert_eq!(document["version"], catch_lab::VERSION);
    assert_eq!(stderr(&output).trim_end(), format!("error: {}", document["error"].as_str().unwrap()));
    let faults = document["faults"].as_array().unwrap();
    let is_whole = |it: &Value| {
        ["file", "field", "found", "expected"].iter().all(|part| it[part].as_str().is_some_and(|it| !it.is_empty()))
    };
    assert!(!faults.is_empty() && faults.iter().all(is_whole), "{arguments:?}: {document}");
    document
}

/// The names of all commands below this one that have `--json`.
fn commands_with_json(command: &clap::Command, name: &str) -> Vec<String> {
    let below = command.get_subcommands();
    let mut names: Vec<String> =
        below.flat_map(|it| commands_with_json(it, format!("{name} {}", it.get_name()).trim())).collect();
    let is_one = !command.has_subcommands() && !name.starts_with("help");
    if is_one && command.get_arguments().any(|it| it.get_id() == "json") {
        names.push(name.to_owned());
    }
    names
}

#[test]
fn every_command_fails_in_the_same_shape() {
    let wrong_input = [
        ("catch", &["--object", "nope"][..], "--object"),
        ("eval", &["--scenario", "nope"], "--scenario"),
        ("play", &["--scenario", "nope"], "--scenario"),
        ("list", &["--show", "nope"], "--show"),
        ("plan", &["--cases", "no.json"], "the file"),
        ("predict", &["--track", "no.csv"], "the file"),
        ("learn", &["--tracks", "no", "--out", "learned.toml"], "the folder"),
        ("calibrate", &["--rig", "nope"], "--rig"),
        ("place-cameras", &["--scenario", "nope"], "--scenario"),
        ("ready", &["--scenario", "nope"], "--scenario"),
        ("object import", &["no.obj", "--out", "thing.toml"], "the file"),
        ("robot import", &["no.urdf", "--out", "arm"], "the file"),
        ("register", &["--cloud", "no.xyz", "--reference", "banana"], "the file"),
        ("replay", &["no.catch"], "the file"),
        ("export", &["--mjcf", "set", "--object", "nope"], "--object"),
        ("gripper-latency", &["no.catch"], "the file"),
        ("check", &["no.toml"], "the file"),
        ("view", &["no.catch"], "--json"),
        ("new", &["object", "../x"], "NAME"),
        ("drive", &["no.toml"], "the file"),
        ("doctor", &["no.toml"], "the file"),
    ];
    let mut command = catch_cli::command();
    command.build();
    let mut names = commands_with_json(&command, "");
    names.sort_unstable();
    let mut tried: Vec<&str> = wrong_input.iter().map(|it| it.0).collect();
    tried.sort_unstable();
    assert_eq!(names, tried);
    for (name, wrong, field) in wrong_input {
        let command: Vec<&str> = name.split(' ').collect();
        assert_eq!(failure(&[&command[..], wrong].concat())["faults"][0]["field"], field, "{name}");
        let options = failure(&[&command[..], &["--no-such-option"]].concat());
        assert_eq!(options["faults"][0]["field"], "--no-such-option", "{name}");
    }
}

#[test]
fn wrong_arguments_are_told_by_field() {
    for (arguments, field, found, expected) in [
        (&["catch", "--sede", "3"][..], "--sede", "an unknown argument", "`--seed`"),
        (&["frobnicate"], "frobnicate", "an unknown argument", "`catch`, `eval`"),
        (&["object"], "COMMAND", "nothing", "one of `import`"),
        (&["--seed", "three"], "--seed", "three", "a whole number from 0"),
        (&["--seed"], "--seed", "nothing", "a value: --seed <N>"),
        (&["--seed", "1", "--seed", "2"], "--seed", "it twice", "it once"),
        (&["--seed=1", "--json=3"], "--json", "3", "no more values"),
        (&["--method", "mine"], "--method", "mine", "one of `ours`, `paper`"),
        (&["catch", "--set", "object=nope"], "--set object", "`nope`", "one of"),
        (&["catch", "--set", "arena.step_s=7"], "arena.step_s", "7", "0.00001 to 0.002"),
        (&["check"], "NAME|FILE", "nothing", "a value: <NAME|FILE>"),
        (&["--seed=1", "list"], "list", "options before it", "`list` first"),
        (&["object", "import", "x.obj"], "--out", "nothing", "a value: --out <DIR|FILE>"),
        (&["predict", "--track", "t.csv", "--at", "soon"], "--at", "soon", "a number"),
        (&["list", "--show", "banana", "--completions", "bash"], "--show", "it beside --completions", "not both"),
    ] {
        let fault = &failure(arguments)["faults"][0];
        assert_eq!(
            (&fault["field"], &fault["file"]),
            (&field.into(), &"command line".into()),
            "{arguments:?}: {fault}"
        );
        let texts = [("found", found), ("expected", expected)];
        assert!(texts.iter().all(|(key, hint)| fault[key].as_str().unwrap().contains(hint)), "{arguments:?}: {fault}");
    }
    let output = catchingbot(&["catch", "--set", "object=nope"]);
    assert!(stderr(&output).contains("command line: --set object: found `nope`"), "{}", stderr(&output));
}

/// What needs no computing is said at once, and leaves nothing.
#[test]
fn a_driver_that_is_missing_is_told_first() {
    let folder = tempfile::tempdir().unwrap();
    let run = |arguments: &[&str]| {
        Command::new(env!("CARGO_BIN_EXE_catchingbot")).args(arguments).current_dir(folder.path()).output().unwrap()
    };
    assert!(run(&["new", "cell", "c"]).status.success());
    for arguments in [&["doctor", "c.toml"][..], &["drive", "--dry-run", "c.toml", "--out", "a/b"]] {
        let output = run(arguments);
        assert_eq!(output.status.code(), Some(2), "{arguments:?}");
        assert!(stderr(&output).contains("arm.driver: found no program `catch_franka`"), "{}", stderr(&output));
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1, "{arguments:?}");
    }
    let output = run(&["check", "c.toml"]);
    assert!(output.status.success() && stdout(&output).contains("no program `catch_franka`"), "{}", stdout(&output));
}

/// The object's own file and the brain's knowledge may be one file.
#[test]
fn a_foreign_field_is_told_once() {
    let said = checked("banana", "o.toml", "name = ", "foo = 1\nname = ");
    assert_eq!(said.matches("foo: found an unknown field").count(), 1, "{said}");
}

/// A check tells of each file besides, and of a file that is right, too.
#[test]
fn a_check_tells_of_each_file() {
    let folder = tempfile::tempdir().unwrap();
    let (right, wrong) = (folder.path().join("right.toml"), folder.path().join("wrong.toml"));
    let text = stdout(&catchingbot(&["list", "--show", "near"]));
    fs::write(&right, &text).unwrap();
    fs::write(&wrong, text.replace("spin_radps = [0.0", "spin_radps = [1e300")).unwrap();
    let (right, wrong) = (right.to_str().unwrap(), wrong.to_str().unwrap());
    let document = failure(&["check", right, wrong]);
    assert_eq!(document["error"], "1 fault found");
    assert_eq!(document["files"][0]["kind"], "throw");
    assert_eq!(document["files"][0]["faults"], Value::Array(Vec::new()));
    assert_eq!(document["files"][1]["faults"], document["faults"]);
    assert_eq!(document["faults"][0]["field"], "motion.spin_radps[0]");
    let output = catchingbot(&["check", right, "--json"]);
    let document: Value = serde_json::from_slice(&output.stdout).unwrap();
    assert!(output.status.success() && document["files"][0]["file"] == right);
    assert!(document.get("error").is_none() && document.get("exit_code").is_none());
}

#[test]
fn samples_are_predicted_and_registered() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().to_str().unwrap();
    for kind in ["track", "cloud"] {
        let output = catchingbot(&["new", kind, "sample", "--out", out]);
        assert!(output.status.success(), "{}", stderr(&output));
        let shown = stdout(&output);
        let command = shown.lines().find_map(|line| line.trim().strip_prefix("try it")).unwrap().trim();
        let arguments: Vec<&str> = command.split(' ').skip_while(|it| !["predict", "register"].contains(it)).collect();
        let output = catchingbot(&[&arguments[..], &["--json"]].concat());
        let document: Value = serde_json::from_slice(&output.stdout).unwrap();
        let expected = if kind == "track" { "predicted" } else { "registered" };
        assert_eq!(document["status"], expected, "{document}");
    }
}

/// Points in one place, on a line and on a plane agree with many poses.
#[test]
fn a_degenerate_cloud_is_not_registered() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("points.xyz");
    type Place = fn(u32) -> [f64; 3];
    let places: [Place; 2] = [|_| [0.1, 0.2, 0.3], |i| [f64::from(i) * 1e-4, 0.0, 0.0]];
    for place in places {
        let rows: String = (0..300).map(|i| place(i).map(|it| it.to_string()).join(" ") + "\n").collect();
        fs::write(&path, rows).unwrap();
        let output = catchingbot(&["register", "--cloud", path.to_str().unwrap(), "--reference", "banana", "--json"]);
        let document: Value = serde_json::from_slice(&output.stdout).unwrap();
        assert_ne!(document["status"], "registered", "{document}");
        assert_eq!(document["X_CR"], Value::Null);
    }
}

#[test]
fn pages_go_where_they_are_wanted() {
    let folder = tempfile::tempdir().unwrap();
    let (out, pages) = (folder.path().join("with space"), folder.path().join("pages"));
    let output = catchingbot(&["catch", "--scenario", "paper", "--out", out.to_str().unwrap()]);
    let shown = stdout(&output);
    let hint = shown.lines().last().unwrap();
    assert!(hint.contains(&format!("view '{}", out.display())), "{hint}");
    let recording = fs::read_dir(&out).unwrap().map(|it| it.unwrap().path());
    let recording = recording.into_iter().find(|it| it.extension().is_some_and(|it| it == "catch")).unwrap();
    fs::remove_file(recording.with_extension("html")).unwrap();
    let arguments = ["view", "--no-open", "--out", pages.to_str().unwrap(), recording.to_str().unwrap()];
    let output = catchingbot(&arguments);
    assert!(output.status.success(), "{}", stderr(&output));
    let written: Vec<_> = fs::read_dir(&pages).unwrap().map(|it| it.unwrap().path()).collect();
    assert!(written.len() == 1 && written[0].extension().is_some_and(|it| it == "html"), "{written:?}");
    assert!(!recording.with_extension("html").exists());
}

#[test]
fn completions_and_the_version_are_printed() {
    for shell in ["bash", "fish", "zsh"] {
        assert!(stdout(&catchingbot(&["list", "--completions", shell])).contains("gripper-latency"));
    }
    assert!(stdout(&catchingbot(&["--version"])).starts_with(&format!("catchingbot {}", catch_lab::VERSION)));
}

#[test]
fn one_process_at_a_time_works_in_a_folder() {
    let folder = tempfile::tempdir().unwrap();
    let lock = fs::File::create(folder.path().join(".at-work")).unwrap();
    fs::write(folder.path().join(".at-work"), "process 1").unwrap();
    lock.lock().unwrap();
    let arguments = ["eval", "--trials", "1", "--resume", "--out", folder.path().to_str().unwrap()];
    let output = catchingbot(&arguments);
    assert_eq!(output.status.code(), Some(2));
    assert!(stderr(&output).contains("in which process 1 is at work"), "{}", stderr(&output));
}
