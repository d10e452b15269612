//! The table of an evaluation: a line per object and throw, beside what was published.

use crate::evaluation::{
    cell_summary::CellSummary,
    published::{published_rate, published_rates},
};

/// Headings of the columns.
pub const HEADINGS: [&str; 11] = [
    "object",
    "throw",
    "trials",
    "caught",
    "95 %",
    "out of reach",
    "within 2.5 cm",
    "paper's Table I",
    "joint travel",
    "limits broken",
    "misses",
];

/// The first column that holds numbers, and the first after them that holds text again.
pub const NUMBERS: std::ops::Range<usize> = 2..10;

/// The lines of the table.
pub fn lines(cells: &[CellSummary]) -> Vec<[String; HEADINGS.len()]> {
    let rates = published_rates();
    let percent = |value: f64| format!("{:.1}", value * 100.0);
    let line = |cell: &CellSummary| {
        let fraction = |count: usize| format!("{count} ({} %)", percent(count as f64 / cell.trials.max(1) as f64));
        let reasons: Vec<String> = cell.reasons.iter().map(|(reason, count)| format!("{count}× {reason}")).collect();
        [
            cell.object.clone(),
            cell.throw.clone(),
            cell.trials.to_string(),
            fraction(cell.caught),
            cell.wilson95
                .map_or("same throw".to_owned(), |[low, high]| format!("{} – {} %", percent(low), percent(high))),
            cell.out_of_reach.map_or("–".to_owned(), |count| count.to_string()),
            fraction(cell.caught_paper),
            published_rate(&rates, cell).map_or("–".to_owned(), |rate| format!("{} %", percent(rate))),
            cell.median_joint_travel_rad.map_or("–".to_owned(), |it| format!("{it:.2} rad")),
            cell.limit_violations.to_string(),
            reasons.join(", "),
        ]
    };
    cells.iter().map(line).collect()
}

/// Returns a sentence about throws that all trials repeat; `None` where every trial has its own throw.
pub fn repeated_throws(cells: &[CellSummary]) -> Option<String> {
    let mut repeated: Vec<&str> =
        cells.iter().filter(|it| it.throw_is_fixed && it.trials > 1).map(|it| it.throw.as_str()).collect();
    repeated.sort_unstable();
    repeated.dedup();
    let (names, verb) = (repeated.join(", "), if repeated.len() == 1 { "is" } else { "are" });
    (!repeated.is_empty()).then(|| {
        format!("{names} {verb} always the same: the trials repeat one throw, which is no sample and has no interval.")
    })
}

/// A time in milliseconds with its unit, in microseconds where it is short.
pub fn shown_ms(ms: f64) -> String {
    if ms < 0.01 { format!("{:.1} µs", ms * 1e3) } else { format!("{ms:.2} ms") }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_time_is_shown_as_zero() {
        let shown = [0.00042, 0.0099, 0.01, 12.345].map(shown_ms);
        assert_eq!(shown, ["0.4 µs", "9.9 µs", "0.01 ms", "12.35 ms"]);
    }
}
