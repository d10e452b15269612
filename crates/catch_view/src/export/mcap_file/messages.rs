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
    ($($(#[$about:meta])* $name:ident { $($field:ident: $kind:ty = [$($wire:tt)*],)* })*) => {
        $($(#[$about])* #[derive(Clone, PartialEq, Message)]
        pub struct $name {
            $(#[prost($($wire)*)] pub $field: $kind,)*
        }
        impl Name for $name {
            const NAME: &'static str = stringify!($name);
            const PACKAGE: &'static str = "foxglove";
        })*
    };
}

messages! {
    Timestamp {
        seconds: i64 = [int64, tag = "1"],
        nanos: i32 = [int32, tag = "2"],
    }
    Vector3 {
        x: f64 = [double, tag = "1"],
        y: f64 = [double, tag = "2"],
        z: f64 = [double, tag = "3"],
    }
    Quaternion {
        x: f64 = [double, tag = "1"],
        y: f64 = [double, tag = "2"],
        z: f64 = [double, tag = "3"],
        w: f64 = [double, tag = "4"],
    }
    PoseMessage {
        position: Option<Vector3> = [message, optional, tag = "1"],
        orientation: Option<Quaternion> = [message, optional, tag = "2"],
    }
    Color {
        r: f64 = [double, tag = "1"],
        g: f64 = [double, tag = "2"],
        b: f64 = [double, tag = "3"],
        a: f64 = [double, tag = "4"],
    }
    FrameTransform {
        timestamp: Option<Timestamp> = [message, optional, tag = "1"],
        parent_frame_id: String = [string, tag = "2"],
        child_frame_id: String = [string, tag = "3"],
        translation: Option<Vector3> = [message, optional, tag = "4"],
        rotation: Option<Quaternion> = [message, optional, tag = "5"],
    }
    /// Poses of frames in others.
    FrameTransforms {
        transforms: Vec<FrameTransform> = [message, repeated, tag = "1"],
    }
    JointState {
        name: String = [string, tag = "1"],
        position: Option<f64> = [double, optional, tag = "2"],
        velocity: Option<f64> = [double, optional, tag = "3"],
        effort: Option<f64> = [double, optional, tag = "5"],
    }
    /// Joint positions, velocities and torques.
    JointStates {
        timestamp: Option<Timestamp> = [message, optional, tag = "1"],
        joints: Vec<JointState> = [message, repeated, tag = "2"],
    }
    PackedElementField {
        name: String = [string, tag = "1"],
        offset: u32 = [fixed32, tag = "2"],
        numeric_type: i32 = [int32, tag = "3"],
    }
    /// Points with fields.
    PointCloud {
        timestamp: Option<Timestamp> = [message, optional, tag = "1"],
        frame_id: String = [string, tag = "2"],
        pose: Option<PoseMessage> = [message, optional, tag = "3"],
        point_stride: u32 = [fixed32, tag = "4"],
        fields: Vec<PackedElementField> = [message, repeated, tag = "5"],
        data: Vec<u8> = [bytes = "vec", tag = "6"],
    }
    /// An image, not compressed.
    RawImage {
        timestamp: Option<Timestamp> = [message, optional, tag = "1"],
        frame_id: String = [string, tag = "7"],
        width: u32 = [fixed32, tag = "2"],
        height: u32 = [fixed32, tag = "3"],
        encoding: String = [string, tag = "4"],
        step: u32 = [fixed32, tag = "5"],
        data: Vec<u8> = [bytes = "vec", tag = "6"],
    }
    /// Calibration of a camera: size, intrinsics and projection.
    CameraCalibration {
        timestamp: Option<Timestamp> = [message, optional, tag = "1"],
        frame_id: String = [string, tag = "9"],
        width: u32 = [fixed32, tag = "2"],
        height: u32 = [fixed32, tag = "3"],
        K: Vec<f64> = [double, repeated, tag = "6"],
        R: Vec<f64> = [double, repeated, tag = "7"],
        P: Vec<f64> = [double, repeated, tag = "8"],
    }
    /// One pose.
    PoseInFrame {
        timestamp: Option<Timestamp> = [message, optional, tag = "1"],
        frame_id: String = [string, tag = "2"],
        pose: Option<PoseMessage> = [message, optional, tag = "3"],
    }
    /// A line for people.
    Log {
        timestamp: Option<Timestamp> = [message, optional, tag = "1"],
        level: i32 = [int32, tag = "2"],
        message: String = [string, tag = "3"],
        name: String = [string, tag = "4"],
    }
    TriangleListPrimitive {
        pose: Option<PoseMessage> = [message, optional, tag = "1"],
        points: Vec<Vector3> = [message, repeated, tag = "2"],
        color: Option<Color> = [message, optional, tag = "3"],
        indices: Vec<u32> = [fixed32, repeated, tag = "5"],
    }
    /// Entity that moves with one frame.
    SceneEntity {
        timestamp: Option<Timestamp> = [message, optional, tag = "1"],
        frame_id: String = [string, tag = "2"],
        id: String = [string, tag = "3"],
        frame_locked: bool = [bool, tag = "5"],
        triangles: Vec<TriangleListPrimitive> = [message, repeated, tag = "12"],
    }
    /// Entities that are visible from now on.
    SceneUpdate {
        entities: Vec<SceneEntity> = [message, repeated, tag = "2"],
    }
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
