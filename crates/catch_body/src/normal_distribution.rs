//! Functions of the normal distribution.

/// φ(u)/Φ(−u) for the normal distribution.
///
/// With Chebyshev's fit of Press et al. (Numerical Recipes, 6.2) to the complementary error function, good to
/// 10⁻⁷.
#[inline]
pub fn inverse_mills(u: f64) -> f64 {
    const C: [f64; 10] = [
        -1.265_512_23,
        1.000_023_68,
        0.374_091_96,
        0.096_784_18,
        -0.186_288_06,
        0.278_868_07,
        -1.135_203_98,
        1.488_515_87,
        -0.822_152_23,
        0.170_872_77,
    ];
    let t = 1.0 / (1.0 + 0.5 * u.abs() * std::f64::consts::FRAC_1_SQRT_2);
    // erfc(x) = t·exp(−x² + P(t)) for x ≥ 0, and Φ(−u) = ½·erfc(u/√2): the squares cancel.
    let polynomial = C.iter().rev().fold(0.0, |sum, c| sum * t + c);
    let tail = 0.5 * t * libm::exp(polynomial);
    let density = 1.0 / std::f64::consts::TAU.sqrt();
    if u >= 0.0 {
        density / tail
    } else {
        let square = libm::exp(-0.5 * u * u);
        density * square / (1.0 - tail * square)
    }
}

/// −ln Φ(−u): what a bound costs that is broken by so many standard deviations.
#[inline]
pub fn bound_cost(u: f64) -> f64 {
    (0.5 * (u * u + libm::log(std::f64::consts::TAU)) + libm::log(inverse_mills(u))).max(0.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_inverse_mills_ratio_is_the_slope_of_the_cost() {
        // Φ(−u) by summing the density.
        let upper_tail = |u: f64| -> f64 {
            let h = 1e-4;
            let density = |x: f64| libm::exp(-0.5 * x * x) / std::f64::consts::TAU.sqrt();
            (0..100_000).map(|i| density(u + (f64::from(i) + 0.5) * h) * h).sum()
        };
        for u in [-4.0, -1.5, -0.2, 0.0, 0.7, 2.0, 5.0] {
            let slope = -(libm::log(upper_tail(u + 1e-3)) - libm::log(upper_tail(u - 1e-3))) / 2e-3;
            assert!((inverse_mills(u) - slope).abs() < 1e-4 * slope.max(0.01), "{u}: {} {slope}", inverse_mills(u));
            let cost = -libm::log(upper_tail(u));
            assert!((bound_cost(u) - cost).abs() < 1e-4 * cost.max(0.01), "{u}: {} {cost}", bound_cost(u));
        }
    }
}
