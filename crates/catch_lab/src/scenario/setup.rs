//! Setup of a trial, read and checked: the scenario and every file that it names.

mod assumptions;
pub mod calibration;
mod knowledge;
mod parts;
mod throw_check;

use std::sync::{Arc, OnceLock};

use catch_body::{Gripper, InputError, JointVector, Robot, workcell::Obstacle};
use catch_bot::{Preparation, grasp_selection::GraspSet};
use catch_cell::{CameraModel, KnownObject};
use catch_sim::{
    Arena, Conditions, Equipment, GripperDriveKind, Release, Throw, ThrownObject,
    config::{RobotController, RobotErrors},
    depth_noise::DepthConfig,
};
use serde::{Deserialize, Serialize};

use calibration::{BySeed, CalibratedCameras};
pub use knowledge::Knowledge;
pub(crate) use parts::arm_with_hand;
use parts::{Parts, Place};

use crate::{
    assets::{Asset, Kind, Origin},
    scenario::{Clock, Scenario},
};
use catch_recording::{brain::Method, sources::Sources, whole_file::COMMAND_LINE};

/// Choice of a scenario, and changes to its file.
#[derive(Debug, Clone, Copy, Default)]
pub struct Choice<'a> {
    /// Name or file; `None` is [`DEFAULT_SCENARIO`].
    pub scenario: Option<&'a str>,
    /// Name or file.
    pub robot: Option<&'a str>,
    /// Name or file.
    pub gripper: Option<&'a str>,
    /// Name or file.
    pub workcell: Option<&'a str>,
    /// Name or file.
    pub object: Option<&'a str>,
    /// Name or file.
    pub throw: Option<&'a str>,
    /// Method that catches.
    pub method: Option<Method>,
    /// Single fields of the scenario, as [`Scenario::with_settings`] takes them.
    pub settings: &'a [String],
}

/// The scenario that is meant when none is named: one that assumes nothing away.
pub const DEFAULT_SCENARIO: &str = "honest";

/// One throw among all: with the scenario, all that its outcome depends on.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Scene {
    /// Name of the scenario.
    pub scenario: String,
    /// Name of the object.
    pub object: String,
    /// Name of the throw.
    pub throw: String,
    /// Seed of everything random.
    pub seed: u64,
    /// Number of the throw.
    pub index: u64,
}

impl Scene {
    /// What the throw is called among others of the scenario.
    pub fn label(&self) -> String {
        format!("{}, {}, throw {}", self.object, self.throw, self.index).replace('_', " ")
    }
}

/// Everything that trials of one object and one throw share.
#[derive(Debug, Clone)]
pub struct Setup {
    /// The scenario, all choices made.
    pub scenario: Scenario,
    /// The arm; it waits at its `ready_q`.
    pub robot: Robot,
    /// The gripper.
    pub gripper: Gripper,
    /// The cameras as they are.
    pub cameras: Vec<CameraModel>,
    /// What stands around and the brain is not told of.
    pub room: Vec<Obstacle>,
    /// Object that is thrown.
    pub object: ThrownObject,
    /// Throw of the object.
    pub throw: Throw,
    /// Model of the object that the brain is given.
    pub known_object: KnownObject,
    /// Texts of the files that the brain depends on.
    pub sources: Sources,
    /// Made when it is first needed.
    equipment: OnceLock<Equipment>,
    /// Made when it is first needed.
    known: OnceLock<Arc<Preparation>>,
    /// Preparation with calibrated cameras, for each seed. Made when it is first needed.
    known_calibrated: BySeed<Preparation>,
    calibrations: BySeed<CalibratedCameras>,
}

impl Setup {
    /// Reads all that is asked for.
    ///
    /// # Errors
    /// The first fault found: which argument or which field of which file, what stands there and what would
    /// be right.
    pub fn load(choice: &Choice) -> Result<Self, InputError> {
        let name = choice.scenario.unwrap_or(DEFAULT_SCENARIO);
        let asset = Asset::asked(Kind::Scenario, name, (COMMAND_LINE, "--scenario"))?;
        Self::of_asset(&asset, choice)
    }

