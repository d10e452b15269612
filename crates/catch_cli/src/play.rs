//! `catchingbot play`: many throws in one life.

use std::{path::PathBuf, sync::Arc};

use catch_body::{InputError, statistics::wilson95};
use catch_lab::{
    assets::Kind,
    evaluation::cell_summary::CellSummary,
    play::{EarlyEnd, Life, Play, PlayRow},
    recording,
    referee::Row,
    scenario::{Scenario, setup::Setup},
};
use catch_recording::whole_file;
use clap::Args;
use comfy_table::Table;
use serde::Serialize;

use super::{ChoiceArguments, MOST, between, whole};
use crate::{
    calibrate, eval, screen,
    watch::{self, Watch},
};

/// Arguments of `play`.
#[derive(Debug, Args)]
pub struct PlayArguments {
    #[command(flatten)]
    choice: ChoiceArguments,
    /// Object: a built-in name or a file; may be given more than once [default: all that are built in]
    #[arg(long = "object", value_name = "NAME|FILE")]
    objects: Vec<String>,
    /// Throw: a built-in name or a file [default: the scenario's]
    #[arg(long, value_name = "NAME|FILE")]
    throw: Option<String>,
    /// Number of throws
    #[arg(long, value_name = "N", default_value_t = 50, value_parser = whole(1, 1_000_000))]
    trials: u64,
    /// Least interval between two throws in seconds; the thrower waits until the arm is ready
    #[arg(long, value_name = "SECONDS", default_value_t = 4.0, value_parser = between(0.0, 600.0))]
    every: f64,
    /// Seed of everything random
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = whole(0, MOST))]
    seed: u64,
    /// Open a page that follows the run, on this machine only; it shows each throw alone, or its recording
    #[arg(long)]
    watch: bool,
    /// Write a recording of each throw to this folder, with the object being put down; `view` opens it
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
}

/// Document of `--json`.
#[derive(Debug, Serialize)]
struct Document<'a> {
    /// Scenario of the first object.
    scenario: &'a Scenario,
    objects: Vec<&'a str>,
    throws: usize,
    caught: usize,
    wilson95: [f64; 2],
    caught_per_minute: f64,
    placed: usize,
    identified: usize,
    limit_violations: usize,
    motion_excursions: usize,
    ended_early: Option<EarlyEnd>,
    duration_s: f64,
    rows: &'a [PlayRow],
}

/// Throws, and tells what came of it.
///
/// # Errors
/// A fault of the input; a recording that cannot be written.
pub fn run(arguments: &PlayArguments, json: bool) -> anyhow::Result<()> {
    let PlayArguments { trials: throws, every: every_s, seed, .. } = *arguments;
    let play = Play { setups: setups(arguments)?, throws, every_s, seed, folder: arguments.out.clone() };
    play.folder.as_ref().map_or(Ok(()), |it| whole_file::make_writable(it, "--out"))?;
    calibrate::before_throws(&play.setups[0], arguments.seed, !json)?;
    let setups: Vec<Arc<Setup>> =
        play.setups.iter().filter(|_| arguments.watch).map(|it| Arc::new(it.clone())).collect();
    let watch = Watch::start(arguments.watch, "Many throws in one life", Some(arguments.trials as usize))?;
    let bar = screen::progress_bar(arguments.trials as usize, "throws");
    let mut caught = 0;
    let life = play.run(&mut |row| {
        caught += usize::from(row.row.verdict.caught);
        bar.set_message(format!("{caught} caught"));
        bar.inc(1);
        let Row { scene, verdict, .. } = &row.row;
        if let Some((watch, setup)) = watch.as_ref().zip(setups.get(play.object(scene.index))) {
            let (setup, seed, index) = (setup.clone(), scene.seed, scene.index);
            let recording = arguments.out.as_ref().map(|folder| recording::file(folder, scene));
            watch.thrown(scene.label(), verdict.reason, move || match &recording {
                Some(file) => watch::recorded(file),
                None => watch::again(&setup, seed, index),
            });
        }
    })?;
    bar.finish_and_clear();
    if let Some(watch) = watch {
        watch.end();
    }
    let document = document(&play, &life);
    if json {
        return screen::document(&document);
    }
    tell(&eval::table(&cells(&play, &life)), &life, &document)?;
    let shown = life.rows.iter().find(|it| it.placed == Some(true)).or(life.rows.first());
    if let Some((folder, shown)) = arguments.out.as_ref().zip(shown) {
        let file = recording::file(folder, &shown.row.scene);
        screen::fact("recordings", &screen::command(&["view", &file.to_string_lossy()]))?;
    }
    Ok(())
}

