//! Two throws as one page, beside each other on one slider.

use serde_json::{Value, json};

use super::{
    catch_page::{self, MOST_POINTS, page_data},
    document, fill, packed,
};
use crate::playback::Playback;

const PAGE: &str = include_str!("pair_page/page.html");
const SCRIPT: &str = include_str!("pair_page/pair.js");

/// Stands for the surfaces of the first throw.
const SURFACES: &str = r#""surfaces":{{surfaces}}"#;

/// The page of two throws with their names.
pub fn page(throws: [(&str, &Playback); 2]) -> String {
    let [a, mut b] = throws.map(|(_, playback)| page_data(playback, MOST_POINTS / 2));
    // Both are seen from the same side at first.
    b["scene_view"] = a["scene_view"].clone();
    let surfaces = format!("\"surfaces\":{}", packed::json_in_html(&a["surfaces"]));
    let throw = |(name, playback): (&str, &Playback), data: &Value| {
        let title = packed::text_in_html(&format!("{name}: {}", playback.header.title));
        json!({ "title": title, "data": packed::json_in_html(data).replacen(&surfaces, SURFACES, 1) })
    };
    let data = json!({
        // Page of a throw, in which `{{title}}` and `{{data}}` stand for a throw's own.
        "page": catch_page::template(),
        // The surfaces of the first throw, for which `SURFACES` stands where either throw has them.
        "surfaces": surfaces,
        "throws": [throw(throws[0], &a), throw(throws[1], &b)],
    });
    let title = format!("{} and {}", throws[0].0, throws[1].0);
    document(&title, "pair", "", &fill(PAGE, &[("data", &packed::json_in_html(&data)), ("script", SCRIPT)]))
}
