//! Checks of a user's files: what kind of file is it, and what is wrong with it?

use std::path::{Path, PathBuf};

use catch_body::{
    Gripper, InputError, Pose, Robot,
    robot_file::{RobotFiles, ignored_elements},
    stated::{Assumption, assumptions},
    workcell::Workcell,
};

use catch_cell::{CameraModel, DataSheet};
use nalgebra::Vector3;

use super::{
    gripper_check,
    object_check::{Examined, examine},
    robot_check,
};

use catch_lab::{
    assets::{Asset, KNOWN_FILE, Kind},
    camera_placement,
    scenario::{
        Scenario,
        setup::{Choice, Setup},
    },
};

/// Result of a check.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Checked {
    /// Kind of what the file describes, if that can be determined.
    pub kind: Option<Kind>,
    /// All faults found.
    pub faults: Vec<InputError>,
    /// Notes for whoever wrote the file, a line each.
    pub notes: Vec<String>,
}

/// Fields that only one kind of file has.
const TELLTALES: [(&str, Kind); 14] = [
    ("extends", Kind::Scenario),
    ("flight_rig", Kind::Scenario),
    ("arena", Kind::Scenario),
    ("flange", Kind::Robot),
    ("finger_mass_kg", Kind::Gripper),
    ("truth", Kind::Object),
    ("motion", Kind::Throw),
    ("boxes", Kind::Workcell),
    ("capsules", Kind::Workcell),
    ("uv_sphere", Kind::Rig),
    ("cameras", Kind::Rig),
    ("subpixel_px", Kind::Camera),
    ("constant_m", Kind::Camera),
    ("common_fraction", Kind::Camera),
];

/// Checks one file, or what is built in under this name.
pub fn check(path: &Path) -> Checked {
    let built_in = built_in(path);
    let path = match described_file(path).or_else(|fault| built_in.as_ref().map(|_| path.to_owned()).ok_or(fault)) {
        Ok(path) => path,
        Err(fault) => return Checked::unreadable(fault),
    };
    // Every kind of file is read in the same way; which kind it is only shows afterwards.
    let asset = match built_in.clone().map_or_else(|| Asset::on_disk(Kind::Scenario, &path), Ok) {
        Ok(asset) => asset,
        Err(InputError { file, field, found, expected, .. }) => {
            // "at most 1 MiB: …", "a regular file: …"
            let limit = expected.split_once(": ").map(|(limit, _)| format!("{limit}: ")).unwrap_or_default();
            let expected = format!(
                "{limit}a readable file of a scenario, robot, gripper, workcell, object, throw, camera, rig or cell"
            );
            return Checked::unreadable(InputError::new(file, field, found, expected));
        }
    };
    let table: toml::Table = match InputError::parse_toml(&asset.file, &asset.text) {
        Ok(table) => table,
        Err(fault) => return Checked::unreadable(fault),
    };
    let kind = TELLTALES.iter().find(|(field, _)| table.contains_key(*field)).map(|&(_, kind)| kind);
    // A thing in a folder of its own bears the folder's name.
    let kind_on_disk = kind.filter(|_| built_in.is_none());
    let asset = kind_on_disk.map_or(Ok(asset.clone()), |kind| Asset::on_disk(kind, &path)).unwrap_or(asset);
    let mut examined = Examined::default();
    let faults = match kind {
        Some(kind) => {
            let mut faults = faults_of(kind, &asset);
            if kind == Kind::Object && faults.is_empty() {
                examined = examine(&asset);
                let not_held = examined.not_held.take();
                faults.extend(not_held.map(|it| InputError::new(&asset.file, "object", it, "one that can be held")));
            } else if kind == Kind::Throw && faults.is_empty() {
                faults.extend(thrown_alone(&asset).err());
            }
            faults
        }
        None => {
            let fields: Vec<&str> = table.keys().map(String::as_str).collect();
            let found = if fields.is_empty() { "nothing".to_owned() } else { format!("fields {}", fields.join(", ")) };
            let expected = "the fields of a scenario, robot, gripper, workcell, object, throw, camera, rig or cell (`catchingbot list --show NAME` prints one)";
            vec![InputError::new(&asset.file, "the file", found, expected)]
        }
    };
    let notes = match kind {
        Some(Kind::Object) => notes_of_object(&asset).into_iter().chain(examined.notes).collect(),
        Some(Kind::Robot) => notes_of_robot(&asset),
        Some(Kind::Scenario | Kind::Workcell) => notes_of_name(&asset, &table),
        Some(Kind::Gripper) => {
            let margins = gripper_of(&asset).map(|it| gripper_check::notes(&it));
            notes_of_name(&asset, &table).into_iter().chain(margins.unwrap_or_default()).collect()
        }
        Some(Kind::Rig) if faults.is_empty() => notes_of_rig(&asset).unwrap_or_default(),
        _ => Vec::new(),
    };
    Checked { kind, faults, notes }
}

