//! What one sees of a catch without touching the camera: hand and object in the first view of a page, and the
//! object in its close-up.

#![allow(clippy::print_stdout, reason = "tests tell what they measured")]

use std::path::Path;

use catch_view::{playback::Playback, viewpoint::CatchScene};

use crate::{catchingbot, stderr, stdout};

/// Height of the close-up of a page in a window of 1360 × 850 pixels.
const CLOSE_UP_PX: f64 = 382.0;

/// Throws a scenario's objects in a workcell; returns the fraction of the contacts that one sees.
fn fraction_seen(scenario: &str, workcell: &[&str], throws: u64) -> f64 {
    let folder = tempfile::tempdir().unwrap();
    let (mut seen_contacts, mut contacts) = (0, 0);
    for throw in 0..throws {
        let (index, object) = (throw.to_string(), ["tennis_ball", "banana", "pill_bottle"][throw as usize % 3]);
        let mut arguments = vec!["catch", "--json", "--scenario", scenario, "--object", object, "--index", &index];
        arguments.extend(["--seed", "5", "--out", folder.path().to_str().unwrap()]);
        let output = catchingbot(&[&arguments, workcell].concat());
        assert!(output.status.success(), "{}", stderr(&output));
        let document: serde_json::Value = serde_json::from_str(&stdout(&output)).unwrap();
        let recording = document["recording"].as_str().unwrap();
        let playback = Playback::read(Path::new(recording)).unwrap();
        let scene = CatchScene::new(&playback).unwrap();
        let (view, near) = (scene.scene(), scene.close_up());
        let seen = scene.seen_from(&scene.eye(&view), 160);
        let pixels = near.seen.object_cover * near.seen.object * CLOSE_UP_PX.powi(2);
        let is_seen = seen.hand >= 0.8 && seen.object >= 0.4 && pixels >= 5_000.0;
        let line = format!("hand {:.2}, object {:.2}, close-up {pixels:.0} px", seen.hand, seen.object);
        println!("{scenario} {workcell:?} {object} {index}: {line}{}", if is_seen { "" } else { " HIDDEN" });
        contacts += u64::from(document["contact_s"].is_number());
        seen_contacts += u64::from(document["contact_s"].is_number() && is_seen);
        std::fs::remove_file(recording).unwrap();
    }
    println!("{scenario} {workcell:?}: {seen_contacts} of {contacts} contacts are seen, of {throws} throws");
    seen_contacts as f64 / contacts as f64
}

const FENCE: &[&str] = &["--workcell", "table_and_fence"];

#[test]
fn hand_and_object_are_seen_at_the_catch() {
    for (scenario, workcell) in [("honest", FENCE), ("lab", &[])] {
        assert_eq!(fraction_seen(scenario, workcell, 3), 1.0, "{scenario} {workcell:?}");
    }
}

/// Four times 50 throws: `cargo test --release -p catch_cli --test it views -- --ignored --nocapture`, some
/// seven minutes.
#[test]
#[ignore = "200 throws"]
fn hand_and_object_are_seen_in_99_of_100_throws() {
    for (scenario, workcell) in [("honest", &[][..]), ("honest", FENCE), ("lab", &[]), ("lab", FENCE)] {
        let seen = fraction_seen(scenario, workcell, 50);
        assert!(seen >= 0.99, "{scenario} {workcell:?}: {seen}");
    }
}
