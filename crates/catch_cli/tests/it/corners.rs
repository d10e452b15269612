//! Settings at the ends of their ranges, two to six at once: whatever is written of such throws can be read
//! again, and nothing is caught that no plan caught. A dozen throws belong to the suite; as many as one likes
//! are tried by
//!
//! ```sh
//! CATCHINGBOT_CORNERS=0..1000 cargo test --release -p catch_cli --test it corners -- --ignored --nocapture
//! ```

#![allow(clippy::print_stdout, reason = "tests tell what they measured")]

use std::{
    fs,
    ops::Range,
    panic::{AssertUnwindSafe, catch_unwind},
    path::Path,
};

use catch_body::InputError;
use catch_lab::{
    recording::{recorded_throw::record, replay::replay},
    scenario::setup::{Choice, Setup},
};
use catch_view::playback::Playback;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;

/// Sections of the page of settings whose headings are no path of a table, or one of several forms.
const NO_TABLES: [&str; 4] = ["The file", "Numbers that are drawn", "clock", "calibration"];

/// The settings that the reference has ranges for, each with the values at the ends.
fn settings() -> Vec<(String, [String; 2])> {
    let page = include_str!("../../../../docs/reference/scenario.md");
    let mut found = Vec::new();
    let mut section = "The file";
    for line in page.lines() {
        if let Some(heading) = line.strip_prefix("## ") {
            section = heading;
        }
        let is_table = !NO_TABLES.contains(&section) && !section.contains([',', ' ']);
        if !is_table || section.starts_with("arena.depth.model") {
            continue;
        }
        let cells: Vec<&str> = line.split(" | ").collect();
        let Some(name) = cells[0].strip_prefix("| `").and_then(|it| it.strip_suffix('`')) else { continue };
        let ends = match (cells.get(1), cells.iter().find_map(|it| it.split_once(" to "))) {
            (Some(kind), _) if kind.starts_with("true or false") => ["true", "false"],
            (Some(kind), Some((least, rest))) if kind.contains("number") && least.parse::<f64>().is_ok() => {
                [least, rest.split([' ', ',']).next().unwrap_or_default()]
            }
            _ => continue,
        };
        let whole =
            |end: &str| if cells[1].starts_with("number") && !end.contains(['.', 'e', 't', 'f']) { ".0" } else { "" };
        found.push((format!("{section}.{name}"), ends.map(|end| format!("{end}{}", whole(end)))));
    }
    found
}

#[derive(Default)]
struct Outcome {
    thrown: usize,
    caught: usize,
    refused: usize,
    failures: Vec<String>,
}

/// Throws once, reads and replays what was written; whether it was caught.
fn thrown(choice: &Choice, index: u64, folder: &Path) -> Result<bool, InputError> {
    let setup = Setup::load(choice)?;
    setup.check_throw(1, index)?;
    let recorded = record(&setup, 1, index, folder, &mut |_| Ok(())).unwrap();
    let playback = Playback::read(&recorded.recording)?;
    assert!(replay(&recorded.recording)?.identical, "it replays otherwise");
    assert!(!playback.ticks.is_empty());
    let verdict = recorded.verdict;
    assert!(!verdict.caught || verdict.catch_time_s.is_some(), "caught without a plan");
    Ok(verdict.caught)
}

/// Throws at corners; what was caught, refused, and what went wrong.
fn tried(indices: Range<u64>) -> Outcome {
    let all = settings();
    assert!(all.len() > 60, "{}: the page of settings has another form", all.len());
    let folder = tempfile::tempdir().unwrap();
    let mut outcome = Outcome::default();
    for index in indices {
        if index % 100 == 99 {
            println!("{} tried", index + 1);
        }
        let mut rng = Pcg64::seed_from_u64(index);
        let settings: Vec<String> = (0..rng.random_range(2..=6))
            .map(|_| {
                let (name, ends) = &all[rng.random_range(0..all.len())];
                format!("{name}={}", ends[rng.random_range(0..2)])
            })
            .collect();
        let object = ["tennis_ball", "banana", "pill_bottle"][rng.random_range(0..3)];
        let choice = Choice { object: Some(object), settings: &settings, ..Choice::default() };
        let told = outcome.failures.len();
        match catch_unwind(AssertUnwindSafe(|| thrown(&choice, index, folder.path()))) {
            Ok(Ok(caught)) => {
                outcome.thrown += 1;
                outcome.caught += usize::from(caught);
            }
            // A recording that was written and is then refused has its name in the fault.
            Ok(Err(fault)) if !fault.file.ends_with(".catch") => outcome.refused += 1,
            Ok(Err(fault)) => outcome.failures.push(format!("{object} {settings:?}: {fault}")),
            Err(panic) => {
                let said = panic.downcast_ref::<String>().cloned();
                let said = said.or(panic.downcast_ref::<&str>().map(|it| (*it).to_owned())).unwrap_or_default();
                outcome.failures.push(format!("{object} {settings:?}: {said}"));
            }
        }
        outcome.failures[told..].iter().for_each(|it| println!("{index}: {it}"));
        for file in fs::read_dir(folder.path()).unwrap() {
            fs::remove_file(file.unwrap().path()).unwrap();
        }
    }
    outcome
}

fn judge(outcome: &Outcome) {
    let Outcome { thrown, caught, refused, failures } = outcome;
    println!("{thrown} thrown, {caught} of them caught, {refused} refused");
    assert!(failures.is_empty(), "{failures:#?}");
}

#[test]
fn corners_of_settings_are_thrown_or_refused() {
    let outcome = tried(0..20);
    judge(&outcome);
    assert!(outcome.thrown >= 5, "nearly all is refused");
}

/// Gains with which the arm is soon farther away than numbers tell.
#[test]
fn an_arm_that_diverges_is_recorded() {
    let folder = tempfile::tempdir().unwrap();
    let settings = ["arena.robot_controller.gains.derivative_per_s=1e6".to_owned()];
    assert!(!thrown(&Choice { settings: &settings, ..Choice::default() }, 0, folder.path()).unwrap());
}

#[test]
#[ignore = "takes as long as one likes"]
fn as_many_corners_as_one_likes() {
    let wanted = std::env::var("CATCHINGBOT_CORNERS").unwrap_or("0..100".to_owned());
    let (from, to) = wanted.split_once("..").expect("a range such as 0..1000");
    judge(&tried(from.parse().unwrap()..to.parse().unwrap()));
}
