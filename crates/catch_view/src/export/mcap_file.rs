//! A throw as an MCAP file with Foxglove's messages, for the tools that roboticists already use.
//!
//! Messages are Protocol Buffers, which both Foxglove and Rerun read (Rerun shows nothing of Foxglove's
//! messages in JSON). Times count from the throw, or are those of a real cell's clock. The file is not
//! compressed: pure Rust has no writer of the compressions that MCAP knows.
//!
//! | topic | message | what |
//! |---|---|---|
//! | `/tf` | `foxglove.FrameTransforms` | the arm link by link from `world`; hand, object and cameras in `world`; fingers in the hand |
//! | `/scene` | `foxglove.SceneUpdate` | shapes of arm, hand and object, each in the frame that moves it; once, at the beginning |
//! | `/joint_states` | `foxglove.JointStates` | positions, velocities and torques |
//! | `/gripper` | `foxglove.JointStates` | `aperture`: distance between the fingers' inner faces in metres, and the force of a finger in N |
//! | `/points` | `foxglove.PointCloud` | what the depth images show of the object |
//! | `/camera_NN/depth` | `foxglove.RawImage` | the part of a depth image that was read out, in metres |
//! | `/camera_NN/calibration` | `foxglove.CameraCalibration` | where that part lies in the camera's image |
//! | `/object/true`, `/object/seen`, `/object/predicted` | `foxglove.PoseInFrame` | now, as perceived, and at the planned catch |
//! | `/hand/planned` | `foxglove.PoseInFrame` | where the hand is meant to be at the catch |
//! | `/log` | `foxglove.Log` | the story of the throw |
//!
//! Arm and object are as they truly were. In a recording without ground truth the arm is as it was sensed,
//! and torques, `/object/true` and the object's frame and shape are absent.
//!
//! Metadata: `recording` (title, version, and every how manieth tick's images are in the file), and of a
//! simulated throw `scene` (object, throw, seed, index), `scenario` (its TOML) and `outcome` (each column of
//! a row of an evaluation, as JSON).

mod messages;
mod scene;

use std::{collections::BTreeMap, io::Cursor};

use catch_body::Pose;
use catch_cell::{CameraModel, DepthFrame, PixelWindow};
use mcap::{
    McapError, WriteOptions, Writer,
    records::{MessageHeader, Metadata},
};
use prost::{Message, Name};
use serde::Serialize;

use crate::{
    playback::{MotionSample, Playback},
    points::points_of,
    surfaces::finger_poses,
};
use catch_recording::{Header, RecordedTick};
use messages::{
    CameraCalibration, DESCRIPTORS, FLOAT32, FrameTransform, FrameTransforms, INFO, JointState, JointStates, Log,
    PackedElementField, PointCloud, PoseInFrame, RawImage, SceneUpdate, nanoseconds, pose, rotation, time, vector,
};

/// Depth images are thinned until they take no more than this many bytes in all.
const MOST_IMAGE_BYTES: usize = 3_000_000;
/// Points of a cloud at most.
const MOST_POINTS: usize = 600;

/// The frame that Rerun's views start from; without a way to it they show nothing.
const RERUN_ROOT: &str = "tf#/";

/// Which depth images are written.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Images {
    /// Those of every so manieth tick: as many as fit into 3 MB.
    Some,
    /// Every one.
    All,
}

/// The file of a throw, and every how manieth tick's images are in it.
///
/// # Errors
/// If it cannot be encoded, which would be a bug.
pub fn mcap(playback: &Playback, images: Images) -> Result<(Vec<u8>, usize), McapError> {
    let mut file = Cursor::new(Vec::new());
    let mut log =
        Topics { writer: WriteOptions::new().compression(None).create(&mut file)?, channels: BTreeMap::new() };
    let images_every = if images == Images::All { 1 } else { images_every(playback) };
    for metadata in metadata(playback, images_every) {
        log.writer.write_metadata(&metadata)?;
    }
    let links: Vec<&str> = playback.robot.link_names().collect();
    let surface = playback.ground_truth().map(|it| it.surface.mesh());
    let start_s = playback.ticks.first().map_or(0.0, |tick| tick.observation.time_s);
    let entities = scene::entities(&playback.robot, &links, &playback.gripper, surface.as_ref(), start_s);
    log.write("/scene", start_s, &SceneUpdate { entities })?;
    let mut events = playback.ending.timeline.iter().peekable();
    for (i, tick) in playback.ticks.iter().enumerate() {
        let now_s = tick.observation.time_s;
        while let Some(entry) = events.next_if(|entry| entry.time_s <= now_s) {
            log.event(entry.time_s, &entry.event.label(), &entry.detail)?;
        }
        log.tick(playback, &links, tick)?;
        if i % images_every == 0 {
            for frame in tick.observation.frames.iter().filter(|frame| frame.window.area() > 0) {
                if let Some(camera) = playback.header.cell.cameras.get(frame.camera) {
                    log.image(frame, camera)?;
                }
            }
        }
    }
    for entry in events {
        log.event(entry.time_s, &entry.event.label(), &entry.detail)?;
    }
    log.writer.finish()?;
    drop(log);
    Ok((file.into_inner(), images_every))
}

