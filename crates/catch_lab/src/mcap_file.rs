//! A throw as an MCAP file with Foxglove's messages, for the tools that roboticists already use.
//!
//! All messages are JSON. Times count from the throw. The file is not compressed: pure Rust has no writer of the compressions
//! that MCAP knows.
//!
//! | topic | message | what |
//! |---|---|---|
//! | `/tf` | `foxglove.FrameTransforms` | links, hand, object and cameras in `world` |
//! | `/joint_states` | `foxglove.JointStates` | positions, velocities and torques |
//! | `/points` | `foxglove.PointCloud` | what the depth images show of the object |
//! | `/camera_NN/depth` | `foxglove.RawImage` | the part of a depth image that was read out, in metres |
//! | `/object/true`, `/object/seen`, `/object/predicted` | `foxglove.PoseInFrame` | now, as perceived, and at the planned catch |
//! | `/hand/planned` | `foxglove.PoseInFrame` | where the hand is meant to be at the catch |
//! | `/log` | `foxglove.Log` | the story of the throw |

mod schemas;

use std::{collections::BTreeMap, io::Cursor};

use base64::{Engine, prelude::BASE64_STANDARD};
use catch_body::Pose;
use catch_cell::DepthFrame;
use mcap::{McapError, WriteOptions, Writer, records::MessageHeader};
use serde_json::{Value, json};

use crate::{catch_page::points_of, playback::Playback, recording::RecordedTick};
use schemas::Message;

/// Depth images are thinned until they take no more than this many bytes in all.
const MOST_IMAGE_BYTES: usize = 2_000_000;
/// Points of a cloud at most.
const MOST_POINTS: usize = 600;

/// The file of a throw.
///
/// # Errors
/// If it cannot be encoded, which would be a bug.
pub fn mcap(playback: &Playback) -> Result<Vec<u8>, McapError> {
    let mut file = Cursor::new(Vec::new());
    let mut log =
        Topics { writer: WriteOptions::new().compression(None).create(&mut file)?, channels: BTreeMap::new() };
    let mut events = playback.ending.timeline.iter().peekable();
    let images_every = images_every(playback);
    for (i, tick) in playback.ticks.iter().enumerate() {
        let now_s = tick.observation.time_s;
        while let Some(entry) = events.next_if(|entry| entry.time_s <= now_s) {
            log.event(entry.time_s, entry.event.label(), &entry.detail)?;
        }
        log.tick(playback, tick)?;
        if i % images_every == 0 {
            for frame in tick.observation.frames.iter().filter(|frame| frame.window.area() > 0) {
                log.image(frame)?;
            }
        }
    }
    for entry in events {
        log.event(entry.time_s, entry.event.label(), &entry.detail)?;
    }
    log.writer.finish()?;
    drop(log);
    Ok(file.into_inner())
}

/// Every how manieth tick's images fit in.
fn images_every(playback: &Playback) -> usize {
    let frames = playback.ticks.iter().flat_map(|tick| &tick.observation.frames);
    // Base64 takes four bytes for three, and each message has a frame of its own.
    let bytes: usize = frames.map(|frame| frame.window.area() * 16 / 3 + 250).sum();
    bytes.div_ceil(MOST_IMAGE_BYTES).max(1)
}

struct Topics<'a> {
    writer: Writer<&'a mut Cursor<Vec<u8>>>,
    /// Topic → channel and number of its messages.
    channels: BTreeMap<String, (u16, u32)>,
}

