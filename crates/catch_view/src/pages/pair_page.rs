//! Two throws as one page, beside each other on one slider.

use serde::Serialize;

use super::{
    catch_page::{self, MOST_POINTS, PageData},
    document, fill, packed,
};
use crate::playback::Playback;

const PAGE: &str = include_str!("pair_page/page.html");
const SCRIPT: &str = include_str!("pair_page/pair.js");

/// Stands for the surfaces of the first throw.
const SURFACES: &str = r#""surfaces":{{surfaces}}"#;

/// All that the page's script reads.
#[derive(Debug, Serialize)]
struct PairData {
    /// Page of a throw, in which `{{title}}` and `{{data}}` stand for a throw's own.
    page: String,
    /// The surfaces of the first throw, for which [`SURFACES`] stands where either throw has them.
    surfaces: String,
    throws: [ThrowData; 2],
}

#[derive(Debug, Serialize)]
struct ThrowData {
    title: String,
    data: String,
}

/// The page of two throws with their names.
pub fn page(throws: [(&str, &Playback); 2]) -> String {
    let [a, b] = throws.map(|(_, playback)| PageData::of(playback, MOST_POINTS / 2));
    let b = b.seen_as(&a);
    let surfaces = format!("\"surfaces\":{}", packed::json_in_html(&a.surfaces));
    let throw = |(name, playback): (&str, &Playback), data: &PageData| ThrowData {
        title: packed::text_in_html(&format!("{name}: {}", playback.header.title)),
        data: packed::json_in_html(data).replacen(&surfaces, SURFACES, 1),
    };
    let throws_data = [throw(throws[0], &a), throw(throws[1], &b)];
    let data = PairData { page: catch_page::template(), surfaces, throws: throws_data };
    let title = format!("{} and {}", throws[0].0, throws[1].0);
    document(&title, "pair", "", &fill(PAGE, &[("data", &packed::json_in_html(&data)), ("script", SCRIPT)]))
}
