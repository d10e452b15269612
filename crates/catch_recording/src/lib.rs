//! Recordings: one file that holds observations, commands and reports of a run, and the ground truth where a
//! simulation knows it.
//!
//! A gzip file of MessagePack maps with named fields, one after the other: a [`Header`], one [`RecordedTick`]
//! per tick, and an [`Ending`]. In a recording of a real cell ([`CellRecorder`](cell_recorder::CellRecorder))
//! the parts that only a simulation knows are `None`. Other tools read it so: `zcat FILE | msgpack2json -c`.
//! It holds no wall time and no path: the same scene gives the same bytes.
//!
//! No simulator stands below this crate: who drives a real arm records and [replays](replay) without a
//! physics engine. What only a simulation knows is a [`Channel`], which the lab brings along. What else a
//! recorded brain needs is here, too: its settings and stages ([`brain`]), the texts of its arm
//! ([`sources`]), its reach map ([`reach_map`]), and files read with limits ([`bounded_file`]) and written as
//! a whole ([`whole_file`]).

pub mod bounded_file;
pub mod brain;
pub mod cell_recorder;
mod consistency;
pub mod drive_job;
pub mod reach_map;
mod reader;
mod recording;
pub mod replay;
pub mod sources;
mod tick;
pub mod timeline;
pub mod whole_file;

pub use reader::{Channel, Part, RecordingReader};
pub use recording::{
    EXTENSION, Ending, FORMAT, FORMAT_VERSION, Header, MOST_UNPACKED_BYTES, ROOM_WITHOUT_IMAGES, RecordedCell,
    RecordedPlan, RecordedReport, RecordedTick, Recorder,
};
pub use tick::Tick;

/// A serialized name, such as that of a status.
pub fn name_of(value: impl serde::Serialize) -> String {
    serde_json::to_value(value).ok().and_then(|it| it.as_str().map(str::to_owned)).unwrap_or_default()
}
