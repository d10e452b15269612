//! Objects of a list of parameters, written as files of objects.

use std::{
    fmt::Write as _,
    fs,
    path::{Path, PathBuf},
};

use anyhow::{Context, Result};
use catch_lab::assets::{Asset, Kind, Origin};
use catch_sim::object::hull_area_m2;
use serde::Deserialize;
use toml::{Table, Value};

/// Air at 20 °C, in kg/m³.
const AIR_KGPM3: f64 = 1.204;
/// Standard deviation of the drag as a fraction of it; that of the built-in objects is known to about a
/// fifth.
const DRAG_SD_FRACTION: f64 = 0.2;
/// The list.
pub const LIST: &str = include_str!("training_objects.toml");

#[derive(Debug, Deserialize)]
struct Listed {
    object: Vec<TrainingObject>,
}

/// Something to throw.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TrainingObject {
    /// Name.
    pub name: String,
    /// True if no weight is fitted or chosen on the object.
    #[serde(default)]
    pub held_out: bool,
    mass_kg: f64,
    restitution: f64,
    drag_coefficient: f64,
    stiffness_npm: Option<f64>,
    shape: Table,
}

/// A polygon along z.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Prism {
    #[serde(rename = "kind")]
    _kind: String,
    height_m: f64,
    /// Points (x, y), counterclockwise, all seen from the origin.
    polygon_m: Vec<[f64; 2]>,
}

/// The objects of the list.
///
/// # Errors
/// If it cannot be read.
pub fn listed() -> Result<Vec<TrainingObject>> {
    let Listed { object } = toml::from_str(LIST).context("training_objects.toml")?;
    Ok(object)
}

impl TrainingObject {
    /// Writes its files into a folder; returns the path by which a scenario names it.
    ///
    /// Its drag is k = ½·ρ·C_D·A/m, where A, the mean area of the shadow of its convex hull, is a quarter of
    /// the hull's surface (Cauchy).
    ///
    /// # Errors
    /// If a file cannot be written or is none of an object.
    pub fn written(&self, folder: &Path) -> Result<PathBuf> {
        fs::create_dir_all(folder).with_context(|| folder.display().to_string())?;
        let shape = self.shape_in(folder)?;
        let path = self.written_with_drag(folder, &shape, 0.0)?;
        let text = path.display().to_string();
        let thrown =
            Asset::find(Kind::Object, &text, &Origin::Disk(".".into()), ("object", &self.name))?.thrown_object()?;
        let area_m2 = hull_area_m2(&thrown.mesh.vertices) / 4.0;
        self.written_with_drag(folder, &shape, 0.5 * AIR_KGPM3 * self.drag_coefficient * area_m2 / self.mass_kg)
    }

    /// Writes the object's file: what it is and what is known of it, which agree but for how well the drag is
    /// known.
    fn written_with_drag(&self, folder: &Path, shape: &Table, drag_per_m: f64) -> Result<PathBuf> {
        let numbers = |pairs: &[(&str, f64)]| -> Table {
            pairs.iter().map(|(key, value)| ((*key).to_owned(), Value::Float(*value))).collect()
        };
        let known = [("mass_kg", self.mass_kg), ("restitution", self.restitution), ("drag_per_m", drag_per_m)];
        let mut truth = numbers(&known);
        truth.extend(self.stiffness_npm.map(|it| ("stiffness_npm".to_owned(), Value::Float(it))));
        truth.insert("shape".to_owned(), Value::Table(shape.clone()));
        let mut figures = numbers(&known);
        figures.insert("drag_sd_per_m".to_owned(), Value::Float(DRAG_SD_FRACTION * drag_per_m));
        let name = Value::String(self.name.clone());
        let tables = [("name", name), ("truth", Value::Table(truth)), ("known", Value::Table(figures))];
        let file: Table = tables.into_iter().map(|(key, value)| (key.to_owned(), value)).collect();
        let path = folder.join(format!("{}.toml", self.name));
        fs::write(&path, toml::to_string(&file)?).with_context(|| path.display().to_string())?;
        Ok(path)
    }

    /// Returns the shape as an object's file has it: a prism becomes a mesh in the folder.
    fn shape_in(&self, folder: &Path) -> Result<Table> {
        if self.shape.get("kind").and_then(Value::as_str) != Some("prism") {
            return Ok(self.shape.clone());
        }
        let prism: Prism = self.shape.clone().try_into().with_context(|| self.name.clone())?;
        let file = format!("{}.obj", self.name);
        fs::write(folder.join(&file), prism.obj())?;
        let fields = [("kind", "mesh".to_owned()), ("file", file)];
        Ok(fields.into_iter().map(|(key, value)| (key.to_owned(), Value::String(value))).collect())
    }
}

