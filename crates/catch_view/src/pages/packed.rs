//! Numbers and texts as pages carry them: small, and unable to break out of where they stand.

use base64::{Engine, prelude::BASE64_STANDARD};
use catch_body::input_error::steers_text;
use serde::Serialize;

/// Rows of numbers in 16 bits each: value = offset + scale · integer, little endian, in base64.
///
/// Over the range of the numbers the rounding error is at most 1/131,070 of it.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Packed {
    offset: f64,
    scale: f64,
    /// Numbers per row.
    columns: usize,
    data: String,
}

impl Packed {
    /// Packs rows of `columns` numbers; one that is not finite becomes the smallest.
    pub fn numbers(values: &[f64], columns: usize) -> Self {
        let finite = || values.iter().copied().filter(|value| value.is_finite());
        let (low, high) = (finite().fold(f64::INFINITY, f64::min), finite().fold(f64::NEG_INFINITY, f64::max));
        let (offset, range) = if low <= high { (low, high - low) } else { (0.0, 0.0) };
        let scale = if range > 0.0 { range / f64::from(u16::MAX) } else { 1.0 };
        let integers = values.iter().map(|value| {
            let value = if value.is_finite() { *value } else { offset };
            // Within 0 to 65535 but for rounding, which the cast saturates.
            ((value - offset) / scale).round() as u16
        });
        Self { offset, scale, columns, data: encode(integers) }
    }

    /// Packs rows of indices below 65,536 as they are.
    pub fn indices(values: impl Iterator<Item = u16>, columns: usize) -> Self {
        Self { offset: 0.0, scale: 1.0, columns, data: encode(values) }
    }
}

fn encode(integers: impl Iterator<Item = u16>) -> String {
    BASE64_STANDARD.encode(integers.flat_map(u16::to_le_bytes).collect::<Vec<u8>>())
}

/// JSON to stand in a `<script type="application/json">`: no `<` in it can end the element or open a comment.
pub fn json_in_html(value: &impl Serialize) -> String {
    let text = serde_json::to_string(value).unwrap_or_else(|fault| format!("\"{fault}\""));
    let text: String = text.chars().map(|it| if steers_text(it) { char::REPLACEMENT_CHARACTER } else { it }).collect();
    text.replace('<', "\\u003c").replace('\u{2028}', "\\u2028").replace('\u{2029}', "\\u2029")
}

/// Text to stand in HTML or in an attribute between quotes.
pub fn text_in_html(text: &str) -> String {
    let mut escaped = String::with_capacity(text.len());
    for letter in text.chars() {
        match letter {
            '&' => escaped.push_str("&amp;"),
            '<' => escaped.push_str("&lt;"),
            '>' => escaped.push_str("&gt;"),
            '"' => escaped.push_str("&quot;"),
            '\'' => escaped.push_str("&#39;"),
            '\n' | '\t' => escaped.push(letter),
            _ if steers_text(letter) => escaped.extend(letter.escape_unicode()),
            _ => escaped.push(letter),
        }
    }
    escaped
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A name that would turn what follows it, or end the element, does neither.
    #[test]
    fn foreign_texts_steer_no_page() {
        let name = "joint\u{202e}gpj.<script>\u{7}";
        assert_eq!(text_in_html(name), "joint\\u{202e}gpj.&lt;script&gt;\\u{7}");
        let json = json_in_html(&name);
        assert!(!json.contains('<') && !json.contains('\u{202e}'), "{json}");
    }

    fn unpack(packed: &Packed) -> Vec<f64> {
        let bytes = BASE64_STANDARD.decode(&packed.data).unwrap();
        let integers = bytes.chunks(2).map(|pair| f64::from(u16::from_le_bytes([pair[0], pair[1]])));
        integers.map(|integer| packed.offset + packed.scale * integer).collect()
    }

    #[test]
    fn numbers_come_back_within_half_a_step() {
        let values: Vec<f64> = (0..1000).map(|i| libm::sin(f64::from(i) * 0.7) * 3.0 - 1.0).collect();
        let packed = Packed::numbers(&values, 4);
        let worst = values.iter().zip(unpack(&packed)).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        assert!(worst <= 6.0 / 131_070.0 * 1.001, "{worst}");
    }

    #[test]
    fn constants_and_gaps_are_packed() {
        assert_eq!(unpack(&Packed::numbers(&[2.5, 2.5], 1)), [2.5, 2.5]);
        assert_eq!(unpack(&Packed::numbers(&[f64::NAN, 1.0, 3.0], 1))[0], 1.0);
        assert_eq!(unpack(&Packed::numbers(&[f64::INFINITY], 1)), [0.0]);
        assert_eq!(unpack(&Packed::numbers(&[], 3)), Vec::<f64>::new());
        assert_eq!(unpack(&Packed::indices([7, 65535].into_iter(), 1)), [7.0, 65535.0]);
    }

    #[test]
    fn nothing_ends_the_element_it_stands_in() {
        let hostile = "</script><!--<img src=x onerror='alert(\"1\")'>&\u{2028}";
        let json = json_in_html(&hostile);
        assert!(!json.contains('<') && !json.contains('\u{2028}'), "{json}");
        assert_eq!(serde_json::from_str::<String>(&json).unwrap(), hostile);
        let text = text_in_html(hostile);
        assert!(!text.contains(['<', '>', '"', '\'']), "{text}");
    }
}
