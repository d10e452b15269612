//! Times, and quantiles of what was measured as entries of tables.

use catch_body::statistics::{paired95, quantile, sorted, wilson95};

use crate::results::Entry;

/// The values below which these fractions of the values lie, times a factor.
pub fn quantiles<const N: usize>(values: &[f64], fractions: [f64; N], factor: f64) -> [Entry; N] {
    let values = sorted(values.iter().map(|value| factor * value));
    fractions.map(|fraction| Entry::Number(quantile(&values, fraction)))
}

/// The median, times a factor.
pub fn median(values: &[f64], factor: f64) -> Entry {
    let [middle] = quantiles(values, [0.5], factor);
    middle
}

/// The median and the 95 % quantile, times a factor.
pub fn spread(values: &[f64], factor: f64) -> Entry {
    let values = sorted(values.iter().map(|value| factor * value));
    Entry::Spread([0.5, 0.95].iter().filter_map(|&fraction| quantile(&values, fraction)).collect())
}

/// A part of a whole in percent, with Wilson's interval of 95 %.
pub fn rate(part: usize, whole: usize) -> Entry {
    let [from, to] = wilson95(part, whole);
    Entry::Spread([part as f64 / whole.max(1) as f64, from, to].map(|it| 100.0 * it).into())
}

/// A part of a whole in percent.
pub fn percent(part: usize, whole: usize) -> Entry {
    Entry::Number((whole > 0).then(|| 100.0 * part as f64 / whole as f64))
}

/// Points by which the second of each pair is more often true, and their interval of 95 %.
pub fn gained(pairs: &[(bool, bool)]) -> [f64; 3] {
    let count = |pair| pairs.iter().filter(|it| **it == pair).count();
    let (gained, lost) = (count((false, true)), count((true, false)));
    let [from, to] = paired95(gained, lost, pairs.len());
    [(gained as f64 - lost as f64) / pairs.len().max(1) as f64, from, to].map(|it| 100.0 * it)
}

/// CPU time of this thread in milliseconds, which other programs hardly disturb; not a number where it cannot
/// be told.
pub fn cpu_ms() -> f64 {
    #[cfg(unix)]
    let time = rustix::time::clock_gettime(rustix::time::ClockId::ThreadCPUTime);
    #[cfg(unix)]
    return time.tv_sec as f64 * 1e3 + time.tv_nsec as f64 * 1e-6;
    #[cfg(not(unix))]
    f64::NAN
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_gained_and_lost_makes_the_difference() {
        let pairs = [(true, true), (true, false), (false, true), (false, false), (true, false)];
        let [points, from, to] = gained(&pairs);
        assert!((points + 20.0).abs() < 1e-9 && from < points && points < to, "{points} ({from} to {to})");
    }
}
