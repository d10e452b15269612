//! Scenarios: everything that a set of trials shares, in one file.

pub mod catch_plan;
mod depth_errors;
pub mod flight_rig;
mod inheritance;
pub mod setup;

use catch_body::{Gripper, InputError, quantity, robot::LimitScale};
use catch_sim::{ArenaConfig, GripperDriveKind};
use serde::{Deserialize, Serialize};

use crate::assets::{Asset, Kind, did_you_mean, nearest};
use catch_recording::{brain::BrainSettings, whole_file::COMMAND_LINE};

/// Time that the computation of a command costs.
#[quantity::checked(rename_all = "snake_case")]
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub enum Clock {
    /// Nothing, as in the paper: a command arrives at the instant of what it answers.
    #[default]
    Free,
    /// A constant time in milliseconds.
    FixedMs(quantity::latency_ms),
    /// The wall time of the brain's tick on this machine. The only clock with which a trial is not the same
    /// every time.
    Charged,
}

impl Clock {
    /// Delay from an observation to the arrival of the command that answers it, in seconds; computing took
    /// `measured_s`.
    pub fn delay_s(self, measured_s: f64) -> f64 {
        match self {
            Self::Free => 0.0,
            Self::FixedMs(delay_ms) => delay_ms / 1e3,
            Self::Charged => measured_s,
        }
    }
}

/// A scenario's file: a composition of each module's own settings. What it does not say is that of the
/// scenario which it names as `extends`, or else the module's default.
#[quantity::checked(deny_unknown_fields)]
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Scenario {
    /// Name. Results call a scenario by its file's name, and by what is different from the file.
    pub name: String,
    /// Description of the scenario, in a sentence.
    pub description: String,
    /// The arm: a built-in robot, or the path of a `robot.toml` with a `robot.urdf` beside it.
    pub robot: String,
    /// The gripper on it.
    pub gripper: String,
    /// Surroundings of the arm, a built-in workcell or a file; nothing but the floor if left out.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub workcell: Option<String>,
    /// What stands around that the cameras see, and nobody has told the brain: a workcell's file. Nothing if
    /// left out.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub room: Option<String>,
    /// Object that is thrown by default.
    pub object: String,
    /// Throw that is used by default.
    pub throw: String,
    /// Joint positions in radians where the arm waits; the robot's own ready pose if left out.
    pub ready_rad: quantity::angle_rad<Option<Vec<f64>>>,
    /// Joint positions in radians in which the gripper opens to put down what was caught; needed where a
    /// brain lives for many throws.
    pub place_rad: quantity::angle_rad<Option<Vec<f64>>>,
    /// Multiplies the arm's limits. Anything but 1, the default, is not the real arm, and the scenario's name
    /// should say so.
    #[serde(default)]
    pub limit_scale: LimitScale,
    /// The cameras' data sheet, by which the brain expects their errors. What their errors are stands in
    /// `arena.depth`.
    pub camera: String,
    /// The cameras that watch the flight.
    pub flight_rig: String,
    /// The cameras that scan the object beforehand, around the object's frame.
    pub reference_rig: String,
    /// Time that commands take to compute: `"free"`, `{ fixed_ms = 10 }` or `"charged"`. The delay that the
    /// brain expects is a setting of its own, `expected_latency_s` in `[brain.control]`.
    #[serde(default)]
    pub clock: Clock,
    /// Calibration of the cameras before the first throw. Without it the brain uses the poses in the rig's
    /// file.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub calibration: Option<CalibrationSettings>,
    /// The physics, the sensors and the drives.
    #[serde(default)]
    pub arena: ArenaConfig,
    /// The brain.
    #[serde(default)]
    pub brain: BrainSettings,
}

