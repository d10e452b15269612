//! The fraction of the acceleration limit that plans may use, by what the link loses.

/// Longest run of lost answers that the margin was seen to survive: `losses_within_the_margin_are_survived`.
pub const LONGEST_RUN: u64 = 2;
/// Fraction of the acceleration limit with which such runs ended in no reflex.
const WITH_LOSSES: f64 = 0.85;

/// Fraction of the acceleration limit that plans may use on a link that loses up to `longest_run` answers in
/// a row. None: no plan may be executed over such a link.
pub fn acceleration_ratio(longest_run: u64) -> Option<f64> {
    match longest_run {
        // A link that lost nothing while it was measured may lose an answer in the next throw.
        0..=LONGEST_RUN => Some(WITH_LOSSES),
        _ => None,
    }
}
