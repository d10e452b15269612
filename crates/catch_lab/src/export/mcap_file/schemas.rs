//! Foxglove's messages (Foxglove documentation, "Message schemas", their Protocol Buffers).

use super::protobuf::{Kind, MessageType};

/// `FLOAT32` in [`NUMERIC_TYPES`].
pub const FLOAT32: u32 = 7;
/// `INFO` in [`LOG_LEVELS`].
pub const INFO: u32 = 2;

const NUMERIC_TYPES: &[&str] =
    &["UNKNOWN", "UINT8", "INT8", "UINT16", "INT16", "UINT32", "INT32", "FLOAT32", "FLOAT64"];
const LOG_LEVELS: &[&str] = &["UNKNOWN", "DEBUG", "INFO", "WARNING", "ERROR", "FATAL"];

static TIME: MessageType = MessageType {
    package: "google.protobuf",
    name: "Timestamp",
    file: "google/protobuf/timestamp.proto",
    fields: &[("seconds", 1, Kind::Int64), ("nanos", 2, Kind::Int32)],
};

const fn foxglove(name: &'static str, file: &'static str, fields: &'static [(&'static str, u32, Kind)]) -> MessageType {
    MessageType { package: "foxglove", name, file, fields }
}

static VECTOR: MessageType = foxglove(
    "Vector3",
    "foxglove/Vector3.proto",
    &[("x", 1, Kind::Double), ("y", 2, Kind::Double), ("z", 3, Kind::Double)],
);

static QUATERNION: MessageType = foxglove(
    "Quaternion",
    "foxglove/Quaternion.proto",
    &[("x", 1, Kind::Double), ("y", 2, Kind::Double), ("z", 3, Kind::Double), ("w", 4, Kind::Double)],
);

static POSE: MessageType = foxglove(
    "Pose",
    "foxglove/Pose.proto",
    &[("position", 1, Kind::Message(&VECTOR)), ("orientation", 2, Kind::Message(&QUATERNION))],
);

static FRAME_TRANSFORM: MessageType = foxglove(
    "FrameTransform",
    "foxglove/FrameTransform.proto",
    &[
        ("timestamp", 1, Kind::Message(&TIME)),
        ("parent_frame_id", 2, Kind::Text),
        ("child_frame_id", 3, Kind::Text),
        ("translation", 4, Kind::Message(&VECTOR)),
        ("rotation", 5, Kind::Message(&QUATERNION)),
    ],
);

static JOINT_STATE: MessageType = foxglove(
    "JointState",
    "foxglove/JointState.proto",
    &[
        ("name", 1, Kind::Text),
        ("position", 2, Kind::OptionalDouble),
        ("velocity", 3, Kind::OptionalDouble),
        ("acceleration", 4, Kind::OptionalDouble),
        ("effort", 5, Kind::OptionalDouble),
    ],
);

static PACKED_ELEMENT_FIELD: MessageType = foxglove(
    "PackedElementField",
    "foxglove/PackedElementField.proto",
    &[("name", 1, Kind::Text), ("offset", 2, Kind::Fixed32), ("type", 3, Kind::OneOf("NumericType", NUMERIC_TYPES))],
);

/// Poses of frames in others.
pub static FRAME_TRANSFORMS: MessageType =
    foxglove("FrameTransforms", "foxglove/FrameTransforms.proto", &[("transforms", 1, Kind::Many(&FRAME_TRANSFORM))]);

/// Joint positions, velocities and torques.
pub static JOINT_STATES: MessageType = foxglove(
    "JointStates",
    "foxglove/JointStates.proto",
    &[("timestamp", 1, Kind::Message(&TIME)), ("joints", 2, Kind::Many(&JOINT_STATE))],
);

/// Points with fields.
pub static POINT_CLOUD: MessageType = foxglove(
    "PointCloud",
    "foxglove/PointCloud.proto",
    &[
        ("timestamp", 1, Kind::Message(&TIME)),
        ("frame_id", 2, Kind::Text),
        ("pose", 3, Kind::Message(&POSE)),
        ("point_stride", 4, Kind::Fixed32),
        ("fields", 5, Kind::Many(&PACKED_ELEMENT_FIELD)),
        ("data", 6, Kind::Bytes),
    ],
);

/// An image, not compressed.
pub static RAW_IMAGE: MessageType = foxglove(
    "RawImage",
    "foxglove/RawImage.proto",
    &[
        ("timestamp", 1, Kind::Message(&TIME)),
        ("frame_id", 7, Kind::Text),
        ("width", 2, Kind::Fixed32),
        ("height", 3, Kind::Fixed32),
        ("encoding", 4, Kind::Text),
        ("step", 5, Kind::Fixed32),
        ("data", 6, Kind::Bytes),
    ],
);

/// What a camera makes of the world.
pub static CAMERA_CALIBRATION: MessageType = foxglove(
    "CameraCalibration",
    "foxglove/CameraCalibration.proto",
    &[
        ("timestamp", 1, Kind::Message(&TIME)),
        ("frame_id", 9, Kind::Text),
        ("width", 2, Kind::Fixed32),
        ("height", 3, Kind::Fixed32),
        ("distortion_model", 4, Kind::Text),
        ("D", 5, Kind::Doubles),
        ("K", 6, Kind::Doubles),
        ("R", 7, Kind::Doubles),
        ("P", 8, Kind::Doubles),
    ],
);

/// One pose.
pub static POSE_IN_FRAME: MessageType = foxglove(
    "PoseInFrame",
    "foxglove/PoseInFrame.proto",
    &[("timestamp", 1, Kind::Message(&TIME)), ("frame_id", 2, Kind::Text), ("pose", 3, Kind::Message(&POSE))],
);

/// A line for people.
pub static LOG: MessageType = foxglove(
    "Log",
    "foxglove/Log.proto",
    &[
        ("timestamp", 1, Kind::Message(&TIME)),
        ("level", 2, Kind::OneOf("Level", LOG_LEVELS)),
        ("message", 3, Kind::Text),
        ("name", 4, Kind::Text),
        ("file", 5, Kind::Text),
        ("line", 6, Kind::Fixed32),
    ],
);
