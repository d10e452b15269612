//! A throw as one page: three dimensions, a time slider, and plots tied to it.
//!
//! The page is one file without any reference to another, so it opens from a disk without a network. `page.html` is its frame,
//! `page.css` its looks, `scene.js` the three dimensions in WebGL 2, `plots.js` the plots and `controls.js` the slider; what was
//! recorded goes in as JSON with packed numbers.

mod data;
mod points;
mod surfaces;

use crate::{packed, playback::Playback};

pub use data::PageData;
#[cfg(feature = "mcap")]
pub(crate) use points::points_of;

const PAGE: &str = include_str!("catch_page/page.html");
/// Looks that all pages share.
pub(crate) const STYLE: &str = include_str!("catch_page/page.css");
const SCRIPTS: [&str; 3] =
    [include_str!("catch_page/scene.js"), include_str!("catch_page/plots.js"), include_str!("catch_page/controls.js")];

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

/// Puts each value in the place of its `{{name}}`. Values are not looked into, whatever they contain.
pub(crate) fn fill(template: &str, values: &[(&str, &str)]) -> String {
    let mut page = String::with_capacity(template.len() + values.iter().map(|(_, value)| value.len()).sum::<usize>());
    let mut rest = template;
    while let Some(at) = rest.find("{{") {
        let Some(length) = rest[at..].find("}}") else { break };
        page.push_str(&rest[..at]);
        let name = &rest[at + 2..at + length];
        page.push_str(values.iter().find(|(known, _)| *known == name).map_or("", |(_, value)| value));
        rest = &rest[at + length + 2..];
    }
    page.push_str(rest);
    page
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_are_put_in_once_and_not_looked_into() {
        assert_eq!(fill("<{{a}}|{{b}}>", &[("a", "{{b}}"), ("b", "2")]), "<{{b}}|2>");
        assert_eq!(fill("{{none}}.{{", &[]), ".{{");
    }

    #[test]
    fn the_template_names_only_what_is_filled_in() {
        let names: Vec<&str> = PAGE.split("{{").skip(1).filter_map(|part| part.split("}}").next()).collect();
        assert_eq!(names, ["title", "style", "title", "data", "script"]);
    }
}
