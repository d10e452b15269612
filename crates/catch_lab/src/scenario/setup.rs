//! What a trial needs, read and checked: the scenario and every file that it names.

pub mod calibration;

use std::{
    path::PathBuf,
    sync::{Arc, OnceLock},
};

use catch_body::{Gripper, InputError, JointVector, Robot};
use catch_bot::{Preparation, grasp_selection::GraspSet, perception::DepthNoise};
use catch_cell::{CameraModel, ReferenceScan, reference_scan, rig_from_toml};
use catch_sim::{
    Arena, Conditions, Equipment, GripperDriveKind, Release, Throw, ThrownObject,
    config::{RobotController, RobotErrors},
    depth_noise::{DataSheet, DepthConfig},
    random_streams::{Stream, seed_for},
};
use serde::{Deserialize, Serialize};

use calibration::{BySeed, CalibratedCameras};

use crate::{
    assets::{Asset, COMMAND_LINE, Kind, Origin},
    scenario::{
        Clock, Scenario,
        brain::{BrainSettings, Method},
        flight_rig, reach_map,
        sources::{self, SourceNames, Sources},
    },
};

/// What somebody asks for: a scenario, and what is to be different from its file.
#[derive(Debug, Clone, Copy, Default)]
pub struct Choice<'a> {
    /// Name or file; `None` is the scenario of the paper.
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
    /// Whose method catches.
    pub method: Option<Method>,
    /// Single fields of the scenario, as [`Scenario::with_settings`] takes them.
    pub settings: &'a [String],
}

/// The scenario that is meant when none is named.
pub const DEFAULT_SCENARIO: &str = "paper";

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
    /// What is thrown.
    pub object: ThrownObject,
    /// How it is thrown.
    pub throw: Throw,
    /// What is known of the object's shape.
    pub reference_scan: ReferenceScan,
    /// Texts of the files that the brain depends on.
    pub sources: Sources,
    /// Made when it is first needed.
    equipment: OnceLock<Equipment>,
    /// Made when it is first needed.
    known: OnceLock<Arc<Preparation>>,
    /// The same with calibrated cameras.
    known_calibrated: BySeed<Preparation>,
    calibrations: BySeed<CalibratedCameras>,
}

impl Setup {
    /// Reads all that is asked for.
    ///
    /// # Errors
    /// The first fault found: which argument or which field of which file, what stands there and what would be right.
    pub fn load(choice: &Choice) -> Result<Self, InputError> {
        let nowhere = Origin::BuiltIn(PathBuf::new());
        let name = choice.scenario.unwrap_or(DEFAULT_SCENARIO);
        let asset = Asset::find(Kind::Scenario, name, &nowhere, (COMMAND_LINE, "--scenario"))?;
        Self::of_asset(&asset, choice)
    }

    /// Reads all that the scenario in `asset` and `choice` name.
    ///
    /// # Errors
    /// As [`load`](Self::load).
    pub fn of_asset(asset: &Asset, choice: &Choice) -> Result<Self, InputError> {
        // Results call it by its file, as they do with objects and throws, and by what is different from it.
        let scenario = Scenario { name: asset.name.clone(), ..Scenario::from_toml(&asset.file, &asset.text)? };
        Self::of_scenario(scenario, &asset.file, &asset.origin, choice)
    }

