//! Robots, grippers, workcells, objects, throws, cameras, rigs of them, and scenarios: those that are
//! built in, and the user's files.
//!
//! Wherever something is named, a built-in name or the path of a file may stand. A file refers to others by
//! built-in names or by paths relative to itself.

use std::{
    fmt::Display,
    path::{Path, PathBuf},
};

use catch_body::{InputError, visual::mesh_names};
use catch_cell::ObjectFigures;
use catch_sim::{Throw, ThrownObject};
use include_dir::{Dir, include_dir};
use serde::Serialize;

use crate::flights::recorded_throws;
use catch_recording::{bounded_file::FileKind, sources::Meshes};

static BUILT_IN: Dir = include_dir!("$CARGO_MANIFEST_DIR/../../assets");

/// Kind of asset.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Kind {
    /// Everything that belongs to a set of trials.
    Scenario,
    /// An arm: a URDF and the TOML file beside it.
    Robot,
    /// A gripper.
    Gripper,
    /// An object to be thrown: a folder with `truth.toml` and `known.toml`, or a file with both tables.
    Object,
    /// A way of throwing.
    Throw,
    /// Surroundings of an arm.
    Workcell,
    /// The data sheet of a camera.
    Camera,
    /// An arrangement of cameras.
    Rig,
}

/// The brain's knowledge of an object, in the folder of the object.
pub const KNOWN_FILE: &str = "known.toml";
/// Endings of files from which an object can be imported.
const SHAPES: [&str; 8] = ["obj", "stl", "ply", "dae", "gltf", "glb", "sdf", "urdf"];

impl Kind {
    /// All kinds, in the order in which a person would ask for them.
    pub const ALL: [Self; 8] = [
        Self::Scenario,
        Self::Object,
        Self::Throw,
        Self::Robot,
        Self::Gripper,
        Self::Workcell,
        Self::Camera,
        Self::Rig,
    ];

    /// Several of them, which is also the folder of the built-in ones.
    pub fn plural(self) -> String {
        format!("{self}s")
    }

    /// "a robot", "an object".
    fn with_article(self) -> String {
        if self == Self::Object { format!("an {self}") } else { format!("a {self}") }
    }

    /// The file that describes one where it has a folder of its own.
    fn main_file(self) -> String {
        if self == Self::Object { "truth.toml".to_owned() } else { format!("{self}.toml") }
    }

    /// Names of the built-in ones, sorted.
    pub fn names(self) -> Vec<&'static str> {
        let entries = BUILT_IN.get_dir(self.plural()).map(Dir::entries).unwrap_or_default();
        let mut names: Vec<&str> = entries
            .iter()
            .filter(|entry| entry.as_dir().is_some() || entry.path().extension().is_some_and(|it| it == "toml"))
            .filter_map(|entry| entry.path().file_stem()?.to_str())
            .collect();
        names.sort_unstable();
        names.dedup();
        names
    }
}

impl Display for Kind {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        self.serialize(f)
    }
}

/// Origin of an asset's text, from which the files that it names are found.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Origin {
    /// A folder of the built-in assets.
    BuiltIn(PathBuf),
    /// A folder of the user's.
    Disk(PathBuf),
}

/// An asset's description as text.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Asset {
    /// Short name: a built-in name, or the file's without its ending.
    pub name: String,
    /// Name of the file in error messages.
    pub file: String,
    /// Content of the file.
    pub text: String,
    /// Origin of the file.
    pub origin: Origin,
}

impl Asset {
    /// Finds what an argument names; `asked_by` is where the argument stands and its own name.
    ///
    /// # Errors
    /// As [`find`](Self::find).
    pub fn asked(kind: Kind, name: &str, asked_by: (&str, &str)) -> Result<Self, InputError> {
        Self::find(kind, name, &Origin::BuiltIn(PathBuf::new()), asked_by)
    }

