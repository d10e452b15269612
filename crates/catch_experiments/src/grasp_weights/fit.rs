//! Fit of the weights to throws: a logistic regression of the outcomes on the cost terms of each catch.

use std::collections::BTreeMap;

use anyhow::{Context, Result};
use nalgebra::{DMatrix, DVector};

use super::{
    throws::Throw,
    weights::{SETTINGS, Terms, Weights},
};
use crate::logistic_regression::{LogisticRegression, logistic};

/// Terms with weights, and whether the object touches the open gripper, which has none.
pub const FEATURES: usize = SETTINGS.len() + 1;
/// Ridge of the features, which are scaled to a standard deviation of one.
const RIDGE: f64 = 1.0;
/// Ridge of the objects' intercepts, which keeps them finite where everything is caught.
const INTERCEPT_RIDGE: f64 = 0.1;

/// A throw as the regression sees it.
#[derive(Debug, Clone, PartialEq)]
pub struct Observation {
    /// Name of the object.
    pub object: String,
    /// The terms that have weights.
    pub terms: Terms,
    /// Contact of the object with the open gripper on its approach, 0 or 1.
    touches: f64,
    /// True if the object was caught.
    pub caught: bool,
}

impl Observation {
    /// Observation of a throw whose outcome its grasp decided.
    pub fn of(throw: &Throw) -> Option<Self> {
        let touches = if throw.approach_is_free { 0.0 } else { 1.0 };
        let (object, caught) = (throw.object.clone(), throw.caught);
        Some(Self { object, terms: *throw.of_the_grasp()?, touches, caught })
    }

    fn features(&self) -> [f64; FEATURES] {
        std::array::from_fn(|j| self.terms.get(j).copied().unwrap_or(self.touches))
    }
}

/// Model of the probability of a catch as a function of its terms, with an intercept for each object.
#[derive(Debug)]
pub struct Model {
    /// Change of the log-odds per unit of each feature; at most zero for those with weights.
    pub coefficients: [f64; FEATURES],
    /// Standard errors of the coefficients, `None` where the bound holds.
    pub standard_errors: [Option<f64>; FEATURES],
    /// Mean of the objects' intercepts, which stands for objects that were not seen.
    intercept: f64,
}

impl Model {
    /// The regression over these observations.
    ///
    /// # Errors
    /// If it has no solution.
    pub fn fit(observations: &[&Observation]) -> Result<Self> {
        let count = observations.len();
        let mut objects: Vec<&str> = observations.iter().map(|it| it.object.as_str()).collect();
        objects.sort_unstable();
        objects.dedup();
        let (mean, sd) = moments(observations);
        let X = DMatrix::from_fn(count, FEATURES + objects.len(), |i, j| match j.checked_sub(FEATURES) {
            None => (observations[i].features()[j] - mean[j]) / sd[j],
            Some(object) => f64::from(u8::from(observations[i].object == objects[object])),
        });
        let y = DVector::from_iterator(count, observations.iter().map(|it| f64::from(u8::from(it.caught))));
        let ridge = DVector::from_fn(X.ncols(), |j, _| if j < FEATURES { RIDGE } else { INTERCEPT_RIDGE });
        let is_at_most_zero: Vec<bool> = (0..X.ncols()).map(|j| j < SETTINGS.len()).collect();
        let regression = LogisticRegression { X: &X, y: &y, ridge: &ridge, is_at_most_zero: &is_at_most_zero };
        let found = regression.fit().context("the regression has no solution")?;
        let coefficients: [f64; FEATURES] = std::array::from_fn(|j| found.beta[j] / sd[j]);
        let centred: f64 = coefficients.iter().zip(&mean).map(|(coefficient, mean)| coefficient * mean).sum();
        let intercepts = found.beta.rows(FEATURES, objects.len()).sum() / objects.len().max(1) as f64;
        Ok(Self {
            coefficients,
            standard_errors: std::array::from_fn(|j| found.standard_errors[j].map(|it| it / sd[j])),
            intercept: intercepts - centred,
        })
    }

    /// The probability that an object is caught of which nothing was seen.
    pub fn probability(&self, observation: &Observation) -> f64 {
        let features = observation.features();
        logistic(self.intercept + self.coefficients.iter().zip(&features).map(|(b, x)| b * x).sum::<f64>())
    }

    /// Weights that cost `scale` for each unit of the log-odds.
    pub fn weights(&self, scale: f64) -> Weights {
        std::array::from_fn(|j| (-scale * self.coefficients[j]).max(0.0))
    }
}

