//! Commented files to start from.

use std::path::PathBuf;

use catch_body::InputError;

use crate::{
    assets::{Asset, COMMAND_LINE, Kind, Origin},
    scenario::setup::DEFAULT_SCENARIO,
};

/// Variants of the scenario that is meant when none is named.
const STUDY: &str = include_str!("templates/study.toml");
const OBJECT: &str = include_str!("templates/object.toml");

/// A file: its name, and its content.
pub type NewFile = (String, String);

/// The files of a new thing of a kind, all of them right as they are: an object and a study from templates, a scenario from the one that
/// is meant when none is named, a robot from the first that is built in.
///
/// # Errors
/// A name that cannot be a file's.
pub fn files(kind: Kind, name: &str) -> Result<Vec<NewFile>, InputError> {
    let fits = |letter: char| letter.is_ascii_alphanumeric() || letter == '_' || letter == '-';
    if name.is_empty() || !name.chars().all(fits) {
        let expected = "letters, digits, `_` and `-`";
        return Err(InputError::new(COMMAND_LINE, "NAME", format!("`{name}`"), expected));
    }
    match kind {
        Kind::Object => Ok(vec![(format!("{name}.toml"), OBJECT.replace("{{name}}", name))]),
        Kind::Study => Ok(vec![(format!("{name}.toml"), STUDY.to_owned())]),
        Kind::Robot => {
            let robot = Asset::any_built_in(Kind::Robot)?;
            let (_, urdf) = robot.read_text_beside("robot.urdf")?;
            Ok(vec![(format!("{name}/robot.toml"), robot.text), (format!("{name}/robot.urdf"), urdf)])
        }
        _ => {
            let nowhere = Origin::BuiltIn(PathBuf::new());
            let scenario = Asset::find(kind, DEFAULT_SCENARIO, &nowhere, (COMMAND_LINE, "NAME"))?;
            let named = |line: &str| {
                let is_name = line.starts_with("name = ");
                if is_name { format!("name = \"{name}\"") } else { line.to_owned() }
            };
            let lines: Vec<String> = scenario.text.lines().map(named).collect();
            Ok(vec![(format!("{name}.toml"), lines.join("\n") + "\n")])
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_new_scenario_shows_every_switch_of_the_arena() {
        let [(_, text)] = &files(Kind::Scenario, "mine").unwrap()[..] else { panic!("one file") };
        let shown: toml::Table = toml::from_str(text).unwrap();
        assert!(shown.contains_key("clock"));
        let all = toml::Table::try_from(catch_sim::ArenaConfig::default()).unwrap();
        let shown = shown["arena"].as_table().unwrap();
        for (name, value) in &all {
            assert!(shown.contains_key(name), "arena.{name} is not shown");
            for field in value.as_table().into_iter().flat_map(toml::Table::keys) {
                assert!(shown[name].as_table().unwrap().contains_key(field), "arena.{name}.{field} is not shown");
            }
        }
    }
}
