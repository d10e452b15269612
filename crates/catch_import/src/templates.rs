//! Commented files to start from.

use catch_body::{InputError, Pose};
use nalgebra::{Point3, Vector3};

use super::cloud_file::{CloudFile, on_surface};
use catch_lab::{
    assets::{Asset, Kind},
    scenario::{Scenario, setup::DEFAULT_SCENARIO},
};
use catch_recording::whole_file::COMMAND_LINE;

const TRUTH: &str = include_str!("templates/truth.toml");
const KNOWN: &str = include_str!("templates/known.toml");
const SCENARIO: &str = include_str!("templates/scenario.toml");
const THROW: &str = include_str!("templates/throw.toml");
const GRIPPER: &str = include_str!("templates/gripper.toml");
const WORKCELL: &str = include_str!("templates/workcell.toml");
const CAMERA: &str = include_str!("templates/camera.toml");
const RIG: &str = include_str!("templates/rig.toml");
const TRACK: &str = include_str!("templates/track.csv");

/// A file: its name, and its content.
pub type NewFile = (String, String);

/// The files of a new thing of a kind, all of them right as they are: from a template, a scenario from the
/// one that is meant when none is named, a robot from that scenario, too.
///
/// # Errors
/// A name that cannot be a file's.
pub fn files(kind: Kind, name: &str) -> Result<Vec<NewFile>, InputError> {
    check_name(name)?;
    let file = |text: String| Ok(vec![(format!("{name}.toml"), text)]);
    let filled_in = |template: &str| file(template.replace("{{name}}", name));
    let asked_by = (COMMAND_LINE, "NAME");
    let scenario = || Asset::asked(Kind::Scenario, DEFAULT_SCENARIO, asked_by);
    match kind {
        Kind::Object => Ok(vec![
            (format!("{name}/truth.toml"), TRUTH.replace("{{name}}", name)),
            (format!("{name}/known.toml"), KNOWN.to_owned()),
        ]),
        Kind::Throw => filled_in(THROW),
        Kind::Gripper => filled_in(GRIPPER),
        Kind::Workcell => filled_in(WORKCELL),
        Kind::Camera => filled_in(CAMERA),
        Kind::Rig => filled_in(RIG),
        Kind::Robot => {
            let scenario = scenario()?;
            let named = Scenario::of_asset(&scenario)?.robot;
            let robot = Asset::asked(Kind::Robot, &named, asked_by)?;
            let (_, urdf) = robot.read_text_beside("robot.urdf")?;
            Ok(vec![(format!("{name}/robot.toml"), without_depths(&robot.text)), (format!("{name}/robot.urdf"), urdf)])
        }
        Kind::Scenario => filled_in(SCENARIO),
    }
}

fn check_name(name: &str) -> Result<(), InputError> {
    let fits = |letter: char| letter.is_ascii_alphanumeric() || letter == '_' || letter == '-';
    if !name.is_empty() && name.chars().all(fits) {
        return Ok(());
    }
    Err(InputError::new(COMMAND_LINE, "NAME", format!("`{name}`"), "letters, digits, `_` and `-`"))
}

/// A track of a ball that flies through the air, seen a hundred times a second with 2 mm of noise, one
/// sighting in ten far off.
///
/// # Errors
/// A name that cannot be a file's.
pub fn track(name: &str) -> Result<NewFile, InputError> {
    check_name(name)?;
    Ok((format!("{name}.csv"), TRACK.to_owned()))
}

/// A cloud of the built-in `object`, turned and shifted, as a camera sees it from one side.
///
/// # Errors
/// A name that cannot be a file's, an object that is not built in.
pub fn cloud(name: &str, object: &str) -> Result<NewFile, InputError> {
    check_name(name)?;
    let object = Asset::asked(Kind::Object, object, (COMMAND_LINE, "NAME"))?.thrown_object()?;
    let CloudFile { points, normals } = on_surface(&object.mesh);
    let X_CO = Pose::new(Vector3::new(0.1, -0.05, 0.8), Vector3::new(0.4, 0.2, -0.3));
    let is_seen = |p: &Point3<f64>, n: &Vector3<f64>| (X_CO * n).dot(&(X_CO * p).coords) < 0.0;
    let seen = points.iter().zip(normals.iter().flatten()).filter(|(p, n)| is_seen(p, n));
    let mut text = "# x y z in metres, in the frame of the camera that sees them.\n".to_owned();
    for (p, _) in seen.step_by(points.len().div_ceil(MOST_SAMPLES)) {
        let p = X_CO * p;
        text += &format!("{:.5} {:.5} {:.5}\n", p.x, p.y, p.z);
    }
    Ok((format!("{name}.xyz"), text))
}

/// Points of a sample cloud at most, and about twice as many as it has.
const MOST_SAMPLES: usize = 2000;

/// The text of a robot without the surfaces below its capsules, which fit no other capsules.
fn without_depths(text: &str) -> String {
    let mut is_within = false;
    let keeps = |line: &&str| {
        let was_within = is_within;
        is_within = (is_within || line.starts_with("depths_mm = [")) && *line != "]";
        !was_within && !is_within
    };
    text.lines().filter(keeps).flat_map(|line| [line, "\n"]).collect()
}
