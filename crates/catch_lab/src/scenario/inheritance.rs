//! `extends`: a scenario's file that says only what differs from another one.

use std::path::{Path, PathBuf};

use catch_body::InputError;
use toml::{Table, Value};

use crate::{
    assets::{Asset, Kind, Origin},
    scenario::{Scenario, depth_errors},
};

/// The field that names the scenario that a file extends.
const FIELD: &str = "extends";
/// Fields that name one of several kinds, some with figures in a table: another kind takes its place.
const KINDS: [&str; 2] = ["clock", "model"];

/// The table of a scenario's file, laid over that of the scenario which it extends, over that of the one
/// which this extends, and so on.
///
/// Tables are merged field by field, however they are written; any other value replaces the one below it.
///
/// # Errors
/// A file that is no TOML, one that extends nothing known or itself, or a fault in one of those that it
/// extends.
pub(super) fn extended(asset: &Asset) -> Result<Table, InputError> {
    extended_after(asset, &mut Vec::new())
}

/// A fault in a scenario's file, which may have this field besides those of a scenario.
pub(super) fn with_own_field(fault: InputError) -> InputError {
    let expected = fault.expected.replace("`name`, `description`", &format!("`{FIELD}`, `name`, `description`"));
    InputError { expected, ..fault }
}

fn extended_after(asset: &Asset, before: &mut Vec<String>) -> Result<Table, InputError> {
    let mut table: Table = InputError::parse_toml(&asset.file, &asset.text)?;
    let Some(base) = table.remove(FIELD) else { return Ok(table) };
    let fault = |found: String, expected: &str| InputError::new(&asset.file, FIELD, found, expected);
    let Value::String(name) = base else {
        return Err(fault(base.to_string(), "the name of a scenario, or the path of its file"));
    };
    before.push(asset.file.clone());
    let base = Asset::find(Kind::Scenario, &name, &asset.origin, (&asset.file, FIELD))?;
    if before.contains(&base.file) {
        return Err(fault(format!("`{name}`"), "a scenario that does not extend this one in turn"));
    }
    let mut below = extended_after(&base, before)?;
    // The file's own faults bear its own name.
    let mut complete = below.clone();
    depth_errors::fill_in(&mut complete, &base.file)?;
    let (scenario, faults): (Scenario, _) = InputError::from_table(&base.file, complete)?;
    InputError::first_of(faults.into_iter().chain(scenario.faults(&base.file)).map(Err::<(), _>))?;
    name_from_here(&scenario, &base.origin, &mut below);
    merge(&mut below, table);
    Ok(below)
}

/// Files beside the scenario below are called by their paths, since they do not lie beside the one above.
fn name_from_here(scenario: &Scenario, origin: &Origin, table: &mut Table) {
    let Origin::Disk(folder) = origin else { return };
    for (kind, field, name) in scenario.parts() {
        if !kind.names().contains(&name) {
            let path: PathBuf = std::path::absolute(folder.join(name)).unwrap_or_else(|_| Path::new(name).into());
            table.insert(field.to_owned(), path.to_string_lossy().into_owned().into());
        }
    }
}

fn merge(below: &mut Table, above: Table) {
    for (field, value) in above {
        match (below.get_mut(&field), value) {
            (Some(Value::Table(below)), Value::Table(above)) if !KINDS.contains(&&*field) => merge(below, above),
            (_, value) => {
                below.insert(field, value);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use catch_sim::depth_noise::DepthConfig;

    use super::*;
    use crate::scenario::setup::{Choice, Setup};

    fn load(folder: &Path, name: &str) -> Result<Scenario, InputError> {
        let path = folder.join(name);
        Setup::load(&Choice { scenario: path.to_str(), ..Choice::default() }).map(|it| it.scenario)
    }

    #[test]
    fn tables_are_merged_however_they_are_written() {
        let folder = tempfile::tempdir().unwrap();
        let write = |name: &str, text: &str| std::fs::write(folder.path().join(name), text).unwrap();
        let head = "name = \"mine\"\ndescription = \"mine\"\n";
        let honest = Setup::load(&Choice { scenario: Some("honest"), ..Choice::default() }).unwrap().scenario;
        let mut expected = honest.clone();
        (expected.name, expected.description) = ("slippery".to_owned(), "mine".to_owned());
        expected.arena.friction = catch_sim::config::Drawn::Always(0.2);
        expected.arena.depth.model = toml::from_str::<DepthConfig>("model.gaussian.sd_m = 0.001").unwrap().model;
        expected.arena.robot_errors.link_mass_spread = 0.1;
        expected.brain.grasp_selection.weights.width = 1.0;
        for arena in [
            "[arena]\nfriction = 0.2\n[arena.depth.model.stereo]\nbaseline_m = 0.1\n",
            "arena = { friction = 0.2, depth = { model = { stereo = { baseline_m = 0.1 } } } }\n",
            "arena.friction = 0.2\narena.depth.model.stereo.baseline_m = 0.1\n",
        ] {
            write("bumpy.toml", &format!("{head}extends = \"honest\"\n{arena}"));
            write(
                "slippery.toml",
                &format!(
                    "{head}extends = \"bumpy.toml\"\n[arena]\ndepth = {{ model = {{ gaussian = {{ sd_m = 0.001 }} }} }}\n\
                     [arena.robot_errors]\nlink_mass_spread = 0.1\n[brain.grasp_selection]\nweights.width = 1.0\n"
                ),
            );
            assert_eq!(load(folder.path(), "slippery.toml").unwrap(), expected, "{arena}");
        }
    }

    #[test]
    fn circles_and_faults_below_are_named() {
        let folder = tempfile::tempdir().unwrap();
        let head = "name = \"mine\"\ndescription = \"mine\"\n";
        for (name, rest) in [
            ("a.toml", "extends = \"b.toml\""),
            ("b.toml", "extends = \"a.toml\""),
            ("number.toml", "extends = 1"),
            ("unknown.toml", "extends = \"honset\""),
            ("foreign.toml", "extends = \"honest\"\nfoo = 1"),
            ("faulty.toml", "extends = \"honest\"\narena.friction = 1000"),
            ("upon.toml", "extends = \"faulty.toml\""),
        ] {
            std::fs::write(folder.path().join(name), format!("{head}{rest}\n")).unwrap();
        }
        for (name, file, said) in [
            ("a.toml", "b.toml: extends", "in turn"),
            ("number.toml", "number.toml: extends", "name of a scenario"),
            ("unknown.toml", "unknown.toml: extends", "did you mean `honest`?"),
            ("foreign.toml", "foreign.toml: foo", "one of `extends`, `name`"),
            ("upon.toml", "faulty.toml: arena.friction", "1000"),
        ] {
            let fault = load(folder.path(), name).unwrap_err().to_string();
            assert!(fault.contains(file) && fault.contains(said), "{fault}");
        }
    }
}