/// A calibration before all throws of a seed: the cameras stand where the rig's file says, and are believed
/// to stand elsewhere until the arm has calibrated them. The brain has what comes out, and what is claimed of
/// it.
#[quantity::checked(default, deny_unknown_fields)]
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct CalibrationSettings {
    /// Standard deviation of what is believed before, along each axis of a camera, in metres.
    pub position_sd_m: quantity::error_m,
    /// Standard deviation of the rotation believed before, about each axis of a camera, in degrees.
    pub rotation_sd_deg: quantity::error_deg,
    /// Poses of the arm, at most.
    pub poses: quantity::poses<usize>,
}

impl Default for CalibrationSettings {
    fn default() -> Self {
        Self { position_sd_m: 0.005, rotation_sd_deg: 0.3, poses: 12 }
    }
}

impl Scenario {
    /// Reads a scenario's TOML file, and those that it extends.
    ///
    /// # Errors
    /// A field that is missing, misspelt or of the wrong kind, or a value out of range.
    pub fn of_asset(asset: &Asset) -> Result<Self, InputError> {
        let (scenario, faults) = Self::with_faults(asset)?;
        faults.into_iter().next().map_or(Ok(scenario), Err)
    }

    /// Reads a scenario, and lists every value that cannot be used instead of the first.
    ///
    /// # Errors
    /// Faults other than values out of their ranges.
    pub fn with_faults(asset: &Asset) -> Result<(Self, Vec<InputError>), InputError> {
        let mut table = inheritance::extended(asset)?;
        depth_errors::fill_in(&mut table, &asset.file)?;
        let read = InputError::from_table(&asset.file, table).map_err(inheritance::with_own_field);
        let (scenario, mut faults): (Self, _) = read?;
        faults.extend(scenario.faults(&asset.file));
        Ok((scenario, faults))
    }

    /// Every value that cannot be used although it is one of its kind: settings of the brain out of their
    /// ranges, values that do not fit together.
    pub fn faults(&self, file: &str) -> Vec<InputError> {
        let mut faults = self.arena.faults(file, "arena");
        let depth = &self.arena.depth;
        if self.calibration.is_some() && (depth.calibration_sd_m > 0.0 || depth.calibration_sd_rad > 0.0) {
            let found = depth.calibration_sd_m.max(depth.calibration_sd_rad);
            let expected = "zero beside a table [calibration], whose cameras stand where their rig says";
            faults.push(InputError::new(file, "arena.depth.calibration_sd_m and calibration_sd_rad", found, expected));
        }
        faults
    }

    /// Returns this scenario with single fields changed: `arena.restitution_scale=0.5`. Its name lists the
    /// changes.
    ///
    /// # Errors
    /// A setting that is no `FIELD=VALUE`, a field that there is not, or a value that it cannot have.
    pub fn with_settings(self, settings: &[String]) -> Result<Self, InputError> {
        let fault = |found: String, expected: String| InputError::new(COMMAND_LINE, "--set", found, expected);
        let named = toml::Table::try_from(&self).map_err(|it| fault(it.to_string(), "a scenario".to_owned()))?;
        let (mut tree, mut changes) = (named.clone(), String::new());
        for setting in settings {
            let fault = |expected: String| fault(format!("`{setting}`"), expected);
            let example = || fault("FIELD=VALUE, such as arena.restitution_scale=0.5".to_owned());
            let whole = |path: &str| path.split('.').all(|field| !field.trim().is_empty());
            let (path, text) = setting.split_once('=').filter(|(path, _)| whole(path)).ok_or_else(example)?;
            // A value that is no TOML is meant as text.
            let value = InputError::toml_table(&format!("value = {text}")).ok();
            let value = value.and_then(|mut table| table.remove("value")).unwrap_or_else(|| text.trim().into());
            let (table, field) = parent(path, &mut tree).map_err(fault)?;
            table.insert(field.to_owned(), value);
            depth_errors::fill_in(&mut tree, COMMAND_LINE)?;
            changes.extend(["+", &setting.replace(' ', "")]);
        }
        let with_hint = |it: InputError| match it.found.as_str() {
            InputError::UNKNOWN_FIELD => {
                let asked = settings.iter().find(|setting| setting.starts_with(&it.field));
                let path = asked.and_then(|setting| setting.split('=').next()).unwrap_or(&it.field);
                let hint = did_you_mean(field_meant(path.trim(), &named).as_deref());
                InputError { expected: it.expected + &hint, ..it }
            }
            _ => it,
        };
        let changed = InputError::from_table(COMMAND_LINE, tree).map_err(with_hint)?;
        let mut changed: Self = InputError::without_faults(changed)?;
        changed.name += &changes;
        changed.faults(COMMAND_LINE).into_iter().next().map_or(Ok(changed), Err)
    }

