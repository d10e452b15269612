//! Random streams: one per purpose, independent of each other, a pure function of (seed, index).
//!
//! What one purpose draws never shifts what another sees, so that switching a sensor's noise on does not
//! change the throw. The generator (PCG XSL RR 128/64) and the way its bits become numbers are value-stable:
//! they are fixed here and not left to the next version of a library.

use rand::Rng;
use rand_pcg::Pcg64;

/// The purpose of a random stream.
///
/// Recorded results depend on these numbers: a stream keeps its own for good.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Stream {
    /// Position and velocity of the release.
    Throw = 0,
    /// Friction.
    Friction = 1,
    /// Noise, losses and calibration of the cameras.
    Sensors = 2,
    /// Phase of the gripper in its cycle.
    Gripper = 3,
    /// The brain's sampling.
    Brain = 4,
    /// Orientation of the object at the release.
    Orientation = 16,
    /// Spin of the object.
    Spin = 17,
    /// Restitution.
    Restitution = 18,
    /// Drag.
    Drag = 19,
    /// Masses of the arm's links.
    LinkMasses = 21,
    /// True mounting of the gripper.
    ToolMount = 22,
    /// Noise of the joint encoders.
    Encoders = 23,
    /// Errors of the robot controller's time stamps, and which trajectories it declines.
    RobotController = 24,
    /// Choice among several objects.
    Object = 25,
    /// Aerodynamic coefficients.
    Aerodynamics = 26,
    /// Errors of the cameras' poses before they are calibrated.
    Calibration = 27,
    /// Path of a person.
    Person = 28,
    /// Surfaces of the arm's links.
    LinkSurfaces = 30,
}

/// Uniform numbers.
#[derive(Debug, Clone)]
pub struct Draws(Pcg64);

impl Draws {
    /// The numbers for one purpose in the scene (`seed`, `index`).
    pub fn new(stream: Stream, seed: u64, index: u64) -> Self {
        // Neighbouring seeds and indices must not give neighbouring states.
        let high = mixed(mixed(seed) ^ index);
        let low = mixed(high ^ 0x9e37_79b9_7f4a_7c15);
        Self(Pcg64::new(u128::from(high) << 64 | u128::from(low), stream as u128))
    }

    /// The next 64 random bits.
    pub fn bits(&mut self) -> u64 {
        self.0.next_u64()
    }

    /// A number from 0 to below 1, with 53 random bits.
    pub fn unit(&mut self) -> f64 {
        (self.bits() >> 11) as f64 * (0.5f64).powi(53)
    }

    /// A number from the normal distribution with mean 0 and standard deviation 1 (Box & Muller, A note on
    /// the generation of random normal deviates, 1958; one of the pair).
    pub fn normal(&mut self) -> f64 {
        let radius = (-2.0 * libm::log(1.0 - self.unit())).sqrt();
        radius * libm::cos(std::f64::consts::TAU * self.unit())
    }

    /// A number between two bounds.
    pub fn between(&mut self, [low, high]: [f64; 2]) -> f64 {
        low + (high - low) * self.unit()
    }
}

/// A bijection that spreads every input bit over all output bits: the finalizer of SplitMix64 (Steele, Lea &
/// Flood, Fast splittable pseudorandom number generators, 2014).
pub(crate) fn mixed(mut bits: u64) -> u64 {
    bits = (bits ^ (bits >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    bits = (bits ^ (bits >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    bits ^ (bits >> 31)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn streams_seeds_and_indices_are_independent() {
        let first = |stream, seed, index| Draws::new(stream, seed, index).bits();
        let reference = first(Stream::Throw, 1, 2);
        assert_eq!(reference, first(Stream::Throw, 1, 2));
        for other in [
            first(Stream::Brain, 1, 2),
            first(Stream::Throw, 2, 2),
            first(Stream::Throw, 1, 3),
            first(Stream::Throw, 2, 1),
        ] {
            assert_ne!(reference, other);
        }
    }

    #[test]
    fn first_draws_of_neighbouring_scenes_are_uniform() {
        let draws: Vec<f64> = (0..10_000).map(|index| Draws::new(Stream::Throw, 7, index).unit()).collect();
        let mean = draws.iter().sum::<f64>() / draws.len() as f64;
        assert!((mean - 0.5).abs() < 0.015, "{mean}");
        let correlation: f64 =
            draws.windows(2).map(|pair| (pair[0] - 0.5) * (pair[1] - 0.5)).sum::<f64>() * 12.0 / draws.len() as f64;
        assert!(correlation.abs() < 0.05, "{correlation}");
    }

    /// Recorded results depend on these values: they may never change.
    #[test]
    fn values_are_stable() {
        let mut draws = Draws::new(Stream::Throw, 0, 0);
        assert_eq!([draws.bits(), draws.bits()], [2_028_211_086_301_335_255, 9_504_774_133_694_213_877]);
    }
}
