//! Evaluations: the same rows whatever the number of threads, also killed, resumed and shared out, and
//! nothing lost by a mistake.

use std::{
    fs,
    path::Path,
    process::{Command, Output, Stdio},
    time::Duration,
};

use serde_json::Value;

use crate::{catchingbot, skipped_without, stderr, stdout};

/// Files of an evaluation that are promised byte for byte.
const FILES: [&str; 4] = ["evaluation.toml", "trials.jsonl", "trials.csv", "trials.parquet"];
const FIXED: [&str; 8] =
    ["eval", "--json", "--object", "tennis_ball", "--object", "pill_bottle", "--throw", "near_sampled"];

fn eval(folder: &Path, more: &[&str]) -> Output {
    let mut arguments = FIXED.to_vec();
    arguments.extend(["--out", folder.to_str().unwrap()]);
    arguments.extend(more);
    catchingbot(&arguments)
}

fn rows(folder: &Path) -> String {
    fs::read_to_string(folder.join("trials.jsonl")).unwrap()
}

fn files(folder: &Path) -> Vec<Vec<u8>> {
    FILES.iter().map(|name| fs::read(folder.join(name)).unwrap_or_else(|fault| panic!("{name}: {fault}"))).collect()
}

#[test]
fn the_files_are_the_same_for_any_number_of_threads_however_often_it_is_killed_and_in_parts() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let output = eval(&at("one"), &["--trials", "3", "--threads", "1"]);
    assert!(output.status.success(), "{}", stderr(&output));
    let document: Value = serde_json::from_str(&stdout(&output)).unwrap();
    assert_eq!(document["trials"], 6);
    let cell = &document["cells"][0];
    assert_eq!(
        (&cell["object"], &cell["throw"], &cell["trials"]),
        (&"tennis_ball".into(), &"near_sampled".into(), &3.into())
    );
    assert!(cell["wilson95"][0].as_f64().unwrap() < cell["wilson95"][1].as_f64().unwrap());
    assert_eq!(cell["published"], 0.983);
    let whole = files(&at("one"));
    assert_eq!(rows(&at("one")).lines().count(), 6);

    for threads in ["2", "4"] {
        assert!(eval(&at(threads), &["--trials", "3", "--threads", threads]).status.success());
        assert_eq!(whole, files(&at(threads)), "{threads} threads");
    }

    // Killed at moments that differ, the first before there is a row, then gone on with.
    let killed = at("killed");
    for attempt in 0..4_u64 {
        let mut child = Command::new(env!("CARGO_BIN_EXE_catchingbot"))
            .args(FIXED)
            .args(["--out", killed.to_str().unwrap(), "--trials", "3", "--threads", "2", "--resume"])
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .spawn()
            .unwrap();
        std::thread::sleep(Duration::from_millis(150 + 700 * attempt));
        child.kill().unwrap();
        child.wait().unwrap();
    }
    assert!(eval(&killed, &["--trials", "3", "--resume"]).status.success());
    assert_eq!(whole, files(&killed));

    // Interrupted, it says how to go on.
    let mut child = Command::new(env!("CARGO_BIN_EXE_catchingbot"))
        .args(FIXED)
        .args(["--out", at("interrupted").to_str().unwrap(), "--trials", "1000"])
        .stdout(Stdio::null())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    // Once there are results it listens.
    while !at("interrupted").join("trials.jsonl").exists() {
        assert!(child.try_wait().unwrap().is_none(), "it ended by itself");
        std::thread::sleep(Duration::from_millis(20));
    }
    if Command::new("kill").args(["-INT", &child.id().to_string()]).status().is_ok_and(|it| it.success()) {
        let output = child.wait_with_output().unwrap();
        assert_eq!(output.status.code(), Some(130));
        assert!(stderr(&output).contains("--resume"), "{}", stderr(&output));
    } else {
        child.kill().unwrap();
        child.wait().unwrap();
    }

    // Cut off in the middle of a row.
    let text = rows(&killed);
    fs::write(killed.join("trials.jsonl"), &text[..text.len() * 2 / 5]).unwrap();
    let output = eval(&killed, &["--trials", "3", "--resume"]);
    assert!(output.status.success(), "{}", stderr(&output));
    assert_eq!(whole, files(&killed));
    let again: Value = serde_json::from_str(&stdout(&output)).unwrap();
    assert_eq!(again["cells"], document["cells"]);

    // In two parts, whose logs become one.
    assert!(eval(&at("a"), &["--first", "0", "--trials", "2"]).status.success());
    assert!(eval(&at("b"), &["--first", "2", "--trials", "1"]).status.success());
    let first = rows(&at("a"));
    fs::write(at("a").join("trials.jsonl"), first.clone() + &rows(&at("b"))).unwrap();
    assert!(eval(&at("a"), &["--trials", "3", "--resume"]).status.success());
    assert_eq!(whole, files(&at("a")));
    let report = fs::read_to_string(at("a").join("report.html")).unwrap();
    assert!(report.contains("6 throws"), "the report is of all rows");
    fs::write(at("a").join("trials.jsonl"), first.clone() + &first).unwrap();
    let output = eval(&at("a"), &["--trials", "4", "--resume"]);
    assert_eq!(output.status.code(), Some(2), "a throw twice: {}", stderr(&output));
    assert!(stderr(&output).contains("trials.jsonl: line 5"), "{}", stderr(&output));

    read_by_python(&at("one"));
}