    /// Reads all that the scenario in `asset` and `choice` name.
    ///
    /// # Errors
    /// As [`load`](Self::load).
    pub fn of_asset(asset: &Asset, choice: &Choice) -> Result<Self, InputError> {
        // Results call it by its file, as they do with objects and throws, and by what is different from it.
        let scenario = Scenario { name: asset.name.clone(), ..Scenario::of_asset(asset)? };
        Self::of_scenario(scenario, &asset.file, &asset.origin, choice)
    }

    /// Reads all that a scenario and `choice` name; `file` names the scenario in errors, and what it names is
    /// looked for from `origin` on.
    ///
    /// # Errors
    /// As [`load`](Self::load).
    pub fn of_scenario(
        mut scenario: Scenario,
        file: &str,
        origin: &Origin,
        choice: &Choice,
    ) -> Result<Self, InputError> {
        if choice.robot.is_some_and(|robot| robot != scenario.robot) {
            // The scenario's pose is one of its own arm.
            (scenario.ready_rad, scenario.place_rad) = (None, None);
        }
        let of_file = scenario.clone();
        let mut scenario = scenario.with_settings(choice.settings)?;
        let parts = Parts::find(&scenario, &of_file, Place { file, origin }, choice)?;
        let (sources, robot, gripper) = parts.arm(&scenario, &of_file, file)?;
        let object = parts.truth(&scenario.arena)?;
        let room = parts.room(&robot, &gripper)?;
        let cameras = parts.cameras(&with_room(&robot, &room))?;
        scenario.arena.check_cameras(&cameras, file, "arena")?;
        let known_object = parts.known_object(&object, &scenario.arena.depth)?;
        let throw = parts.throw(robot.length_m())?;
        parts.name(&mut scenario, choice);
        scenario.ready_rad = Some(robot.ready_q.as_slice()[..robot.dof()].to_vec());
        let setup = Self {
            scenario,
            robot,
            gripper,
            cameras,
            room,
            object,
            throw,
            known_object,
            sources,
            equipment: OnceLock::new(),
            known: OnceLock::new(),
            known_calibrated: BySeed::default(),
            calibrations: BySeed::default(),
        };
        if let Some(settings) = &setup.scenario.calibration {
            calibration::check_memory(
                &setup,
                &calibration::config_of(&setup, settings, 0),
                (file, "calibration.poses"),
            )?;
        }
        Ok(setup)
    }

    /// Returns the reason why the brain has no grasp of the object, if so.
    pub fn without_grasps(&self) -> Option<String> {
        Some(&self.known().grasps).filter(|it| it.grasps.is_empty()).map(|it| self.why_without_grasps(it))
    }

    /// Widths of object and gripper, and what is wrong with the candidates.
    pub fn why_without_grasps(&self, grasps: &GraspSet) -> String {
        let margin_m = self.scenario.brain.grasp_selection.approach_margin_m;
        let lengths_m = [self.object.mesh.aabb().size.min(), self.gripper.max_width_m, margin_m];
        let [narrowest_mm, opening_mm, margin_mm] = lengths_m.map(|it| it * 1e3);
        format!(
            "an object {narrowest_mm:.0} mm wide at its narrowest; the gripper opens {opening_mm:.0} mm and needs \
             {margin_mm:.0} mm on each side; {}",
            grasps.failures()
        )
    }

    /// Joint positions in which the gripper opens to put down what was caught.
    ///
    /// # Errors
    /// If the scenario names none, or none of this arm.
    pub fn place_q(&self) -> Result<JointVector, InputError> {
        let (file, field) = (&self.scenario.name, "place_rad");
        let expected = "joint positions in which the gripper opens to put down what was caught: --set place_rad=[…]";
        let values = self.scenario.place_rad.as_ref();
        let values = values.ok_or_else(|| InputError::new(file, field, "nothing", expected))?;
        self.robot.checked_pose(file, field, values)
    }

