//! Objects that others scanned or modelled: fetched, imported by one command each, and thrown in the scenario
//! `honest`.

use std::{
    collections::BTreeMap,
    fs,
    path::{Path, PathBuf},
    process::Command,
};

use anyhow::{Context, Result, bail};
use catch_bot::perception::Symmetry;
use catch_import::object_import::{ImportOptions, ImportedObject};
use catch_lab::{
    referee::{Verdict, reason::Reason},
    scenario::setup::Setup,
    trial::Trial,
};
use serde::Deserialize;

use crate::{
    Options,
    rates::{self, judged, misses},
    results::{Entry, Table},
    spread::{percent, rate},
};

/// Folder of the collections, fetched or given, and of the files made of them.
const FOLDER: &str = "target/objects";
/// Time after the first pose at which the spin is compared, and the error from which it is wrong.
const SPIN_SEEN_S: f64 = 0.15;
const WRONG_RADPS: f64 = 3.0;

#[derive(Debug, Deserialize)]
struct Listed {
    collection: Vec<Collection>,
    /// Objects, as paths of collections.
    objects: Vec<String>,
    /// Objects that are counted together as well, by their names.
    groups: BTreeMap<String, Vec<String>>,
}

#[derive(Debug, Deserialize)]
struct Collection {
    name: String,
    address: String,
}

/// Imports, and throws of the listed objects.
pub fn run(options: &Options) -> Result<Vec<Table>> {
    let listed: Listed = toml::from_str(include_str!("objects.toml")).context("objects.toml")?;
    let folder = Path::new(FOLDER);
    for collection in &listed.collection {
        fetch(collection, folder)?;
    }
    let columns = [
        ["object", "mass, kg", "volume, %", "centre of mass, mm", "grasps"],
        ["throws", "caught, %", "spin wrong, %", "limits broken", "misses"],
    ];
    let mut thrown = Table::new("Throws of `honest`", &columns.concat());
    let mut outcomes = BTreeMap::new();
    for (number, object) in listed.objects.iter().enumerate() {
        let path = written(&folder.join(object), &folder.join("imported"))?;
        let setup = rates::setup("honest", &path.to_string_lossy())?;
        // Some throws are hard for any object: each has its own.
        let seed = options.seed + number as u64;
        let each = judged(&setup, seed, 0..options.trials, |trial, verdict| Outcome::of(&setup, trial, &verdict));
        let name = vec![Entry::text(&setup.object.name)];
        thrown.rows.push([name, model(&setup), Outcome::entries(&each)].concat());
        outcomes.insert(setup.object.name, each);
    }
    let (all, every) = ("all".to_owned(), outcomes.keys().cloned().collect());
    for (name, objects) in std::iter::once((&all, &every)).chain(&listed.groups) {
        let mut together = Vec::new();
        for object in objects {
            let each = outcomes.get(object).with_context(|| format!("objects.toml: {object} is not thrown"))?;
            together.extend(each.iter().cloned());
        }
        let none = vec![Entry::text(""); 4];
        thrown.rows.push([vec![Entry::text(name)], none, Outcome::entries(&together)].concat());
    }
    Ok(vec![thrown])
}

/// Brings a collection here.
fn fetch(collection: &Collection, folder: &Path) -> Result<()> {
    let to = folder.join(&collection.name);
    if to.is_dir() {
        return Ok(());
    }
    let status = Command::new("git").args(["clone", "--depth", "1", &collection.address]).arg(&to).status()?;
    if !status.success() {
        bail!("{} could not be fetched to {}", collection.address, to.display());
    }
    Ok(())
}

/// Imports an object and writes its files; returns the path of its description.
fn written(source: &Path, folder: &Path) -> Result<PathBuf> {
    let stem = source.file_stem().context("an object's path has a name")?.to_string_lossy();
    let object = ImportedObject::read(source, &stem, &ImportOptions::default())?;
    fs::create_dir_all(folder)?;
    for (name, bytes) in &object.beside {
        fs::write(folder.join(name), bytes)?;
    }
    let path = folder.join(format!("{stem}.toml"));
    fs::write(&path, object.truth + "\n" + &object.known)?;
    Ok(path)
}

/// Describes the model that the brain made of the scan.
fn model(setup: &Setup) -> Vec<Entry> {
    let known = setup.known();
    let (reference, object) = (&known.reference, &setup.object);
    let uniform = object.mesh.mass_properties(object.mass_kg).com;
    vec![
        Entry::Number(Some(object.mass_kg)),
        Entry::Number(Some(100.0 * reference.volume_m3 / object.mesh.volume())),
        Entry::Number(Some(1e3 * (reference.X_RO.translation.vector - uniform.coords).norm())),
        Entry::Count(known.grasps.grasps.len()),
    ]
}

/// Result of a throw.
#[derive(Debug, Clone)]
struct Outcome {
    caught: bool,
    /// Error of the spin, where it was predicted.
    spin_radps: Option<f64>,
    breaks_limits: bool,
    reason: Option<Reason>,
}

impl Outcome {
    fn of(setup: &Setup, trial: &Trial, verdict: &Verdict) -> Self {
        Self {
            caught: verdict.caught,
            spin_radps: spin_error_radps(setup, trial, verdict),
            breaks_limits: verdict.limit_violations > 0,
            reason: verdict.reason,
        }
    }

    fn entries(all: &[Self]) -> Vec<Entry> {
        let spins: Vec<f64> = all.iter().filter_map(|it| it.spin_radps).collect();
        vec![
            Entry::Count(all.len()),
            rate(all.iter().filter(|it| it.caught).count(), all.len()),
            percent(spins.iter().filter(|it| **it > WRONG_RADPS).count(), spins.len()),
            Entry::Count(all.iter().filter(|it| it.breaks_limits).count()),
            misses(all.iter().filter_map(|it| it.reason)),
        ]
    }
}

/// Error of the angular velocity when the object had been seen for a while and nothing had touched it; of
/// objects whose rotation can be seen.
fn spin_error_radps(setup: &Setup, trial: &Trial, verdict: &Verdict) -> Option<f64> {
    if !matches!(setup.known().reference.symmetry, Symmetry::Finite { .. }) {
        return None;
    }
    let reports = || trial.snapshots.iter().filter_map(|it| it.report.as_ref());
    let first_s = reports().find_map(|it| it.pose.as_ref()).map(|it| it.capture_s)?;
    let until_s = (first_s + SPIN_SEEN_S).min(verdict.contact_s.unwrap_or(f64::INFINITY));
    let flight = reports().filter_map(|it| it.flight.as_ref()).rfind(|it| it.time_s <= until_s + 1e-6)?;
    let sample = trial.truth.samples.iter().find(|it| it.time_s >= flight.time_s - 1e-6)?;
    Some((flight.twist_at(sample.time_s).angular - sample.V_WO.angular).norm())
}
