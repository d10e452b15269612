//! Recordings of throws in the arena: what [`catch_recording`] keeps of any cell, and the truth.

pub mod gripper_latency;
pub mod recorded_surface;
pub mod recorded_throw;
pub mod replay;
pub(crate) mod story;
pub mod throw_times;

use std::{
    hash::{DefaultHasher, Hash, Hasher},
    io,
    path::{Path, PathBuf},
};

use catch_body::{InputError, quantity};
use catch_recording::{Channel, EXTENSION, RecordedCell, Recorder, RecordingReader};
use catch_sim::Truth;
use nalgebra::Point3;
use serde::{Deserialize, Serialize};

use crate::{
    recording::recorded_surface::RecordedSurface,
    referee::Verdict,
    scenario::{
        Scenario,
        setup::{Scene, Setup},
    },
};

/// Bytes of a scenario's name that go into the name of a file.
const LONGEST_NAME: usize = 80;

/// Reads recordings with all that only a simulation knows.
pub type LabReader = RecordingReader<Simulation, GroundTruth>;

/// A throw in the arena.
#[quantity::checked]
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Simulation {
    /// Scene of the throw.
    pub scene: Scene,
    /// The scenario, all choices made.
    pub scenario: Scenario,
    /// Time of the release on the clock of many throws; `None` for a throw of its own. Such a recording
    /// cannot be replayed: the brain remembers earlier throws.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub thrown_s: quantity::clock_s<Option<f64>>,
}

impl Channel for Simulation {}

/// The true motion and what the referee made of it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct GroundTruth {
    /// True states of the throw.
    pub truth: Truth,
    /// The outcome.
    pub verdict: Verdict,
    /// The object's true surface in O, for pictures.
    pub surface: RecordedSurface,
    /// The object's true centre of mass in the brain's O.
    #[serde(default = "Point3::origin")]
    pub com_O: Point3<f64>,
    /// Position of that point at the last planned catch if nothing had touched the object.
    pub undisturbed_m: Option<Point3<f64>>,
}

impl Channel for GroundTruth {
    /// Checks that the true states follow each other in time, and the surface.
    fn check(&self, file: &str) -> Result<(), InputError> {
        for (i, pair) in self.truth.samples.windows(2).enumerate() {
            let [last_s, time_s] = [0, 1].map(|at| pair[at].time_s);
            if !(0.0..=1.0).contains(&(time_s - last_s)) {
                let field = format!("ending.ground_truth.truth.samples[{}].time_s", i + 1);
                let expected = format!("a time within a second after {last_s} s");
                return Err(InputError::new(file, field, time_s, expected));
            }
        }
        self.surface.check(file, "ending.ground_truth.surface")
    }
}

/// Returns the cell that the brain of throw number `index` of `seed` is made from.
pub fn cell(setup: &Setup, seed: u64, index: u64) -> RecordedCell {
    RecordedCell {
        seed: setup.brain_seed(seed, index),
        brain: setup.brain_config(seed),
        sources: setup.sources.clone(),
        ready_rad: setup.robot.ready_q.as_slice()[..setup.robot.dof()].to_vec(),
        cameras: setup.believed_cameras(seed),
        reference_scan: setup.known_object.scan.clone(),
    }
}

/// Begins the recording of a scene in `folder`, which is made if it does not exist; `thrown_s` is the time of
/// the release among many throws.
///
/// # Errors
/// If the folder or the file cannot be written.
pub fn begin(folder: &Path, setup: &Setup, scene: &Scene, thrown_s: Option<f64>) -> io::Result<Recorder> {
    let cell = cell(setup, scene.seed, scene.index);
    let title = format!("{}, {} throw", scene.object, scene.throw).replace('_', " ");
    let simulation = Simulation { scene: scene.clone(), scenario: setup.scenario.clone(), thrown_s };
    Recorder::begin(folder, &file_stem(scene), title, cell, Some(simulation))
}

/// Recording of a scene in `folder`.
pub fn file(folder: &Path, scene: &Scene) -> PathBuf {
    folder.join(format!("{}.{EXTENSION}", file_stem(scene)))
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
