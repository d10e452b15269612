//! Foxglove's messages on the wire, with the fields that are written; `foxglove.proto` has all of them.

use catch_body::Pose;
use nalgebra::Point3 as Point;
use prost::{Message, Name};

/// Descriptors of all messages, as each schema in the file carries them: readers know the messages by these.
pub const DESCRIPTORS: &[u8] = include_bytes!("foxglove.binpb");
/// `FLOAT32` of the numeric types.
pub const FLOAT32: i32 = 7;
/// `INFO` of the levels of a log.
pub const INFO: i32 = 2;

#[derive(Clone, Copy, PartialEq, Message)]
pub struct Timestamp {
    #[prost(int64, tag = "1")]
    pub seconds: i64,
    #[prost(int32, tag = "2")]
    pub nanos: i32,
}

#[derive(Clone, Copy, PartialEq, Message)]
pub struct Vector3 {
    #[prost(double, tag = "1")]
    pub x: f64,
    #[prost(double, tag = "2")]
    pub y: f64,
    #[prost(double, tag = "3")]
    pub z: f64,
}

#[derive(Clone, Copy, PartialEq, Message)]
pub struct Quaternion {
    #[prost(double, tag = "1")]
    pub x: f64,
    #[prost(double, tag = "2")]
    pub y: f64,
    #[prost(double, tag = "3")]
    pub z: f64,
    #[prost(double, tag = "4")]
    pub w: f64,
}

#[derive(Clone, Copy, PartialEq, Message)]
pub struct PoseMessage {
    #[prost(message, optional, tag = "1")]
    pub position: Option<Vector3>,
    #[prost(message, optional, tag = "2")]
    pub orientation: Option<Quaternion>,
}

#[derive(Clone, Copy, PartialEq, Message)]
pub struct Color {
    #[prost(double, tag = "1")]
    pub r: f64,
    #[prost(double, tag = "2")]
    pub g: f64,
    #[prost(double, tag = "3")]
    pub b: f64,
    #[prost(double, tag = "4")]
    pub a: f64,
}

#[derive(Clone, PartialEq, Message)]
pub struct FrameTransform {
    #[prost(message, optional, tag = "1")]
    pub timestamp: Option<Timestamp>,
    #[prost(string, tag = "2")]
    pub parent_frame_id: String,
    #[prost(string, tag = "3")]
    pub child_frame_id: String,
    #[prost(message, optional, tag = "4")]
    pub translation: Option<Vector3>,
    #[prost(message, optional, tag = "5")]
    pub rotation: Option<Quaternion>,
}

/// Poses of frames in others.
#[derive(Clone, PartialEq, Message)]
pub struct FrameTransforms {
    #[prost(message, repeated, tag = "1")]
    pub transforms: Vec<FrameTransform>,
}

#[derive(Clone, PartialEq, Message)]
pub struct JointState {
    #[prost(string, tag = "1")]
    pub name: String,
    #[prost(double, optional, tag = "2")]
    pub position: Option<f64>,
    #[prost(double, optional, tag = "3")]
    pub velocity: Option<f64>,
    #[prost(double, optional, tag = "5")]
    pub effort: Option<f64>,
}

/// Joint positions, velocities and torques.
#[derive(Clone, PartialEq, Message)]
pub struct JointStates {
    #[prost(message, optional, tag = "1")]
    pub timestamp: Option<Timestamp>,
    #[prost(message, repeated, tag = "2")]
    pub joints: Vec<JointState>,
}

#[derive(Clone, PartialEq, Message)]
pub struct PackedElementField {
    #[prost(string, tag = "1")]
    pub name: String,
    #[prost(fixed32, tag = "2")]
    pub offset: u32,
    #[prost(int32, tag = "3")]
    pub numeric_type: i32,
}

/// Points with fields.
#[derive(Clone, PartialEq, Message)]
pub struct PointCloud {
    #[prost(message, optional, tag = "1")]
    pub timestamp: Option<Timestamp>,
    #[prost(string, tag = "2")]
    pub frame_id: String,
    #[prost(message, optional, tag = "3")]
    pub pose: Option<PoseMessage>,
    #[prost(fixed32, tag = "4")]
    pub point_stride: u32,
    #[prost(message, repeated, tag = "5")]
    pub fields: Vec<PackedElementField>,
    #[prost(bytes = "vec", tag = "6")]
    pub data: Vec<u8>,
}

/// An image, not compressed.
#[derive(Clone, PartialEq, Message)]
pub struct RawImage {
    #[prost(message, optional, tag = "1")]
    pub timestamp: Option<Timestamp>,
    #[prost(string, tag = "7")]
    pub frame_id: String,
    #[prost(fixed32, tag = "2")]
    pub width: u32,
    #[prost(fixed32, tag = "3")]
    pub height: u32,
    #[prost(string, tag = "4")]
    pub encoding: String,
    #[prost(fixed32, tag = "5")]
    pub step: u32,
    #[prost(bytes = "vec", tag = "6")]
    pub data: Vec<u8>,
}

