//! Evaluations: the same rows whatever the number of threads, also after being cut off, and nothing lost by a mistake.

use std::{fs, path::Path, process::Output};

use serde_json::Value;

use crate::{catchingbot, stderr, stdout};

fn eval(folder: &Path, more: &[&str]) -> Output {
    let fixed = ["eval", "--json", "--object", "tennis_ball", "--object", "pill_bottle", "--throw", "near_sampled"];
    let mut arguments = fixed.to_vec();
    arguments.extend(["--out", folder.to_str().unwrap()]);
    arguments.extend(more);
    catchingbot(&arguments)
}

fn rows(folder: &Path) -> String {
    fs::read_to_string(folder.join("trials.jsonl")).unwrap()
}

#[test]
fn rows_are_the_same_for_any_number_of_threads_and_after_a_cut() {
    let folder = tempfile::tempdir().unwrap();
    let (one, two) = (folder.path().join("one"), folder.path().join("two"));
    let output = eval(&one, &["--trials", "3", "--threads", "1"]);
    assert!(output.status.success(), "{}", stderr(&output));
    let document: Value = serde_json::from_str(&stdout(&output)).unwrap();
    assert_eq!(document["trials"], 6);
    let cell = &document["cells"][0];
    assert_eq!(
        (&cell["object"], &cell["throw"], &cell["trials"]),
        (&"tennis_ball".into(), &"near_sampled".into(), &3.into())
    );
    assert!(cell["wilson95"][0].as_f64().unwrap() < cell["wilson95"][1].as_f64().unwrap());

    assert!(eval(&two, &["--trials", "3", "--threads", "3"]).status.success());
    let whole = rows(&one);
    assert_eq!(whole, rows(&two));
    assert_eq!(whole.lines().count(), 6);

    // Cut off in the middle of a row, and begun with fewer trials than it ends with.
    fs::write(two.join("trials.jsonl"), &whole[..whole.len() * 2 / 5]).unwrap();
    let output = eval(&two, &["--trials", "3", "--resume"]);
    assert!(output.status.success(), "{}", stderr(&output));
    assert_eq!(whole, rows(&two));
    let again: Value = serde_json::from_str(&stdout(&output)).unwrap();
    assert_eq!(again["cells"], document["cells"]);
}

#[test]
fn results_are_not_lost_by_mistake() {
    let folder = tempfile::tempdir().unwrap();
    assert!(eval(folder.path(), &["--trials", "1"]).status.success());
    let before = rows(folder.path());
    for (mistake, hint) in [
        (&["--trials", "1"][..], "--resume"),
        (&["--trials", "1", "--resume", "--seed", "9"], "seed"),
        (&["--trials", "1", "--resume", "--throw", "far"], "cells"),
        (&["--trials", "0"], "0"),
        (&["--trials", "1", "--throw", "near_sampled"], "twice"),
    ] {
        let output = eval(folder.path(), mistake);
        assert_eq!(output.status.code(), Some(2), "{mistake:?}: {}", stderr(&output));
        assert!(stderr(&output).contains(hint), "{mistake:?}: {}", stderr(&output));
        assert_eq!(before, rows(folder.path()));
    }
    fs::write(folder.path().join("trials.jsonl"), "{\"what\": 1}\n").unwrap();
    let output = eval(folder.path(), &["--trials", "1", "--resume"]);
    assert_eq!(output.status.code(), Some(2));
    assert!(stderr(&output).contains("line 1"), "{}", stderr(&output));
}
