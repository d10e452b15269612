//! Makes an object of this project from what people have: a mesh, a point cloud or the depth images of a
//! scan, or the link of a description in SDF or URDF.
//!
//! The surface is repaired where that is safe, its unit is guessed where no file says it, and mass properties
//! that no body of that shape can have are left out. Each of these is told.

mod depth_images;
mod draft;
mod mass;
mod normal_signs;
mod scan;
mod source;

use std::path::Path;

use catch_body::{InputError, TriangleMesh, quantity};
use catch_sim::{ThrownObject, object::check_length};

use crate::mesh_repair::repaired;
use catch_recording::whole_file::COMMAND_LINE;
use draft::Draft;
use source::Source;

/// Options of an object's import.
#[derive(Debug, Clone, Default)]
pub struct ImportOptions {
    /// The link of a description with several.
    pub link: Option<String>,
    /// Metres per unit of a mesh; guessed otherwise.
    pub scale: Option<f64>,
    /// Mass in kg, whatever a description says.
    pub mass_kg: Option<f64>,
    /// Width in metres up to which holes are filled, and gaps in a scan closed; a fraction of the longest
    /// side otherwise.
    pub largest_hole_m: Option<f64>,
}

/// An object that was imported, not yet written.
#[derive(Debug, Clone)]
pub struct ImportedObject {
    /// The object as its files describe it.
    pub object: ThrownObject,
    /// The content of the object's `truth.toml`.
    pub truth: String,
    /// The content of the object's `known.toml`.
    pub known: String,
    /// Files beside the object's, by their names.
    pub beside: Vec<(String, Vec<u8>)>,
    /// Findings of the import: the source of the shape, its unit, each repair, and what of a description was
    /// not believed.
    pub findings: Vec<String>,
}

/// Holes are filled up to this fraction of the longest side.
const LARGEST_HOLE: f64 = 0.15;
/// Gaps in a scan are closed up to this fraction of the longest side: nobody sees all of the inside of a cup.
const LARGEST_GAP: f64 = 0.25;
/// Narrower gaps, in metres, are between the points of any scan.
const LEAST_GAP_M: f64 = 0.008;
/// Triangles of an object; more take long to cut into convex parts, and show nothing that a camera in the
/// room could see.
const MOST_TRIANGLES: usize = 30_000;
/// Units of length that a mesh may be in, with metres per unit; the first that makes something to throw.
const UNITS: [(&str, f64); 4] = [("metres", 1.0), ("millimetres", 1e-3), ("centimetres", 1e-2), ("inches", 0.0254)];
/// Lengths in metres of most things that are thrown, and of all.
const LENGTHS_M: [[f64; 2]; 2] = [[0.02, 0.4], [0.005, 0.5]];

impl ImportedObject {
    /// Reads what `path` names, a file or a folder, for an object file of the name `stem`.
    ///
    /// # Errors
    /// Faults of the files or the options; defects of the surface that cannot be repaired, with their places.
    pub fn read(path: &Path, stem: &str, options: &ImportOptions) -> Result<Self, InputError> {
        for (option, range, given) in [
            ("--scale", quantity::SCALE, options.scale),
            ("--fill-holes", quantity::SHAPE_SIZE_M, options.largest_hole_m),
            ("--mass", quantity::THROWN_MASS_KG, options.mass_kg),
        ] {
            given.map(|it| range.check(COMMAND_LINE, option, it)).transpose()?;
        }
        let mut source = Source::read(path, options.link.as_deref(), options.scale)?;
        let mut findings = std::mem::take(&mut source.findings);
        let (scale, unit) = scale_of(&source, options.scale);
        findings.push(unit);
        if scale != 1.0 {
            source.scale(scale);
        }
        let file = source.file.clone();
        let length_m = source.surface.aabb().size.max();
        check_length(&file, "the shape", length_m, "a mesh in millimetres needs `--scale 0.001`")?;

        let largest_hole_m = options.largest_hole_m.unwrap_or(LARGEST_HOLE * length_m);
        let largest_gap_m = options.largest_hole_m.unwrap_or(LARGEST_GAP * length_m);
        if source.gap_m > largest_gap_m.max(LEAST_GAP_M) {
            let found = format!("none on a part of the surface that is {:.0} mm wide", source.gap_m * 1e3);
            let expected = "points all around a solid; `--fill-holes METRES` closes wider gaps";
            return Err(InputError::new(file, "points", found, expected));
        }
        let surface = std::mem::take(&mut source.surface);
        let (mut mesh, repairs) = repaired(&file, &surface, largest_hole_m)?;
        drop(surface);
        findings.extend(repairs);
        if let Some((fewer, cell_m)) = mesh.simplified(MOST_TRIANGLES) {
            let (count, volume) = (fewer.triangles.len(), 100.0 * (fewer.volume() / mesh.volume() - 1.0));
            let cell_mm = cell_m * 1e3;
            findings.push(format!("simplified to {count} triangles of about {cell_mm:.1} mm, volume {volume:+.2} %"));
            mesh = fewer;
        }

        let stated = mass::Stated::of(source.inertia, &mesh, options.mass_kg);
        findings.extend(stated.findings.iter().cloned());
        let parts = source.usable_parts(&mesh);
        findings.extend(parts.as_ref().err().cloned());
        let draft = Draft {
            name: stem.to_owned(),
            source: source.named.clone(),
            mesh: &mesh,
            parts: parts.unwrap_or_default(),
            stated: &stated,
            friction: source.friction,
            restitution: source.restitution,
        };
        let (truth, known, beside) = (draft.truth_toml(), draft.known_toml(), draft.files());
        let load = |name: &str| {
            let found = beside.iter().find(|(file, _)| file == name).map(|(_, bytes)| bytes.clone());
            found.ok_or_else(|| InputError::new(name, "the file", "nothing", "a file of the import"))
        };
        let object = ThrownObject::from_toml(&format!("{stem}.toml"), &truth, &load)?;
        Ok(Self { object, truth, known, beside, findings })
    }
}

/// Metres per unit, and a sentence that says so.
fn scale_of(source: &Source, given: Option<f64>) -> (f64, String) {
    let length = source.surface.aabb().size.max();
    let said = |unit: &str, scale: f64, why: &str| format!("{unit}{why}: {:.1} mm long", length * scale * 1e3);
    if let Some(scale) = given {
        return (scale, said(&format!("units of {scale} m"), scale, ", as --scale says"));
    }
    if source.in_metres {
        return (1.0, said("metres", 1.0, ", as the format says"));
    }
    match unit_of(length) {
        Some((unit, scale)) => (scale, said(unit, scale, ", guessed from its size (`--scale` says otherwise)")),
        None => (1.0, said("metres", 1.0, ", as no unit makes it something to throw")),
    }
}

/// The unit with which something so long can be thrown, and metres per unit.
fn unit_of(length: f64) -> Option<(&'static str, f64)> {
    let within =
        |[least, most]: [f64; 2]| UNITS.into_iter().find(|(_, scale)| (least..=most).contains(&(length * scale)));
    LENGTHS_M.into_iter().find_map(within)
}

/// Volume of all convex hulls of point sets, in m³.
fn hulls_m3(parts: &[TriangleMesh]) -> f64 {
    let hull = |it: &TriangleMesh| catch_sim::object::ColliderPart::Hull(it.vertices.clone()).volume_m3();
    parts.iter().map(hull).sum()
}
