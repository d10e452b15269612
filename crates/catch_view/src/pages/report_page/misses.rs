//! Pages of the throws that were missed, each with the nearest throw that was caught.

use std::{
    collections::{BTreeMap, BTreeSet},
    path::{Path, PathBuf},
};

use catch_body::InputError;
use serde_json::json;

use crate::{pages::catch_page, playback::Playback, shading};
use catch_lab::{
    evaluation::{Cell, Evaluation, Row},
    parallel,
    recording::recorded_throw::record,
    scenario::setup::Setup,
};
use catch_recording::whole_file;

/// Misses of an evaluation that get a page, the first ones.
pub const MOST_MISSES: usize = 20;
/// Folder of the misses' pages beside the report.
const FOLDER: &str = "misses";

/// A miss that can be looked at.
#[derive(Debug, Clone)]
pub struct Miss {
    /// Its page, relative to the report.
    pub page: String,
    /// Hand and object at the catch, as a PNG file in base64; empty without motion.
    pub picture: String,
}

/// Throws the first `most` missed throws and their caught neighbours once more, which gives the same again,
/// and writes their pages; on so many threads; returns the misses by the index of their row.
///
/// # Errors
/// Files that cannot be written.
pub fn record_misses(
    evaluation: &Evaluation,
    rows: &[Row],
    (most, threads): (usize, usize),
    folder: &Path,
) -> Result<BTreeMap<usize, Miss>, InputError> {
    let missed: Vec<usize> = (0..rows.len()).filter(|i| !rows[*i].verdict.caught).take(most).collect();
    let neighbours: BTreeMap<usize, usize> = missed.iter().filter_map(|i| Some((*i, neighbour(rows, *i)?))).collect();
    let all: Vec<usize> =
        missed.iter().chain(neighbours.values()).copied().collect::<BTreeSet<_>>().into_iter().collect();
    let thrown = parallel::map_on(threads, all.len(), |at| {
        let setup = setup_of(evaluation, &rows[all[at]]);
        let scene = &rows[all[at]].scene;
        setup.map(|it| recorded(it, (scene.seed, scene.index), &folder.join(FOLDER)).map(|it| it.0)).transpose()
    });
    let mut recordings = BTreeMap::new();
    for (i, recording) in all.iter().zip(thrown) {
        recordings.extend(recording?.map(|it| (*i, it.with_extension("html"))));
    }
    let name = |i: usize| Some(recordings.get(&i)?.file_name()?.to_string_lossy().into_owned());
    let written = parallel::map_on(threads, all.len(), |at| {
        let i = all[at];
        let Some(page) = recordings.get(&i) else { return Ok(None) };
        let playback = Playback::read(&page.with_extension(catch_recording::EXTENSION))?;
        let place = missed.iter().position(|it| *it == i);
        let beside = |by: usize| place.and_then(|it| name(*missed.get(it.wrapping_add(by))?));
        let links = json!({
            "report": "../report.html",
            // The misses before and after this one.
            "previous": beside(usize::MAX),
            "next": beside(1),
            // The nearest throw that was caught; of a caught one, the miss that it is near to.
            "caught": neighbours.get(&i).and_then(|it| name(*it)),
            "missed": neighbours.iter().find(|(_, caught)| **caught == i).and_then(|(it, _)| name(*it)),
        });
        whole_file::write(page, catch_page::page_among(&playback, links))?;
        let picture = shading::picture_of_catch(&playback);
        Ok(name(i).map(|name| (i, Miss { page: format!("{FOLDER}/{name}"), picture })))
    });
    let written: Result<Vec<_>, InputError> = written.into_iter().filter_map(Result::transpose).collect();
    Ok(written?.into_iter().filter(|(i, _)| !rows[*i].verdict.caught).collect())
}

/// The caught throw of the same object and kind that was released most like another: metres count as much as
/// metres per second.
fn neighbour(rows: &[Row], of: usize) -> Option<usize> {
    let release = |row: &Row| row.conditions.as_ref().map(|it| (it.release.position_m, it.release.velocity_mps));
    let distance = |row: &Row| match (release(row), release(&rows[of])) {
        (Some(a), Some(b)) => (0..3).map(|i| (a.0[i] - b.0[i]).powi(2) + (a.1[i] - b.1[i]).powi(2)).sum(),
        _ => row.scene.index.abs_diff(rows[of].scene.index) as f64,
    };
    let is_alike = |row: &Row| {
        let (a, b) = (&row.scene, &rows[of].scene);
        row.verdict.caught && (&a.object, &a.throw) == (&b.object, &b.throw)
    };
    let alike = (0..rows.len()).filter(|i| is_alike(&rows[*i]));
    alike.min_by(|a, b| distance(&rows[*a]).total_cmp(&distance(&rows[*b])))
}

/// The setup of a row's throw.
fn setup_of<'a>(evaluation: &'a Evaluation, Row { scene, .. }: &Row) -> Option<&'a Setup> {
    let has_thrown = |cell: &&Cell| {
        let ours = cell.setup.scene(scene.seed, scene.index);
        ours.object == scene.object && ours.throw == scene.throw
    };
    evaluation.cells.iter().find(has_thrown).map(|it| &it.setup)
}

/// Throws once more, which gives the same again, and keeps it in `folder`; returns the recording.
///
/// # Errors
/// Files that cannot be written.
pub fn recorded(setup: &Setup, (seed, index): (u64, u64), folder: &Path) -> Result<(PathBuf, Playback), InputError> {
    let thrown = record(setup, seed, index, folder, &mut |_| Ok(()))
        .map_err(|fault| InputError::unwritten(folder.display(), &fault, "a folder that can be written"))?;
    let playback = Playback::read(&thrown.recording)?;
    Ok((thrown.recording, playback))
}
