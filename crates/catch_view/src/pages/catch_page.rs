//! A throw as one page: three dimensions, a time slider, and plots tied to it.
//!
//! The page is one file without any reference to another, so it opens from a disk without a network.
//! `page.html` is its body, `page.css` and `viewer.js` in the folder above what pages share, `scene.js` the
//! three dimensions, `drawing.js` and `why.js` their drawing in WebGL 2, `plots.js` the plots and `controls.js` the
//! slider; what was recorded goes in
//! as JSON with packed numbers.

mod contacts;
mod data;
mod points;
mod predictions;
mod surfaces;

use super::{VIEWER, document, fill, packed};
use crate::playback::Playback;

pub use data::PageData;
pub(super) use {data::seven, surfaces::PackedSurface};

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
    let (title, data) = (&playback.header.title, packed::json_in_html(&PageData::of(playback)));
    let heading = packed::text_in_html(title);
    let body = fill(PAGE, &[("title", &heading), ("data", &data), ("script", &SCRIPTS.concat())]);
    document(title, "catch", "", &body)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_template_names_only_what_is_filled_in() {
        let names: Vec<&str> = PAGE.split("{{").skip(1).filter_map(|part| part.split("}}").next()).collect();
        assert_eq!(names, ["title", "data", "script"]);
    }
}