/// The table in the tools in which people look at tables, whichever of them there is.
fn read_by_python(folder: &Path) {
    let script = r#"
import sys
folder = sys.argv[1]
def rows():
    try:
        import polars
        for table in (polars.read_parquet(folder + "/trials.parquet"), polars.read_csv(folder + "/trials.csv")):
            yield table.rows(named=True)
        return
    except ImportError:
        pass
    import pandas
    for table in (pandas.read_parquet(folder + "/trials.parquet"), pandas.read_csv(folder + "/trials.csv")):
        yield table.to_dict("records")
parquet, csv = rows()
assert len(parquet) == len(csv) == 6, (len(parquet), len(csv))
for a, b in zip(parquet, csv):
    assert a.keys() == b.keys()
    for key, value in a.items():
        assert value == b[key] or (value != value and b[key] != b[key]), (key, value, b[key])
assert parquet[0]["object"] == "tennis_ball" and parquet[1]["object"] == "pill_bottle"
assert parquet[5]["index"] == 2 and type(parquet[0]["caught"]).__name__ in ("bool", "bool_")
"#;
    // Folder in which CI has put packages that are not installed for everybody.
    let packages = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../target/python");
    let python = |arguments: &[&str]| Command::new("python3").env("PYTHONPATH", &packages).args(arguments).output();
    let has_any = python(&["-c", "try:\n import polars\nexcept ImportError:\n import pandas, pyarrow"]);
    if !has_any.is_ok_and(|output| output.status.success()) {
        skipped_without("polars, or pandas with pyarrow (python3 -m pip install --target target/python polars)");
        return;
    }
    let output = python(&["-c", script, folder.to_str().unwrap()]).unwrap();
    assert!(output.status.success(), "{}", stderr(&output));
}