/// The built-in asset of this name, which options take before a file of the same name.
fn built_in(path: &Path) -> Option<Asset> {
    let name = path.to_str()?;
    let kind = Kind::ALL.into_iter().find(|kind| kind.names().contains(&name))?;
    Asset::built_in(kind, name).ok()
}

impl Checked {
    fn unreadable(fault: InputError) -> Self {
        Self { kind: None, faults: vec![fault], notes: Vec::new() }
    }
}

/// The arm that a `robot.toml` and the `robot.urdf` beside it describe.
fn robot_of(asset: &Asset) -> Result<Robot, InputError> {
    let (urdf_file, urdf) = asset.read_text_beside("robot.urdf")?;
    let files = RobotFiles { urdf_file: &urdf_file, urdf: &urdf, toml_file: &asset.file, toml: &asset.text };
    Robot::from_files(&files)?.with_meshes(&|name| asset.read_beside(name))
}

/// The gripper that a file describes.
fn gripper_of(asset: &Asset) -> Result<Gripper, InputError> {
    Gripper::from_toml(&asset.file, &asset.text)?.with_meshes(&|name| asset.read_beside(name))
}

/// Notes on a robot: flanges, shapes, assumptions, and elements of its URDF that are ignored.
fn notes_of_robot(asset: &Asset) -> Vec<String> {
    let of_arm = |it: &Robot| notes_of_flanges(it).into_iter().chain(robot_check::note_of_visuals(it));
    let mut notes: Vec<String> = robot_of(asset).iter().flat_map(of_arm).collect();
    notes.extend(notes_of_assumptions(asset));
    let ignored =
        asset.read_text_beside("robot.urdf").map(|(_, urdf)| ignored_elements(&urdf, &[])).unwrap_or_default();
    if !ignored.is_empty() {
        notes.push(format!("robot.urdf: ignored are {}", ignored.join(", ")));
    }
    notes
}

/// Notes on the flanges, and on where fingers close.
fn notes_of_flanges(robot: &Robot) -> Vec<String> {
    let link = robot.joints.last().map_or("", |it| it.link_name.as_str());
    let numbers = |v: Vector3<f64>| {
        // No negative zero.
        let [x, y, z]: [f64; 3] = v.map(|it| (it * 1e3).round() / 1e3 + 0.0).into();
        format!("({x:.3}, {y:.3}, {z:.3})")
    };
    let note = |name: &str, X_LF: &Pose| {
        let at = numbers(X_LF.translation.vector);
        let [closing, approach] = [Vector3::x(), Vector3::y()].map(|it| numbers(X_LF.rotation * it));
        format!("flange of {name} at {at} m in {link}: approach along {approach}, fingers close along {closing}")
    };
    let own = robot.X_LF_by_gripper.iter().map(|(name, X_LF)| note(name, X_LF));
    std::iter::once(note("grippers", &robot.X_LF)).chain(own).collect()
}

/// Values that nobody published, those with the same reason together.
fn notes_of_assumptions(asset: &Asset) -> Vec<String> {
    let mut by_reason: Vec<(String, Vec<String>)> = Vec::new();
    for Assumption { field, reason } in assumptions(&asset.file, &asset.text) {
        match by_reason.iter_mut().find(|(known, _)| *known == reason) {
            Some((_, fields)) => fields.push(field),
            None => by_reason.push((reason, vec![field])),
        }
    }
    let note = |(reason, fields): (String, Vec<String>)| format!("assumed: {}: {reason}", fields.join(", "));
    by_reason.into_iter().map(note).collect()
}

/// A name in the file that is not the one by which things are called.
fn notes_of_name(asset: &Asset, table: &toml::Table) -> Vec<String> {
    let name = table.get("name").and_then(toml::Value::as_str).filter(|name| *name != asset.name);
    let note = |name: &str| format!("name = \"{name}\" is ignored: it is called `{}`, as its file is", asset.name);
    name.map(note).into_iter().collect()
}

/// Scenario for whose throws a rig of few cameras is judged.
const RIG_SCENARIO: &str = "lab";
/// More cameras than these know a flight by silhouettes of few pixels, which the score leaves out.
const FEW_CAMERAS: usize = 8;

