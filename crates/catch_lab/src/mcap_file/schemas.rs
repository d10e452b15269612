//! Foxglove's messages as JSON schemas (Foxglove documentation, "Message schemas").

use serde_json::{Map, Value, json};

/// `FLOAT32` in Foxglove's list of numeric types.
pub const FLOAT32: u8 = 7;

const NUMERIC_TYPES: [&str; 9] =
    ["UNKNOWN", "UINT8", "INT8", "UINT16", "INT16", "UINT32", "INT32", "FLOAT32", "FLOAT64"];
const LOG_LEVELS: [&str; 6] = ["UNKNOWN", "DEBUG", "INFO", "WARNING", "ERROR", "FATAL"];

/// The messages that are written.
#[derive(Debug, Clone, Copy)]
pub enum Message {
    /// Poses of frames in others.
    FrameTransforms,
    /// Joint positions, velocities and torques.
    JointStates,
    /// Points with fields.
    PointCloud,
    /// An image, not compressed.
    RawImage,
    /// One pose.
    PoseInFrame,
    /// A line for people.
    Log,
}

impl Message {
    /// The schema's name, by which the tools know it.
    pub fn name(self) -> &'static str {
        match self {
            Self::FrameTransforms => "foxglove.FrameTransforms",
            Self::JointStates => "foxglove.JointStates",
            Self::PointCloud => "foxglove.PointCloud",
            Self::RawImage => "foxglove.RawImage",
            Self::PoseInFrame => "foxglove.PoseInFrame",
            Self::Log => "foxglove.Log",
        }
    }

    /// The schema.
    pub fn schema(self) -> Value {
        let fields = match self {
            Self::FrameTransforms => vec![("transforms", list(frame_transform()))],
            Self::JointStates => vec![("timestamp", time()), ("joints", list(joint_state()))],
            Self::PointCloud => vec![
                ("timestamp", time()),
                ("frame_id", string()),
                ("pose", pose()),
                ("point_stride", count()),
                ("fields", list(packed_element_field())),
                ("data", bytes()),
            ],
            Self::RawImage => vec![
                ("timestamp", time()),
                ("frame_id", string()),
                ("width", count()),
                ("height", count()),
                ("encoding", string()),
                ("step", count()),
                ("data", bytes()),
            ],
            Self::PoseInFrame => vec![("timestamp", time()), ("frame_id", string()), ("pose", pose())],
            Self::Log => vec![
                ("timestamp", time()),
                ("level", one_of("foxglove.LogLevel", &LOG_LEVELS)),
                ("message", string()),
                ("name", string()),
                ("file", string()),
                ("line", count()),
            ],
        };
        object(self.name(), fields)
    }
}

fn object(title: &str, fields: Vec<(&str, Value)>) -> Value {
    let properties: Map<String, Value> = fields.into_iter().map(|(name, schema)| (name.to_owned(), schema)).collect();
    json!({ "title": title, "type": "object", "properties": properties })
}

fn list(items: Value) -> Value {
    json!({ "type": "array", "items": items })
}

fn string() -> Value {
    json!({ "type": "string" })
}

fn number() -> Value {
    json!({ "type": "number" })
}

fn count() -> Value {
    json!({ "type": "integer", "minimum": 0 })
}

fn bytes() -> Value {
    json!({ "type": "string", "contentEncoding": "base64" })
}

fn one_of(title: &str, names: &[&str]) -> Value {
    let options: Vec<Value> =
        names.iter().enumerate().map(|(value, name)| json!({ "title": name, "const": value })).collect();
    json!({ "title": title, "oneOf": options })
}

fn time() -> Value {
    let nanoseconds = json!({ "type": "integer", "minimum": 0, "maximum": 999_999_999 });
    object("time", vec![("sec", count()), ("nsec", nanoseconds)])
}

fn numbers(title: &str, names: &[&'static str]) -> Value {
    object(title, names.iter().map(|name| (*name, number())).collect())
}

fn vector() -> Value {
    numbers("foxglove.Vector3", &["x", "y", "z"])
}

fn quaternion() -> Value {
    numbers("foxglove.Quaternion", &["x", "y", "z", "w"])
}

fn pose() -> Value {
    object("foxglove.Pose", vec![("position", vector()), ("orientation", quaternion())])
}

fn frame_transform() -> Value {
    let fields = vec![
        ("timestamp", time()),
        ("parent_frame_id", string()),
        ("child_frame_id", string()),
        ("translation", vector()),
        ("rotation", quaternion()),
    ];
    object("foxglove.FrameTransform", fields)
}

fn joint_state() -> Value {
    let fields = vec![
        ("name", string()),
        ("position", number()),
        ("velocity", number()),
        ("acceleration", number()),
        ("effort", number()),
    ];
    object("foxglove.JointState", fields)
}

fn packed_element_field() -> Value {
    let fields =
        vec![("name", string()), ("offset", count()), ("type", one_of("foxglove.NumericType", &NUMERIC_TYPES))];
    object("foxglove.PackedElementField", fields)
}