/// A file keeps its name when somebody edits it.
#[test]
fn results_of_an_edited_file_are_of_another_evaluation() {
    let folder = tempfile::tempdir().unwrap();
    let in_folder = |arguments: &[&str]| {
        let program =
            Command::new(env!("CARGO_BIN_EXE_catchingbot")).current_dir(folder.path()).args(arguments).output();
        program.unwrap()
    };
    assert!(in_folder(&["new", "object", "can"]).status.success());
    let eval = |trials| in_folder(&["eval", "--object", "can", "--out", "results", "--resume", "--trials", trials]);
    assert!(eval("1").status.success() && eval("2").status.success());
    let file = folder.path().join("can/truth.toml");
    fs::write(&file, fs::read_to_string(&file).unwrap() + "\n# A comment changes nothing.\n").unwrap();
    assert!(eval("3").status.success());
    fs::write(&file, fs::read_to_string(&file).unwrap().replace("mass_kg = 0.", "mass_kg = 1.")).unwrap();
    let output = eval("4");
    assert_eq!(output.status.code(), Some(2));
    assert!(stderr(&output).contains("checksums[0].object: found"), "{}", stderr(&output));
}

#[test]
fn results_are_not_lost_by_mistake() {
    let folder = tempfile::tempdir().unwrap();
    assert!(eval(folder.path(), &["--trials", "1"]).status.success());
    let before = files(folder.path());
    for (mistake, hint) in [
        (&["--trials", "1"][..], "--resume"),
        (
            &["--trials", "1", "--resume", "--seed", "9"],
            "seed: found results of another evaluation, with 1, expected 9;",
        ),
        (
            &["--trials", "1", "--resume", "--throw", "far"],
            "throw: found results of another evaluation, with \"near_sampled\", expected \"far,",
        ),
        (&["--trials", "1", "--resume", "--scenario", "as-published"], "scenario: found results"),
        (
            &["--trials", "1", "--resume", "--set", "arena.friction=0.5"],
            "evaluation.toml: arena.friction: found results of another evaluation, with {\"max\":1.0,\"min\":0.4}, expected 0.5;",
        ),
        (
            &["--trials", "1", "--resume", "--set", "arena.person={nearest_m=2,speed_mps=1}"],
            "expected {\"nearest_m\":2.0,",
        ),
        (&["--trials", "0"], "0"),
        (&["--trials", "1", "--throw", "near_sampled"], "twice"),
    ] {
        let output = eval(folder.path(), mistake);
        assert_eq!(output.status.code(), Some(2), "{mistake:?}: {}", stderr(&output));
        assert!(stderr(&output).contains(hint), "{mistake:?}: {}", stderr(&output));
        assert_eq!(before, files(folder.path()));
    }
    // Finished results stay as they are, with their times and their report.
    let others = ["times.json", "report.html"].map(|name| folder.path().join(name));
    let read = || others.each_ref().map(|path| fs::read(path).unwrap());
    let times = read();
    assert!(eval(folder.path(), &["--trials", "1", "--resume"]).status.success());
    let text = stdout(&eval(folder.path(), &["--trials", "1", "--resume"]));
    assert_eq!((before, times), (files(folder.path()), read()), "{text}");
    // A trial more is told as one.
    assert!(eval(folder.path(), &["--trials", "2", "--resume"]).status.success());
    let times: Value = serde_json::from_slice(&read()[0]).unwrap();
    assert_eq!(times["trials"], 2);
    let output = eval(folder.path(), &["--trials", "1", "--resume"]);
    assert_eq!(output.status.code(), Some(2));
    assert!(stderr(&output).contains("--trials: found 1, expected at least the 2 that"), "{}", stderr(&output));

    // What lacks its description is nobody's.
    let identity = folder.path().join("evaluation.toml");
    let description = fs::read(&identity).unwrap();
    fs::remove_file(&identity).unwrap();
    for left in ["trials.jsonl", "report.html"] {
        let output = eval(folder.path(), &["--trials", "2", "--resume"]);
        assert_eq!(output.status.code(), Some(2));
        assert!(stderr(&output).contains(left) && !identity.exists(), "{}", stderr(&output));
        fs::rename(folder.path().join(left), folder.path().join("aside")).unwrap();
    }
    fs::write(&identity, description).unwrap();
    fs::write(folder.path().join("trials.jsonl"), "{\"what\": 1}\n").unwrap();
    let output = eval(folder.path(), &["--trials", "1", "--resume"]);
    assert_eq!(output.status.code(), Some(2));
    assert!(stderr(&output).contains("line 1"), "{}", stderr(&output));
}

