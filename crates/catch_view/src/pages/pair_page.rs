//! Two throws as one page, beside each other on one slider.

use serde::Serialize;

use super::{catch_page, document, fill, packed};
use crate::playback::Playback;

const PAGE: &str = include_str!("pair_page/page.html");
const SCRIPT: &str = include_str!("pair_page/pair.js");

/// All that the page's script reads.
#[derive(Debug, Serialize)]
struct PairData {
    /// Page of a throw, in which `{{title}}` and `{{data}}` stand for a throw's own.
    page: String,
    throws: [ThrowData; 2],
}

#[derive(Debug, Serialize)]
struct ThrowData {
    title: String,
    data: String,
}

/// The page of two throws with their names.
pub fn page(throws: [(&str, &Playback); 2]) -> String {
    let data = PairData {
        page: catch_page::template(),
        throws: throws.map(|(name, playback)| ThrowData {
            title: packed::text_in_html(&format!("{name}: {}", playback.header.title)),
            data: packed::json_in_html(&catch_page::PageData::of(playback, catch_page::MOST_POINTS / 2)),
        }),
    };
    let title = format!("{} and {}", throws[0].0, throws[1].0);
    document(&title, "pair", "", &fill(PAGE, &[("data", &packed::json_in_html(&data)), ("script", SCRIPT)]))
}