/// Mean and standard deviation of each feature; one for the latter where a feature does not vary.
fn moments(observations: &[&Observation]) -> ([f64; FEATURES], [f64; FEATURES]) {
    let n = observations.len().max(1) as f64;
    let mean_of = |f: &dyn Fn([f64; FEATURES], usize) -> f64, j| {
        observations.iter().map(|it| f(it.features(), j)).sum::<f64>() / n
    };
    let mean: [f64; FEATURES] = std::array::from_fn(|j| mean_of(&|x, j| x[j], j));
    let sd = std::array::from_fn(|j| {
        let sd = mean_of(&|x, j| (x[j] - mean[j]).powi(2), j).sqrt();
        if sd > 1e-9 { sd } else { 1.0 }
    });
    (mean, sd)
}

/// The probability of each observation by a model of the other folds' objects: every object is in one of
/// `folds`, in the order of their names.
///
/// # Errors
/// As [`Model::fit`].
pub fn cross_validated(observations: &[Observation], folds: usize) -> Result<Vec<f64>> {
    let names: BTreeMap<&str, ()> = observations.iter().map(|it| (it.object.as_str(), ())).collect();
    let fold_of: BTreeMap<&str, usize> = names.keys().enumerate().map(|(i, name)| (*name, i % folds)).collect();
    let fold = |it: &Observation| fold_of[it.object.as_str()];
    let mut probabilities = vec![0.0; observations.len()];
    for left_out in 0..folds {
        let others: Vec<&Observation> = observations.iter().filter(|it| fold(it) != left_out).collect();
        let model = Model::fit(&others)?;
        for (probability, it) in probabilities.iter_mut().zip(observations).filter(|(_, it)| fold(it) == left_out) {
            *probability = model.probability(it);
        }
    }
    Ok(probabilities)
}

/// Pairs of a catch and a miss: how many in which the catch has the higher score, ties half, and how many
/// there are. The ratio is the area under the receiver operating characteristic (Mann and Whitney's U).
pub fn ordered_pairs(scored: &[(f64, bool)]) -> (f64, usize) {
    let of = |caught: bool| scored.iter().filter(move |(_, it)| *it == caught).map(|(score, _)| *score);
    let right: f64 = of(true)
        .flat_map(|hit| {
            of(false).map(move |miss| {
                if hit > miss {
                    1.0
                } else if hit < miss {
                    0.0
                } else {
                    0.5
                }
            })
        })
        .sum();
    (right, of(true).count() * of(false).count())
}

#[cfg(test)]
mod tests {
    use catch_sim::random_streams::{Draws, Stream};

    use super::*;

    fn observations(count: usize) -> Vec<Observation> {
        let mut draws = Draws::new(Stream::GraspWeights, 1, 0);
        let coefficients = [-6.0, -2.0, -1.0, -0.5, 0.0, 1.0, -0.3];
        let one = |i: usize| {
            let terms: Terms = std::array::from_fn(|_| draws.unit());
            let object = i % 6;
            let log_odds: f64 =
                5.0 - 0.5 * object as f64 + terms.iter().zip(coefficients).map(|(x, b)| b * x).sum::<f64>();
            Observation {
                object: format!("object {object}"),
                terms,
                touches: 0.0,
                caught: draws.unit() < logistic(log_odds),
            }
        };
        (0..count).map(one).collect()
    }

    #[test]
    fn weights_are_those_that_data_have_and_never_negative() {
        let observations = observations(20_000);
        let model = Model::fit(&observations.iter().collect::<Vec<_>>()).unwrap();
        let weights = model.weights(2.0);
        for (found, expected) in weights.iter().zip([12.0, 4.0, 2.0, 1.0, 0.0, 0.0, 0.6]) {
            assert!((found - expected).abs() < 0.35, "{weights:?}");
        }
        // A term that is good by the data costs nothing, and has no standard error.
        assert!(weights[5] == 0.0 && model.standard_errors[5].is_none());
    }

    #[test]
    fn objects_that_were_left_out_are_ordered_and_their_probabilities_right_on_average() {
        let observations = observations(6_000);
        let probabilities = cross_validated(&observations, 5).unwrap();
        let scored: Vec<(f64, bool)> = probabilities.iter().zip(&observations).map(|(p, it)| (*p, it.caught)).collect();
        let (right, pairs) = ordered_pairs(&scored);
        assert!(right / pairs as f64 > 0.75, "{}", right / pairs as f64);
        let (expected, seen) =
            (probabilities.iter().sum::<f64>(), observations.iter().filter(|it| it.caught).count() as f64);
        assert!((expected - seen).abs() / 6_000.0 < 0.03, "{expected} {seen}");
    }

    #[test]
    fn pairs_are_counted_with_ties_as_halves() {
        let scored = [(0.9, true), (0.5, true), (0.5, false), (0.1, false)];
        assert_eq!(ordered_pairs(&scored), (3.5, 4));
        assert_eq!(ordered_pairs(&[(0.9, true)]), (0.0, 0));
    }
}
