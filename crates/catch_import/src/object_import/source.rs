//! Source of an imported object: the triangles of a mesh, or a link with all that its description says of it.

use std::path::{Path, PathBuf};

use crate::{
    capsule_fit::directions,
    cloud_file,
    description::{Description, Geometry, Link},
    mesh_files::MeshFiles,
    model_of_mujoco,
    surface_file::{self, PlyFile},
};
use catch_body::{InputError, TriangleMesh, document::root_element, quantity, robot::Inertia};
use nalgebra::{Point3, Vector3};

use super::{
    depth_images, hulls_m3,
    scan::{self, Scanned},
    unit_of,
};
use catch_recording::{
    bounded_file::{FileKind, paths_in},
    whole_file::COMMAND_LINE,
};

/// Endings of the files of which a folder may have one, the most telling first.
const ENDINGS: [&[&str]; 9] =
    [&["sdf"], &["urdf"], &["xml", "mjcf"], &["glb"], &["gltf"], &["obj"], &["ply"], &["stl", "dae"], &["pcd", "xyz"]];
/// Files with a surface, or with points of one.
const FILE: FileKind =
    FileKind::geometry("a mesh: .obj, .stl, .ply, .dae, .gltf or .glb, or a cloud: .ply, .pcd or .xyz");
/// Names of links that are told.
const MOST_NAMES: usize = 20;
/// Greatest number of convex parts of an object.
const MOST_PARTS: usize = 64;
/// Collision shapes fill the object if their volume is that many times its own.
const PARTS_FILL: [f64; 2] = [0.8, 1.35];
/// A part is convex if its hull has no more than this many times its own volume.
const CONVEX: f64 = 1.1;
/// Fraction of the object's longest side by which collision shapes may stick out of the box around the
/// object.
const STICKS_OUT: f64 = 0.05;
/// Largest distance in metres, in any direction, between the ends of the collision shapes and of the object:
/// fingers touch what collides.
const ENDS_OFF_M: f64 = 0.001;
/// Number of directions in which this distance is measured.
const DIRECTIONS: usize = 200;
/// Source of an object, as it was found.
#[derive(Debug, Clone, Default)]
pub(super) struct Source {
    /// Name of the file in errors.
    pub file: String,
    /// Name of the file, and of the link.
    pub named: String,
    /// The surface as its files have it, in the frame of the link or of the mesh.
    pub surface: TriangleMesh,
    /// True if the surface is in metres, by its format.
    pub in_metres: bool,
    /// Mass properties that the description states.
    pub inertia: Option<Inertia>,
    /// Coulomb friction coefficient.
    pub friction: Option<f64>,
    /// Coefficient of restitution.
    pub restitution: Option<f64>,
    /// Shapes for collisions, if they are others than the surface.
    parts: Vec<TriangleMesh>,
    /// Findings that a reader may want to know.
    pub findings: Vec<String>,
    /// Width of the widest part of the surface on which a scan shows nothing, in metres.
    pub gap_m: f64,
}