    /// The scene of throw number `index`.
    pub fn scene(&self, seed: u64, index: u64) -> Scene {
        let Scenario { name, object, throw, .. } = &self.scenario;
        Scene { scenario: name.clone(), object: object.clone(), throw: throw.clone(), seed, index }
    }

    /// Returns this setup with another throw, by name or file; the preparation is shared.
    ///
    /// # Errors
    /// As [`load`](Self::load).
    pub fn thrown(&self, throw: &str) -> Result<Self, InputError> {
        let asset = Asset::asked(Kind::Throw, throw, (COMMAND_LINE, "--throw"))?;
        let throw = asset.throw()?.for_arm(self.robot.length_m());
        Ok(self.with_throw(asset.name, throw))
    }

    /// Returns this setup with the given throw; the preparation is shared.
    pub fn with_throw(&self, name: String, throw: Throw) -> Self {
        self.prepare();
        let mut other = self.clone();
        other.throw = throw;
        other.scenario.throw = name;
        other
    }

    /// Works out what all trials share, so that none of them has to wait for it.
    pub fn prepare(&self) {
        self.equipment();
        self.known();
    }

    /// Everything in the arena but the throw.
    pub fn equipment(&self) -> &Equipment {
        self.equipment.get_or_init(|| {
            let Self { scenario, gripper, object, cameras, .. } = self.clone();
            let robot = with_room(&self.robot, &self.room);
            Equipment::new(scenario.arena, robot, gripper, object, cameras)
        })
    }

    /// The arena with everything in place, the object about to fly.
    pub fn arena(&self, seed: u64, index: u64) -> Arena {
        let waiting = (&self.robot.ready_q, self.waiting_width_m());
        let mut arena = Arena::new(self.equipment(), &self.release(seed, index), waiting, seed, index);
        // Nobody throws before the brain has seen what it wants to see.
        arena.show_before(self.scenario.brain.perception.background_images);
        arena
    }

    /// Distance between the fingers of the waiting hand, in metres: as wide as the grasps of the object need,
    /// or wide open where the method of planning says nothing.
    pub fn waiting_width_m(&self) -> f64 {
        let planner = self.scenario.brain.catch_planner(self.known(), 0);
        planner.waiting_width_m().unwrap_or(self.gripper.max_width_m)
    }

    /// Draws the conditions that differ from throw to throw besides the throw itself.
    pub fn conditions(&self, seed: u64, index: u64) -> Conditions {
        Conditions::draw(&self.scenario.arena, &self.object, seed, index)
    }

    /// Returns whether all throws are the same in everything that is drawn.
    pub fn repeats_itself(&self) -> bool {
        let Scenario { arena, clock, .. } = &self.scenario;
        let scene = |index| (self.release(0, index), self.conditions(0, index));
        let [earliest_s, latest_s] = arena.latency_s.bounds();
        let has_own_stream = arena.depth != DepthConfig::default()
            || arena.free_running_cameras
            || arena.person.is_some()
            || earliest_s < latest_s
            || arena.gripper != GripperDriveKind::default()
            || arena.robot_errors != RobotErrors::default()
            || arena.robot_controller != RobotController::default()
            || *clock == Clock::Charged;
        !has_own_stream && scene(0) == scene(1)
    }

    /// Draws the release of the object from the thrower's hand.
    pub fn release(&self, seed: u64, index: u64) -> Release {
        self.throw.release(&self.object.name, &self.conditions(seed, index), seed, index)
    }
}

/// The arm with what stands in the room besides the obstacles that it knows.
fn with_room(robot: &Robot, room: &[Obstacle]) -> Robot {
    Robot { obstacles: [&robot.obstacles, room].concat(), ..robot.clone() }
}

/// Reason why a setup's settings are valid.
pub(super) const CHECKED: &str = "settings are checked when a scenario is read";
