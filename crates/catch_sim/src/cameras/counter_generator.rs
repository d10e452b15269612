//! Random numbers by counting: each is a pure function of where it belongs, so that what is rendered, and in
//! which order, changes none of them.
//!
//! The numbers of a key are the outputs of SplitMix64 (Steele, Lea & Flood, Fast splittable pseudorandom
//! number generators, 2014), of which every one can be computed without those before it: output n is
//! mixed(key + (n + 1)·γ). Keys form a tree: scene, camera, frame, purpose.

use crate::random_streams::{Draws, Stream, mixed};

/// SplitMix64's increment γ, the odd number nearest to 2⁶⁴ over the golden ratio.
const GAMMA: u64 = 0x9e37_79b9_7f4a_7c15;

/// A sequence of random numbers, of which each can be asked for by itself.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Key(u64);

impl Key {
    /// The key of everything that happens to the cameras of a scene.
    pub fn of_scene(seed: u64, index: u64) -> Self {
        Self(Draws::new(Stream::Sensors, seed, index).bits())
    }

    /// The key of part `n`, independent of those of all other parts.
    pub fn part(self, n: u64) -> Self {
        // Mixed twice, so that no part's key is a number of its parent's sequence.
        Self(mixed(self.bits(n) ^ GAMMA))
    }

    /// The 64 random bits of place `n`.
    #[inline]
    pub fn bits(self, n: u64) -> u64 {
        mixed(self.0.wrapping_add(n.wrapping_add(1).wrapping_mul(GAMMA)))
    }

    /// A standard normal number for place `n`.
    pub fn normal(self, n: u64) -> f64 {
        normal((self.bits(n) >> 32) as u32)
    }

    /// A number from 0 to below 1 for place `n`.
    pub fn unit(self, n: u64) -> f64 {
        unit((self.bits(n) >> 32) as u32)
    }
}

/// A number from 0 to below 1 out of 32 random bits.
#[inline]
pub(super) fn unit(bits: u32) -> f64 {
    f64::from(bits) * (0.5f64).powi(32)
}

/// A standard normal number out of 32 random bits: the quantile of (bits + ½)/2³², at most 6.3 in size.
///
/// Rational approximation with a relative error below 1.2e-9 (P. J. Acklam, An algorithm for computing the
/// inverse normal cumulative distribution function, 2003).
#[inline]
pub(super) fn normal(bits: u32) -> f64 {
    const CENTRE: [f64; 6] = [
        -3.969_683_028_665_376e1,
        2.209_460_984_245_205e2,
        -2.759_285_104_469_687e2,
        1.383_577_518_672_69e2,
        -3.066_479_806_614_716e1,
        2.506_628_277_459_239,
    ];
    const CENTRE_BELOW: [f64; 6] = [
        -5.447_609_879_822_406e1,
        1.615_858_368_580_409e2,
        -1.556_989_798_598_866e2,
        6.680_131_188_771_972e1,
        -1.328_068_155_288_572e1,
        1.0,
    ];
    /// Fraction of each tail that the other approximation takes over.
    const TAIL: f64 = 0.024_25;
    // Distance from the median.
    let q = (f64::from(bits) + 0.5) * (0.5f64).powi(32) - 0.5;
    if q.abs() <= 0.5 - TAIL {
        q * polynomial(&CENTRE, q * q) / polynomial(&CENTRE_BELOW, q * q)
    } else {
        tail(0.5 - q.abs()).copysign(q)
    }
}

/// The size of the quantile of a small probability.
#[cold]
fn tail(p: f64) -> f64 {
    const TAIL: [f64; 6] = [
        -7.784_894_002_430_293e-3,
        -3.223_964_580_411_365e-1,
        -2.400_758_277_161_838,
        -2.549_732_539_343_734,
        4.374_664_141_464_968,
        2.938_163_982_698_783,
    ];
    const TAIL_BELOW: [f64; 5] =
        [7.784_695_709_041_462e-3, 3.224_671_290_700_398e-1, 2.445_134_137_142_996, 3.754_408_661_907_416, 1.0];
    let r = (-2.0 * libm::log(p)).sqrt();
    (polynomial(&TAIL, r) / polynomial(&TAIL_BELOW, r)).abs()
}

/// The polynomial with these coefficients, that of the highest power first.
#[inline]
fn polynomial<const N: usize>(coefficients: &[f64; N], x: f64) -> f64 {
    coefficients.iter().fold(0.0, |sum, coefficient| sum * x + coefficient)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Quantiles from tables of the normal distribution.
    #[test]
    fn normal_numbers_are_quantiles() {
        for (fraction, quantile) in [
            (0.5, 0.0),
            (0.841_344_746_068_543, 1.0),
            (0.158_655_253_931_457, -1.0),
            (0.977_249_868_051_821, 2.0),
            (0.001_349_898_031_63, -3.0),
            (0.999_968_328_758_167, 4.0),
        ] {
            let found = normal((fraction * 2.0f64.powi(32)) as u32);
            // 32 bits resolve a fraction of 2.3e-10, at four standard deviations 1.7e-6 of the quantile.
            assert!((found - quantile).abs() < 3e-6, "{fraction}: {found}");
        }
        assert!(normal(0) < -6.2 && normal(u32::MAX) > 6.2 && normal(u32::MAX).is_finite());
    }

    /// Compares with the moments of the normal distribution, with their standard errors over a million
    /// numbers; the numbers of one key, and the first numbers of neighbouring keys.
    #[test]
    fn numbers_of_a_key_and_of_neighbouring_keys_are_normal_and_independent() {
        const COUNT: u64 = 1_000_000;
        let key = Key::of_scene(3, 5);
        let sequences: [&dyn Fn(u64) -> f64; 3] =
            [&|n| key.normal(n), &|n| key.part(n).normal(0), &|n| key.part(n % 1000).part(n / 1000).normal(7)];
        for (name, draw) in sequences.iter().enumerate() {
            let (mut moments, mut serial, mut beyond, mut last) = ([0.0; 4], 0.0, 0, 0.0);
            for n in 0..COUNT {
                let x = draw(n);
                for (power, moment) in (1..).zip(&mut moments) {
                    *moment += x.powi(power) / COUNT as f64;
                }
                serial += x * last / COUNT as f64;
                beyond += usize::from(x.abs() > 4.0);
                last = x;
            }
            // Var(xᵏ) = E[x²ᵏ] − E[xᵏ]²: 1, 2, 15, 96.
            for (moment, (mean, variance)) in moments.iter().zip([(0.0, 1.0), (1.0, 2.0), (0.0, 15.0), (3.0, 96.0)]) {
                let errors = (moment - mean) / f64::sqrt(variance / COUNT as f64);
                assert!(errors.abs() < 4.0, "sequence {name}: {moments:?}");
            }
            assert!(serial.abs() < 4.0 / (COUNT as f64).sqrt(), "sequence {name}: {serial}");
            // 63.3 are expected beyond four standard deviations, give or take 8.
            assert!((32..=95).contains(&beyond), "sequence {name}: {beyond}");
        }
    }

    /// Recorded results depend on these values: they may never change.
    #[test]
    fn values_are_stable() {
        let key = Key::of_scene(0, 0);
        assert_eq!([key.bits(0), key.part(1).bits(2)], [16_277_247_434_422_746_576, 14_893_516_788_499_821_774]);
    }
}