/// Returns the data of the throw as a whole.
fn metadata(playback: &Playback, images_every: usize) -> Vec<Metadata> {
    let Header { title, version, simulation, .. } = &playback.header;
    let text = |key: &str, value: &str| (key.to_owned(), value.to_owned());
    let named = |name: &str, metadata: BTreeMap<String, String>| Metadata { name: name.to_owned(), metadata };
    let images_every = text("images_of_every_nth_tick", &images_every.to_string());
    let mut all = vec![named("recording", [text("title", title), text("version", version), images_every].into())];
    if let Some(simulation) = simulation {
        all.push(named("scene", fields(&simulation.scene)));
        let toml = toml::to_string(&simulation.scenario).unwrap_or_else(|fault| fault.to_string());
        all.push(named("scenario", [("toml".to_owned(), toml)].into()));
    }
    all.extend(playback.ground_truth().map(|it| named("outcome", fields(&it.verdict))));
    all
}

/// The fields of a value as JSON, texts without quotes.
fn fields(value: &impl Serialize) -> BTreeMap<String, String> {
    let serde_json::Value::Object(fields) = serde_json::to_value(value).unwrap_or_default() else {
        return BTreeMap::new();
    };
    let text = |value: serde_json::Value| value.as_str().map_or_else(|| value.to_string(), str::to_owned);
    fields.into_iter().map(|(name, value)| (name, text(value))).collect()
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
    fn write<M: Message + Name>(&mut self, topic: &str, time_s: f64, message: &M) -> Result<(), McapError> {
        if !self.channels.contains_key(topic) {
            let schema = self.writer.add_schema(&M::full_name(), "protobuf", DESCRIPTORS)?;
            let channel = self.writer.add_channel(schema, topic, "protobuf", &BTreeMap::new())?;
            self.channels.insert(topic.to_owned(), (channel, 0));
        }
        let Some((channel_id, sequence)) = self.channels.get_mut(topic) else { return Ok(()) };
        *sequence += 1;
        let (log_time, channel_id, sequence) = (nanoseconds(time_s), *channel_id, *sequence);
        let header = MessageHeader { channel_id, sequence, log_time, publish_time: log_time };
        self.writer.write_to_known_channel(&header, &message.encode_to_vec())
    }

    fn event(&mut self, time_s: f64, label: &str, detail: &str) -> Result<(), McapError> {
        let (message, name) = (format!("{label}: {detail}"), "catchingbot".to_owned());
        self.write("/log", time_s, &Log { timestamp: time(time_s), level: INFO, message, name })
    }

    fn tick(&mut self, playback: &Playback, links: &[&str], tick: &RecordedTick) -> Result<(), McapError> {
        let now_s = tick.observation.time_s;
        if let Some(sample) = playback.motion_at(now_s) {
            self.motion(playback, links, &sample, now_s)?;
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

    /// Frames, joints, aperture and the object's pose.
    fn motion(
        &mut self,
        playback: &Playback,
        links: &[&str],
        sample: &MotionSample,
        now_s: f64,
    ) -> Result<(), McapError> {
        let transform = |parent: &str, child: &str, X_PC: &Pose| FrameTransform {
            timestamp: time(now_s),
            parent_frame_id: parent.to_owned(),
            child_frame_id: child.to_owned(),
            translation: vector(&X_PC.translation.vector),
            rotation: rotation(X_PC),
        };
        let X_WL = playback.robot.link_poses(&sample.q);
        let mut transforms = vec![
            transform(RERUN_ROOT, scene::WORLD, &Pose::identity()),
            transform(scene::WORLD, "gripper", &sample.X_WG),
            transform(scene::WORLD, links[0], &X_WL[0]),
        ];
        transforms.extend(sample.X_WO.map(|X_WO| transform(scene::WORLD, "object", &X_WO)));
        // Each link in the one before it, as in its URDF.
        let pairs = links.windows(2).enumerate();
        transforms.extend(pairs.map(|(i, pair)| transform(pair[0], pair[1], &(X_WL[i].inverse() * X_WL[i + 1]))));
        let fingers = scene::FINGERS.into_iter().zip(finger_poses(&playback.gripper, sample.width_m));
        transforms.extend(fingers.map(|(name, X_GF)| transform("gripper", name, &X_GF)));
        let cameras = playback.header.cell.cameras.iter().enumerate();
        transforms.extend(cameras.map(|(i, camera)| transform(scene::WORLD, &camera_name(i), &camera.X_WC)));
        self.write("/tf", now_s, &FrameTransforms { transforms })?;

        let joint = |(i, name): (usize, &String)| JointState {
            name: name.clone(),
            position: Some(sample.q[i]),
            velocity: Some(sample.dq[i]),
            effort: sample.torque.map(|torque| torque[i]),
        };
        let joints = playback.robot.joints.iter().map(|joint| &joint.name).enumerate().map(joint).collect();
        self.write("/joint_states", now_s, &JointStates { timestamp: time(now_s), joints })?;
        let [left, right] = sample.finger_force_n;
        let aperture = JointState {
            name: "aperture".to_owned(),
            position: Some(sample.width_m),
            velocity: None,
            effort: Some(left.max(right)),
        };
        self.write("/gripper", now_s, &JointStates { timestamp: time(now_s), joints: vec![aperture] })?;
        sample.X_WO.as_ref().map_or(Ok(()), |X_WO| self.pose("/object/true", now_s, X_WO))
    }

    fn pose(&mut self, topic: &str, time_s: f64, X_WF: &Pose) -> Result<(), McapError> {
        let message = PoseInFrame { timestamp: time(time_s), frame_id: scene::WORLD.to_owned(), pose: pose(X_WF) };
        self.write(topic, time_s, &message)
    }

    fn cloud(&mut self, playback: &Playback, tick: &RecordedTick) -> Result<(), McapError> {
        let frames = &tick.observation.frames;
        let points = points_of(frames, &playback.header.cell.cameras);
        let Some(capture_s) = frames.first().map(|frame| frame.capture_s).filter(|_| !points.is_empty()) else {
            return Ok(());
        };
        let every = points.len().div_ceil(MOST_POINTS);
        let numbers = points.iter().step_by(every).flat_map(|point| point.coords.cast::<f32>().data.0[0]);
        let field =
            |(i, name): (u32, &str)| PackedElementField { name: name.to_owned(), offset: i * 4, numeric_type: FLOAT32 };
        let message = PointCloud {
            timestamp: time(capture_s),
            frame_id: scene::WORLD.to_owned(),
            pose: pose(&Pose::identity()),
            point_stride: 12,
            fields: (0..).zip(["x", "y", "z"]).map(field).collect(),
            data: numbers.flat_map(f32::to_le_bytes).collect(),
        };
        self.write("/points", tick.observation.time_s, &message)
    }

    fn image(&mut self, frame: &DepthFrame, camera: &CameraModel) -> Result<(), McapError> {
        let PixelWindow { left, top, width, height } = frame.window;
        // Here the centre of the first pixel is at 0, not at 0.5.
        let [cx, cy] = [(0, left), (1, top)].map(|(i, first)| camera.principal_px[i] - f64::from(first) - 0.5);
        let f = camera.focal_px;
        let (timestamp, frame_id) = (time(frame.capture_s), camera_name(frame.camera));
        let topic = |what: &str| format!("/{}/{what}", camera_name(frame.camera));
        let calibration = CameraCalibration {
            timestamp: timestamp.clone(),
            frame_id: frame_id.clone(),
            width,
            height,
            K: vec![f, 0.0, cx, 0.0, f, cy, 0.0, 0.0, 1.0],
            R: vec![1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0],
            P: vec![f, 0.0, cx, 0.0, 0.0, f, cy, 0.0, 0.0, 0.0, 1.0, 0.0],
        };
        self.write(&topic("calibration"), frame.capture_s, &calibration)?;
        let image = RawImage {
            timestamp,
            frame_id,
            width,
            height,
            encoding: "32FC1".to_owned(),
            step: width * 4,
            data: frame.depth_m.iter().flat_map(|depth| depth.to_le_bytes()).collect(),
        };
        self.write(&topic("depth"), frame.capture_s, &image)
    }
}

fn camera_name(index: usize) -> String {
    format!("camera_{index:02}")
}
