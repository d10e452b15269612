//! `suite table`: documents of other programs, and of nobody, are not results.

use std::{fs, path::Path};

use catch_lab::suite::Suite;
use serde_json::{Value, json};

use crate::{catchingbot, mutations::mutator::Mutator, stderr, stdout};

/// A document as `suite run` writes it.
fn document(brain: &str) -> Value {
    json!({
        "version": catch_lab::VERSION,
        "suite": "catch-2026.2",
        "content_sha256": Suite::load("catch-2026.2").unwrap().file.content_sha256,
        "brain": brain,
        "complete": false,
        "conditions": [{
            "scenario": "<img src=x>", "object": "a|b", "throw": "near", "throw_is_fixed": false,
            "trials": 10, "caught": 7, "out_of_reach": 2,
        }],
        "trials": 10,
        "caught": 7,
        "rows_sha256": "0".repeat(64),
    })
}

fn table(folder: &Path) -> (Option<i32>, String) {
    let output = catchingbot(&["suite", "table", "catch-2026.2", "--out", folder.to_str().unwrap()]);
    (output.status.code(), stdout(&output) + &stderr(&output))
}

#[test]
fn a_table_is_made_of_results_alone() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("catch-2026.2-ours.json");
    let (code, said) = table(folder.path());
    assert!(code == Some(2) && said.contains("no results of catch-2026.2"), "{said}");

    fs::write(&path, document("ours").to_string()).unwrap();
    let (code, said) = table(folder.path());
    assert_eq!(code, Some(0), "{said}");
    let line = "| &lt;img src=x&gt; | a\\|b | near | ours | 10 | 7 | 70.0 (39.7 – 89.2) | 2 |";
    assert!(said.contains(line), "{said}");

    for (pointer, wrong, field) in [
        ("/suite", json!("other"), "suite: found other"),
        ("/brain", json!("idle"), "brain: found idle"),
        ("/content_sha256", json!("abc"), "content_sha256: found abc"),
        ("/rows_sha256", json!("`"), "rows_sha256: found `"),
        ("/conditions/0/caught", json!(1000), "conditions[0].caught: found 1000"),
        ("/conditions/0/out_of_reach", json!(4), "conditions[0].out_of_reach: found 4"),
        ("/conditions/0/trials", json!("ten"), "conditions[0].trials: found"),
        ("/trials", json!(1), "trials: found 1, expected 10"),
        ("/caught", json!(99), "caught: found 99, expected 7"),
    ] {
        let mut changed = document("ours");
        *changed.pointer_mut(pointer).unwrap() = wrong;
        fs::write(&path, changed.to_string()).unwrap();
        let (code, said) = table(folder.path());
        assert!(code == Some(2) && said.contains(field), "{pointer}: {said}");
    }
    fs::write(&path, "{\"version\": ").unwrap();
    let (code, said) = table(folder.path());
    assert!(code == Some(2) && said.contains("line 1"), "{said}");

    // Results of two versions are not compared.
    fs::write(&path, document("ours").to_string()).unwrap();
    let mut old = document("idle");
    old["version"] = json!("0.0.1");
    fs::write(folder.path().join("catch-2026.2-idle.json"), old.to_string()).unwrap();
    let (code, said) = table(folder.path());
    assert!(code == Some(2) && said.contains("version: found 0.0.1"), "{said}");
}

#[test]
fn changed_documents_are_read_or_refused() {
    let folder = tempfile::tempdir().unwrap();
    let right = document("ours").to_string();
    let tried = (0..100).map(|seed| {
        let mut mutator = if seed == 0 { Mutator::idle() } else { Mutator::new(seed) };
        fs::write(folder.path().join("catch-2026.2-ours.json"), mutator.text(&right)).unwrap();
        let (code, said) = table(folder.path());
        assert!(code == Some(0) || code == Some(2) && said.contains("expected "), "{seed}: {code:?} {said}");
        code == Some(0)
    });
    let read: Vec<bool> = tried.collect();
    assert!(read[0] && !read.iter().all(|it| *it));
}

#[test]
fn what_cannot_be_read_is_told() {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("catch-2026.2-ours.json"), document("ours").to_string()).unwrap();
    let path = folder.path().join("catch-2026.2-paper.json");
    fs::create_dir(&path).unwrap();
    let (code, said) = table(folder.path());
    assert!(code == Some(2) && said.contains("a folder"), "{said}");
    fs::remove_dir(&path).unwrap();
    // It would be waited for.
    if cfg!(unix) && std::process::Command::new("mkfifo").arg(&path).status().is_ok_and(|it| it.success()) {
        let (code, said) = table(folder.path());
        assert!(code == Some(2) && said.contains("a device or a pipe"), "{said}");
    }
}