/// Trials that repeat one throw are told as such, and results have a folder without `--out`.
#[test]
fn an_evaluation_has_a_folder_and_says_which_trials_repeat_one_throw() {
    let folder = tempfile::tempdir().unwrap();
    let run = |arguments: &[&str]| {
        let program = env!("CARGO_BIN_EXE_catchingbot");
        let output = Command::new(program).args(arguments).current_dir(folder.path()).output().unwrap();
        assert!(output.status.success(), "{arguments:?}: {}", stderr(&output));
        stdout(&output)
    };
    let shown = run(&["eval", "--scenario", "paper", "--throw", "near", "--throw", "near_sampled", "--trials", "2"]);
    assert!(shown.contains("  near is always the same: the trials repeat one throw"), "{shown}");
    assert!(folder.path().join("out/eval/trials.jsonl").exists());
}

#[test]
fn what_an_arm_could_have_reached_is_told_of_every_arm() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().to_str().unwrap();
    let slow = "limit_scale.velocity=0.05";
    let arguments = [
        "eval",
        "--scenario",
        "paper",
        "--robot",
        "panda",
        "--throw",
        "near_sampled",
        "--trials",
        "1",
        "--set",
        slow,
        "--out",
        out,
    ];
    let output = catchingbot(&arguments);
    assert!(output.status.success(), "{}", stderr(&output));
    let document = catchingbot(&[&arguments[..], &["--resume", "--json"]].concat());
    let document: Value = serde_json::from_str(&stdout(&document)).unwrap();
    let cell = &document["cells"][0];
    for (field, expected) in [("caught", 0), ("out_of_reach", 1)] {
        assert_eq!(cell[field], expected, "{field}: {cell}");
    }
}

#[test]
fn where_nothing_can_be_written_it_says_so() {
    let folder = tempfile::tempdir().unwrap();
    // No folder can be made where a file is, whoever asks; a folder that is read-only does not stop an
    // administrator.
    let file = folder.path().join("file");
    fs::write(&file, "").unwrap();
    let output = eval(&file.join("out"), &["--trials", "1"]);
    assert_eq!(output.status.code(), Some(2), "{}", stderr(&output));
    assert!(stderr(&output).contains("--out"), "{}", stderr(&output));
    assert_eq!(stderr(&output).lines().count(), 1, "{}", stderr(&output));
}

/// A disk that is full after a few kilobytes: a limit on the size of files, to which the log grows.
#[cfg(unix)]
#[test]
fn a_full_disk_loses_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let (whole, full) = (folder.path().join("whole"), folder.path().join("full"));
    assert!(eval(&whole, &["--trials", "3"]).status.success());
    // In blocks of 512 or 1024 bytes, as the shell has it; the identity fits, the six rows do not.
    let size = fs::metadata(whole.join("trials.jsonl")).unwrap().len();
    let identity = fs::metadata(whole.join("evaluation.toml")).unwrap().len();
    let blocks = (identity.max(size / 3) / 512 + 1).to_string();
    let script = format!("trap '' XFSZ; ulimit -f {blocks}; exec \"$0\" \"$@\"");
    let output = Command::new("sh")
        .args(["-c", &script, env!("CARGO_BIN_EXE_catchingbot")])
        .args(FIXED)
        .args(["--out", full.to_str().unwrap(), "--trials", "3"])
        .output()
        .unwrap();
    // Nothing is wrong with what was asked for.
    assert_eq!(output.status.code(), Some(1), "{}", stderr(&output));
    let message = stderr(&output);
    assert!(message.contains("trials") && message.contains("--resume"), "{message}");
    let output = eval(&full, &["--trials", "3", "--resume"]);
    assert!(output.status.success(), "{}", stderr(&output));
    assert_eq!(files(&whole), files(&full));
}