impl Source {
    /// Reads a file, or the one of a folder that says most; `scale` is in metres per unit, if it is known.
    ///
    /// # Errors
    /// A fault of the file or its link.
    pub fn read(path: &Path, link: Option<&str>, scale: Option<f64>) -> Result<Self, InputError> {
        let is_scan = path.join(depth_images::RIG).is_file();
        let path = if path.is_dir() && !is_scan { within(path)? } else { path.to_path_buf() };
        let is_description = !is_scan && ["sdf", "urdf", "xml", "mjcf"].contains(&ending(&path).as_str());
        if let Some(link) = link.filter(|_| !is_description) {
            let found = format!("`{link}` for {}, which has no links", path.display());
            return Err(InputError::new(COMMAND_LINE, "--link", found, "a description, SDF or URDF, or no --link"));
        }
        let file = path.display().to_string();
        if is_scan {
            let Scanned { surface, findings, gap_m } = depth_images::surface(&path, scale)?;
            let named = format!("depth images of {file}");
            return Ok(Self { file, named, surface, in_metres: true, findings, gap_m, ..Self::default() });
        }
        let named = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        if !is_description {
            let bytes = FILE.read(&path)?;
            if is_cloud(&path, &bytes) {
                let cloud = cloud_file::parse(&file, &bytes, false)?;
                let scale = scale.unwrap_or_else(|| unit_of(scan::length(&cloud)).map_or(1.0, |(_, scale)| scale));
                let Scanned { surface, findings, gap_m } = scan::surface(&file, cloud, scale)?;
                return Ok(Self { file, named, surface, findings, gap_m, ..Self::default() });
            }
            drop(bytes);
            if !ENDINGS.iter().any(|it| it.contains(&ending(&path).as_str())) {
                return Err(InputError::new(file, "extension", format!("`{}`", ending(&path)), FILE.expected));
            }
            let (groups, in_metres) = surface_file::read(&path)?;
            let surface = TriangleMesh::merged(groups);
            let findings = vec![format!("{file}: {} triangles", surface.triangles.len())];
            return Ok(Self { file, named, surface, in_metres, findings, ..Self::default() });
        }
        let text = FileKind::text("a description of an object, SDF or URDF").read_text(&path)?;
        // Some files declare a version of XML that never was.
        let text = text.replacen("<?xml version=\"0.0\"", "<?xml version=\"1.0\"", 1);
        let description = match root_element(&text) {
            Some("mujoco") => return Err(model_of_mujoco(&file)),
            Some("sdf") => Description::from_sdf(&file, &text)?,
            _ => Description::from_urdf(&file, &text)?,
        };
        let (name, link) = chosen(&description, link)?;
        let mut source = Self::of_link(&path, &named, name, link)?;
        let weighs = |it: &Link| it.inertia.is_some_and(|it| it.mass > 0.0);
        let others = description.links.iter().filter(|(other, it)| *other != name && weighs(it));
        let others: Vec<&str> = others.take(MOST_NAMES).map(|(other, _)| other.as_str()).collect();
        if !others.is_empty() {
            source.findings.push(format!("without the masses of other links: {}", others.join(", ")));
        }
        Ok(source)
    }

    fn of_link(path: &Path, named: &str, name: &str, link: &Link) -> Result<Self, InputError> {
        let mut source = Self {
            file: path.display().to_string(),
            named: format!("link {name} of {named}"),
            in_metres: true,
            inertia: link.inertia,
            friction: link.friction.filter(|it| quantity::FRICTION.contains(*it)),
            restitution: link.restitution,
            ..Self::default()
        };
        let mut meshes = MeshFiles::new(path);
        let mut read = |shapes: &[Geometry]| meshes.placed(name, shapes, |_, _| None);
        let ((visuals, mut faults), (collisions, others)) = (read(&link.visuals)?, read(&link.collisions)?);
        faults.extend(others);
        source.findings.extend(faults.iter().map(|it| format!("not read: {it}")));
        let of_visuals = !visuals.is_empty();
        source.surface = TriangleMesh::merged(if of_visuals { visuals } else { collisions.clone() });
        if source.surface.triangles.is_empty() {
            let none = || InputError::new(&source.file, format!("link {name}"), "no shape", "a visual or a collision");
            return Err(faults.into_iter().next().unwrap_or_else(none));
        }
        if let (Some(stated), None) = (link.friction, source.friction) {
            source.findings.push(format!("a friction coefficient of {stated} is none of a surface, and is not used"));
        }
        if !link.unused.is_empty() {
            source.findings.push(format!("friction coefficients that are not used: {}", link.unused.join(", ")));
        }
        let (count, from) = (source.surface.triangles.len(), if of_visuals { "visual" } else { "collision" });
        source.findings.insert(0, format!("{}: {count} triangles of its {from} shape", source.named));
        source.parts = collisions;
        Ok(source)
    }

    /// Scales the surface and the collision shapes.
    pub fn scale(&mut self, scale: f64) {
        let meshes = std::iter::once(&mut self.surface).chain(&mut self.parts);
        meshes.flat_map(|it| &mut it.vertices).for_each(|it| it.coords *= scale);
    }