/// How a camera projects.
#[derive(Clone, PartialEq, Message)]
pub struct CameraCalibration {
    #[prost(message, optional, tag = "1")]
    pub timestamp: Option<Timestamp>,
    #[prost(string, tag = "9")]
    pub frame_id: String,
    #[prost(fixed32, tag = "2")]
    pub width: u32,
    #[prost(fixed32, tag = "3")]
    pub height: u32,
    #[prost(double, repeated, tag = "6")]
    pub K: Vec<f64>,
    #[prost(double, repeated, tag = "7")]
    pub R: Vec<f64>,
    #[prost(double, repeated, tag = "8")]
    pub P: Vec<f64>,
}

/// One pose.
#[derive(Clone, PartialEq, Message)]
pub struct PoseInFrame {
    #[prost(message, optional, tag = "1")]
    pub timestamp: Option<Timestamp>,
    #[prost(string, tag = "2")]
    pub frame_id: String,
    #[prost(message, optional, tag = "3")]
    pub pose: Option<PoseMessage>,
}

/// A line for people.
#[derive(Clone, PartialEq, Message)]
pub struct Log {
    #[prost(message, optional, tag = "1")]
    pub timestamp: Option<Timestamp>,
    #[prost(int32, tag = "2")]
    pub level: i32,
    #[prost(string, tag = "3")]
    pub message: String,
    #[prost(string, tag = "4")]
    pub name: String,
}

/// A box or a ball: its full extents.
#[derive(Clone, Copy, PartialEq, Message)]
pub struct SizedPrimitive {
    #[prost(message, optional, tag = "1")]
    pub pose: Option<PoseMessage>,
    #[prost(message, optional, tag = "2")]
    pub size: Option<Vector3>,
    #[prost(message, optional, tag = "3")]
    pub color: Option<Color>,
}

/// A cylinder along z.
#[derive(Clone, Copy, PartialEq, Message)]
pub struct CylinderPrimitive {
    #[prost(message, optional, tag = "1")]
    pub pose: Option<PoseMessage>,
    #[prost(message, optional, tag = "2")]
    pub size: Option<Vector3>,
    #[prost(double, tag = "3")]
    pub bottom_scale: f64,
    #[prost(double, tag = "4")]
    pub top_scale: f64,
    #[prost(message, optional, tag = "5")]
    pub color: Option<Color>,
}

#[derive(Clone, PartialEq, Message)]
pub struct TriangleListPrimitive {
    #[prost(message, optional, tag = "1")]
    pub pose: Option<PoseMessage>,
    #[prost(message, repeated, tag = "2")]
    pub points: Vec<Vector3>,
    #[prost(message, optional, tag = "3")]
    pub color: Option<Color>,
    #[prost(fixed32, repeated, tag = "5")]
    pub indices: Vec<u32>,
}

/// What moves with one frame.
#[derive(Clone, PartialEq, Message)]
pub struct SceneEntity {
    #[prost(message, optional, tag = "1")]
    pub timestamp: Option<Timestamp>,
    #[prost(string, tag = "2")]
    pub frame_id: String,
    #[prost(string, tag = "3")]
    pub id: String,
    #[prost(bool, tag = "5")]
    pub frame_locked: bool,
    #[prost(message, repeated, tag = "8")]
    pub cubes: Vec<SizedPrimitive>,
    #[prost(message, repeated, tag = "9")]
    pub spheres: Vec<SizedPrimitive>,
    #[prost(message, repeated, tag = "10")]
    pub cylinders: Vec<CylinderPrimitive>,
    #[prost(message, repeated, tag = "12")]
    pub triangles: Vec<TriangleListPrimitive>,
}

/// What is to be seen from now on.
#[derive(Clone, PartialEq, Message)]
pub struct SceneUpdate {
    #[prost(message, repeated, tag = "2")]
    pub entities: Vec<SceneEntity>,
}

macro_rules! named {
    ($($message:ident)*) => {
        $(impl Name for $message {
            const NAME: &'static str = stringify!($message);
            const PACKAGE: &'static str = "foxglove";
        })*
    };
}
named!(FrameTransforms JointStates PointCloud RawImage CameraCalibration PoseInFrame Log SceneUpdate);

/// A time, from the beginning of the epoch or of the throw; none before it.
pub fn time(time_s: f64) -> Option<Timestamp> {
    let nanoseconds = nanoseconds(time_s);
    let (seconds, nanos) = (nanoseconds / 1_000_000_000, nanoseconds % 1_000_000_000);
    Some(Timestamp { seconds: i64::try_from(seconds).unwrap_or(i64::MAX), nanos: nanos as i32 })
}

/// The same as one number.
pub fn nanoseconds(time_s: f64) -> u64 {
    (time_s.max(0.0) * 1e9).round() as u64
}

pub fn vector(v: &nalgebra::Vector3<f64>) -> Option<Vector3> {
    Some(Vector3 { x: v.x, y: v.y, z: v.z })
}

pub fn point(p: &Point<f64>) -> Vector3 {
    Vector3 { x: p.x, y: p.y, z: p.z }
}

pub fn rotation(X_AB: &Pose) -> Option<Quaternion> {
    let q = X_AB.rotation.coords;
    Some(Quaternion { x: q.x, y: q.y, z: q.z, w: q.w })
}

pub fn pose(X_AB: &Pose) -> Option<PoseMessage> {
    Some(PoseMessage { position: vector(&X_AB.translation.vector), orientation: rotation(X_AB) })
}
