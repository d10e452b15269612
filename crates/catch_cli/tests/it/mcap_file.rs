//! The MCAP file reads back, and every message is what its schema says.

use std::{
    collections::{BTreeMap, BTreeSet},
    fs,
    path::Path,
};

use base64::{Engine, prelude::BASE64_STANDARD};
use catch_body::Pose;
use catch_view::{
    export::mcap_file::{self, Images},
    playback::Playback,
    surfaces::{Part, surfaces},
};
use nalgebra::{Point3, Quaternion, Translation3, UnitQuaternion};
use prost_reflect::{DescriptorPool, DynamicMessage, Kind, SerializeOptions};
use serde_json::Value;

use crate::{catchingbot, stderr, stdout};

/// A message, read by the description that the file itself brings along; every byte of it must be understood.
fn decode(message: &mcap::Message) -> Value {
    let schema = message.channel.schema.as_ref().unwrap();
    assert_eq!((schema.encoding.as_str(), message.channel.message_encoding.as_str()), ("protobuf", "protobuf"));
    let pool = DescriptorPool::decode(&schema.data[..]).unwrap();
    let descriptor = pool.get_message_by_name(&schema.name).unwrap();
    let decoded = DynamicMessage::decode(descriptor, &message.data[..]).unwrap();
    assert_eq!(decoded.unknown_fields().count(), 0, "{}", message.channel.topic);
    let options = SerializeOptions::new().use_proto_field_name(true).skip_default_fields(false);
    decoded.serialize_with_options(serde_json::value::Serializer, &options).unwrap()
}

/// `foxglove_fields.txt` has message, field, number and type of each field as Foxglove publishes them,
/// written down from the descriptors in their Python package `foxglove-schemas-protobuf` 0.4.0.
#[test]
fn fields_are_those_that_foxglove_publishes() {
    let published: BTreeSet<String> = include_str!("foxglove_fields.txt").lines().map(str::to_owned).collect();
    let folder = tempfile::tempdir().unwrap();
    let mut written = BTreeSet::new();
    for message in mcap::MessageStream::new(&file_of(folder.path(), &["catch", "--scenario", "paper"]))
        .unwrap()
        .map(Result::unwrap)
    {
        let pool = DescriptorPool::decode(&message.channel.schema.as_ref().unwrap().data[..]).unwrap();
        for of in pool.all_messages() {
            for field in of.fields() {
                let kind = match field.kind() {
                    Kind::Message(part) => part.full_name().to_owned(),
                    Kind::Enum(list) => list.full_name().to_owned(),
                    other => format!("{other:?}").to_lowercase(),
                };
                let many = if field.is_list() { "many " } else { "" };
                let line = format!("{} {} {} {many}{kind}", of.full_name(), field.name(), field.number());
                written.insert(line);
            }
        }
    }
    assert_eq!(written, published);
}

/// The file of a throw, read.
fn file_of(folder: &Path, options: &[&str]) -> Vec<u8> {
    let output = catchingbot(&[options, &["--json", "--mcap", "--out", folder.to_str().unwrap()]].concat());
    assert!(output.status.success(), "{}", stderr(&output));
    let document: Value = serde_json::from_str(&stdout(&output)).unwrap();
    fs::read(document["pictures"]["mcap"].as_str().unwrap()).unwrap()
}

#[test]
fn every_message_is_what_its_schema_says() {
    let folder = tempfile::tempdir().unwrap();
    for object in ["tennis_ball", "banana", "pill_bottle"] {
        let file = file_of(folder.path(), &["catch", "--scenario", "paper", "--object", object, "--throw", "far"]);
        assert!(file.len() < 5_000_000, "{object}: {} bytes", file.len());
        let summary = mcap::Summary::read(&file).unwrap().expect("a summary");
        assert!(summary.stats.is_some());
        let (mut counts, mut last) = (BTreeMap::<String, usize>::new(), BTreeMap::<String, u64>::new());
        for message in mcap::MessageStream::new(&file).unwrap().map(Result::unwrap) {
            let topic = message.channel.topic.clone();
            let content = decode(&message);
            if topic.ends_with("/depth") {
                let size = |name: &str| content[name].as_u64().unwrap() as usize;
                let bytes = content["data"].as_str().unwrap().len() / 4 * 3;
                assert!(bytes.abs_diff(size("step") * size("height")) < 3 && size("step") == 4 * size("width"));
            }
            let before = last.insert(topic.clone(), message.log_time).unwrap_or(0);
            assert!(message.log_time >= before, "{topic} goes back in time");
            *counts.entry(topic).or_default() += 1;
        }
        for topic in
            ["/tf", "/joint_states", "/gripper", "/points", "/object/true", "/object/seen", "/object/predicted", "/log"]
        {
            assert!(counts.get(topic).is_some_and(|&count| count > 5), "{object}: {topic} in {counts:?}");
        }
        for what in ["/depth", "/calibration"] {
            assert!(counts.keys().filter(|topic| topic.ends_with(what)).count() >= 10, "{counts:?}");
        }
    }
}

