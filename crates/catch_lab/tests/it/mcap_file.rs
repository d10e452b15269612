//! The MCAP file reads back, and every message is what its schema says.

use std::{collections::BTreeMap, fs, path::Path};

use catch_lab::{mcap_file, playback::Playback};
use serde_json::Value;

use crate::{catchingbot, stderr, stdout};

/// Whether a value is what a JSON schema says. Keywords that it does not know are a fault, so that none is passed over.
fn check(value: &Value, schema: &Value, path: &str) {
    for (keyword, wanted) in schema.as_object().unwrap() {
        match keyword.as_str() {
            "title" => {}
            "type" => {
                let is = match wanted.as_str().unwrap() {
                    "object" => value.is_object(),
                    "array" => value.is_array(),
                    "string" => value.is_string(),
                    "number" => value.is_number(),
                    "integer" => value.is_i64() || value.is_u64(),
                    other => panic!("{path}: type {other}"),
                };
                assert!(is, "{path}: {value} is no {wanted}");
            }
            "properties" => {
                let properties = wanted.as_object().unwrap();
                for (name, part) in value.as_object().unwrap() {
                    let schema = properties.get(name).unwrap_or_else(|| panic!("{path}: no {name} in the schema"));
                    check(part, schema, &format!("{path}.{name}"));
                }
            }
            "items" => value.as_array().unwrap().iter().for_each(|item| check(item, wanted, &format!("{path}[]"))),
            "minimum" => assert!(value.as_f64() >= wanted.as_f64(), "{path}: {value}"),
            "maximum" => assert!(value.as_f64() <= wanted.as_f64(), "{path}: {value}"),
            "oneOf" => {
                let matching = wanted.as_array().unwrap().iter().filter(|option| option["const"] == *value);
                assert_eq!(matching.count(), 1, "{path}: {value}");
            }
            "contentEncoding" => {
                assert_eq!(wanted, "base64");
                let text = value.as_str().unwrap();
                assert!(
                    text.len() % 4 == 0 && text.bytes().all(|it| it.is_ascii_alphanumeric() || b"+/=".contains(&it))
                );
            }
            other => panic!("{path}: unknown keyword {other}"),
        }
    }
}

#[test]
#[should_panic(expected = "is no")]
fn the_check_finds_a_wrong_type() {
    check(&serde_json::json!({"a": "1"}), &serde_json::json!({"properties": {"a": {"type": "number"}}}), "it");
}

#[test]
fn every_message_is_what_its_schema_says() {
    let folder = tempfile::tempdir().unwrap();
    for object in ["tennis_ball", "banana", "pill_bottle"] {
        let out = folder.path().to_str().unwrap();
        let output = catchingbot(&["catch", "--json", "--mcap", "--object", object, "--throw", "far", "--out", out]);
        assert!(output.status.success(), "{}", stderr(&output));
        let document: Value = serde_json::from_str(&stdout(&output)).unwrap();
        let file = fs::read(document["pictures"]["mcap"].as_str().unwrap()).unwrap();
        assert!(file.len() < 5_000_000, "{object}: {} bytes", file.len());
        // The robot is described beside it.
        assert!(fs::read_to_string(document["pictures"]["urdf"].as_str().unwrap()).unwrap().contains("<robot"));

        let summary = mcap::Summary::read(&file).unwrap().expect("a summary");
        assert!(summary.stats.is_some());
        let (mut counts, mut last) = (BTreeMap::<String, usize>::new(), BTreeMap::<String, u64>::new());
        for message in mcap::MessageStream::new(&file).unwrap() {
            let message = message.unwrap();
            let schema = message.channel.schema.as_ref().unwrap();
            assert_eq!((schema.encoding.as_str(), message.channel.message_encoding.as_str()), ("jsonschema", "json"));
            let wanted: Value = serde_json::from_slice(&schema.data).unwrap();
            assert_eq!(wanted["title"], schema.name.as_str());
            let topic = message.channel.topic.clone();
            check(&serde_json::from_slice(&message.data).unwrap(), &wanted, &topic);
            let before = last.insert(topic.clone(), message.log_time).unwrap_or(0);
            assert!(message.log_time >= before, "{topic} goes back in time");
            *counts.entry(topic).or_default() += 1;
        }
        for topic in ["/tf", "/joint_states", "/points", "/object/true", "/object/seen", "/object/predicted", "/log"] {
            assert!(counts.get(topic).is_some_and(|&count| count > 5), "{object}: {topic} in {counts:?}");
        }
        assert!(counts.keys().filter(|topic| topic.ends_with("/depth")).count() >= 10, "{counts:?}");
    }
}

#[test]
fn the_file_tells_the_recorded_motion() {
    let folder = tempfile::tempdir().unwrap();
    let output = catchingbot(&["catch", "--json", "--out", folder.path().to_str().unwrap()]);
    let document: Value = serde_json::from_str(&stdout(&output)).unwrap();
    let playback = Playback::read(Path::new(document["recording"].as_str().unwrap())).unwrap();
    let file = mcap_file::mcap(&playback).unwrap();
    let mut compared = 0;
    for message in mcap::MessageStream::new(&file).unwrap().map(Result::unwrap) {
        if message.channel.topic == "/joint_states" {
            let sample = playback.truth_at(message.log_time as f64 / 1e9).unwrap();
            let content: Value = serde_json::from_slice(&message.data).unwrap();
            // Reading decimal numbers back may round the last bit.
            assert!((content["joints"][3]["position"].as_f64().unwrap() - sample.q[3]).abs() < 1e-12);
            compared += 1;
        }
    }
    assert_eq!(compared, playback.ticks.len());
}
