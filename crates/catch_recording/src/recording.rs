//! The format of recordings, and what writes them.

use std::{
    io::{self, BufWriter, Write},
    ops::Not,
    path::{Path, PathBuf},
};

use catch_body::{JointVector, Pose, quantity};
use catch_bot::{
    Report, Status, control::GripperPlan, grasp_selection::Approach, perception::ObjectPose,
    trajectory_prediction::FlightTrajectory,
};
use catch_cell::{CameraModel, Command, DepthFrame, Observation, ReferenceScan};
use flate2::{Compression, GzBuilder, write::GzEncoder};
use serde::{Deserialize, Serialize};

use crate::{
    brain::BrainSettings,
    sources::Sources,
    tick::Tick,
    timeline::Entry,
    whole_file::{Unfinished, sweep_out},
};

/// Format name at the beginning of every recording.
pub const FORMAT: &str = "catchingbot recording";
/// Changes whenever older programs could not read the file.
pub const FORMAT_VERSION: u32 = 5;
/// Version of this program, as every recording carries it.
const VERSION: &str = env!("CARGO_PKG_VERSION");
/// Bytes of an unpacked recording at most.
pub const MOST_UNPACKED_BYTES: u64 = 1 << 30;
/// Bytes of an unpacked header, tick or ending at most.
pub const MOST_PART_BYTES: u64 = 64 << 20;
/// Ending of the files' names.
pub const EXTENSION: &str = "catch";

/// Header of a recording: all that is given before anything is sensed.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Header<Simulation> {
    /// Always `catchingbot recording`.
    pub format: String,
    /// Version of the format; older programs cannot read a higher one.
    pub format_version: u32,
    /// Version of the program that wrote it.
    pub version: String,
    /// Title of the recording, for people.
    pub title: String,
    /// Cell that the brain is made from.
    pub cell: RecordedCell,
    /// Scene of the simulated throw; `None` for a real cell.
    pub simulation: Option<Simulation>,
}

/// Cell as a brain has it: enough to build the same brain again.
#[quantity::checked]
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct RecordedCell {
    /// Seed of everything that the brain draws at random.
    pub seed: u64,
    /// The brain's settings as it was given them.
    pub brain: BrainSettings,
    /// Texts of robot and gripper.
    pub sources: Sources,
    /// Joint positions in which the arm waits.
    pub ready_rad: quantity::angle_rad<Vec<f64>>,
    /// The cameras as the brain believes them to be.
    pub cameras: Vec<CameraModel>,
    /// Reference scan of the object's shape.
    pub reference_scan: ReferenceScan,
}

/// One tick of the brain.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct RecordedTick {
    /// Observation that the brain was given.
    pub observation: Observation,
    /// Command that the brain returned.
    pub command: Command,
    /// State snapshots of the brain.
    pub report: RecordedReport,
    /// True if images that the brain was given are left out of the recording, which has no room for more.
    #[serde(default)]
    pub images_left_out: bool,
}

/// State snapshot of the brain. The plan's motion is in the command of the tick that made it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct RecordedReport {
    /// Progress of the throw.
    pub status: Status,
    /// The newest pose of the object.
    pub pose: Option<ObjectPose>,
    /// The predicted flight.
    pub flight: Option<FlightTrajectory>,
    /// Planned catch, if any.
    pub plan: Option<RecordedPlan>,
    /// Closing of the gripper.
    pub closing: Option<GripperPlan>,
}

/// A plan without its motion.
#[quantity::checked]
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct RecordedPlan {
    /// Time at which the object is at the grasp centre.
    pub catch_s: quantity::clock_s,
    /// Direction from which the object enters the gripper.
    pub approach: Approach,
    /// Pose of the gripper then.
    pub X_WG: quantity::pose<Pose>,
    /// Joint positions then, in radians.
    pub q: quantity::joint_rad<JointVector>,
    /// Fraction of the object's velocity at which the gripper moves along.
    pub speed_fraction: f64,
    /// Opening before the catch.
    pub aperture_m: f64,
    /// Width of the object between the fingers.
    pub object_width_m: f64,
}

/// Ending of a recording: all that is given after the throw.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Ending<GroundTruth> {
    /// The story.
    pub timeline: Vec<Entry>,
    /// Ground truth of a simulation; `None` for a real cell.
    pub ground_truth: Option<GroundTruth>,
}

impl From<&Report> for RecordedReport {
    fn from(report: &Report) -> Self {
        let plan = report.plan.as_ref().map(|plan| RecordedPlan {
            catch_s: plan.catch_s,
            approach: plan.approach,
            X_WG: plan.X_WG,
            q: plan.q,
            speed_fraction: plan.speed_fraction,
            aperture_m: plan.aperture_m,
            object_width_m: plan.grasp.object_width_m,
        });
        Self { status: report.status, pose: report.pose, flight: report.flight.clone(), plan, closing: report.closing }
    }
}

#[derive(Serialize)]
#[serde(rename_all = "snake_case")]
enum Written<'a, T> {
    Tick {
        observation: &'a Observation,
        command: &'a Command,
        report: &'a RecordedReport,
        #[serde(skip_serializing_if = "Not::not")]
        images_left_out: bool,
    },
    Ending(&'a Ending<T>),
}

