//! Pages of the throws that were missed.

use std::{
    collections::BTreeMap,
    path::{Path, PathBuf},
};

use catch_body::InputError;

use crate::{pages::catch_page, playback::Playback};
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

/// Throws the first `most` missed throws once more, which gives the same again, and writes their pages;
/// on so many threads;
/// returns the pages' paths relative to `folder` by the index of their row.
///
/// # Errors
/// Files that cannot be written.
pub fn record_misses(
    evaluation: &Evaluation,
    rows: &[Row],
    (most, threads): (usize, usize),
    folder: &Path,
) -> Result<BTreeMap<usize, String>, InputError> {
    let missed: Vec<(usize, &Row)> =
        rows.iter().enumerate().filter(|(_, row)| !row.verdict.caught).take(most).collect();
    let misses = folder.join(FOLDER);
    let recorded = parallel::map_on(threads, missed.len(), |at| {
        let (i, Row { scene, .. }) = missed[at];
        let has_thrown = |cell: &&Cell| {
            let ours = cell.setup.scene(scene.seed, scene.index);
            ours.object == scene.object && ours.throw == scene.throw
        };
        let Some(cell) = evaluation.cells.iter().find(has_thrown) else { return Ok(None) };
        let (recording, playback) = recorded(&cell.setup, (scene.seed, scene.index), &misses)?;
        let page = recording.with_extension("html");
        whole_file::write(&page, catch_page::page(&playback))?;
        let name = page.file_name().map(|name| name.to_string_lossy());
        Ok(name.map(|name| (i, format!("{FOLDER}/{name}"))))
    });
    recorded.into_iter().filter_map(Result::transpose).collect()
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
