//! `catchingbot object`: things to throw that others described.

use std::path::PathBuf;

use catch_body::InputError;
use catch_import::object_import::{ImportOptions, ImportedObject};
use catch_recording::whole_file::{COMMAND_LINE, write_new};
use clap::{Args, Subcommand};
use serde_json::json;

use crate::{number, screen};

/// Commands of `object`.
#[derive(Debug, Subcommand)]
pub enum ObjectCommand {
    Import(ImportArguments),
}

/// Makes an object from a mesh, a point cloud, depth images, or a link that somebody else described
///
/// A mesh (OBJ, STL, PLY, COLLADA, glTF, GLB) becomes the object's shape, and so does the surface
/// of a point cloud all around it (PLY without faces, PCD, XYZ; in metres or millimetres, best with
/// outward normals) and of depth images (a folder with 16-bit PNG files in millimetres, and in its
/// rig.toml a camera for each); of a description (SDF, URDF) its link with a shape does, with mass,
/// centre of mass, inertia, friction and collision shapes. Vertices are welded, holes filled and
/// triangles turned where that is safe; each repair is told, and a defect that is left is located.
/// What no file says is assumed, and says so in the object's file.
///
/// Examples:
///   catchingbot object import scan.ply --out mug
///   catchingbot object import models/drill/model.sdf --out drill
///   catchingbot --object mug
#[derive(Debug, Args)]
#[command(verbatim_doc_comment)]
pub struct ImportArguments {
    /// A mesh, a cloud, a description, or a folder that holds one, or depth images and their rig.toml
    #[arg(value_name = "FILE|FOLDER")]
    source: PathBuf,
    /// The object's folder, for truth.toml, known.toml and its mesh NAME.obj; or a file NAME.toml for both,
    /// its mesh beside it
    #[arg(long, value_name = "DIR|FILE")]
    out: PathBuf,
    /// The link of a description with several
    #[arg(long, value_name = "NAME")]
    link: Option<String>,
    /// Metres per unit of the mesh, or of a depth [default: guessed from its size; a millimetre]
    #[arg(long, value_name = "N", value_parser = number)]
    scale: Option<f64>,
    /// Mass in kg [default: the description's, or that of the volume at 500 kg/m³]
    #[arg(long, value_name = "KG", value_parser = number)]
    mass: Option<f64>,
    /// Fill holes up to this width in metres [default: 0.15 of the longest side, 0.25 in a scan]
    #[arg(long, value_name = "N", value_parser = number)]
    fill_holes: Option<f64>,
}

/// Imports an object.
///
/// # Errors
/// Faults of the files, the options or the place to write to.
pub fn run(ObjectCommand::Import(arguments): &ObjectCommand, json: bool) -> anyhow::Result<()> {
    let out = &arguments.out;
    let fault = |found: String, expected: &str| InputError::new(COMMAND_LINE, "--out", found, expected);
    let is_file = out.extension().is_some_and(|it| it == "toml");
    let stem = if is_file { out.file_stem() } else { out.file_name() }.and_then(|it| it.to_str());
    let stem = stem.ok_or_else(|| fault(format!("`{}`", out.display()), "a folder NAME or a file NAME.toml"))?;
    let options = ImportOptions {
        link: arguments.link.clone(),
        scale: arguments.scale,
        mass_kg: arguments.mass,
        largest_hole_m: arguments.fill_holes,
    };
    let bar = screen::spinner("reading the surface");
    let imported = ImportedObject::read(&arguments.source, stem, &options)?;
    bar.finish_and_clear();

    let folder = if is_file { out.parent().map(PathBuf::from).unwrap_or_default() } else { out.clone() };
    // The object's own file comes last: where it is, all that it names is there.
    let mut files: Vec<(PathBuf, Vec<u8>)> =
        imported.beside.iter().map(|(name, bytes)| (folder.join(name), bytes.clone())).collect();
    let (truth, known) = (imported.truth.clone(), imported.known.clone());
    if is_file {
        files.push((out.clone(), format!("{truth}\n{known}").into_bytes()));
    } else {
        files.push((folder.join("known.toml"), known.into_bytes()));
        files.push((folder.join("truth.toml"), truth.into_bytes()));
    }
    write_new(&files, "--out")?;
    tell(arguments, &imported, json)
}

/// Says what was made, and what to do next.
fn tell(arguments: &ImportArguments, imported: &ImportedObject, json: bool) -> anyhow::Result<()> {
    let object = &imported.object;
    let size_m = object.mesh.aabb().size;
    if json {
        return screen::document(&json!({
            "object": arguments.out.to_string_lossy(),
            "name": object.name,
            "mass_kg": object.mass_kg,
            "volume_m3": object.mesh.volume(),
            "size_m": size_m.as_slice(),
            "triangles": object.mesh.triangles.len(),
            "convex_parts": object.parts.len(),
            "findings": imported.findings,
        }));
    }
    let [x, y, z] = <[f64; 3]>::from(size_m * 1e3);
    let volume_cm3 = object.mesh.volume() * 1e6;
    screen::fact(
        "object",
        &format!("{}: {x:.0} × {y:.0} × {z:.0} mm, {volume_cm3:.0} cm³, {} kg", object.name, object.mass_kg),
    )?;
    for finding in &imported.findings {
        screen::fact("found", finding)?;
    }
    let out = arguments.out.to_string_lossy();
    screen::fact("written", &out)?;
    screen::fact("is it right?", &screen::command(&["check", &out]))?;
    Ok(screen::fact("try it", &screen::command(&["--object", &out]))?)
}
