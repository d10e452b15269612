//! Recordings of cells without ground truth, and what is measured with recordings.

use std::{fs, path::Path};

use catch_lab::recording::replay;
use catch_recording::{RecordingReader, replay::compare};
use catch_view::{
    export::mcap_file::{self, Images},
    playback::Playback,
};
use serde_json::Value;

use crate::{catchingbot, stderr, stdout};

#[expect(dead_code, reason = "an example has a main function")]
#[path = "../../examples/06_own_cell.rs"]
mod own_cell;

fn document(arguments: &[&str]) -> Value {
    let output = catchingbot(arguments);
    assert!(output.status.success(), "{}", stderr(&output));
    serde_json::from_str(&stdout(&output)).unwrap()
}

/// The page, the replay and the MCAP file of a cell that is not the arena: what was sensed and predicted, and
/// nothing invented.
#[test]
fn a_recording_without_ground_truth_is_viewed_replayed_and_converted() {
    let folder = tempfile::tempdir().unwrap();
    let recording = own_cell::record(folder.path()).unwrap();
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1);
    let path = recording.to_str().unwrap();

    let replay = document(&["replay", "--json", path]);
    assert_eq!(replay["identical"], true, "{replay}");
    assert!(replay["ticks"].as_u64().unwrap() > 90);
    assert_eq!((&replay["caught"], &replay["scene"]), (&Value::Null, &Value::Null));
    assert!(stdout(&catchingbot(&["replay", path])).contains("own cell: outcome unknown"));

    // The recording is read without the lab, as a driver's author does it.
    let mut reader: RecordingReader = RecordingReader::open(&recording).unwrap();
    let compared = compare(&mut reader).unwrap();
    assert_eq!((compared.difference, compared.ticks as u64), (None, replay["ticks"].as_u64().unwrap()));

    let output = catchingbot(&["view", "--no-open", "--mcap", path]);
    assert!(output.status.success(), "{}", stderr(&output));
    let page = fs::read_to_string(recording.with_extension("html")).unwrap();
    let text = page.split("id=\"data\">").nth(1).unwrap().split("</script>").next().unwrap();
    let data: Value = serde_json::from_str(text).unwrap();
    for unknown in [&data["caught"], &data["scene"], &data["motion"]["p_WO"], &data["motion"]["torque_ratio"]] {
        assert_eq!(unknown, &Value::Null);
    }
    assert!(data["errors"]["time_s"].as_array().unwrap().is_empty());
    assert!(data["surfaces"].as_array().unwrap().iter().all(|it| it["of"] != "object"));
    assert!(data["plans"].as_array().unwrap().len() > 10 && data["points"]["time_s"].as_array().unwrap().len() > 10);
    let events: Vec<&str> = data["events"].as_array().unwrap().iter().map(|it| it["label"].as_str().unwrap()).collect();
    assert!(events.contains(&"first plan") && events.contains(&"closing"), "{events:?}");
    assert!(!events.contains(&"thrown") && !events.contains(&"contact"), "{events:?}");

    let file = fs::read(recording.with_extension("mcap")).unwrap();
    let playback = Playback::read(&recording).unwrap();
    assert_eq!(file, mcap_file::mcap(&playback, Images::Some).unwrap().0);
    let topics: Vec<String> =
        mcap::MessageStream::new(&file).unwrap().map(|message| message.unwrap().channel.topic.clone()).collect();
    assert_eq!(topics.iter().filter(|topic| *topic == "/joint_states").count(), playback.ticks.len());
    assert!(["/tf", "/object/seen", "/object/predicted"].iter().all(|it| topics.iter().any(|topic| topic == it)));
    assert!(!topics.iter().any(|topic| topic == "/object/true"));
    #[cfg(feature = "gif")]
    assert!(catch_view::export::gif_picture::gif(&playback).unwrap().len() > 1_000);
}

/// A cell's clock may be that of the day; pages count from the beginning of the recording.
#[test]
fn a_page_counts_from_the_first_observation() {
    let folder = tempfile::tempdir().unwrap();
    let mut playback = Playback::read(&own_cell::record(folder.path()).unwrap()).unwrap();
    playback.ticks.drain(..20);
    assert!((playback.start_s() - 0.2).abs() < 1e-9);
    let data = catch_view::pages::catch_page::page_data(&playback, 1000);
    assert!((data["end_s"].as_f64().unwrap() - (playback.end_s() - 0.2)).abs() < 1e-9);
    let sensed = playback.motion_at(0.5).unwrap();
    assert!((sensed.time_s - 0.5).abs() < 1e-9 && sensed.X_WO.is_none());
    assert!(replay::replay(Path::new("nowhere.catch")).is_err());
}

/// A gripper that obeys after 30 ms, half a cycle of its 140 Hz more or less.
#[test]
fn the_latency_of_an_honest_gripper_is_measured() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().to_str().unwrap();
    let recordings: Vec<String> = (0..10)
        .map(|index| {
            let index = index.to_string();
            let thrown = document(&["catch", "--json", "--scenario", "honest", "--index", &index, "--out", out]);
            thrown["recording"].as_str().unwrap().to_owned()
        })
        .collect();
    let paths: Vec<&str> = recordings.iter().map(String::as_str).collect();
    let measured = document(&[&["gripper-latency", "--json"], &paths[..]].concat());
    let median_s = measured["median_s"].as_f64().unwrap();
    assert!((median_s - 0.03).abs() < 0.004, "{measured}");
    assert!(measured["moves"].as_array().unwrap().len() >= 5, "{measured}");
    let setting = measured["setting"].as_str().unwrap();
    assert_eq!(setting, format!("brain.control.gripper_latency_s = {median_s:.4}"));
    let told = stdout(&catchingbot(&[&["gripper-latency"], &paths[..]].concat()));
    assert!(told.contains(setting), "{told}");
}

#[test]
fn recordings_without_a_gripper_move_are_told_so() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().to_str().unwrap();
    let thrown = document(&[
        "catch",
        "--scenario",
        "paper",
        "--json",
        "--set",
        "ready_rad=[2.8, 1.2, 1.1, -1.5, 1.6, 1.4, 0.2]",
        "--out",
        out,
    ]);
    let output = catchingbot(&["gripper-latency", thrown["recording"].as_str().unwrap()]);
    assert_eq!(output.status.code(), Some(2));
    let complaint = stderr(&output);
    assert!(complaint.lines().count() == 1 && complaint.contains("RECORDING: found no"), "{complaint}");
}