impl Prism {
    /// Returns the prism as an OBJ file: a fan around the middle of each end, and two triangles for each
    /// side.
    fn obj(&self) -> String {
        let Self { height_m, polygon_m, .. } = self;
        let count = polygon_m.len();
        let mut text = String::new();
        for z in [-0.5 * height_m, 0.5 * height_m] {
            for [x, y] in polygon_m.iter().chain([&[0.0, 0.0]]) {
                let _ = writeln!(text, "v {x} {y} {z}");
            }
        }
        // Vertices count from one; the middle of an end comes after its corners.
        let (low, high) = (|i: usize| 1 + i % count, |i: usize| count + 2 + i % count);
        let (low_middle, high_middle) = (count + 1, 2 * count + 2);
        for i in 0..count {
            let triangles = [
                [low_middle, low(i + 1), low(i)],
                [high_middle, high(i), high(i + 1)],
                [low(i), low(i + 1), high(i + 1)],
                [low(i), high(i + 1), high(i)],
            ];
            for [a, b, c] in triangles {
                let _ = writeln!(text, "f {a} {b} {c}");
            }
        }
        text
    }
}

#[cfg(test)]
mod tests {
    use std::f64::consts::PI;

    use super::*;

    fn folder(name: &str) -> PathBuf {
        std::env::temp_dir().join(format!("catch_experiments_{name}_{}", std::process::id()))
    }

    fn thrown(object: &TrainingObject, folder: &Path) -> catch_sim::ThrownObject {
        let path = object.written(folder).unwrap().display().to_string();
        let asset = Asset::find(Kind::Object, &path, &Origin::Disk(".".into()), ("object", &object.name)).unwrap();
        asset.thrown_object().unwrap()
    }

    #[test]
    fn every_listed_object_is_one_and_none_is_built_in() {
        let folder = folder("training");
        let objects = listed().unwrap();
        assert!(objects.iter().filter(|it| !it.held_out).count() >= 12);
        for object in &objects {
            let thrown = thrown(object, &folder);
            assert!((0.03..=0.4).contains(&thrown.mass_kg), "{}", object.name);
            assert!((0.005..0.2).contains(&thrown.drag_per_m), "{}: {}", object.name, thrown.drag_per_m);
            assert!(!Kind::Object.names().contains(&object.name.as_str()), "{}", object.name);
            let diameter_m = object.shape.get("diameter_m").and_then(Value::as_float);
            assert!(diameter_m.is_none_or(|it| (it - 0.0672).abs() > 5e-3), "{}", object.name);
        }
        fs::remove_dir_all(folder).unwrap();
    }

    #[test]
    fn prisms_have_the_volume_of_their_polygon_also_where_they_are_not_convex() {
        let folder = folder("prisms");
        let objects = listed().unwrap();
        for (name, volume_m3) in [
            ("box", 0.06 * 0.04 * 0.09),
            ("angle_iron", (0.110 * 0.024 + 0.024 * 0.056) * 0.028),
            ("mallet", (0.08 * 0.036 + 0.022 * 0.102) * 0.03),
        ] {
            let object = objects.iter().find(|it| it.name == name).unwrap();
            let thrown = thrown(object, &folder);
            assert!((thrown.mesh.volume() - volume_m3).abs() < 1e-9, "{name}: {}", thrown.mesh.volume());
            assert!((thrown.parts_volume_ratio() - 1.0).abs() < 0.02, "{name}: {}", thrown.parts_volume_ratio());
        }
        fs::remove_dir_all(folder).unwrap();
    }

    /// k = ½·ρ·C_D·π·r²/m.
    #[test]
    fn drag_of_a_ball_is_that_of_its_shadow() {
        let folder = folder("drag");
        let ball = listed().unwrap().into_iter().find(|it| it.name == "rubber_ball").unwrap();
        let expected = 0.5 * AIR_KGPM3 * 0.5 * PI * 0.027 * 0.027 / 0.085;
        let found = thrown(&ball, &folder).drag_per_m;
        assert!((found / expected - 1.0).abs() < 0.01, "{found} {expected}");
        fs::remove_dir_all(folder).unwrap();
    }
}
