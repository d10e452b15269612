//! Rows of a report: a label, a track with marks on it, and a value.

use crate::pages::packed::text_in_html;

/// Mark on a track; places are fractions of its length.
#[derive(Debug, Clone, Copy)]
pub enum Mark {
    /// A bar from one place to another.
    Bar(f64, f64),
    /// A bar of something bad.
    Bad(f64, f64),
    /// An interval.
    Range(f64, f64),
    /// A middle value.
    Dot(f64),
    /// A largest value.
    Most(f64),
    /// A published value.
    Paper(f64),
    /// A part of a distribution: from one place to another, and its height.
    Part(f64, f64, f64),
}

impl Mark {
    fn html(self) -> String {
        let (class, from, until) = match self {
            Self::Bar(from, until) => ("bar", from, Some(until)),
            Self::Bad(from, until) => ("bar bad", from, Some(until)),
            Self::Range(from, until) => ("range", from, Some(until)),
            Self::Dot(at) => ("dot", at, None),
            Self::Most(at) => ("most", at, None),
            Self::Paper(at) => ("paper", at, None),
            Self::Part(from, until, _) => ("part", from, Some(until)),
        };
        let percent = |fraction: f64| format!("{:.2}%", fraction.clamp(0.0, 1.0) * 100.0);
        let width = until.map_or(String::new(), |until| format!(";width:{}", percent(until - from)));
        let height =
            if let Self::Part(.., height) = self { format!(";height:{}", percent(height)) } else { String::new() };
        format!("<i class=\"{class}\" style=\"left:{}{width}{height}\"></i>", percent(from))
    }
}

/// A row: a label, a track and a value.
pub fn row(label: &str, marks: &[Mark], value: &str, thin: bool) -> String {
    let (label, track, value) = (text_in_html(label), track(marks, thin), text_in_html(value));
    format!("<div class=\"row\"><span>{label}</span>{track}<span class=\"value\">{value}</span></div>\n")
}

/// A track with marks on it; thin ones have no ground of their own.
pub fn track(marks: &[Mark], thin: bool) -> String {
    let marks: String = marks.iter().map(|mark| mark.html()).collect();
    let class = if thin { "track thin" } else { "track" };
    format!("<div class=\"{class}\">{marks}</div>")
}

/// Scale of the values on a track.
#[derive(Debug, Clone, Copy)]
pub struct Scale {
    /// Powers of ten at both ends; without them the track goes from 0 to 1.
    decades: Option<(i32, i32)>,
    unit: &'static str,
}

impl Scale {
    /// Scale from 0 to 100 %.
    pub const FRACTION: Self = Self { decades: None, unit: "%" };

    /// A logarithmic scale that holds all positive values.
    pub fn decades(values: &[f64], unit: &'static str) -> Self {
        let logarithms = || values.iter().filter(|value| **value > 0.0).map(|value| libm::log10(*value));
        let high = logarithms().fold(f64::NEG_INFINITY, f64::max).ceil().clamp(-6.0, 9.0) as i32;
        let low = logarithms().fold(f64::INFINITY, f64::min).floor().clamp(f64::from(high) - 6.0, 9.0) as i32;
        Self { decades: Some((low.min(high - 1), high)), unit }
    }

    /// The place of a value.
    pub fn place(&self, value: f64) -> f64 {
        let Some((low, high)) = self.decades else { return value };
        ((libm::log10(value.max(1e-12)) - f64::from(low)) / f64::from(high - low)).clamp(0.0, 1.0)
    }

    /// The axis below the rows.
    pub fn axis(&self) -> String {
        let ticks: Vec<(f64, String)> = match self.decades {
            None => [0, 25, 50, 75, 100].map(|it| (f64::from(it) / 100.0, format!("{it}"))).to_vec(),
            Some((low, high)) => {
                let label = |power: i32| format!("{:.*}", (-power).max(0) as usize, 10f64.powi(power));
                (low..=high).map(|it| (f64::from(it - low) / f64::from(high - low), label(it))).collect()
            }
        };
        let last = ticks.len() - 1;
        let tick = |(i, (place, label)): (usize, &(f64, String))| {
            let unit = if i == last { format!(" {}", self.unit) } else { String::new() };
            format!("<span style=\"left:{:.2}%\">{label}{unit}</span>", place * 100.0)
        };
        let ticks: String = ticks.iter().enumerate().map(tick).collect();
        format!("<div class=\"axis\"><div></div><div>{ticks}</div><div></div></div>\n")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn decades_hold_all_values() {
        let scale = Scale::decades(&[0.02, 3.0, 70.0, 0.0], "mm");
        assert_eq!(scale.decades, Some((-2, 2)));
        assert_eq!((scale.place(0.01), scale.place(1.0), scale.place(100.0)), (0.0, 0.5, 1.0));
        assert!(scale.axis().contains("0.01") && scale.axis().contains("100 mm"));
        // One value, or none, still makes a scale.
        for values in [&[1.0][..], &[]] {
            let (low, high) = Scale::decades(values, "mm").decades.unwrap();
            assert!(low < high);
        }
    }
}
