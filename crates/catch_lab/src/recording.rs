//! Recordings: one file that holds observations, commands and reports of a throw, and the ground truth where a simulation knows it.
//!
//! A gzip file of MessagePack maps with named fields, one after the other: a [`Header`], one [`RecordedTick`] per tick, and an
//! [`Ending`]. In a recording of a real cell ([`CellRecorder`](crate::recording::cell_recorder::CellRecorder)) the parts that only a simulation knows are
//! `None`. Other tools read it so: `zcat FILE | msgpack2json -c`. It holds no wall time and no path: the same scene gives
//! the same bytes.

pub mod cell_recorder;
mod consistency;
pub mod gripper_latency;
mod reader;
pub mod recorded_surface;
pub mod recorded_throw;
pub mod replay;
pub mod throw_times;
pub mod timeline;

use std::{
    hash::{DefaultHasher, Hash, Hasher},
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
use catch_sim::Truth;
use flate2::{Compression, GzBuilder, write::GzEncoder};
use nalgebra::Point3;
use serde::{Deserialize, Serialize};

use crate::{
    VERSION,
    recording::{recorded_surface::RecordedSurface, timeline::Entry},
    referee::Verdict,
    scenario::{
        Scenario,
        brain::BrainSettings,
        setup::{Scene, Setup},
        sources::Sources,
    },
    trial::Tick,
    whole_file::{Unfinished, sweep_out},
};

pub use reader::{MOST_UNPACKED_BYTES, Part, RecordingReader};

/// What every recording begins with.
pub const FORMAT: &str = "catchingbot recording";
/// Changes whenever older programs could not read the file.
pub const FORMAT_VERSION: u32 = 5;
/// Ending of the files' names.
pub const EXTENSION: &str = "catch";
/// Bytes of a scenario's name that go into the name of a file.
const LONGEST_NAME: usize = 80;

/// What is known before anything is sensed.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Header {
    /// Always `catchingbot recording`.
    pub format: String,
    /// Version of the format; older programs cannot read a higher one.
    pub format_version: u32,
    /// Version of the program that wrote it.
    pub version: String,
    /// What it is a recording of, for people.
    pub title: String,
    /// What the brain is made from.
    pub cell: RecordedCell,
    /// Which throw of which scenario; `None` for a real cell.
    pub simulation: Option<Simulation>,
}

/// A throw in the arena.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Simulation {
    /// Which throw.
    pub scene: Scene,
    /// The scenario, all choices made.
    pub scenario: Scenario,
}

/// What a brain knows of its cell: enough to build the same brain again.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct RecordedCell {
    /// The brain's settings as it was given them.
    pub brain: BrainSettings,
    /// Texts of robot and gripper.
    pub sources: Sources,
    /// Joint positions in which the arm waits.
    #[serde(deserialize_with = "quantity::angle_rad")]
    pub ready_rad: Vec<f64>,
    /// The cameras as the brain believes them to be.
    pub cameras: Vec<CameraModel>,
    /// What it knows of the object's shape.
    pub reference_scan: ReferenceScan,
}

/// What the headers of all versions have: whether the rest can be read is known before it is.
#[derive(Deserialize)]
struct Preamble {
    format: String,
    format_version: u32,
    version: String,
}

/// One tick of the brain.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct RecordedTick {
    /// What it saw.
    pub observation: Observation,
    /// What it wanted.
    pub command: Command,
    /// State snapshots of the brain.
    pub report: RecordedReport,
    /// Whether images that the brain saw are not in the recording, which has no room for more.
    #[serde(default)]
    pub images_left_out: bool,
}

/// State snapshot of the brain. The plan's motion is in the command of the tick that made it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct RecordedReport {
    /// How far it got.
    pub status: Status,
    /// The newest pose of the object.
    pub pose: Option<ObjectPose>,
    /// The predicted flight.
    pub flight: Option<FlightTrajectory>,
    /// Where, when and how it means to catch.
    pub plan: Option<RecordedPlan>,
    /// Closing of the gripper.
    pub closing: Option<GripperPlan>,
}

/// A plan without its motion.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct RecordedPlan {
    /// When the object is at the grasp centre.
    #[serde(deserialize_with = "quantity::clock_s")]
    pub catch_s: f64,
    /// How the object comes into the gripper.
    pub approach: Approach,
    /// Pose of the gripper then.
    #[serde(deserialize_with = "quantity::pose")]
    pub X_WG: Pose,
    /// Joint positions then, in radians.
    #[serde(deserialize_with = "quantity::joint_rad")]
    pub q: JointVector,
    /// Fraction of the object's velocity at which the gripper moves along.
    pub speed_fraction: f64,
    /// Opening before the catch.
    pub aperture_m: f64,
    /// Width of the object between the fingers.
    pub object_width_m: f64,
}

/// What is known afterwards.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Ending {
    /// The story.
    pub timeline: Vec<Entry>,
    /// What only a simulation knows; `None` for a real cell.
    pub ground_truth: Option<GroundTruth>,
}

/// The true motion and what the referee made of it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct GroundTruth {
    /// What really happened.
    pub truth: Truth,
    /// The outcome.
    pub verdict: Verdict,
    /// The object's true surface in O, for pictures.
    pub surface: RecordedSurface,
    /// The object's true centre of mass in the brain's O.
    #[serde(default = "Point3::origin")]
    pub com_O: Point3<f64>,
    /// Where that would have been at the last planned catch if nothing had touched it.
    #[serde(default)]
    pub undisturbed_m: Option<Point3<f64>>,
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
enum Written<'a> {
    Tick {
        observation: &'a Observation,
        command: &'a Command,
        report: &'a RecordedReport,
        #[serde(skip_serializing_if = "Not::not")]
        images_left_out: bool,
    },
    Ending(&'a Ending),
}

