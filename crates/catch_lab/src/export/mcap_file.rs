//! A throw as an MCAP file with Foxglove's messages, for the tools that roboticists already use.
//!
//! Messages are Protocol Buffers, which both Foxglove and Rerun read (Rerun shows nothing of Foxglove's messages in JSON). Times
//! count from the throw, or are those of a real cell's clock. The file is not compressed: pure Rust has no writer of the compressions that MCAP knows.
//!
//! | topic | message | what |
//! |---|---|---|
//! | `/tf` | `foxglove.FrameTransforms` | the arm link by link from `world`; hand, object and cameras in `world` |
//! | `/joint_states` | `foxglove.JointStates` | positions, velocities and torques |
//! | `/points` | `foxglove.PointCloud` | what the depth images show of the object |
//! | `/camera_NN/depth` | `foxglove.RawImage` | the part of a depth image that was read out, in metres |
//! | `/camera_NN/calibration` | `foxglove.CameraCalibration` | where that part lies in the camera's image |
//! | `/object/true`, `/object/seen`, `/object/predicted` | `foxglove.PoseInFrame` | now, as perceived, and at the planned catch |
//! | `/hand/planned` | `foxglove.PoseInFrame` | where the hand is meant to be at the catch |
//! | `/log` | `foxglove.Log` | the story of the throw |
//!
//! Arm and object are as they truly were. In a recording without ground truth the arm is as it was sensed, and torques, `/object/true`
//! and the object's frame are absent.

mod protobuf;
mod schemas;

use std::{collections::BTreeMap, io::Cursor};

use catch_body::Pose;
use catch_cell::{CameraModel, DepthFrame, PixelWindow};
use mcap::{McapError, WriteOptions, Writer, records::MessageHeader};

use crate::recording::{RecordedTick, playback::Playback, points::points_of};
use protobuf::{Content, Fields, MessageType};

/// Depth images are thinned until they take no more than this many bytes in all.
const MOST_IMAGE_BYTES: usize = 3_000_000;
/// Points of a cloud at most.
const MOST_POINTS: usize = 600;

/// The frame that Rerun's views start from; without a way to it they show nothing.
const RERUN_ROOT: &str = "tf#/";

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
                if let Some(camera) = playback.header.cell.cameras.get(frame.camera) {
                    log.image(frame, camera)?;
                }
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
    // Four bytes for a pixel, and each has a calibration.
    let bytes: usize = frames.map(|frame| frame.window.area() * 4 + 450).sum();
    bytes.div_ceil(MOST_IMAGE_BYTES).max(1)
}

struct Topics<'a> {
    writer: Writer<&'a mut Cursor<Vec<u8>>>,
    /// Topic → channel and number of its messages.
    channels: BTreeMap<String, (u16, u32)>,
}

