//! What tells whether a catch holds: a logistic regression of the outcomes of honest throws on what each catch was like.

use anyhow::{Context, Result};
use catch_lab::{
    assets::Kind,
    referee::{self, Measures},
    scenario::setup::{Choice, Setup},
    trial,
};
use nalgebra::{DMatrix, DVector};

use crate::{
    Findings, Options,
    logistic_regression::{Coefficients, LogisticRegression},
    parallel,
    results::{Entry, Table},
    spread::percent,
};

/// What a catch is described by, in the units of the weights of grasp selection.
const FEATURES: [&str; 7] = [
    "sideways fraction (catchability)",
    "1 − palm fraction (pass_through)",
    "overhang / 30 mm (overhang)",
    "distance from the axis / 30 mm (strength)",
    "width / 100 mm (width)",
    "relative speed, m/s (speed)",
    "touches the open gripper",
];

/// Keeps what the data do not tell near zero.
const RIDGE: f64 = 0.05;

const LEGEND: &str = "A logistic regression of *caught* on what each catch was like, with one intercept per object; throws without a \
plan are left out. The *weight* is the coefficient in the proportion in which that of the relative speed is the weight `speed` of the \
scenario. How the weights of the scenario `honest` were chosen is in `docs/notebook.md`.";

/// The features of a throw that was tried to be caught.
fn features(it: &Measures) -> Option<[f64; FEATURES.len()]> {
    Some([
        it.sideways_fraction?,
        1.0 - it.palm_fraction?,
        it.grasp_overhang_m? / 0.03,
        it.grasp_strength_m? / 0.03,
        it.grasp_width_m? / 0.1,
        it.relative_speed_mps?,
        if it.approach_is_free? { 0.0 } else { 1.0 },
    ])
}

/// Honest throws of all objects.
pub fn run(options: &Options) -> Result<Findings> {
    let objects = Kind::Object.names();
    let mut speed_weight = 1.0;
    let (mut rows, mut outcomes) = (Vec::new(), Vec::new());
    let mut caught = Table::new("Throws", &["object", "throws", "caught, %", "in the regression"]);
    for (at, object) in objects.iter().enumerate() {
        let setup = Setup::load(&Choice { scenario: Some("honest"), object: Some(object), ..Choice::default() })?;
        speed_weight = setup.scenario.brain.trajectory_optimization.weights.speed;
        setup.prepare();
        let count = options.trials as usize;
        let verdicts = parallel::map(count, |index| {
            let trial = trial::run(&setup, options.seed, index as u64, &mut |_, _| Ok(()));
            trial.map(|trial| referee::judge(&setup, &trial))
        });
        let verdicts = verdicts.into_iter().collect::<Result<Vec<_>, _>>()?;
        let before = outcomes.len();
        for verdict in &verdicts {
            let Some(features) = features(&verdict.measures) else { continue };
            let indicators = (0..objects.len()).map(|it| f64::from(u8::from(it == at)));
            rows.extend(features.into_iter().chain(indicators));
            outcomes.push(f64::from(u8::from(verdict.caught)));
        }
        caught.rows.push(vec![
            Entry::text(*object),
            Entry::Count(count),
            percent(verdicts.iter().filter(|it| it.caught).count(), count),
            Entry::Count(outcomes.len() - before),
        ]);
    }
    let X = DMatrix::from_row_slice(outcomes.len(), FEATURES.len() + objects.len(), &rows);
    let (y, ridge, free) = (DVector::from(outcomes), DVector::repeat(X.ncols(), RIDGE), vec![false; X.ncols()]);
    let regression = LogisticRegression { X: &X, y: &y, ridge: &ridge, is_at_most_zero: &free };
    let Coefficients { beta, standard_errors } = regression.fit().context("the regression has no solution")?;
    let mut table = Table::new("Coefficients", &["feature", "coefficient", "standard error", "weight"]);
    for (i, name) in FEATURES.iter().enumerate() {
        let figures = [Some(beta[i]), standard_errors[i], Some(beta[i] / beta[5] * speed_weight)].map(Entry::Number);
        table.rows.push([Entry::text(*name)].into_iter().chain(figures).collect());
    }
    Ok(Findings { legend: LEGEND, tables: vec![caught, table] })
}
