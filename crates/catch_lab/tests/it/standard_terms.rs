//! One quantity has one name, that of the field: words of our own that were given up stay out of identifiers,
//! settings and columns.

use std::{fs, path::Path};

use crate::source::{read, root, rust_files, string_literals, without_comments};

/// Words, or words in a row, that no identifier contains; what stands for them now.
pub const GIVEN_UP: &[(&str, &str)] = &[
    ("attitude", "orientation"),
    ("turn_rad", "rotation_error_rad"),
    ("share", "fraction, ratio or scaling"),
    ("put_off", "failure_penalty"),
    ("way_in", "approach or swept_volume"),
    ("lets_in", "approach_is_free"),
    ("enters_straight", "straight_approach_is_free"),
    ("braking_way", "braking_distance"),
    ("return_way", "rebound_distance"),
    ("way_m", "travel_m"),
    ("settled_cost", "reference_cost"),
    ("switch_gain", "switching_hysteresis"),
    ("ticket", "heap entry"),
    ("cabinet", "robot_controller"),
    ("chance", "random stream or probability"),
    ("misfit", "robust_cost"),
    ("doubt", "uncertainty"),
    ("onlooker", "observer"),
    ("thought", "snapshot"),
    ("askew", "misaligned"),
    ("brink", "marginal"),
    ("ladder", "ablation study"),
    ("rung", "ablation step"),
    ("climb", "ablation study"),
];
/// Names that only the search of the brain must not use; elsewhere a pair of things may be called so.
const GIVEN_UP_IN_SEARCH: &[(&str, &str)] = &[("moment", "catch-time sample"), ("pair", "candidate")];

#[test]
fn words_that_were_given_up_stay_out_of_identifiers() {
    let mut found = Vec::new();
    for file in rust_files("crates").into_iter().filter(|file| !file.ends_with("standard_terms.rs")) {
        let code = without_comments(&read(&file));
        let literals = string_literals(&code);
        // Texts for people are prose; a literal of one word is a setting or a column.
        let outside = literals.iter().filter(|it| it.contains(' ')).fold(code.clone(), |code, it| code.replace(it, ""));
        let in_search = file.components().any(|it| it.as_os_str() == "search" || it.as_os_str() == "search.rs");
        let words = GIVEN_UP.iter().chain(GIVEN_UP_IN_SEARCH.iter().filter(|_| in_search));
        found.extend(faults(&file, &outside, words));
    }
    for (folder, extension, comment) in [("assets", "toml", "#"), ("crates", "js", "//")] {
        for file in files(&root().join(folder), extension) {
            let code: Vec<String> =
                read(&file).lines().map(|line| line.split(comment).next().unwrap_or("").to_owned()).collect();
            found.extend(faults(&file, &code.join("\n"), GIVEN_UP.iter()));
        }
    }
    assert!(found.is_empty(), "{}", found.join("\n"));
}

fn faults<'a>(file: &Path, code: &str, words: impl Iterator<Item = &'a (&'a str, &'a str)>) -> Vec<String> {
    let identifiers: Vec<&str> = code.split(|it: char| !it.is_alphanumeric() && it != '_').collect();
    words
        .flat_map(|(word, instead)| {
            identifiers.iter().filter(|it| contains(it, word)).map(move |it| (*it, *word, *instead)).collect::<Vec<_>>()
        })
        .map(|(identifier, word, instead)| format!("{}: {identifier}: {instead}, not {word}", file.display()))
        .collect()
}

/// Returns whether the words of an identifier, in either spelling, hold those of `words` in a row, the last
/// one also in the plural.
fn contains(identifier: &str, words: &str) -> bool {
    let mut parts = vec![String::new()];
    let mut after_small = false;
    for letter in identifier.chars() {
        if letter == '_' || letter.is_uppercase() && after_small {
            parts.push(String::new());
        }
        if letter != '_' {
            parts.last_mut().unwrap().extend(letter.to_lowercase());
        }
        after_small = letter.is_lowercase();
    }
    let words: Vec<&str> = words.split('_').collect();
    parts.windows(words.len()).any(|window| {
        let (last, first) = (words.len() - 1, &words[..words.len() - 1]);
        window.iter().zip(first).all(|(part, word)| part == word)
            && (window[last] == words[last] || window[last].strip_suffix('s') == Some(words[last]))
    })
}

fn files(folder: &Path, extension: &str) -> Vec<std::path::PathBuf> {
    fs::read_dir(folder)
        .unwrap()
        .flat_map(|entry| {
            let path = entry.unwrap().path();
            match path.is_dir() {
                true => files(&path, extension),
                false => Vec::from_iter(path.extension().is_some_and(|it| it == extension).then_some(path)),
            }
        })
        .collect()
}

#[test]
fn words_are_found_in_both_spellings() {
    assert!(
        contains("velocity_shares", "share")
            && contains("MinShare", "share")
            && contains("SAME_ATTITUDE_RAD", "attitude")
    );
    assert!(
        contains("palm_way_m", "way_m") && contains("firstTicket", "ticket") && contains("grasp_turn_rad", "turn_rad")
    );
    assert!(!contains("shared_with", "share") && !contains("away_m", "way_m") && !contains("half_turn", "turn_rad"));
}
