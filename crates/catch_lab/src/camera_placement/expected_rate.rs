//! Expected catch rates: how often throws are caught that a rig knows so well.
//!
//! Two cameras that stand close together, or far away, know a throw to centimetres when the catch is decided,
//! and few of these are caught. How few says a logistic regression on the logarithm of that standard
//! deviation. `catch_experiments -- cameras` fits it to throws of the built-in objects on ten rigs drawn at
//! random, and reports it on ten others.

use super::FlightScore;
use crate::{
    assets::{Asset, Kind},
    scenario::{
        Scenario,
        setup::{DEFAULT_SCENARIO, Setup},
    },
};

/// Coefficients of the [`features`] of a throw.
pub const COEFFICIENTS: [f64; 3] = [3.322, 2.112, -0.678];
/// Cameras of the rigs that they were fitted to.
const CAMERAS: usize = 2;
/// A ball's narrowest extent is its diameter, to this fraction.
const ROUND: f64 = 0.9;

/// The probability that each throw is caught, averaged; none for other arms, hands and numbers of cameras.
pub(super) fn rate(setup: &Setup, cameras: usize, flights: &[FlightScore]) -> Option<f64> {
    // The rates were found with the arm and the hand of this scenario.
    let usual = Asset::built_in(Kind::Scenario, DEFAULT_SCENARIO).and_then(|it| Scenario::of_asset(&it)).ok()?;
    let has = |it: &Scenario| (it.robot.clone(), it.gripper.clone());
    if cameras != CAMERAS || has(&setup.scenario) != has(&usual) {
        return None;
    }
    let is_round = is_round(setup);
    let probabilities = flights.iter().map(|it| probability(&COEFFICIENTS, &features(it, is_round)));
    (!flights.is_empty()).then(|| probabilities.sum::<f64>() / flights.len() as f64)
}

/// Returns whether the thrown object is a ball.
pub fn is_round(setup: &Setup) -> bool {
    let object = &setup.object;
    object.mesh.aabb().size.min() > ROUND * 2.0 * object.bounding_radius_m
}

/// What the logit depends on: whether the object is a ball, whether it is another one, of which the
/// orientation counts, too, and the logarithm of the standard deviation in millimetres at the decision.
pub fn features(flight: &FlightScore, is_round: bool) -> [f64; 3] {
    [f64::from(is_round), f64::from(!is_round), libm::log(1e3 * flight.decision_sd_m)]
}

/// The probability that a throw of these features is caught.
pub fn probability(coefficients: &[f64; 3], features: &[f64; 3]) -> f64 {
    let logit: f64 = features.iter().zip(coefficients).map(|(feature, coefficient)| feature * coefficient).sum();
    1.0 / (1.0 + libm::exp(-logit))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scenario::setup::Choice;

    #[test]
    fn better_known_throws_are_caught_more_often() {
        let of = |mm: f64| FlightScore { shown_by_two_s: 0.0, decision_sd_m: 2e-3 * mm, closing_sd_m: 1e-3 * mm };
        let at = |mm: f64, is_round| probability(&COEFFICIENTS, &features(&of(mm), is_round));
        for is_round in [false, true] {
            let probabilities = [0.3, 1.0, 3.0, 10.0, 100.0].map(|mm| at(mm, is_round));
            assert!(probabilities.is_sorted_by(|a, b| a > b) && probabilities.iter().all(|it| (0.0..1.0).contains(it)));
        }
        assert!(at(1.0, true) > at(1.0, false));
    }

    #[test]
    fn nothing_is_expected_of_what_was_not_measured() {
        let rate = |robot: Option<&str>, object, cameras| {
            let setup = Setup::load(&Choice { robot, object, ..Choice::default() }).unwrap();
            let flight = FlightScore { shown_by_two_s: 0.3, decision_sd_m: 1e-3, closing_sd_m: 1e-3 };
            rate(&setup, cameras, &[flight])
        };
        let [ball, banana] = ["tennis_ball", "banana"].map(|object| rate(None, Some(object), 2).unwrap());
        assert!((ball - 0.965).abs() < 1e-3 && (banana - 0.892).abs() < 1e-3, "{ball} {banana}");
        assert_eq!([rate(Some("panda"), None, 2), rate(None, None, 1)], [None, None]);
    }
}