/// A depth image, seen through its calibration and its camera's frame, shows the object where it is.
#[test]
fn calibrated_images_show_the_object() {
    let folder = tempfile::tempdir().unwrap();
    let file = file_of(folder.path(), &["catch", "--scenario", "paper"]);
    let (mut transforms, mut calibration, mut object, mut seen) = (Value::Null, Value::Null, Value::Null, 0);
    for message in mcap::MessageStream::new(&file).unwrap().map(Result::unwrap) {
        let topic = message.channel.topic.as_str();
        let content = || decode(&message);
        match topic.rsplit('/').next().unwrap() {
            "tf" => transforms = content(),
            "true" => object = content(),
            "calibration" => calibration = content(),
            "depth" => {
                let (image, of) = (content(), calibration["frame_id"].as_str().unwrap());
                assert_eq!(image["frame_id"], of);
                let number = |value: &Value| value.as_f64().unwrap();
                let frames = transforms["transforms"].as_array().unwrap();
                let it = frames.iter().find(|it| it["child_frame_id"] == of).unwrap();
                let X_WC = pose(&it["translation"], &it["rotation"]);
                let X_WO = pose(&object["pose"]["position"], &object["pose"]["orientation"]);
                let [f, cx, cy] = [0, 2, 5].map(|i| number(&calibration["K"][i]));
                let width = image["width"].as_u64().unwrap() as usize;
                let bytes = BASE64_STANDARD.decode(image["data"].as_str().unwrap()).unwrap();
                let depths = bytes.chunks_exact(4).map(|it| f64::from(f32::from_le_bytes(it.try_into().unwrap())));
                let near = |(i, depth): &(usize, f64)| {
                    let (u, v) = ((i % width) as f64, (i / width) as f64);
                    let p_CP = Point3::new((u - cx) / f * depth, (v - cy) / f * depth, *depth);
                    ((X_WC * p_CP).coords - X_WO.translation.vector).norm() < 0.04
                };
                seen += depths.enumerate().filter(near).count();
            }
            _ => {}
        }
    }
    assert!(seen > 1_000, "only {seen} pixels on the ball");
}

fn pose(p: &Value, q: &Value) -> Pose {
    let number = |value: &Value| value.as_f64().unwrap();
    let rotation = Quaternion::new(number(&q["w"]), number(&q["x"]), number(&q["y"]), number(&q["z"]));
    let translation = Translation3::new(number(&p["x"]), number(&p["y"]), number(&p["z"]));
    Pose::from_parts(translation, UnitQuaternion::from_quaternion(rotation))
}

/// Frames hang together as a tree, the arm link by link.
#[test]
fn frames_lead_from_the_world_to_the_hand() {
    let folder = tempfile::tempdir().unwrap();
    let output = catchingbot(&["catch", "--scenario", "paper", "--json", "--out", folder.path().to_str().unwrap()]);
    let document: Value = serde_json::from_str(&stdout(&output)).unwrap();
    let playback = Playback::read(Path::new(document["recording"].as_str().unwrap())).unwrap();
    let (file, _) = mcap_file::mcap(&playback, Images::Some).unwrap();
    let message = mcap::MessageStream::new(&file).unwrap().map(Result::unwrap).find(|it| it.channel.topic == "/tf");
    let content = decode(&message.unwrap());
    let frames: BTreeMap<&str, &Value> = content["transforms"]
        .as_array()
        .unwrap()
        .iter()
        .map(|it| (it["child_frame_id"].as_str().unwrap(), it))
        .collect();
    let mut X_WF = Pose::identity();
    let mut name = playback.robot.joints.last().unwrap().link_name.as_str();
    for _ in 0..=playback.robot.joints.len() {
        let it = frames[name];
        X_WF = pose(&it["translation"], &it["rotation"]) * X_WF;
        name = it["parent_frame_id"].as_str().unwrap();
    }
    assert_eq!(name, "world");
    let first = playback.truth_at(0.0).unwrap();
    let last_link = *playback.robot.link_poses(&first.q).last().unwrap();
    assert!((last_link.inverse() * X_WF).translation.vector.norm() < 1e-12);
    assert!((last_link.inverse() * X_WF).rotation.angle() < 1e-7);
}

