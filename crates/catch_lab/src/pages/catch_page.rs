//! A throw as one page: three dimensions, a time slider, and plots tied to it.
//!
//! The page is one file without any reference to another, so it opens from a disk without a network. `page.html` is its frame,
//! `page.css` and `viewer.js` in the folder above what pages share, `scene.js` the three dimensions in WebGL 2, `plots.js` the plots and `controls.js` the slider; what was
//! recorded goes in as JSON with packed numbers.

mod data;
mod points;
mod surfaces;

use super::{STYLE, VIEWER, fill, packed};
use crate::recording::playback::Playback;

pub use data::PageData;
pub(super) use {data::seven, surfaces::PackedSurface};

const PAGE: &str = include_str!("catch_page/page.html");
const SCRIPTS: [&str; 4] = [
    VIEWER,
    include_str!("catch_page/scene.js"),
    include_str!("catch_page/plots.js"),
    include_str!("catch_page/controls.js"),
];

/// The page of a throw.
pub fn page(playback: &Playback) -> String {
    let data = PageData::of(playback);
    fill(
        PAGE,
        &[
            ("title", &packed::text_in_html(&playback.header.title)),
            ("style", STYLE),
            ("data", &packed::json_in_html(&data)),
            ("script", &SCRIPTS.concat()),
        ],
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_template_names_only_what_is_filled_in() {
        let names: Vec<&str> = PAGE.split("{{").skip(1).filter_map(|part| part.split("}}").next()).collect();
        assert_eq!(names, ["title", "style", "title", "data", "script"]);
    }
}
