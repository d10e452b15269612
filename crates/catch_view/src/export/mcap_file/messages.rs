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

/// Messages from tables: name and type of each field, and how it stands on the wire. Messages within others
/// have no name on the wire.
macro_rules! messages {
    ($($(#[$about:meta])* $name:ident { $($field:ident: $kind:ty = $tag:literal $($wire:ident)*),* })*) => {
        $($(#[$about])* #[derive(Clone, PartialEq, Message)]
        pub struct $name {
            $(#[prost($($wire,)* tag = $tag)] pub $field: $kind,)*
        }
        impl Name for $name {
            const NAME: &'static str = stringify!($name);
            const PACKAGE: &'static str = "foxglove";
        })*
    };
}

messages! {
    Timestamp { seconds: i64 = 1 int64, nanos: i32 = 2 int32 }
    Vector3 { x: f64 = 1 double, y: f64 = 2 double, z: f64 = 3 double }
    Quaternion { x: f64 = 1 double, y: f64 = 2 double, z: f64 = 3 double, w: f64 = 4 double }
    PoseMessage { position: Option<Vector3> = 1 message optional, orientation: Option<Quaternion> = 2 message optional }
    Color { r: f64 = 1 double, g: f64 = 2 double, b: f64 = 3 double, a: f64 = 4 double }
    FrameTransform {
        timestamp: Option<Timestamp> = 1 message optional, parent_frame_id: String = 2 string,
        child_frame_id: String = 3 string, translation: Option<Vector3> = 4 message optional,
        rotation: Option<Quaternion> = 5 message optional
    }
    /// Poses of frames in others.
    FrameTransforms { transforms: Vec<FrameTransform> = 1 message repeated }
    JointState {
        name: String = 1 string, position: Option<f64> = 2 double optional, velocity: Option<f64> = 3 double optional,
        effort: Option<f64> = 5 double optional
    }
    /// Joint positions, velocities and torques.
    JointStates { timestamp: Option<Timestamp> = 1 message optional, joints: Vec<JointState> = 2 message repeated }
    PackedElementField { name: String = 1 string, offset: u32 = 2 fixed32, numeric_type: i32 = 3 int32 }
    /// Points with fields.
    PointCloud {
        timestamp: Option<Timestamp> = 1 message optional, frame_id: String = 2 string,
        pose: Option<PoseMessage> = 3 message optional, point_stride: u32 = 4 fixed32,
        fields: Vec<PackedElementField> = 5 message repeated, data: Vec<u8> = 6 bytes
    }
    /// An image, not compressed.
    RawImage {
        timestamp: Option<Timestamp> = 1 message optional, frame_id: String = 7 string, width: u32 = 2 fixed32,
        height: u32 = 3 fixed32, encoding: String = 4 string, step: u32 = 5 fixed32, data: Vec<u8> = 6 bytes
    }
    /// Calibration of a camera: size, intrinsics and projection.
    CameraCalibration {
        timestamp: Option<Timestamp> = 1 message optional, frame_id: String = 9 string, width: u32 = 2 fixed32,
        height: u32 = 3 fixed32, K: Vec<f64> = 6 double repeated, R: Vec<f64> = 7 double repeated,
        P: Vec<f64> = 8 double repeated
    }
    /// One pose.
    PoseInFrame {
        timestamp: Option<Timestamp> = 1 message optional, frame_id: String = 2 string,
        pose: Option<PoseMessage> = 3 message optional
    }
    /// A line for people.
    Log {
        timestamp: Option<Timestamp> = 1 message optional, level: i32 = 2 int32, message: String = 3 string,
        name: String = 4 string
    }
    TriangleListPrimitive {
        pose: Option<PoseMessage> = 1 message optional, points: Vec<Vector3> = 2 message repeated,
        color: Option<Color> = 3 message optional, indices: Vec<u32> = 5 fixed32 repeated
    }
    /// Entity that moves with one frame.
    SceneEntity {
        timestamp: Option<Timestamp> = 1 message optional, frame_id: String = 2 string, id: String = 3 string,
        frame_locked: bool = 5 bool, triangles: Vec<TriangleListPrimitive> = 12 message repeated
    }
    /// Entities that are visible from now on.
    SceneUpdate { entities: Vec<SceneEntity> = 2 message repeated }
}

/// A time, from the beginning of the epoch or of the throw; none before it.
pub fn time(time_s: f64) -> Option<Timestamp> {
    let nanoseconds = nanoseconds(time_s);
    let (seconds, nanos) = (nanoseconds / 1_000_000_000, nanoseconds % 1_000_000_000);
    Some(Timestamp { seconds: i64::try_from(seconds).unwrap_or(i64::MAX), nanos: nanos as i32 })
}

/// Converts a time to nanoseconds, as one number.
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
