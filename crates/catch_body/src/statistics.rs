//! Statistics of samples: medians, quantiles and intervals of rates.

/// The 97.5 % quantile of the normal distribution.
const Z_95: f64 = 1.959_963_984_540_054;

/// Wilson's score interval at 95 % for a probability of which `successes` of `trials` were seen.
///
/// (p + z²/2n ± z·√(p·(1 − p)/n + z²/4n²)) / (1 + z²/n) (Wilson, Probable inference, the law of succession,
/// and statistical inference, 1927). Unlike the textbook's interval it is right near 0 and 1.
pub fn wilson95(successes: usize, trials: usize) -> [f64; 2] {
    if trials == 0 {
        return [0.0, 1.0];
    }
    let n = trials as f64;
    let p = successes as f64 / n;
    let z2 = Z_95 * Z_95;
    let centre = p + z2 / (2.0 * n);
    let reach = Z_95 * (p * (1.0 - p) / n + z2 / (4.0 * n * n)).sqrt();
    [(centre - reach) / (1.0 + z2 / n), (centre + reach) / (1.0 + z2 / n)].map(|bound| bound.clamp(0.0, 1.0))
}

/// Interval at 95 % for the difference of two rates that were measured on the same `trials`, of which
/// `gained` and `lost` changed.
///
/// Wald's with half a trial more in each of the four cells (Agresti and Min, Effects and non-effects of
/// paired identical observations in comparing proportions with binary matched-pairs data, 2005).
pub fn paired95(gained: usize, lost: usize, trials: usize) -> [f64; 2] {
    let (gained, lost, n) = (gained as f64 + 0.5, lost as f64 + 0.5, trials as f64 + 2.0);
    let difference = (gained - lost) / n;
    let reach = Z_95 * ((gained + lost) - (gained - lost).powi(2) / n).sqrt() / n;
    [difference - reach, difference + reach].map(|bound| bound.clamp(-1.0, 1.0))
}

/// The middle of the values, the mean of the two middle ones where their number is even.
pub fn median(values: Vec<f64>) -> Option<f64> {
    quantile(&sorted(values), 0.5)
}

/// The upper of the two middle values, or zero if there is none, without memory of its own: the slice is
/// reordered.
pub fn median_in_place(values: &mut [f64]) -> f64 {
    let middle = values.len() / 2;
    if values.is_empty() { 0.0 } else { *values.select_nth_unstable_by(middle, f64::total_cmp).1 }
}

/// The values in ascending order, as [`quantile`] takes them.
pub fn sorted(values: impl IntoIterator<Item = f64>) -> Vec<f64> {
    let mut values: Vec<f64> = values.into_iter().collect();
    values.sort_by(f64::total_cmp);
    values
}

/// The value below which a fraction of the sorted values lies, linear between neighbours (Hyndman & Fan,
/// Sample quantiles in statistical packages, 1996, definition 7); none of no values.
pub fn quantile(sorted: &[f64], fraction: f64) -> Option<f64> {
    let at = fraction.clamp(0.0, 1.0) * sorted.len().checked_sub(1)? as f64;
    let (low, high) = (sorted[at.floor() as usize], sorted[at.ceil() as usize]);
    // Equal infinities have no difference.
    Some(if low == high { low } else { low + (high - low) * at.fract() })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Against the figures of Newcombe, Two-sided confidence intervals for the single proportion (1998),
    /// table I, method 3.
    #[test]
    fn wilson_agrees_with_published_figures() {
        for (successes, trials, expected) in [
            (81, 263, [0.2553, 0.3662]),
            (15, 148, [0.0624, 0.1605]),
            (0, 20, [0.0, 0.1611]),
            (1, 29, [0.0061, 0.1718]),
        ] {
            let [low, high] = wilson95(successes, trials);
            assert!(
                (low - expected[0]).abs() < 6e-5 && (high - expected[1]).abs() < 6e-5,
                "{successes}/{trials}: {low} {high}"
            );
        }
        assert!(wilson95(561, 570)[0] >= 0.97 && wilson95(560, 570)[0] < 0.97);
    }

    /// Ten and a half less two and a half of a hundred, by hand; nothing that changed tells less of few
    /// trials.
    #[test]
    fn paired_differences_are_wald_s_with_two_trials_more() {
        let [low, high] = paired95(10, 2, 98);
        assert!((low - 0.0111).abs() < 1e-4 && (high - 0.1489).abs() < 1e-4, "{low} {high}");
        assert_eq!(paired95(2, 10, 98), [-high, -low]);
        assert!(paired95(0, 0, 10)[1] > 2.0 * paired95(0, 0, 100)[1]);
    }

    #[test]
    fn quantiles_lie_between_neighbours() {
        assert_eq!(quantile(&[], 0.5), None);
        for fraction in [0.0, 0.25, 1.0] {
            assert_eq!(quantile(&[3.0], fraction), Some(3.0));
        }
        let values = sorted([8.0, 1.0, 4.0, 2.0]);
        assert_eq!(values, [1.0, 2.0, 4.0, 8.0]);
        for (fraction, expected) in
            [(-1.0, 1.0), (0.0, 1.0), (0.25, 1.75), (0.5, 3.0), (0.9, 6.8), (1.0, 8.0), (2.0, 8.0)]
        {
            assert!((quantile(&values, fraction).unwrap() - expected).abs() < 1e-12, "{fraction}");
        }
        assert_eq!(quantile(&[1.0, f64::INFINITY, f64::INFINITY], 0.75), Some(f64::INFINITY));
    }

    #[test]
    fn median_is_in_the_middle() {
        assert_eq!(median(vec![]), None);
        assert_eq!(median(vec![3.0, 1.0, 2.0]), Some(2.0));
        assert_eq!(median(vec![4.0, 1.0, 2.0, 3.0]), Some(2.5));
    }
}
