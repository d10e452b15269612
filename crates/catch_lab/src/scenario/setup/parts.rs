//! The files that a scenario and a choice name: found, read and checked one by one.

use catch_body::{
    Gripper, InputError, Robot,
    robot::LimitScale,
    workcell::{Obstacle, Workcell},
};
use catch_cell::{CameraModel, DataSheet, KnownObject, ReferenceScan, reference_scan, rig_from_toml};
use catch_sim::{ArenaConfig, Throw, ThrownObject, depth_noise::DepthConfig};

use super::Choice;
use crate::{
    assets::{Asset, Kind, Origin},
    scenario::{Scenario, flight_rig},
};
use catch_recording::{
    sources::{self, SourceNames, Sources},
    whole_file::COMMAND_LINE,
};

/// Place of a scenario: its name in error messages, and the origin of the files that it names.
#[derive(Debug, Clone, Copy)]
pub(super) struct Place<'a> {
    pub file: &'a str,
    pub origin: &'a Origin,
}

/// The arm with its gripper and what stands around them, by their files, and the texts of these.
///
/// # Errors
/// A file that is missing, or a fault in one.
pub fn arm_with_hand(
    robot: &Asset,
    gripper: &Asset,
    workcell: Option<&Asset>,
    limit_scale: LimitScale,
) -> Result<(Sources, Robot, Gripper), InputError> {
    let (urdf_file, robot_urdf) = robot.read_text_beside("robot.urdf")?;
    let sources = Sources {
        robot_urdf,
        robot_toml: robot.text.clone(),
        robot_meshes: robot.meshes()?,
        gripper_toml: gripper.text.clone(),
        gripper_meshes: gripper.meshes()?,
        workcell_toml: workcell.map(|it| it.text.clone()),
        limit_scale,
    };
    let (arm, hand) = sources.parse(&SourceNames {
        robot_urdf: &urdf_file,
        robot_toml: &robot.file,
        gripper_toml: &gripper.file,
        workcell_toml: workcell.map_or("", |it| &it.file),
    })?;
    Ok((sources, arm, hand))
}

/// The files of a cell.
pub(super) struct Parts {
    robot: Asset,
    gripper: Asset,
    workcell: Option<Asset>,
    room: Option<Asset>,
    object: Asset,
    throw: Asset,
    camera: Asset,
    flight_rig: Asset,
    reference_rig: Asset,
}

impl Parts {
    /// Finds them all. What `scenario` names otherwise than `of_file`, as which it was read, was named on the
    /// command line.
    pub fn find(scenario: &Scenario, of_file: &Scenario, place: Place, choice: &Choice) -> Result<Self, InputError> {
        let find = |kind: Kind, asked: Option<&str>, named: &str, field: &str| {
            let is_set = !of_file.parts().contains(&(kind, field, named));
            match asked {
                Some(name) => Asset::asked(kind, name, (COMMAND_LINE, &format!("--{kind}"))),
                None if is_set => Asset::asked(kind, named, (COMMAND_LINE, &format!("--set {field}"))),
                None => Asset::find(kind, named, place.origin, (place.file, field)),
            }
        };
        let workcell = match (choice.workcell, &scenario.workcell) {
            (None, None) => None,
            (asked, named) => Some(find(Kind::Workcell, asked, named.as_deref().unwrap_or_default(), "workcell")?),
        };
        let room = scenario.room.as_deref().map(|named| find(Kind::Workcell, None, named, "room")).transpose()?;
        Ok(Self {
            room,
            robot: find(Kind::Robot, choice.robot, &scenario.robot, "robot")?,
            gripper: find(Kind::Gripper, choice.gripper, &scenario.gripper, "gripper")?,
            workcell,
            object: find(Kind::Object, choice.object, &scenario.object, "object")?,
            throw: find(Kind::Throw, choice.throw, &scenario.throw, "throw")?,
            camera: find(Kind::Camera, None, &scenario.camera, "camera")?,
            flight_rig: find(Kind::Rig, None, &scenario.flight_rig, "flight_rig")?,
            reference_rig: find(Kind::Rig, None, &scenario.reference_rig, "reference_rig")?,
        })
    }