impl Topics<'_> {
    fn write(&mut self, topic: &str, message: Message, time_s: f64, content: &Value) -> Result<(), McapError> {
        if !self.channels.contains_key(topic) {
            let schema =
                self.writer.add_schema(message.name(), "jsonschema", message.schema().to_string().as_bytes())?;
            let channel = self.writer.add_channel(schema, topic, "json", &BTreeMap::new())?;
            self.channels.insert(topic.to_owned(), (channel, 0));
        }
        let Some((channel_id, sequence)) = self.channels.get_mut(topic) else { return Ok(()) };
        *sequence += 1;
        let nanoseconds = (time_s.max(0.0) * 1e9).round() as u64;
        let header = MessageHeader {
            channel_id: *channel_id,
            sequence: *sequence,
            log_time: nanoseconds,
            publish_time: nanoseconds,
        };
        self.writer.write_to_known_channel(&header, content.to_string().as_bytes())
    }

    fn event(&mut self, time_s: f64, label: &str, detail: &str) -> Result<(), McapError> {
        let content = json!({
            "timestamp": time(time_s), "level": 2, "message": format!("{label}: {detail}"), "name": "catchingbot", "file": "", "line": 0,
        });
        self.write("/log", Message::Log, time_s, &content)
    }

    fn tick(&mut self, playback: &Playback, tick: &RecordedTick) -> Result<(), McapError> {
        let now_s = tick.observation.time_s;
        if let Some(sample) = playback.truth_at(now_s) {
            let stamp = time(now_s);
            let mut frames = vec![("object".to_owned(), sample.X_WO), ("gripper".to_owned(), sample.X_WG)];
            let X_WL = playback.robot.link_poses(&sample.q);
            frames.push((base_link(&playback.header.sources.robot_urdf), X_WL[0]));
            let joints = || playback.robot.joints.iter().enumerate();
            frames.extend(joints().map(|(i, joint)| (joint.link_name.clone(), X_WL[i + 1])));
            let cameras = playback.header.cameras.iter().enumerate();
            frames.extend(cameras.map(|(i, camera)| (camera_name(i), camera.X_WC)));
            let transforms: Vec<Value> = frames.iter().map(|(name, X_WF)| transform(&stamp, name, X_WF)).collect();
            self.write("/tf", Message::FrameTransforms, now_s, &json!({ "transforms": transforms }))?;

            let state = |(i, joint): (usize, &catch_body::robot::Joint)| json!({ "name": joint.name, "position": sample.q[i], "velocity": sample.dq[i], "effort": sample.torque[i] });
            let joints: Vec<Value> = joints().map(state).collect();
            self.write("/joint_states", Message::JointStates, now_s, &json!({ "timestamp": stamp, "joints": joints }))?;
            self.pose("/object/true", now_s, &sample.X_WO)?;
        }
        let report = &tick.report;
        if let Some(pose) = &report.pose {
            self.pose("/object/seen", pose.capture_s, &pose.X_WO)?;
        }
        if let Some(plan) = report.plan.as_ref().filter(|plan| now_s <= plan.catch_s) {
            self.pose("/hand/planned", now_s, &plan.X_WG)?;
            if let Some(flight) = &report.flight {
                self.pose("/object/predicted", now_s, &flight.pose_at(plan.catch_s))?;
            }
        }
        self.cloud(playback, tick)
    }

    fn pose(&mut self, topic: &str, time_s: f64, X_WF: &Pose) -> Result<(), McapError> {
        let content = json!({ "timestamp": time(time_s), "frame_id": "world", "pose": pose(X_WF) });
        self.write(topic, Message::PoseInFrame, time_s, &content)
    }

    fn cloud(&mut self, playback: &Playback, tick: &RecordedTick) -> Result<(), McapError> {
        let frames = &tick.observation.frames;
        let points = points_of(frames, &playback.header.cameras);
        let Some(capture_s) = frames.first().map(|frame| frame.capture_s).filter(|_| !points.is_empty()) else {
            return Ok(());
        };
        let every = points.len().div_ceil(MOST_POINTS);
        let numbers = points.iter().step_by(every).flat_map(|point| point.coords.cast::<f32>().data.0[0]);
        let bytes: Vec<u8> = numbers.flat_map(f32::to_le_bytes).collect();
        let field = |(i, name): (usize, &str)| json!({ "name": name, "offset": i * 4, "type": schemas::FLOAT32 });
        let fields: Vec<Value> = ["x", "y", "z"].into_iter().enumerate().map(field).collect();
        let content = json!({
            "timestamp": time(capture_s), "frame_id": "world", "pose": pose(&Pose::identity()), "point_stride": 12,
            "fields": fields, "data": BASE64_STANDARD.encode(bytes),
        });
        self.write("/points", Message::PointCloud, tick.observation.time_s, &content)
    }

    fn image(&mut self, frame: &DepthFrame) -> Result<(), McapError> {
        let bytes: Vec<u8> = frame.depth_m.iter().flat_map(|depth| depth.to_le_bytes()).collect();
        let content = json!({
            "timestamp": time(frame.capture_s), "frame_id": camera_name(frame.camera), "width": frame.window.width,
            "height": frame.window.height, "encoding": "32FC1", "step": frame.window.width * 4,
            "data": BASE64_STANDARD.encode(bytes),
        });
        self.write(&format!("/{}/depth", camera_name(frame.camera)), Message::RawImage, frame.capture_s, &content)
    }
}

fn camera_name(index: usize) -> String {
    format!("camera_{index:02}")
}

/// Name of the link that stands still: the first in the URDF.
fn base_link(urdf: &str) -> String {
    let name = urdf.split("<link").nth(1).and_then(|it| it.split("name=\"").nth(1)).and_then(|it| it.split('"').next());
    name.unwrap_or("base").to_owned()
}

fn time(time_s: f64) -> Value {
    let nanoseconds = (time_s.max(0.0) * 1e9).round() as u64;
    json!({ "sec": nanoseconds / 1_000_000_000, "nsec": nanoseconds % 1_000_000_000 })
}

fn vector(X_AB: &Pose) -> Value {
    let p = &X_AB.translation.vector;
    json!({ "x": p.x, "y": p.y, "z": p.z })
}

fn rotation(X_AB: &Pose) -> Value {
    let q = X_AB.rotation.coords;
    json!({ "x": q.x, "y": q.y, "z": q.z, "w": q.w })
}

fn pose(X_AB: &Pose) -> Value {
    json!({ "position": vector(X_AB), "orientation": rotation(X_AB) })
}

fn transform(stamp: &Value, child: &str, X_WF: &Pose) -> Value {
    json!({
        "timestamp": stamp, "parent_frame_id": "world", "child_frame_id": child, "translation": vector(X_WF),
        "rotation": rotation(X_WF),
    })
}