/// Notes on what the cameras of a rig know of throws, and how many of them are caught.
fn notes_of_rig(asset: &Asset) -> Option<Vec<String>> {
    let cameras = catch_cell::rig_from_toml(&asset.file, &asset.text).ok().filter(|it| it.len() <= FEW_CAMERAS)?;
    let mut notes = Vec::new();
    for object in Kind::Object.names() {
        let choice = Choice { scenario: Some(RIG_SCENARIO), object: Some(object), ..Choice::default() };
        let mut setup = Setup::load(&choice).ok()?;
        let sheet = setup.cameras.first()?.sheet.clone();
        setup.cameras = cameras.iter().map(|it| CameraModel { sheet: sheet.clone(), ..it.clone() }).collect();
        let score = camera_placement::score_of(&setup, &setup.cameras).ok()?;
        notes.push(format!("throws of `{RIG_SCENARIO}`, {object}: {}", score.summary(&setup)));
    }
    Some(notes)
}

/// Notes on the shape with which an object collides; none for an object that cannot be read.
fn notes_of_object(asset: &Asset) -> Vec<String> {
    let Ok(object) = asset.thrown_object() else { return Vec::new() };
    let parts = match object.parts.len() {
        1 => "1 convex part".to_owned(),
        count => format!("{count} convex parts"),
    };
    vec![format!(
        "volume {:.1} cm³; its convex hull has {:.2} times that; it collides as {parts} of {:.2} times that",
        object.mesh.volume() * 1e6,
        object.hull_volume_ratio(),
        object.parts_volume_ratio()
    )]
}

/// A robot may be called by its folder or its URDF, an object by its folder or its `known.toml`; what is
/// checked is the file that says most, and what that stands beside.
///
/// # Errors
/// A folder of something else.
fn described_file(path: &Path) -> Result<PathBuf, InputError> {
    let (robot, object) = ("robot.toml", "truth.toml");
    if path.is_dir() {
        let file = [object, robot].map(|it| path.join(it)).into_iter().find(|it| it.is_file());
        let expected = "the folder of a robot or of an object, or the file of something else";
        let fault = || InputError::new(path.display(), "the folder", format!("neither {robot} nor {object}"), expected);
        return file.ok_or_else(fault);
    }
    let file = if path.extension().is_some_and(|it| it == "urdf") {
        path.with_file_name(robot)
    } else if path.ends_with(KNOWN_FILE) {
        path.with_file_name(object)
    } else {
        path.to_path_buf()
    };
    Ok(file)
}

fn faults_of(kind: Kind, asset: &Asset) -> Vec<InputError> {
    let (file, text) = (&asset.file, &asset.text);
    let result = match kind {
        Kind::Scenario => return faults_of_scenario(asset),
        Kind::Robot => robot_of(asset).map(drop),
        Kind::Gripper => gripper_of(asset).map(drop),
        Kind::Object => InputError::first_of([asset.thrown_object().map(drop), asset.known_figures().map(drop)]),
        Kind::Camera => DataSheet::from_toml(file, text).map(drop),
        Kind::Throw => asset.throw().map(drop),
        Kind::Workcell => Workcell::from_toml(file, text).map(drop),
        Kind::Rig => catch_cell::rig_from_toml(file, text).map(drop),
    };
    result.err().into_iter().flat_map(InputError::all).collect()
}

/// A scenario's own faults and those of all the files that it names.
fn faults_of_scenario(asset: &Asset) -> Vec<InputError> {
    let (scenario, mut faults) = match Scenario::with_faults(asset) {
        Ok(parsed) => parsed,
        Err(fault) => return fault.all(),
    };
    for (kind, field, name) in scenario.parts() {
        match Asset::find(kind, name, &asset.origin, (&asset.file, field)) {
            Ok(part) => faults.extend(faults_of(kind, &part)),
            Err(fault) => faults.push(fault),
        }
    }
    if faults.is_empty() {
        // Each part is right; they may still not fit together.
        let setup = Setup::of_asset(asset, &Choice::default());
        faults = setup.and_then(|it| fits(asset, &it)).err().into_iter().flat_map(InputError::all).collect();
    }
    faults
}

/// Checks the first flight of a throw. No scenario says what is in its way.
fn thrown_alone(asset: &Asset) -> Result<(), InputError> {
    let mut setup = Setup::load(&Choice { scenario: Some(RIG_SCENARIO), ..Choice::default() })?;
    setup.throw = asset.throw()?.for_arm(setup.robot.length_m());
    setup.scenario.throw.clone_from(&asset.file);
    setup.check_flight(0, 0)
}

/// Checks that the object of a setup can be held, and thrown.
fn fits(asset: &Asset, setup: &Setup) -> Result<(), InputError> {
    match setup.without_grasps() {
        Some(widths) => Err(InputError::new(&asset.file, "object", widths, "one that can be held")),
        None => setup.check_throw(0, 0),
    }
}