impl Topics<'_> {
    fn write(
        &mut self,
        topic: &str,
        message: &'static MessageType,
        time_s: f64,
        content: &Fields,
    ) -> Result<(), McapError> {
        if !self.channels.contains_key(topic) {
            let schema = self.writer.add_schema(&message.full_name(), "protobuf", &message.descriptor_set())?;
            let channel = self.writer.add_channel(schema, topic, "protobuf", &BTreeMap::new())?;
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
        self.writer.write_to_known_channel(&header, &message.encode(content))
    }

    fn event(&mut self, time_s: f64, label: &str, detail: &str) -> Result<(), McapError> {
        let content = vec![
            ("timestamp", time(time_s)),
            ("level", Content::Whole(schemas::INFO)),
            ("message", text(&format!("{label}: {detail}"))),
            ("name", text("catchingbot")),
        ];
        self.write("/log", &schemas::LOG, time_s, &content)
    }

    fn tick(&mut self, playback: &Playback, tick: &RecordedTick) -> Result<(), McapError> {
        let now_s = tick.observation.time_s;
        if let Some(sample) = playback.motion_at(now_s) {
            let X_WL = playback.robot.link_poses(&sample.q);
            let base = base_link(&playback.header.cell.sources.robot_urdf);
            let mut frames = vec![
                transform(now_s, RERUN_ROOT, "world", &Pose::identity()),
                transform(now_s, "world", "gripper", &sample.X_WG),
                transform(now_s, "world", &base, &X_WL[0]),
            ];
            frames.extend(sample.X_WO.map(|X_WO| transform(now_s, "world", "object", &X_WO)));
            // Each link in the one before it, as in the URDF, so that both can be shown together.
            let joints = || playback.robot.joints.iter().enumerate();
            let parents = std::iter::once(base.as_str()).chain(joints().map(|(_, joint)| joint.link_name.as_str()));
            let links = joints().zip(parents);
            frames.extend(links.map(|((i, joint), parent)| {
                transform(now_s, parent, &joint.link_name, &(X_WL[i].inverse() * X_WL[i + 1]))
            }));
            let cameras = playback.header.cell.cameras.iter().enumerate();
            frames.extend(cameras.map(|(i, camera)| transform(now_s, "world", &camera_name(i), &camera.X_WC)));
            self.write("/tf", &schemas::FRAME_TRANSFORMS, now_s, &vec![("transforms", Content::Many(frames))])?;

            let joints = joints().map(|(i, joint)| {
                let mut fields = vec![
                    ("name", text(&joint.name)),
                    ("position", Content::Number(sample.q[i])),
                    ("velocity", Content::Number(sample.dq[i])),
                ];
                fields.extend(sample.torque.map(|torque| ("effort", Content::Number(torque[i]))));
                fields
            });
            let content = vec![("timestamp", time(now_s)), ("joints", Content::Many(joints.collect()))];
            self.write("/joint_states", &schemas::JOINT_STATES, now_s, &content)?;
            if let Some(X_WO) = &sample.X_WO {
                self.pose("/object/true", now_s, X_WO)?;
            }
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
        let content = vec![("timestamp", time(time_s)), ("frame_id", text("world")), ("pose", pose(X_WF))];
        self.write(topic, &schemas::POSE_IN_FRAME, time_s, &content)
    }

    fn cloud(&mut self, playback: &Playback, tick: &RecordedTick) -> Result<(), McapError> {
        let frames = &tick.observation.frames;
        let points = points_of(frames, &playback.header.cell.cameras);
        let Some(capture_s) = frames.first().map(|frame| frame.capture_s).filter(|_| !points.is_empty()) else {
            return Ok(());
        };
        let every = points.len().div_ceil(MOST_POINTS);
        let numbers = points.iter().step_by(every).flat_map(|point| point.coords.cast::<f32>().data.0[0]);
        let bytes: Vec<u8> = numbers.flat_map(f32::to_le_bytes).collect();
        let field = |(i, name): (u32, &str)| {
            vec![("name", text(name)), ("offset", Content::Whole(i * 4)), ("type", Content::Whole(schemas::FLOAT32))]
        };
        let content = vec![
            ("timestamp", time(capture_s)),
            ("frame_id", text("world")),
            ("pose", pose(&Pose::identity())),
            ("point_stride", Content::Whole(12)),
            ("fields", Content::Many((0..).zip(["x", "y", "z"]).map(field).collect())),
            ("data", Content::Bytes(bytes)),
        ];
        self.write("/points", &schemas::POINT_CLOUD, tick.observation.time_s, &content)
    }

    fn image(&mut self, frame: &DepthFrame, camera: &CameraModel) -> Result<(), McapError> {
        let PixelWindow { left, top, width, height } = frame.window;
        // Here the centre of the first pixel is at 0, not at 0.5.
        let [cx, cy] = [(0, left), (1, top)].map(|(i, first)| camera.principal_px[i] - f64::from(first) - 0.5);
        let f = camera.focal_px;
        let calibration = vec![
            ("timestamp", time(frame.capture_s)),
            ("frame_id", text(&camera_name(frame.camera))),
            ("width", Content::Whole(width)),
            ("height", Content::Whole(height)),
            ("K", Content::Numbers(vec![f, 0.0, cx, 0.0, f, cy, 0.0, 0.0, 1.0])),
            ("R", Content::Numbers(vec![1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0])),
            ("P", Content::Numbers(vec![f, 0.0, cx, 0.0, 0.0, f, cy, 0.0, 0.0, 0.0, 1.0, 0.0])),
        ];
        let topic = |what: &str| format!("/{}/{what}", camera_name(frame.camera));
        self.write(&topic("calibration"), &schemas::CAMERA_CALIBRATION, frame.capture_s, &calibration)?;
        let content = vec![
            ("timestamp", time(frame.capture_s)),
            ("frame_id", text(&camera_name(frame.camera))),
            ("width", Content::Whole(width)),
            ("height", Content::Whole(height)),
            ("encoding", text("32FC1")),
            ("step", Content::Whole(width * 4)),
            ("data", Content::Bytes(frame.depth_m.iter().flat_map(|depth| depth.to_le_bytes()).collect())),
        ];
        self.write(&topic("depth"), &schemas::RAW_IMAGE, frame.capture_s, &content)
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

fn text(text: &str) -> Content {
    Content::Text(text.to_owned())
}

fn time(time_s: f64) -> Content {
    let nanoseconds = (time_s.max(0.0) * 1e9).round() as u64;
    let whole = |value: u64| Content::Whole(u32::try_from(value).unwrap_or(u32::MAX));
    Content::Message(vec![
        ("seconds", whole(nanoseconds / 1_000_000_000)),
        ("nanos", whole(nanoseconds % 1_000_000_000)),
    ])
}

fn vector(X_AB: &Pose) -> Content {
    let p = &X_AB.translation.vector;
    Content::Message(vec![("x", Content::Number(p.x)), ("y", Content::Number(p.y)), ("z", Content::Number(p.z))])
}

fn rotation(X_AB: &Pose) -> Content {
    let q = X_AB.rotation.coords;
    let fields = ["x", "y", "z", "w"].into_iter().zip(q.iter().map(|value| Content::Number(*value)));
    Content::Message(fields.collect())
}

fn pose(X_AB: &Pose) -> Content {
    Content::Message(vec![("position", vector(X_AB)), ("orientation", rotation(X_AB))])
}

fn transform(time_s: f64, parent: &str, child: &str, X_PC: &Pose) -> Fields {
    vec![
        ("timestamp", time(time_s)),
        ("parent_frame_id", text(parent)),
        ("child_frame_id", text(child)),
        ("translation", vector(X_PC)),
        ("rotation", rotation(X_PC)),
    ]
}
