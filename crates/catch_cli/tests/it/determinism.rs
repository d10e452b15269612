//! Same seed, same bytes.

use std::{fs, path::Path, process::Command};

use serde_json::Value;

use crate::{catchingbot, stderr, stdout};

fn throw(folder: &Path, object: &str) -> (Value, Vec<u8>) {
    let folder = folder.to_str().unwrap();
    let thrown = ["--scenario", "paper", "--object", object, "--throw", "far_sampled", "--seed", "5"];
    let output = catchingbot(&[&["catch", "--json", "--out", folder], &thrown[..]].concat());
    assert!(output.status.success(), "{}", stderr(&output));
    let document: Value = serde_json::from_str(&stdout(&output)).unwrap();
    let recording = fs::read(document["recording"].as_str().unwrap()).unwrap();
    (document, recording)
}

#[test]
fn two_runs_write_the_same_recording_and_a_replay_wants_the_same() {
    let folder = tempfile::tempdir().unwrap();
    let (one, two) = (folder.path().join("one"), folder.path().join("two"));
    for object in ["tennis_ball", "banana"] {
        let (mut first, recording) = throw(&one, object);
        let (mut second, again) = throw(&two, object);
        assert!(recording == again, "{object}: the recordings differ");
        for document in [&mut first, &mut second] {
            // Wall times, and the folder.
            for name in ["stages", "recording", "pictures"] {
                document[name].take();
            }
        }
        assert_eq!(first, second);
    }
    assert_eq!(fs::read_dir(&one).unwrap().count(), 6, "two recordings with their times and pages, and nothing else");

    let recording = one.join("paper-banana-far_sampled-5-0.catch");
    let output = catchingbot(&["replay", "--json", recording.to_str().unwrap()]);
    assert!(output.status.success(), "{}", stderr(&output));
    let replay: Value = serde_json::from_str(&stdout(&output)).unwrap();
    assert_eq!(replay["identical"], true, "{replay}");
    assert!(replay["ticks"].as_u64().unwrap() > 50);
}

#[test]
fn a_processor_without_avx2_and_fma_gives_the_same_bytes() {
    let folder = tempfile::tempdir().unwrap();
    let recording = |name: &str, tunables: &str| {
        let out = folder.path().join(name);
        let thrown = ["--scenario", "honest", "--object", "banana", "--seed", "5", "--index", "1"];
        let output = Command::new(env!("CARGO_BIN_EXE_catchingbot"))
            .args(["catch", "--json", "--out", out.to_str().unwrap()])
            .args(thrown)
            // The system's library chooses its functions by these; another one ignores them.
            .env("GLIBC_TUNABLES", tunables)
            .output()
            .unwrap();
        assert!(output.status.success(), "{}", stderr(&output));
        let document: Value = serde_json::from_str(&stdout(&output)).unwrap();
        fs::read(document["recording"].as_str().unwrap()).unwrap()
    };
    assert!(recording("as it is", "") == recording("without", "glibc.cpu.hwcaps=-AVX2,-FMA"));
}

#[test]
fn json_is_one_document_with_everything_in_it() {
    let folder = tempfile::tempdir().unwrap();
    let (document, _) = throw(folder.path(), "tennis_ball");
    for field in [
        "caught",
        "caught_paper",
        "reason",
        "limit_violations",
        "motion_excursions",
        "conditions",
        "scene",
        "catch_time_s",
        "timeline",
        "stages",
        "version",
    ] {
        assert!(document.get(field).is_some(), "{field}");
    }
    assert_eq!(document["scene"]["seed"], 5);
    assert_eq!(document["timeline"][0]["event"], "thrown");
    assert_eq!(document["scenario"]["arena"]["drag"], false);
}
