//! `catchingbot new`: a commented file to start from.

use std::path::PathBuf;

use catch_body::InputError;
use catch_import::templates;
use catch_lab::assets::Kind;
use catch_recording::whole_file::{COMMAND_LINE, write_new};
use clap::{Args, ValueEnum};
use serde_json::json;

use crate::screen;

/// A commented cell.
const NEW_CELL: &str = include_str!("new_cell.toml");

/// Arguments of `new`.
#[derive(Debug, Args)]
pub struct NewArguments {
    /// Kind of the new file
    #[arg(value_enum)]
    kind: NewKind,
    /// Name: letters, digits, `_` and `-`
    #[arg(value_name = "NAME")]
    name: String,
    /// Folder to put it in
    #[arg(long, value_name = "DIR", default_value = ".")]
    out: PathBuf,
}

#[derive(Debug, Clone, Copy, ValueEnum)]
enum NewKind {
    /// An arm: a URDF and what URDF cannot say
    Robot,
    /// A gripper with two parallel fingers
    Gripper,
    /// Surroundings of an arm
    Workcell,
    /// The data sheet of a camera
    Camera,
    /// Cameras
    Rig,
    /// Something to throw
    Object,
    /// A way of throwing
    Throw,
    /// Everything that a set of trials shares
    Scenario,
    /// A real cell, for `drive` and `doctor`
    Cell,
    /// A sample of a recorded flight, for `predict`
    Track,
    /// A sample of a point cloud, for `register`
    Cloud,
}

/// Writes the files; none is overwritten.
///
/// # Errors
/// A name that cannot be a file's, or that something built in has; a file that is already there.
pub fn run(arguments: &NewArguments, json: bool) -> anyhow::Result<()> {
    let name = &arguments.name;
    let object = Kind::Object.names()[0];
    let of_kind = |kind: Kind, trial: &str| {
        if kind.names().contains(&name.as_str()) {
            let (found, expected) =
                (format!("`{name}`, which is built in"), "another name: options take what is built in");
            return Err(InputError::new(COMMAND_LINE, "NAME", found, expected));
        }
        Ok((templates::files(kind, name)?, trial.to_owned()))
    };
    // Trial command: {} is the first of the files.
    let (new_files, trial) = match arguments.kind {
        NewKind::Robot => of_kind(Kind::Robot, "--robot {}")?,
        NewKind::Gripper => of_kind(Kind::Gripper, "--gripper {}")?,
        NewKind::Workcell => of_kind(Kind::Workcell, "--workcell {}")?,
        NewKind::Camera => of_kind(Kind::Camera, "--set camera={}")?,
        NewKind::Rig => of_kind(Kind::Rig, "--set flight_rig={}")?,
        NewKind::Object => of_kind(Kind::Object, "--object {}")?,
        NewKind::Throw => of_kind(Kind::Throw, "--throw {}")?,
        NewKind::Scenario => of_kind(Kind::Scenario, "--scenario {}")?,
        NewKind::Cell => (vec![(format!("{name}.toml"), NEW_CELL.to_owned())], "drive --dry-run {}".to_owned()),
        NewKind::Track => (vec![templates::track(name)?], "predict --until 0.3 --track {}".to_owned()),
        NewKind::Cloud => {
            (vec![templates::cloud(name, object)?], format!("register --reference {object} --cloud {{}}"))
        }
    };
    let files: Vec<(PathBuf, Vec<u8>)> =
        new_files.into_iter().map(|(name, content)| (arguments.out.join(name), content.into_bytes())).collect();
    write_new(&files, "--out")?;
    let first = files[0].0.to_string_lossy();
    let trial: Vec<String> = trial.split(' ').map(|it| it.replace("{}", &first)).collect();
    let trial: Vec<&str> = trial.iter().map(String::as_str).collect();
    let try_it = screen::command(&trial);
    if json {
        let files: Vec<_> = files.iter().map(|(path, _)| path.to_string_lossy()).collect();
        return screen::document(&json!({ "files": files, "try_it": try_it }));
    }
    for (path, _) in &files {
        screen::fact("written", &path.display().to_string())?;
    }
    if !matches!(arguments.kind, NewKind::Track | NewKind::Cloud) {
        screen::fact("is it right?", &screen::command(&["check", &first]))?;
    }
    Ok(screen::fact("try it", &try_it)?)
}
