//! A throw as one page: three dimensions, a time slider, and plots tied to it.
//!
//! The page is one file without any reference to another, so it opens from a disk without a network.
//! `page.html` is its body, `page.css` and `viewer.js` in the folder above what pages share, `scene.js` the
//! three dimensions, `drawing.js` and `why.js` their drawing in WebGL 2, `plots.js` the plots and
//! `controls.js` the slider; what was recorded goes in as JSON with packed numbers.

mod contacts;
mod data;
mod points;
mod predictions;
mod surfaces;

use serde_json::Value;

use super::{VIEWER, document, fill, packed};
use crate::playback::Playback;

pub use {data::page_data, points::MOST_POINTS};
pub(super) use {
    data::{joint_data, seven},
    surfaces::packed_surface,
};

const PAGE: &str = include_str!("catch_page/page.html");
const SCRIPTS: [&str; 6] = [
    VIEWER,
    include_str!("catch_page/scene.js"),
    include_str!("catch_page/drawing.js"),
    include_str!("catch_page/why.js"),
    include_str!("catch_page/plots.js"),
    include_str!("catch_page/controls.js"),
];

/// The page of a throw.
pub fn page(playback: &Playback) -> String {
    page_among(playback, Value::Null)
}

/// The page of a throw, with links to others where it is one of a report's.
pub fn page_among(playback: &Playback, links: Value) -> String {
    let mut data = page_data(playback, MOST_POINTS);
    data["links"] = links;
    let data = packed::json_in_html(&data);
    fill(&template(), &[("title", &packed::text_in_html(&playback.header.title)), ("data", &data)])
}

/// The page of any throw, in which `{{title}}` and `{{data}}` stand for a throw's own.
pub(super) fn template() -> String {
    let body = fill(PAGE, &[("title", "{{title}}"), ("data", "{{data}}"), ("script", &SCRIPTS.concat())]);
    document("{{title}}", "catch", "", &body)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_template_names_only_what_is_filled_in() {
        let names: Vec<&str> = PAGE.split("{{").skip(1).filter_map(|part| part.split("}}").next()).collect();
        assert_eq!(names, ["title", "data", "script"]);
        let template = template();
        let names: Vec<&str> = template.split("{{").skip(1).filter_map(|part| part.split("}}").next()).collect();
        assert_eq!(names, ["title", "title", "data"], "no script looks like a place to fill");
    }
}
