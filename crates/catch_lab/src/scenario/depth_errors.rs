//! `arena.depth.model` by name: the figures of a built-in file in its place.

use std::path::Path;

use catch_body::InputError;
use toml::{Table, Value};

use crate::assets::built_in_files;

/// The folder of the built-in files, and the table of a model whose figures they have.
const FOLDER: &str = "depth_errors";
const MODEL: &str = "stereo";
/// The model without any figures.
const PERFECT: &str = "perfect";

/// Puts the figures of a built-in file where a scenario names it.
///
/// # Errors
/// A name of which there is no file.
pub(super) fn fill_in(scenario: &mut Table, file: &str) -> Result<(), InputError> {
    let tables = ["arena", "depth"].iter().try_fold(scenario, |table, name| table.get_mut(*name)?.as_table_mut());
    let Some(model) = tables.and_then(|depth| depth.get_mut("model")) else { return Ok(()) };
    let Some(name) = model.as_str().filter(|it| *it != PERFECT) else { return Ok(()) };
    let files = files();
    let Some((_, path, text)) = files.iter().find(|(of_file, ..)| of_file == name) else {
        let names: Vec<String> = files.iter().map(|(name, ..)| format!("`{name}`")).collect();
        let expected =
            format!("`{PERFECT}`, {}, or figures: {{ {MODEL} = {{ baseline_m = 0.05, … }} }}", names.join(", "));
        return Err(InputError::new(file, "arena.depth.model", format!("`{name}`"), expected));
    };
    let figures: Table = InputError::parse_toml(path, text)?;
    *model = Value::Table(Table::from_iter([(MODEL.to_owned(), Value::Table(figures))]));
    Ok(())
}

/// Names, paths and texts of the built-in files.
fn files() -> Vec<(String, String, &'static str)> {
    let named = |(path, bytes): (String, &'static [u8])| {
        let name = Path::new(&path).file_stem()?.to_str()?.to_owned();
        Some((name, path, std::str::from_utf8(bytes).ok()?))
    };
    built_in_files(FOLDER).into_iter().filter_map(named).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use catch_sim::depth_noise::StereoNoise;

    #[test]
    fn every_file_has_figures_of_a_stereo_camera() {
        assert!(files().len() > 2);
        for (name, path, text) in files() {
            let figures: StereoNoise = InputError::parse_toml(&path, text).unwrap();
            assert!(figures.subpixel_px > 0.0, "{name}");
        }
    }

    #[test]
    fn a_name_becomes_figures_and_an_unknown_one_is_a_fault() {
        let parse = |model: &str| toml::from_str::<Table>(&format!("arena.depth.model = {model}")).unwrap();
        let filled = |model: &str| {
            let mut table = parse(model);
            fill_in(&mut table, "s.toml").map(|()| table)
        };
        let figures = "{ stereo = { baseline_m = 0.095, subpixel_px = 0.08 } }";
        assert_eq!(filled("\"stereo7\"").unwrap(), parse(figures));
        assert_eq!(filled(figures).unwrap(), parse(figures));
        assert_eq!(filled("\"perfect\"").unwrap(), parse("\"perfect\""));
        let fault = filled("\"stereo8\"").unwrap_err().to_string();
        assert!(fault.starts_with("s.toml: arena.depth.model: found `stereo8`, expected `perfect`, `"), "{fault}");
    }
}