    /// Checks that the brain expects fingers that are no faster than those of a gripper with limits.
    ///
    /// # Errors
    /// If it does not: every catch would come too late.
    pub(crate) fn check_closing(&self, file: &str, gripper: &Gripper, gripper_file: &str) -> Result<(), InputError> {
        if self.arena.gripper != GripperDriveKind::Real {
            return Ok(());
        }
        let grasping = &self.brain.grasp_selection;
        for (field, value, limit, most) in [
            ("closing_speed_mps", grasping.closing_speed_mps, "max_speed_mps", gripper.max_speed_mps),
            (
                "closing_acceleration_mps2",
                grasping.closing_acceleration_mps2,
                "max_acceleration_mps2",
                gripper.max_acceleration_mps2,
            ),
        ] {
            if let Some(value) = value.filter(|value| *value > most) {
                let expected =
                    format!("at most {most}, the {limit} of {gripper_file} that arena.gripper keeps to, or nothing");
                return Err(InputError::new(file, format!("brain.grasp_selection.{field}"), value, expected));
            }
        }
        Ok(())
    }

    /// The files that it names: what kind, in which field, by which name.
    pub fn parts(&self) -> Vec<(Kind, &'static str, &str)> {
        let workcells = [("workcell", &self.workcell), ("room", &self.room)].into_iter();
        let workcells = workcells.filter_map(|(field, name)| Some((Kind::Workcell, field, name.as_deref()?)));
        let parts: [(Kind, &'static str, &str); 7] = [
            (Kind::Robot, "robot", &self.robot),
            (Kind::Gripper, "gripper", &self.gripper),
            (Kind::Object, "object", &self.object),
            (Kind::Throw, "throw", &self.throw),
            (Kind::Camera, "camera", &self.camera),
            (Kind::Rig, "flight_rig", &self.flight_rig),
            (Kind::Rig, "reference_rig", &self.reference_rig),
        ];
        parts.into_iter().chain(workcells).collect()
    }
}

/// The table in which the field of a path stands, and the field's own name. A table that is left out is there
/// from now on.
///
/// # Errors
/// What is expected instead, if something on the way is no table.
fn parent<'a, 'b>(path: &'b str, tree: &'a mut toml::Table) -> Result<(&'a mut toml::Table, &'b str), String> {
    let (mut table, mut start) = (tree, 0);
    for (end, _) in path.match_indices('.') {
        let next = table.entry(path[start..end].trim()).or_insert_with(|| toml::Table::new().into());
        table = next.as_table_mut().ok_or_else(|| format!("`{}=VALUE`: it is no table here", path[..end].trim()))?;
        start = end + 1;
    }
    Ok((table, path[start..].trim()))
}

/// The field that is probably meant by the path of one that there is not: spelt alike, or of the same name
/// elsewhere.
fn field_meant(path: &str, tree: &toml::Table) -> Option<String> {
    let tree = toml::Value::Table(tree.clone());
    let mut known = Vec::new();
    fields("", &tree, &mut known);
    let known: Vec<&str> = known.iter().map(|(field, _)| field.as_str()).collect();
    let name = |path: &str| path.rsplit('.').next().unwrap_or_default().to_owned();
    let elsewhere = known.iter().find(|it| name(it) == name(path)).copied();
    elsewhere.or_else(|| nearest(path, &known)).map(str::to_owned)
}

/// All fields of a value with their paths, tables and elements of arrays included.
fn fields<'a>(path: &str, value: &'a toml::Value, found: &mut Vec<(String, &'a toml::Value)>) {
    let mut field = |path: String, value: &'a toml::Value| {
        fields(&path, value, found);
        found.push((path, value));
    };
    match value {
        toml::Value::Table(table) => {
            let of = |name: &String| if path.is_empty() { name.clone() } else { format!("{path}.{name}") };
            table.iter().for_each(|(name, value)| field(of(name), value));
        }
        toml::Value::Array(values) => {
            values.iter().enumerate().for_each(|(i, value)| field(format!("{path}[{i}]"), value));
        }
        _ => {}
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scenario::setup::{Choice, Setup};
    use catch_recording::brain::Method;
    use catch_sim::drawn::Drawn;

    fn set(settings: &[&str]) -> Result<Scenario, InputError> {
        let settings: Vec<String> = settings.iter().map(|&it| it.to_owned()).collect();
        Setup::load(&Choice { scenario: Some("paper"), settings: &settings, ..Choice::default() })
            .map(|setup| setup.scenario)
    }

    #[test]
    fn single_fields_can_be_changed() {
        let scenario = set(&["arena.restitution_scale = 0.5", "brain.method=paper", "arena.frame_rate_hz=50"]).unwrap();
        assert_eq!((scenario.arena.restitution_scale, scenario.arena.frame_rate_hz), (0.5, 50.0));
        assert_eq!(scenario.brain.method, Method::Paper);
        // A table that is left out is there from its first field on.
        let calibrated = set(&["calibration.position_sd_m=0.01"]).unwrap();
        assert!(scenario.calibration.is_none() && calibrated.calibration.is_some_and(|it| it.position_sd_m == 0.01));
        assert!(scenario.name.starts_with("paper+arena.restitution_scale=0.5+"), "{}", scenario.name);
        let person = set(&["arena.person.nearest_m=2", "arena.person.speed_mps=1"]).unwrap().arena.person;
        assert_eq!(person.map(|it| it.speed_mps), Some(Drawn::Always(1.0)));
    }

    #[test]
    fn no_setting_is_infinite_or_no_number() {
        for (setting, expected) in [
            (
                "brain.control.switching_hysteresis=nan",
                "brain.control.switching_hysteresis: found nan, expected a finite number",
            ),
            ("brain.perception.camera_sd_rad=inf", "brain.perception.camera_sd_rad: found inf"),
            ("ready_rad=[0, 0, 0, 0, 0, 0, inf]", "ready_rad[6]: found inf, expected a finite number"),
            ("brain.trajectory_optimization.terminal_velocity_scaling=1.5", "0.01 to 1"),
        ] {
            let fault = set(&[setting]).unwrap_err().to_string();
            assert!(fault.contains(expected), "{fault}");
        }
    }

    /// Each number among the settings has a range.
    #[test]
    fn every_number_is_checked() {
        let more = ["calibration={}", "arena.person={ nearest_m = 2, speed_mps = 1 }", "arena.friction=0.5"];
        let mut scenario = set(&more).unwrap();
        let brain = &mut scenario.brain;
        brain.perception.depth_noise = Some(Default::default());
        brain.trajectory_prediction.com_sd_m = Some(0.0);
        brain.grasp_selection.restitution = Some(0.5);
        brain.trajectory_optimization.object_mass_kg = Some(0.1);
        let whole = toml::Value::try_from(&scenario).unwrap();
        let mut all = Vec::new();
        fields("", &whole, &mut all);
        let mut checked = 0;
        for (path, value) in &all {
            let wrong = match value {
                toml::Value::Float(_) => toml::Value::Float(1e300),
                toml::Value::Integer(_) => toml::Value::Integer(1_000_000_000),
                _ => continue,
            };
            checked += 1;
            let mut spoilt = whole.clone();
            let keys = path.replace('[', ".").replace(']', "");
            let at = keys.split('.').fold(&mut spoilt, |at, key| match key.parse::<usize>() {
                Ok(index) => &mut at[index],
                Err(_) => &mut at[key],
            });
            *at = wrong;
            let toml::Value::Table(spoilt) = spoilt else { panic!("a table") };
            let faults = match InputError::from_table::<Scenario>("s.toml", spoilt) {
                Ok((scenario, faults)) => faults.into_iter().chain(scenario.faults("s.toml")).collect(),
                Err(fault) => fault.all(),
            };
            assert!(faults.iter().any(|fault| fault.field.starts_with(path)), "{path} may be anything: {faults:?}");
        }
        assert!(checked > 90, "{checked}");
    }

    #[test]
    fn another_robot_waits_in_its_own_pose_and_the_name_tells() {
        let pose = "ready_rad=[0.0, -1.5, 1.5, 0.0, 0.0, 0.0]".to_owned();
        for (robot, method, settings, ready, name) in [
            (None, None, vec![], -1.308, "paper"),
            (Some("iiwa14"), Some(Method::Ours), vec![], -1.308, "paper"),
            (Some("ur10e"), None, vec![], -0.228, "paper+robot=ur10e"),
            (Some("ur10e"), None, vec![pose], 0.0, "paper+ready_rad=[0.0,-1.5,1.5,0.0,0.0,0.0]+robot=ur10e"),
            (None, Some(Method::Paper), vec![], -1.308, "paper+method=paper"),
        ] {
            let setup = Setup::load(&Choice {
                scenario: Some("paper"),
                robot,
                method,
                settings: &settings,
                ..Choice::default()
            })
            .unwrap();
            assert_eq!((setup.robot.ready_q[0], setup.scenario.name.as_str()), (ready, name));
            assert_eq!(setup.scenario.ready_rad.unwrap().len(), setup.robot.dof());
        }
    }

    #[test]
    fn a_file_is_called_by_its_own_name() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("slippery.toml");
        std::fs::write(&path, include_str!("../../../assets/scenarios/paper.toml")).unwrap();
        let setup = Setup::load(&Choice { scenario: path.to_str(), ..Choice::default() }).unwrap();
        assert_eq!(setup.scene(1, 0).scenario, "slippery");
    }