/// Writes a recording tick by tick. The file appears under its name when it is complete, not before.
pub struct Recorder {
    path: PathBuf,
    out: Counted,
    /// Bytes that an unpacked recording may have.
    room: u64,
    /// Time of the first image that was left out.
    pub images_until_s: Option<f64>,
}

/// Writer that counts bytes before they are packed.
struct Counted {
    /// Numbers come one by one, and the encoder clears a buffer at each call: they are gathered first.
    packed: BufWriter<GzEncoder<BufWriter<Unfinished>>>,
    bytes: u64,
}

impl Write for Counted {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let written = self.packed.write(bytes)?;
        self.bytes += written as u64;
        Ok(written)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.packed.flush()
    }
}

/// Bytes of an unpacked recording that are no image's: enough for the states and the story of any throw.
pub const ROOM_WITHOUT_IMAGES: u64 = 256 << 20;

/// Bytes of a tick without its images at most.
const MOST_STATE_BYTES: u64 = 1 << 20;

/// Most bytes that an image takes: five for a depth, one for a pixel of the mask, and some for the rest.
pub(crate) fn most_bytes(frame: &DepthFrame) -> u64 {
    6 * frame.depth_m.len() as u64 + 1000
}

impl Recorder {
    /// Begins a recording called `name`, a file name without ending.
    ///
    /// # Errors
    /// If the folder or the file cannot be written.
    pub fn begin<S: Serialize>(
        folder: &Path,
        name: &str,
        title: String,
        cell: RecordedCell,
        simulation: Option<S>,
    ) -> io::Result<Self> {
        let path = folder.join(format!("{name}.{EXTENSION}"));
        let unfinished = Unfinished::beside(&path)?;
        sweep_out(folder)?;
        let out = GzBuilder::new().write(BufWriter::new(unfinished), Compression::fast());
        let out = Counted { packed: BufWriter::with_capacity(1 << 16, out), bytes: 0 };
        let mut recorder = Self { path, out, room: MOST_UNPACKED_BYTES, images_until_s: None };
        recorder.write(&Header {
            format: FORMAT.to_owned(),
            format_version: FORMAT_VERSION,
            version: VERSION.to_owned(),
            title,
            cell,
            simulation,
        })?;
        Ok(recorder)
    }

    /// Adds a tick, without its images where a reader would find the recording too large with them.
    ///
    /// # Errors
    /// If it cannot be written, or no reader would take it even without images.
    pub fn ticked(&mut self, tick: &Tick) -> io::Result<()> {
        let Tick { observation, command, report } = *tick;
        // A brain that tells nothing is recorded as one that has seen nothing.
        let report = report.map_or_else(|| (&Report::default()).into(), RecordedReport::from);
        let images: u64 = observation.frames.iter().map(most_bytes).sum();
        let is_room =
            self.out.bytes + images + ROOM_WITHOUT_IMAGES <= self.room && images + MOST_STATE_BYTES <= MOST_PART_BYTES;
        let images_left_out = images > 0 && !is_room;
        let Observation { time_s, arm, gripper, .. } = observation;
        let without;
        let observation = if images_left_out {
            self.images_until_s.get_or_insert(*time_s);
            without = Observation { time_s: *time_s, arm: arm.clone(), gripper: *gripper, frames: Vec::new() };
            &without
        } else {
            observation
        };
        let report = &report;
        let tick: Written<()> = Written::Tick { observation, command, report, images_left_out };
        self.write(&tick)
    }

    /// Leaves room for so many more bytes, unpacked, than are written; how many there may be in all.
    pub fn leave_room(&mut self, bytes: u64) -> u64 {
        self.room = self.out.bytes + bytes;
        self.room
    }

    /// Adds the ending and gives the file its name, which is returned.
    ///
    /// # Errors
    /// If it cannot be written.
    pub fn finish<T: Serialize>(mut self, ending: &Ending<T>) -> io::Result<PathBuf> {
        self.write(&Written::Ending(ending))?;
        let packed = self.out.packed.into_inner().map_err(io::IntoInnerError::into_error)?.finish()?;
        packed.into_inner().map_err(io::IntoInnerError::into_error)?.replace(&self.path)?;
        Ok(self.path)
    }

    fn write(&mut self, value: &impl Serialize) -> io::Result<()> {
        let before = self.out.bytes;
        rmp_serde::encode::write_named(&mut self.out, value).map_err(|fault| match fault {
            rmp_serde::encode::Error::InvalidValueWrite(write) => write.into(),
            other => io::Error::other(other),
        })?;
        if self.out.bytes > self.room || self.out.bytes - before > MOST_PART_BYTES {
            let [most, of_part] = [self.room, MOST_PART_BYTES].map(|it| it >> 20);
            let found = format!("more than the {most} MiB of a recording, or {of_part} MiB of a part of it");
            return Err(io::Error::new(io::ErrorKind::FileTooLarge, found));
        }
        Ok(())
    }
}