/// Arm, hand and object have shapes in frames that `/tf` moves.
#[test]
fn the_scene_has_arm_hand_and_object() {
    let folder = tempfile::tempdir().unwrap();
    let output =
        catchingbot(&["catch", "--scenario", "paper", "--json", "--mcap", "--out", folder.path().to_str().unwrap()]);
    let document: Value = serde_json::from_str(&stdout(&output)).unwrap();
    let path = |value: &Value| Path::new(value.as_str().unwrap()).to_path_buf();
    let playback = Playback::read(&path(&document["recording"])).unwrap();
    let file = fs::read(path(&document["pictures"]["mcap"])).unwrap();
    let messages = || mcap::MessageStream::new(&file).unwrap().map(Result::unwrap);
    let of = |topic: &str| decode(&messages().find(|it| it.channel.topic == topic).unwrap());
    let (scene, frames) = (of("/scene"), of("/tf"));
    let frames: BTreeSet<&str> =
        frames["transforms"].as_array().unwrap().iter().map(|it| it["child_frame_id"].as_str().unwrap()).collect();
    let mut shapes = BTreeMap::new();
    for entity in scene["entities"].as_array().unwrap() {
        let frame = entity["frame_id"].as_str().unwrap();
        assert!(frames.contains(frame), "{frame} in {frames:?}");
        let count = |kind: &str| entity[kind].as_array().unwrap().len();
        for (kind, count) in ["cylinders", "spheres", "cubes", "triangles"].map(|kind| (kind, count(kind))) {
            *shapes.entry(kind).or_insert(0) += count;
        }
    }
    let mesh = playback.ground_truth().unwrap().surface.mesh();
    let shown = surfaces(&playback.robot, &playback.gripper, Some(&mesh));
    let of_part = |part: Part| shown.iter().filter(move |it| it.of == part);
    // Both fingers look alike.
    let triangles = shown.len() + of_part(Part::Finger).count();
    assert_eq!(shapes, [("cylinders", 0), ("spheres", 0), ("cubes", 0), ("triangles", triangles)].into());
    let object = scene["entities"].as_array().unwrap().iter().find(|it| it["frame_id"] == "object").unwrap();
    let points = object["triangles"].as_array().unwrap().iter().map(|it| it["points"].as_array().unwrap().len());
    let vertices = of_part(Part::Object).map(|it| it.mesh.vertices.len());
    assert_eq!(points.collect::<Vec<_>>(), vertices.collect::<Vec<_>>());
    // Gripper aperture, at the end about as wide as the object.
    let aperture = messages().filter(|it| it.channel.topic == "/gripper").last().unwrap();
    let width_m = decode(&aperture)["joints"][0]["position"].as_f64().unwrap();
    assert_eq!(width_m, playback.truth_at(aperture.log_time as f64 / 1e9).unwrap().width_m);
}

#[test]
fn metadata_tell_scenario_and_outcome() {
    let folder = tempfile::tempdir().unwrap();
    let file = file_of(folder.path(), &["catch", "--scenario", "paper", "--object", "banana"]);
    let summary = mcap::Summary::read(&file).unwrap().unwrap();
    let metadata: BTreeMap<String, BTreeMap<String, String>> = summary
        .metadata_indexes
        .iter()
        .map(|index| mcap::read::metadata(&file, index).unwrap())
        .map(|it| (it.name, it.metadata))
        .collect();
    assert_eq!(metadata["scene"]["object"], "banana");
    assert_eq!(metadata["outcome"]["caught"], "true");
    let scenario: toml::Table = toml::from_str(&metadata["scenario"]["toml"]).unwrap();
    assert_eq!(scenario["name"].as_str(), Some("paper"));
}

#[test]
fn the_file_tells_the_recorded_motion() {
    let folder = tempfile::tempdir().unwrap();
    let output = catchingbot(&["catch", "--scenario", "honest", "--json", "--out", folder.path().to_str().unwrap()]);
    let document: Value = serde_json::from_str(&stdout(&output)).unwrap();
    let playback = Playback::read(Path::new(document["recording"].as_str().unwrap())).unwrap();
    let (file, images_every) = mcap_file::mcap(&playback, Images::Some).unwrap();
    let (whole, every_one) = mcap_file::mcap(&playback, Images::All).unwrap();
    assert!(images_every > every_one && every_one == 1 && whole.len() > file.len(), "{images_every}");
    let mut compared = 0;
    for message in mcap::MessageStream::new(&file).unwrap().map(Result::unwrap) {
        if message.channel.topic == "/joint_states" {
            let sample = playback.truth_at(message.log_time as f64 / 1e9).unwrap();
            assert_eq!(decode(&message)["joints"][3]["position"].as_f64().unwrap(), sample.q[3]);
            compared += 1;
        }
    }
    assert_eq!(compared, playback.ticks.len());
}
