//! Expected catch rates: how often throws are caught that a rig knows so well.
//!
//! Two cameras that stand close together, or far away, know a throw to centimetres when the catch is decided,
//! and few of these are caught. How few says a logistic regression on the logarithms of both standard
//! deviations. It was fitted to throws of the built-in objects on ten rigs drawn at random, 15 of each kind,
//! and on `d435_lab`; `catch_experiments -- cameras` reports ten other rigs.

use super::{Config, FlightScore};
use crate::{
    assets::{Asset, Kind},
    scenario::{
        Scenario,
        setup::{DEFAULT_SCENARIO, Setup},
    },
};

/// Logits of balls and of other objects that are known to 1 mm at both times: for others the orientation
/// counts, too.
const AT_1_MM: [f64; 2] = [2.50, 0.99];
/// What the logit loses where the standard deviation is e times as large: at the decision, at the closing.
const LOST: [f64; 2] = [0.51, 0.57];
/// A ball's narrowest extent is its diameter, to this fraction.
const ROUND: f64 = 0.9;
/// The probability that each throw is caught, averaged; none for other arms and hands, and for other times.
pub(super) fn rate(setup: &Setup, config: &Config, flights: &[FlightScore]) -> Option<f64> {
    let times = |it: &Config| (it.decision_s, it.closing_s);
    // The rates were found with the arm and the hand of this scenario.
    let usual = Asset::built_in(Kind::Scenario, DEFAULT_SCENARIO).and_then(|it| Scenario::of_asset(&it)).ok()?;
    let has = |it: &Scenario| (it.robot.clone(), it.gripper.clone());
    if has(&setup.scenario) != has(&usual) || times(config) != times(&Config::default()) {
        return None;
    }
    let is_round = is_round(setup);
    let probabilities = flights.iter().map(|it| probability(it, is_round));
    (!flights.is_empty()).then(|| probabilities.sum::<f64>() / flights.len() as f64)
}

/// Returns whether the thrown object is a ball.
pub fn is_round(setup: &Setup) -> bool {
    let object = &setup.object;
    object.mesh.aabb().size.min() > ROUND * 2.0 * object.bounding_radius_m
}

/// The probability that a throw is caught.
pub fn probability(flight: &FlightScore, is_round: bool) -> f64 {
    let lost = LOST[0] * libm::log(1e3 * flight.decision_sd_m) + LOST[1] * libm::log(1e3 * flight.closing_sd_m);
    1.0 / (1.0 + libm::exp(lost - AT_1_MM[usize::from(!is_round)]))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scenario::setup::Choice;

    #[test]
    fn better_known_throws_are_caught_more_often() {
        let of = |mm: f64| FlightScore { shown_by_two_s: 0.0, decision_sd_m: 2e-3 * mm, closing_sd_m: 1e-3 * mm };
        for is_round in [false, true] {
            let probabilities = [0.3, 1.0, 3.0, 10.0, 100.0].map(|mm| probability(&of(mm), is_round));
            assert!(probabilities.is_sorted_by(|a, b| a > b) && probabilities.iter().all(|it| (0.0..1.0).contains(it)));
        }
        assert!(probability(&of(1.0), true) > probability(&of(1.0), false));
    }

    #[test]
    fn nothing_is_expected_of_what_was_not_measured() {
        let rate = |robot: Option<&str>, object, config: &Config| {
            let setup = Setup::load(&Choice { robot, object, ..Choice::default() }).unwrap();
            let flight = FlightScore { shown_by_two_s: 0.3, decision_sd_m: 1e-3, closing_sd_m: 1e-3 };
            rate(&setup, config, &[flight])
        };
        let usual = Config::default();
        let [ball, banana] = ["tennis_ball", "banana"].map(|object| rate(None, Some(object), &usual).unwrap());
        assert!((ball - 0.924).abs() < 1e-3 && (banana - 0.729).abs() < 1e-3, "{ball} {banana}");
        assert_eq!(rate(Some("panda"), None, &usual), None);
        assert_eq!(rate(None, None, &Config { decision_s: 0.2, ..usual }), None);
    }
}
