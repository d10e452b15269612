//! Pages of the throws that were missed.

use std::{collections::BTreeMap, path::Path};

use catch_body::InputError;

use crate::{pages::catch_page, playback::Playback};
use catch_lab::{
    evaluation::{Evaluation, Row},
    recording::recorded_throw::record,
};
use catch_recording::whole_file;

/// Misses of an evaluation that get a page, the first ones.
pub const MOST_MISSES: usize = 20;
/// The same for each step of a study, which has many.
pub const MOST_MISSES_OF_A_STEP: usize = 3;
/// Their folder beside the report.
const FOLDER: &str = "misses";

/// Throws the first `most` missed throws once more, which gives the same again, and writes their pages;
/// returns the pages' paths relative to `folder` by the index of their row.
///
/// # Errors
/// Files that cannot be written.
pub fn record_misses(
    evaluation: &Evaluation,
    rows: &[Row],
    most: usize,
    folder: &Path,
) -> Result<BTreeMap<usize, String>, InputError> {
    let missed = rows.iter().enumerate().filter(|(_, row)| !row.verdict.caught).take(most);
    let mut pages = BTreeMap::new();
    for (i, row) in missed {
        let of_row = |scene: &catch_lab::scenario::setup::Scene| {
            scene.object == row.scene.object && scene.throw == row.scene.throw
        };
        let cell = evaluation.cells.iter().find(|cell| of_row(&cell.setup.scene(row.scene.seed, row.scene.index)));
        let Some(cell) = cell else { continue };
        let misses = folder.join(FOLDER);
        let thrown = record(&cell.setup, row.scene.seed, row.scene.index, &misses, &mut |_| Ok(()))
            .map_err(|fault| InputError::unwritten(misses.display(), &fault, "a folder that can be written"))?;
        let playback = Playback::read(&thrown.recording)?;
        let page = thrown.recording.with_extension("html");
        whole_file::write(&page, catch_page::page(&playback))?;
        if let Some(name) = page.file_name() {
            pages.insert(i, format!("{FOLDER}/{}", name.to_string_lossy()));
        }
    }
    Ok(pages)
}