    /// Finds what `name` means: a built-in asset or a file.
    ///
    /// # Errors
    /// Names the argument or field `asked_by`, lists what is built in and suggests the nearest.
    pub fn find(kind: Kind, name: &str, asked_by: &Origin, field: (&str, &str)) -> Result<Self, InputError> {
        if kind.names().contains(&name) {
            return Self::built_in(kind, name);
        }
        let path = match asked_by {
            Origin::Disk(folder) => folder.join(name),
            Origin::BuiltIn(_) => PathBuf::from(name),
        };
        if kind == Kind::Throw && path.is_dir() && !path.join(kind.main_file()).exists() {
            return Ok(Self::of_recordings(path));
        }
        let path = if path.is_dir() { path.join(kind.main_file()) } else { path };
        let path = if kind == Kind::Object && path.ends_with(KNOWN_FILE) {
            path.with_file_name(kind.main_file())
        } else {
            path
        };
        let is_shape = |it: &std::ffi::OsStr| SHAPES.iter().any(|known| it.eq_ignore_ascii_case(known));
        if kind == Kind::Object && path.extension().is_some_and(is_shape) {
            let stem = path.file_stem().unwrap_or_default().display();
            let expected = format!(
                "an object, of which files say what it weighs: `catchingbot object import {name} --out {stem}` makes one"
            );
            return Err(InputError::new(field.0, field.1, format!("the shape `{name}`"), expected));
        }
        let is_description = path
            .extension()
            .is_some_and(|it| ["urdf", "xacro", "xml", "mjcf"].iter().any(|known| it.eq_ignore_ascii_case(known)));
        if kind == Kind::Robot && is_description {
            let expected = format!(
                "a robot.toml, which says what a description cannot: `catchingbot robot import {name} --out {}` makes one",
                path.file_stem().unwrap_or_default().display()
            );
            return Err(InputError::new(field.0, field.1, format!("the description `{name}`"), expected));
        }
        let looks_like_path = name.contains(['/', '\\']) || name.ends_with(".toml");
        if looks_like_path || path.is_file() { Self::on_disk(kind, &path) } else { Err(unknown(kind, name, field)) }
    }

    /// The built-in asset of this name.
    ///
    /// # Errors
    /// If there is none.
    pub fn built_in(kind: Kind, name: &str) -> Result<Self, InputError> {
        let folder = PathBuf::from(kind.plural());
        let own = folder.join(name).join(kind.main_file());
        let path = if BUILT_IN.get_file(&own).is_some() { own } else { folder.join(format!("{name}.toml")) };
        let file = path.display().to_string();
        let text = BUILT_IN.get_file(&path).and_then(|it| it.contents_utf8());
        let text =
            text.ok_or_else(|| InputError::new(&file, "the file", "nothing", "a built-in text file"))?.to_owned();
        let origin = Origin::BuiltIn(path.parent().map(Path::to_path_buf).unwrap_or_default());
        Ok(Self { name: name.to_owned(), file, text, origin })
    }

    /// Reads a file that describes a thing of this kind.
    ///
    /// # Errors
    /// If it cannot be read as text.
    pub fn on_disk(kind: Kind, path: &Path) -> Result<Self, InputError> {
        let file = path.display().to_string();
        let built_in = kind.names().join(", ");
        let expected = format!("a readable {kind} file, or one of the built-in {} {built_in}", kind.plural());
        let text = FileKind::toml(&expected).read_text(path)?;
        let folder = path.parent().map(Path::to_path_buf).unwrap_or_default();
        // A thing in a folder of its own bears the folder's name.
        let named_by =
            if path.file_name().is_some_and(|it| *it == *kind.main_file()) { folder.as_path() } else { path };
        let name = named_by.file_stem().or_else(|| path.file_stem());
        let name = name.map(|it| it.to_string_lossy().into_owned()).unwrap_or_default();
        Ok(Self { name, file, text, origin: Origin::Disk(folder) })
    }

    /// The throws that were recorded in a folder, all settings as they are without a file.
    fn of_recordings(folder: PathBuf) -> Self {
        let name = folder.canonicalize().unwrap_or_else(|_| folder.clone());
        let name = name.file_name().map(|it| it.to_string_lossy().into_owned()).unwrap_or_default();
        let text = "[motion]\nkind = \"recorded\"\n".to_owned();
        Self { name, file: folder.display().to_string(), text, origin: Origin::Disk(folder) }
    }

    /// Reads a file that this one names, from beside it.
    ///
    /// # Errors
    /// If there is no such file.
    pub fn read_beside(&self, name: &str) -> Result<(String, Vec<u8>), InputError> {
        match &self.origin {
            Origin::BuiltIn(folder) => {
                let path = folder.join(name);
                let file = path.display().to_string();
                let found = BUILT_IN.get_file(&path).map(|it| it.contents().to_vec());
                let bytes = found.ok_or_else(|| {
                    InputError::new(&file, "the file", "nothing", format!("the {name} of {}", self.file))
                })?;
                Ok((file, bytes))
            }
            Origin::Disk(folder) => {
                let file = folder.join(name).display().to_string();
                let expected = format!("the {name} of {}", self.file);
                let bytes = FileKind::geometry(&expected).read(Path::new(&file))?;
                Ok((file, bytes))
            }
        }
    }