    /// Reads all that a scenario and `choice` name; `file` names the scenario in errors, and what it names is looked for from
    /// `origin` on.
    ///
    /// # Errors
    /// As [`load`](Self::load).
    pub fn of_scenario(
        mut scenario: Scenario,
        file: &str,
        origin: &Origin,
        choice: &Choice,
    ) -> Result<Self, InputError> {
        let is_other_robot = choice.robot.is_some_and(|robot| robot != scenario.robot);
        let is_other_gripper = choice.gripper.is_some_and(|gripper| gripper != scenario.gripper);
        if is_other_robot {
            // The scenario's pose is one of its own arm.
            (scenario.ready_rad, scenario.place_rad) = (None, None);
        }
        let of_file = scenario.clone();
        let mut scenario = scenario.with_settings(choice.settings)?;
        let find = |kind: Kind, asked: Option<&str>, named: &str, field: &str| {
            let nowhere = Origin::BuiltIn(PathBuf::new());
            let is_set = !of_file.parts().contains(&(kind, field, named));
            match asked {
                Some(name) => Asset::find(kind, name, &nowhere, (COMMAND_LINE, &format!("--{kind}"))),
                None if is_set => Asset::find(kind, named, &nowhere, (COMMAND_LINE, &format!("--set {field}"))),
                None => Asset::find(kind, named, origin, (file, field)),
            }
        };
        let robot = find(Kind::Robot, choice.robot, &scenario.robot, "robot")?;
        let gripper = find(Kind::Gripper, choice.gripper, &scenario.gripper, "gripper")?;
        let workcell = match (choice.workcell, &scenario.workcell) {
            (None, None) => None,
            (asked, named) => Some(find(Kind::Workcell, asked, named.as_deref().unwrap_or_default(), "workcell")?),
        };
        let object = find(Kind::Object, choice.object, &scenario.object, "object")?;
        let throw = find(Kind::Throw, choice.throw, &scenario.throw, "throw")?;
        let flight_rig = find(Kind::Rig, None, &scenario.flight_rig, "flight_rig")?;
        let reference_rig = find(Kind::Rig, None, &scenario.reference_rig, "reference_rig")?;

        let (urdf_file, robot_urdf) = robot.read_text_beside("robot.urdf")?;
        let sources = Sources {
            robot_urdf,
            robot_toml: robot.text,
            gripper_toml: gripper.text,
            workcell_toml: workcell.as_ref().map(|it| it.text.clone()),
            limit_scale: scenario.limit_scale,
        };
        let names = SourceNames {
            robot_urdf: &urdf_file,
            robot_toml: &robot.file,
            gripper_toml: &gripper.file,
            workcell_toml: workcell.as_ref().map_or("", |it| &it.file),
        };
        let (mut arm, hand) = sources.parse(&names)?;
        let said_by = |is_set: bool| if is_set { COMMAND_LINE } else { file };
        if let Some(values) = &scenario.ready_rad {
            let file = said_by(scenario.ready_rad != of_file.ready_rad);
            arm.ready_q = arm.checked_pose(file, "ready_rad", values)?;
        }
        if let Some(values) = &scenario.place_rad {
            arm.checked_pose(said_by(scenario.place_rad != of_file.place_rad), "place_rad", values)?;
        }
        if let Some(workcell) = &workcell {
            sources::check_waits_clear(&arm, &hand, &workcell.file)?;
        }
        let mut thrown = object.thrown_object()?;
        if scenario.arena.published_bodies {
            let expected = "the table [published], or arena.published_bodies = false";
            let missing = || InputError::new(&object.file, "published", "nothing", expected);
            thrown = thrown.as_published().ok_or_else(missing)?;
        }
        scenario.check_closing(file, &hand, &gripper.file)?;
        let cameras = flight_rig::read(&flight_rig.file, &flight_rig.text)?;
        scenario.arena.check_cameras(&cameras, file, "arena")?;
        let scanners = rig_from_toml(&reference_rig.file, &reference_rig.text)?;
        let depth = &scenario.arena.depth;
        let shifted: Vec<CameraModel> = scanners.iter().map(|camera| depth.shifted(camera)).collect();
        let reference_scan = ReferenceScan { cameras: scanners, ..reference_scan(&thrown.mesh, &shifted) };
        if reference_scan.is_empty() {
            let expected = "cameras that look at the origin, where the object is scanned";
            return Err(InputError::new(&reference_rig.file, "cameras", "none that sees the object", expected));
        }

        // Names only: results of the same content are the same wherever the files lie.
        if is_other_robot {
            scenario.name += &format!("+robot={}", robot.name);
        }
        if is_other_gripper {
            scenario.name += &format!("+gripper={}", gripper.name);
        }
        let workcell = workcell.map(|it| it.name);
        if let Some(name) = workcell.as_ref().filter(|_| workcell != scenario.workcell && choice.workcell.is_some()) {
            scenario.name += &format!("+workcell={name}");
        }
        scenario.workcell = workcell;
        if let Some(method) = choice.method.filter(|method| *method != scenario.brain.method) {
            scenario.name += &format!("+method={method}");
            scenario.brain.method = method;
        }
        scenario.robot = robot.name;
        scenario.gripper = gripper.name;
        scenario.object = object.name;
        let motion = throw.throw()?.for_arm(arm.length_m());
        scenario.throw = throw.name;
        scenario.flight_rig = flight_rig.name;
        scenario.reference_rig = reference_rig.name;
        scenario.ready_rad = Some(arm.ready_q.as_slice()[..arm.dof()].to_vec());
        Ok(Self {
            scenario,
            robot: arm,
            gripper: hand,
            cameras,
            throw: motion,
            object: thrown,
            reference_scan,
            sources,
            equipment: OnceLock::new(),
            known: OnceLock::new(),
            known_calibrated: BySeed::default(),
            calibrations: BySeed::default(),
        })
    }

    /// If the brain knows no way of holding the object: why.
    pub fn without_grasps(&self) -> Option<String> {
        Some(self.known().grasps()).filter(|it| it.grasps.is_empty()).map(|it| self.why_without_grasps(it))
    }

