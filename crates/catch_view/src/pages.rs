//! Pages for the browser: each is one file without any reference to another, so it opens from a disk without
//! a network.

pub mod calibration_page;
pub mod catch_page;
pub mod compare_page;
pub mod packed;
pub mod pair_page;
pub mod placement_page;
pub mod report_page;
pub mod robot_page;

/// Looks that all pages share.
const STYLE: &str = include_str!("pages/page.css");

/// The three dimensions that pages share: algebra, WebGL, a camera.
const VIEWER: &str = include_str!("pages/viewer.js");

/// HTML around the body of every page.
const FRAME: &str = include_str!("pages/frame.html");

/// A whole page: plain text as its title, a class and styles beside those that all pages share, and what is
/// in it as HTML.
pub fn document(title: &str, class: &str, style: &str, body: &str) -> String {
    let style = [STYLE, style].concat();
    fill(FRAME, &[("title", &packed::text_in_html(title)), ("style", &style), ("class", class), ("body", body)])
}

/// Puts each value in the place of its `{{name}}`. Values are not looked into, whatever they contain.
fn fill(template: &str, values: &[(&str, &str)]) -> String {
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

    /// Relative luminance of a colour `#rrggbb`. (WCAG 2.2.)
    fn luminance(colour: &str) -> f64 {
        let channel = |at: usize| f64::from(u8::from_str_radix(&colour[at..at + 2], 16).unwrap()) / 255.0;
        let linear =
            |value: f64| if value <= 0.04045 { value / 12.92 } else { libm::pow((value + 0.055) / 1.055, 2.4) };
        0.2126 * linear(channel(1)) + 0.7152 * linear(channel(3)) + 0.0722 * linear(channel(5))
    }

    #[test]
    fn text_stands_out_from_its_ground() {
        for theme in STYLE.split(":root").skip(1).take(2) {
            let colour = |name: &str| {
                let value = theme.split(&format!("--{name}: ")).nth(1).unwrap();
                luminance(&value[..7])
            };
            let on = |text: &'static str, ground| (text, ground);
            let grounds =
                ["paper", "card", "sky"].into_iter().flat_map(|ground| [on("ink", ground), on("faint", ground)]);
            let links = ["paper", "card"].map(|ground| on("blue", ground));
            let badges = ["good", "bad", "faint"].map(|ground| on("card", ground));
            for (text, ground) in grounds.chain(links).chain(badges) {
                let [dark, light] = [colour(text).min(colour(ground)), colour(text).max(colour(ground))];
                let contrast = (light + 0.05) / (dark + 0.05);
                assert!(contrast >= 4.5, "{text} on {ground}: {contrast:.2}");
            }
        }
    }
}