/// Loads a setup for each object.
fn setups(arguments: &PlayArguments) -> Result<Vec<Setup>, InputError> {
    let mut objects: Vec<&str> = arguments.objects.iter().map(String::as_str).collect();
    if objects.is_empty() {
        objects = Kind::Object.names();
    }
    let load = |object: &str| Setup::load(&arguments.choice.with(Some(object), arguments.throw.as_deref()));
    let mut setups: Vec<Setup> = Vec::new();
    for object in objects {
        let setup = load(object)?;
        setups.push(match setups.first() {
            Some(first) => setup.sharing_calibrations(first),
            None => setup,
        });
    }
    Ok(setups)
}

/// Prints the story of a life.
fn tell(table: &Table, life: &Life, document: &Document) -> anyhow::Result<()> {
    screen::line("")?;
    screen::line(&table.trim_fmt())?;
    screen::line("")?;
    let [low, high] = document.wilson95.map(|it| it * 100.0);
    let Document { throws, caught, caught_per_minute, placed, identified, .. } = *document;
    let (broken, exceeded) = (document.limit_violations, document.motion_excursions);
    screen::fact("caught", &format!("{caught} of {throws} ({low:.1}–{high:.1} %), {caught_per_minute:.1} a minute"))?;
    screen::fact("put down", &format!("{placed} of {caught}"))?;
    screen::fact("identified", &format!("{identified} of {throws}"))?;
    screen::fact("limits", &format!("{broken} broken by commands, {exceeded} exceeded by the motion, as at impacts"))?;
    let mut told = Vec::new();
    for (i, row) in life.rows.iter().enumerate() {
        for faulty in row.faulty_cameras.iter().filter(|it| !told.contains(*it)).copied().collect::<Vec<_>>() {
            told.push(faulty);
            screen::fact("camera", &format!("number {}: {}, first in throw {}", faulty.camera, faulty.status, i + 1))?;
        }
    }
    if let Some(reason) = &life.ended_early {
        screen::fact("ended early", &reason.to_string())?;
    }
    Ok(())
}

fn document<'a>(play: &'a Play, life: &'a Life) -> Document<'a> {
    let rows = &life.rows;
    let caught = rows.iter().filter(|it| it.row.verdict.caught).count();
    let violations: usize = rows.iter().map(|it| it.row.verdict.limit_violations).sum();
    let excursions: usize = rows.iter().map(|it| it.row.verdict.motion_excursions).sum();
    Document {
        scenario: &play.setups[0].scenario,
        objects: play.setups.iter().map(|setup| setup.scenario.object.as_str()).collect(),
        throws: rows.len(),
        caught,
        wilson95: wilson95(caught, rows.len()),
        caught_per_minute: caught as f64 / life.duration_s * 60.0,
        placed: rows.iter().filter(|it| it.placed == Some(true)).count(),
        identified: rows.iter().filter(|it| it.identified.as_ref() == Some(&it.row.scene.object)).count(),
        limit_violations: violations + life.violations_between,
        motion_excursions: excursions + life.excursions_between,
        ended_early: life.ended_early,
        duration_s: life.duration_s,
        rows,
    }
}

/// A row for each object.
fn cells(play: &Play, life: &Life) -> Vec<CellSummary> {
    let of_object = |setup: &Setup| {
        let Scenario { object, throw, .. } = &setup.scenario;
        let rows: Vec<&Row> = life.rows.iter().map(|it| &it.row).filter(|row| row.scene.object == *object).collect();
        CellSummary::of(object, throw, &rows, false)
    };
    play.setups.iter().map(of_object).collect()
}