    /// The arm, waiting where the scenario says, its gripper, and their texts.
    pub fn arm(
        &self,
        scenario: &Scenario,
        of_file: &Scenario,
        file: &str,
    ) -> Result<(Sources, Robot, Gripper), InputError> {
        let workcell = self.workcell.as_ref();
        let (sources, mut arm, hand) = arm_with_hand(&self.robot, &self.gripper, workcell, scenario.limit_scale)?;
        let said_by = |is_set: bool| if is_set { COMMAND_LINE } else { file };
        if let Some(values) = &scenario.ready_rad {
            let file = said_by(scenario.ready_rad != of_file.ready_rad);
            arm.ready_q = arm.checked_pose(file, "ready_rad", values)?;
        }
        if let Some(values) = &scenario.place_rad {
            arm.checked_pose(said_by(scenario.place_rad != of_file.place_rad), "place_rad", values)?;
        }
        if let Some(workcell) = workcell {
            sources::check_waits_clear(&arm, &hand, &workcell.file)?;
        }
        scenario.check_closing(file, &hand, &self.gripper.file)?;
        Ok((sources, arm, hand))
    }

    /// What stands in the room besides. The arm waits clear of it.
    pub fn room(&self, robot: &Robot, gripper: &Gripper) -> Result<Vec<Obstacle>, InputError> {
        let Some(Asset { file, text, .. }) = &self.room else { return Ok(Vec::new()) };
        let obstacles = Workcell::from_toml(file, text)?.obstacles;
        sources::check_waits_clear(&Robot { obstacles: obstacles.clone(), ..robot.clone() }, gripper, file)?;
        Ok(obstacles)
    }

    /// The object as it is.
    pub fn truth(&self, arena: &ArenaConfig) -> Result<ThrownObject, InputError> {
        let thrown = self.object.thrown_object()?;
        if !arena.published_bodies {
            return Ok(thrown);
        }
        let expected = "the table [published], or arena.published_bodies = false";
        let published = thrown.as_published.map(|it| *it);
        published.ok_or_else(|| InputError::new(&self.object.file, "published", "nothing", expected))
    }

    /// The cameras as their rig's file and their data sheet have them.
    pub fn cameras(&self, robot: &Robot) -> Result<Vec<CameraModel>, InputError> {
        let sheet = DataSheet::from_toml(&self.camera.file, &self.camera.text)?;
        let cameras = flight_rig::read(&self.flight_rig.file, &self.flight_rig.text)?;
        flight_rig::check_clear(&self.flight_rig.file, &cameras, robot)?;
        Ok(cameras.into_iter().map(|camera| CameraModel { sheet: Some(sheet.clone()), ..camera }).collect())
    }

    /// Model of the object: its file's figures, and a scan that its owner took, of `thrown`, by scanners with
    /// these errors.
    pub fn known_object(&self, thrown: &ThrownObject, scanner: &DepthConfig) -> Result<KnownObject, InputError> {
        let figures = self.object.known_figures()?;
        let cameras = rig_from_toml(&self.reference_rig.file, &self.reference_rig.text)?;
        let shifted: Vec<CameraModel> = cameras.iter().map(|camera| scanner.shifted(camera)).collect();
        let scan = ReferenceScan { cameras, ..reference_scan(&thrown.mesh, &shifted) };
        if scan.is_empty() {
            let expected = "cameras that look at the origin, where the object is scanned";
            return Err(InputError::new(&self.reference_rig.file, "cameras", "none that sees the object", expected));
        }
        Ok(KnownObject { scan, figures })
    }

    /// Reads the throw of the object at an arm of this length.
    pub fn throw(&self, arm_length_m: f64) -> Result<Throw, InputError> {
        Ok(self.throw.throw()?.for_arm(arm_length_m))
    }

    /// Writes the names of all parts into the scenario, and into its own name those that a choice made
    /// different. Names only: results of the same content are the same wherever the files lie.
    pub fn name(self, scenario: &mut Scenario, choice: &Choice) {
        let differs = |asked: Option<&str>, named: &str| asked.is_some_and(|it| it != named);
        if differs(choice.robot, &scenario.robot) {
            scenario.name += &format!("+robot={}", self.robot.name);
        }
        if differs(choice.gripper, &scenario.gripper) {
            scenario.name += &format!("+gripper={}", self.gripper.name);
        }
        let workcell = self.workcell.map(|it| it.name);
        if let Some(name) = workcell.as_ref().filter(|_| workcell != scenario.workcell && choice.workcell.is_some()) {
            scenario.name += &format!("+workcell={name}");
        }
        scenario.workcell = workcell;
        scenario.room = self.room.map(|it| it.name);
        if let Some(method) = choice.method.filter(|method| *method != scenario.brain.method) {
            scenario.name += &format!("+method={method}");
            scenario.brain.method = method;
        }
        scenario.robot = self.robot.name;
        scenario.gripper = self.gripper.name;
        scenario.object = self.object.name;
        scenario.throw = self.throw.name;
        scenario.camera = self.camera.name;
        scenario.flight_rig = self.flight_rig.name;
        scenario.reference_rig = self.reference_rig.name;
    }
}