    /// The object that this file describes.
    ///
    /// # Errors
    /// A fault in the file, or in the mesh that it names.
    pub fn thrown_object(&self) -> Result<ThrownObject, InputError> {
        ThrownObject::from_toml(&self.file, &self.text, &|name| Ok(self.read_beside(name)?.1))
    }

    /// The brain's knowledge of the object that this file describes: of `known.toml` beside a `truth.toml`,
    /// or of the file's own table.
    ///
    /// # Errors
    /// A fault in that file, or a table of knowledge within `truth.toml`, which nobody would read.
    pub fn known_figures(&self) -> Result<ObjectFigures, InputError> {
        if !Path::new(&self.file).ends_with(Kind::Object.main_file()) {
            return ObjectFigures::from_toml(&self.file, &self.text);
        }
        let table: toml::Table = InputError::parse_toml(&self.file, &self.text)?;
        if let Some(name) = ["known", "prior"].into_iter().find(|it| table.contains_key(*it)) {
            let expected = format!("this table in {KNOWN_FILE} beside it");
            return Err(InputError::new(&self.file, name, "a table", expected));
        }
        let (file, text) = self.read_text_beside(KNOWN_FILE)?;
        ObjectFigures::from_toml(&file, &text)
    }

    /// The throw that this file describes, with the recordings that it names.
    ///
    /// # Errors
    /// A fault in the file, or in a recording.
    pub fn throw(&self) -> Result<Throw, InputError> {
        let folder = match &self.origin {
            Origin::Disk(folder) => folder.as_path(),
            Origin::BuiltIn(_) => Path::new(""),
        };
        Throw::from_toml_with(&self.file, &self.text, &|tracks, up| recorded_throws::read(&folder.join(tracks), up))
    }

    /// Texts of the meshes of visual shapes that this file names.
    ///
    /// # Errors
    /// If one of them is not there or is not text.
    pub fn meshes(&self) -> Result<Meshes, InputError> {
        let names = mesh_names(&self.text).into_iter();
        names.map(|name| self.read_text_beside(&name).map(|(_, text)| (name, text))).collect()
    }

    /// Like [`read_beside`](Self::read_beside), for text.
    ///
    /// # Errors
    /// If there is no such file or it is not text.
    pub fn read_text_beside(&self, name: &str) -> Result<(String, String), InputError> {
        let (file, bytes) = self.read_beside(name)?;
        let text = FileKind::text("text").decode(&file, bytes)?;
        Ok((file, text))
    }
}

/// The built-in files in a folder and in the folders within, by their paths.
pub fn built_in_files(folder: &str) -> Vec<(String, &'static [u8])> {
    let Some(folder) = BUILT_IN.get_dir(folder) else { return Vec::new() };
    let within = |path: &Path| path.to_string_lossy().into_owned();
    let mut files: Vec<(String, &[u8])> = folder.files().map(|it| (within(it.path()), it.contents())).collect();
    files.extend(folder.dirs().flat_map(|it| built_in_files(&within(it.path()))));
    files.sort_unstable();
    files
}

/// The error for a name that means nothing: what there is, and what was probably meant.
fn unknown(kind: Kind, name: &str, (file, field): (&str, &str)) -> InputError {
    let names = kind.names();
    let hint = did_you_mean(nearest(name, &names));
    let expected = format!("one of {}, or the path of {} file{hint}", names.join(", "), kind.with_article());
    InputError::new(file, field, format!("`{name}`"), expected)
}

/// Addition to what an error expects, where something else was probably meant.
pub fn did_you_mean(meant: Option<&str>) -> String {
    meant.map_or_else(String::new, |it| format!(" (did you mean `{it}`?)"))
}

/// The candidate that is spelt most like `name`, if any comes near.
pub fn nearest<'a>(name: &str, candidates: &[&'a str]) -> Option<&'a str> {
    let distance = |it: &str| strsim::damerau_levenshtein(&name.to_lowercase(), it);
    let best = candidates.iter().copied().min_by_key(|it| distance(it))?;
    (distance(best) <= 1 + best.len().max(name.len()) / 3).then_some(best)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_built_in_asset_can_be_read() {
        for kind in Kind::ALL {
            assert!(!kind.names().is_empty(), "there is no {kind}");
            for name in kind.names() {
                let asset = Asset::asked(kind, name, ("test", "name")).unwrap();
                assert_eq!(asset.name, name);
            }
        }
    }

    #[test]
    fn a_misspelt_name_gets_the_nearest_one() {
        assert_eq!(nearest("tenis_ball", &["banana", "tennis_ball"]), Some("tennis_ball"));
        assert_eq!(nearest("xyz", &["banana", "tennis_ball"]), None);
    }
}