/// Writes a recording tick by tick. The file appears under its name when it is complete, not before.
pub struct Recorder {
    path: PathBuf,
    out: Counted,
    /// Bytes that an unpacked recording may have.
    room: u64,
    /// When the first image was left out.
    images_until_s: Option<f64>,
}

/// What is written, counted before it is packed.
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
const ROOM_WITHOUT_IMAGES: u64 = 64 << 20;

/// Most bytes that an image takes: five for a depth, one for a pixel of the mask, and some for the rest.
fn most_bytes(frame: &DepthFrame) -> u64 {
    6 * frame.depth_m.len() as u64 + 1000
}

impl Recorder {
    /// Begins the recording of a scene in `folder`, which is made if it does not exist.
    ///
    /// # Errors
    /// If the folder or the file cannot be written.
    pub fn create(folder: &Path, setup: &Setup, scene: &Scene) -> io::Result<Self> {
        let cell = RecordedCell {
            brain: setup.brain_config(scene.seed, scene.index),
            sources: setup.sources.clone(),
            ready_rad: setup.robot.ready_q.as_slice()[..setup.robot.dof()].to_vec(),
            cameras: setup.believed_cameras(scene.seed),
            reference_scan: setup.known_object.scan.clone(),
        };
        let title = format!("{}, {} throw", scene.object, scene.throw).replace('_', " ");
        let simulation = Simulation { scene: scene.clone(), scenario: setup.scenario.clone() };
        Self::begin(folder, &file_stem(scene), title, cell, Some(simulation))
    }

    /// Begins a recording called `name`, a file name without ending.
    pub(crate) fn begin(
        folder: &Path,
        name: &str,
        title: String,
        cell: RecordedCell,
        simulation: Option<Simulation>,
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
        let images_left_out = images > 0 && self.out.bytes + images + ROOM_WITHOUT_IMAGES > self.room;
        let Observation { time_s, arm, gripper, .. } = observation;
        let without;
        let observation = if images_left_out {
            self.images_until_s.get_or_insert(*time_s);
            without = Observation { time_s: *time_s, arm: arm.clone(), gripper: *gripper, frames: Vec::new() };
            &without
        } else {
            observation
        };
        self.write(&Written::Tick { observation, command, report: &report, images_left_out })
    }

    /// When the first image was left out for want of room; `None` where all are recorded.
    pub fn images_until_s(&self) -> Option<f64> {
        self.images_until_s
    }

    /// Adds the ending and gives the file its name, which is returned.
    ///
    /// # Errors
    /// If it cannot be written.
    pub fn finish(mut self, ending: &Ending) -> io::Result<PathBuf> {
        self.write(&Written::Ending(ending))?;
        let packed = self.out.packed.into_inner().map_err(io::IntoInnerError::into_error)?.finish()?;
        packed.into_inner().map_err(io::IntoInnerError::into_error)?.replace(&self.path)?;
        Ok(self.path)
    }

    fn write(&mut self, value: &impl Serialize) -> io::Result<()> {
        rmp_serde::encode::write_named(&mut self.out, value).map_err(|fault| match fault {
            rmp_serde::encode::Error::InvalidValueWrite(write) => write.into(),
            other => io::Error::other(other),
        })?;
        if self.out.bytes > self.room {
            let most = self.room >> 20;
            return Err(io::Error::new(
                io::ErrorKind::FileTooLarge,
                format!("more than the {most} MiB of a recording"),
            ));
        }
        Ok(())
    }
}

/// Name of a scene's files, without ending.
pub fn file_stem(scene: &Scene) -> String {
    let Scene { scenario, object, throw, seed, index } = scene;
    let name = scenario.replace(['/', '\\'], "_");
    // File systems take 255 bytes; a scenario with many changed fields has a longer name.
    let cut = name.floor_char_boundary(LONGEST_NAME);
    let name = if cut < name.len() {
        let mut hasher = DefaultHasher::new();
        name.hash(&mut hasher);
        format!("{}~{:016x}", &name[..cut], hasher.finish())
    } else {
        name
    };
    format!("{name}-{object}-{throw}-{seed}-{index}")
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs::File;

    /// The first format had neither trajectories with identifiers nor headers like these.
    #[test]
    fn an_old_recording_is_refused_by_its_version() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("old.catch");
        let mut out = GzBuilder::new().write(File::create(&path).unwrap(), Compression::fast());
        let header = serde_json::json!({
            "format": FORMAT, "format_version": 3, "version": "0.0.9", "scenario": "something else"
        });
        rmp_serde::encode::write_named(&mut out, &header).unwrap();
        out.finish().unwrap();
        let fault = RecordingReader::open(&path).err().unwrap().to_string();
        assert!(
            fault.contains("format_version: found 3, written by version 0.0.9")
                && fault.contains(&FORMAT_VERSION.to_string()),
            "{fault}"
        );
    }

    #[test]
    fn names_of_files_are_short_and_differ() {
        let stem = |scenario: &str| {
            let scenario = scenario.to_owned();
            file_stem(&Scene { scenario, object: "ball".to_owned(), throw: "far".to_owned(), seed: 1, index: 2 })
        };
        assert_eq!(stem("paper"), "paper-ball-far-1-2");
        assert_eq!(stem("paper+object=a/b"), "paper+object=a_b-ball-far-1-2");
        let changed = |value: u32| format!("paper{}{value}", "+arena.restitution_scale=½".repeat(20));
        assert!(stem(&changed(1)).len() < 200);
        assert_ne!(stem(&changed(1)), stem(&changed(2)));
    }
}