    /// The collision shapes, if they fill the solid and little more.
    ///
    /// # Errors
    /// A sentence that says why they are not used; an empty list is no error.
    pub fn usable_parts(&self, solid: &TriangleMesh) -> Result<Vec<TriangleMesh>, String> {
        let bounds = solid.aabb();
        let most = bounds.size / 2.0 + Vector3::repeat(STICKS_OUT * bounds.size.max());
        let is_within =
            |p: &Point3<f64>| (p - bounds.centre).abs().zip_fold(&most, true, |all, at, most| all && at <= most);
        let solids: Vec<TriangleMesh> = self
            .parts
            .iter()
            .filter(|it| hulls_m3(std::slice::from_ref(it)) > 1e-6 * solid.volume())
            .cloned()
            .collect();
        if solids.is_empty() {
            return Ok(solids);
        }
        if solids.len() > MOST_PARTS || !solids.iter().flat_map(|it| &it.vertices).all(is_within) {
            return Err("the collision shapes are not where the surface is, so it is cut into convex parts anew".into());
        }
        // Other programs collide with a mesh as it is, not with its hull.
        if solids.iter().any(|it| hulls_m3(std::slice::from_ref(it)) > CONVEX * it.volume().abs()) {
            return Err("the collision shapes are not convex, so the surface is cut into convex parts anew".into());
        }
        let ratio = hulls_m3(&solids) / solid.volume();
        if !(PARTS_FILL[0]..=PARTS_FILL[1]).contains(&ratio) {
            return Err(format!(
                "the collision shapes fill {ratio:.2} times the object, so it is cut into convex parts anew"
            ));
        }
        let off_m = ends_off_m(&solids, solid);
        if off_m <= ENDS_OFF_M {
            return Ok(solids);
        }
        let off_mm = off_m * 1e3;
        Err(format!(
            "the collision shapes end {off_mm:.1} mm from where the surface does, so it is cut into convex parts anew"
        ))
    }
}

/// Distance between the ends of the parts and of the solid, at most in any direction, in metres.
fn ends_off_m(parts: &[TriangleMesh], solid: &TriangleMesh) -> f64 {
    let end = |mesh: &TriangleMesh, direction: &Vector3<f64>| {
        mesh.vertices.iter().map(|it| it.coords.dot(direction)).fold(f64::NEG_INFINITY, f64::max)
    };
    let off = directions(DIRECTIONS).map(|direction| {
        let of_parts = parts.iter().map(|it| end(it, &direction)).fold(f64::NEG_INFINITY, f64::max);
        (of_parts - end(solid, &direction)).abs()
    });
    off.fold(0.0, f64::max)
}

/// The file of a folder that says most.
fn within(folder: &Path) -> Result<PathBuf, InputError> {
    let mut files = paths_in(folder, "a readable folder")?;
    files.retain(|it| it.is_file());
    for endings in ENDINGS {
        let found: Vec<&PathBuf> = files.iter().filter(|it| endings.contains(&ending(it).as_str())).collect();
        match &found[..] {
            [] => {}
            [one] => return Ok((*one).clone()),
            all => {
                let names: Vec<_> = all.iter().take(10).filter_map(|it| it.file_name()?.to_str()).collect();
                let found = format!("{} files: {}", all.len(), names.join(", "));
                return Err(InputError::new(folder.display(), "the folder", found, "one of them as FILE"));
            }
        }
    }
    let expected = "a folder with an SDF or URDF file, with a mesh, or with depth images and their rig.toml";
    Err(InputError::new(folder.display(), "the folder", "none of them", expected))
}

fn ending(path: &Path) -> String {
    path.extension().and_then(|it| it.to_str()).unwrap_or_default().to_ascii_lowercase()
}

/// The link that is meant: the only one with a shape, or the one that was named.
fn chosen<'a>(description: &'a Description, named: Option<&str>) -> Result<(&'a str, &'a Link), InputError> {
    let has_shape = |(_, link): &(&String, &Link)| !link.visuals.is_empty() || !link.collisions.is_empty();
    let links: Vec<(&String, &Link)> = description.links.iter().filter(has_shape).collect();
    let names = || links.iter().take(MOST_NAMES).map(|(name, _)| name.as_str()).collect::<Vec<_>>().join(", ");
    if let Some(named) = named {
        let found = links.iter().find(|(name, _)| *name == named);
        let missing = || InputError::new(COMMAND_LINE, "--link", format!("`{named}`"), format!("one of {}", names()));
        return found.map(|(name, link)| (name.as_str(), *link)).ok_or_else(missing);
    }
    match links[..] {
        [(name, link)] => Ok((name, link)),
        [] => Err(InputError::new(&description.file, "link", "none with a shape", "a visual or a collision")),
        _ => {
            let found = format!("{} with shapes: {}", links.len(), names());
            Err(InputError::new(&description.file, "link", found, "one of them as `--link NAME`"))
        }
    }
}

/// Returns whether a file has points without faces.
fn is_cloud(path: &Path, bytes: &[u8]) -> bool {
    match ending(path).as_str() {
        "pcd" | "xyz" => true,
        "ply" => PlyFile::from_bytes("", bytes).is_ok_and(|it| it.mesh.triangles.is_empty()),
        _ => false,
    }
}