    /// Widths of object and gripper, and what is wrong with the candidates.
    pub(crate) fn why_without_grasps(&self, grasps: &GraspSet) -> String {
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

    /// The same with another throw, by name or file; what has been prepared is shared.
    ///
    /// # Errors
    /// As [`load`](Self::load).
    pub fn thrown(&self, throw: &str) -> Result<Self, InputError> {
        let asset = Asset::find(Kind::Throw, throw, &Origin::BuiltIn(PathBuf::new()), (COMMAND_LINE, "--throw"))?;
        let throw = asset.throw()?.for_arm(self.robot.length_m());
        Ok(self.with_throw(asset.name, throw))
    }

    /// The same with a throw that is given; what has been prepared is shared.
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
            let Self { scenario, robot, gripper, object, cameras, .. } = self.clone();
            Equipment::new(scenario.arena, robot, gripper, object, cameras)
        })
    }

    /// The arena with everything in place, the object about to fly.
    pub fn arena(&self, seed: u64, index: u64) -> Arena {
        Arena::new(self.equipment(), &self.release(seed, index), &self.robot.ready_q, seed, index)
    }

    /// What differs from throw to throw besides the throw itself.
    pub fn conditions(&self, seed: u64, index: u64) -> Conditions {
        Conditions::draw(&self.scenario.arena, &self.object, seed, index)
    }

    /// Whether all throws are the same in everything that is drawn.
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

    /// How the object leaves the thrower's hand.
    pub fn release(&self, seed: u64, index: u64) -> Release {
        self.throw.release(&self.object.name, &self.conditions(seed, index), seed, index)
    }

    /// The brain's settings in one scene, but for what a calibration says.
    pub(crate) fn uncalibrated_config(&self, seed: u64, index: u64) -> BrainSettings {
        let mut config = self.scenario.brain.clone();
        config.seed = seed_for(Stream::Brain, seed, index);
        // What is known beforehand, unless the scenario tells the brain otherwise: whether there is air, and how much it brakes the
        // object; how the object bounces and what it weighs; whether the cameras see the floor, and what their data sheet says.
        let (prior, prediction) = (&self.object.prior, &mut config.trajectory_prediction);
        let drag = [&mut prediction.drag_prior_per_m, &mut prediction.drag_prior_sd_per_m];
        for (set, known) in drag.into_iter().zip([prior.drag_per_m, prior.drag_sd_per_m]) {
            if self.scenario.arena.drag {
                set.get_or_insert(known);
            }
        }
        prediction.com_sd_m = prediction.com_sd_m.or(prior.com_sd_m);
        // A gripper that is ideal obeys at once; a real one as its file says.
        if self.scenario.arena.gripper.real().is_none() {
            config.control.gripper_latency_s.get_or_insert(0.0);
        }
        let grasping = &mut config.grasp_selection;
        grasping.restitution = grasping.restitution.or(prior.restitution);
        let planning = &mut config.trajectory_optimization;
        planning.object_mass_kg = planning.object_mass_kg.or(prior.mass_kg);
        let perception = &mut config.perception;
        perception.floor_visible.get_or_insert(self.scenario.arena.floor_visible);
        let focal_px = self.cameras.first().map_or(1.0, |camera| camera.focal_px);
        let sheet = self.scenario.arena.depth.model.data_sheet(focal_px);
        let DataSheet { constant_m, quadratic_per_m, common_fraction, dropout, edge_px } = sheet;
        perception.depth_noise.get_or_insert(DepthNoise { constant_m, quadratic_per_m });
        let has_holes = self.scenario.arena.depth.hole_fraction.bounds()[1] > 0.0;
        perception.depth_dropout.get_or_insert(dropout || has_holes);
        perception.depth_common_fraction.get_or_insert(common_fraction);
        perception.depth_edge_px.get_or_insert(edge_px);
        config.trajectory_prediction.correlated_error.sd_per_m = Some(self.correlated_sd_per_m(&config));
        config
    }

    /// What the brain works out before anything flies, with the cameras as they are.
    ///
    /// # Panics
    /// If settings were changed in code to values out of their ranges.
    pub fn known(&self) -> &Arc<Preparation> {
        self.known.get_or_init(|| Arc::new(self.preparation(&self.uncalibrated_config(0, 0), self.cameras.clone())))
    }

    fn preparation(&self, config: &BrainSettings, cameras: Vec<CameraModel>) -> Preparation {
        let (robot, reach_map) = (self.robot.clone(), reach_map::of(&self.robot));
        let known =
            Preparation::new(config.config(), robot, self.gripper.clone(), cameras, &self.reference_scan, reach_map);
        known.expect(CHECKED)
    }
}

/// Why a setup's settings are right.
pub(super) const CHECKED: &str = "settings are checked when a scenario is read";