    #[test]
    fn what_there_is_not_is_named() {
        for (setting, named) in [
            ("arena.restitution", "one of `gripper`"),
            ("arena.restitution_scale", "FIELD=VALUE"),
            ("arina.friction=1", "arena"),
            ("arena.friction=-1", "arena.friction"),
            ("arena.friction=much", "a number or { min"),
            ("arena.frame_rate_hz=many", "expected a number"),
            ("arena.frictoin=0.3", "did you mean `arena.friction`?"),
            ("friction=0.3", "did you mean `arena.friction`?"),
            ("arena.frame_rate_hz.x=1", "`arena.frame_rate_hz=VALUE`"),
            ("physics.friction=1", "did you mean `arena.friction`?"),
            ("arena.person.speed_mps=1", "arena.person.nearest_m: found nothing"),
            ("brain.grasp_selection.closing_speed_mps=0", "brain.grasp_selection.closing_speed_mps"),
            ("arena.latency_s=100", "arena.latency_s"),
            ("clock={ fixed_ms = 20000 }", "clock.fixed_ms"),
        ] {
            let setting = if setting.ends_with("restitution") { format!("{setting}=1") } else { setting.to_owned() };
            let fault = set(&[&setting]).unwrap_err().to_string();
            assert!(fault.contains(named) && fault.contains("command line"), "{setting}: {fault}");
        }
    }
}
