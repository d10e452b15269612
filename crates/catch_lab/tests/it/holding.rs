//! What tells whether a catch holds: a logistic regression of the outcomes of honest throws on what each catch was like. The
//! weights of grasp selection in the scenario `honest` were chosen from such regressions.

#![allow(clippy::print_stdout, reason = "figures for the docs, shown by --nocapture")]

use catch_lab::{
    evaluation::{Cell, Evaluation, Row},
    scenario::setup::{Choice, Setup},
};
use nalgebra::{DMatrix, DVector};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;

/// What a catch is described by, in the units of the weights.
const FEATURES: [&str; 7] = [
    "sideways fraction (catchability)",
    "1 - palm fraction (pass_through)",
    "overhang / 30 mm (overhang)",
    "distance from the axis / 30 mm (strength)",
    "width / 100 mm (width)",
    "relative speed, m/s (speed)",
    "touches the open gripper",
];

/// The features of a throw that was tried to be caught.
fn features(row: &Row) -> Option<[f64; FEATURES.len()]> {
    let it = &row.verdict.measures;
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

/// Coefficients and their standard errors, by Newton's method; the last column of `X` is constant. A little ridge keeps what
/// the data do not tell near zero.
fn logistic_regression(X: &DMatrix<f64>, y: &DVector<f64>) -> (DVector<f64>, DVector<f64>) {
    let ridge = DMatrix::identity(X.ncols(), X.ncols()) * 0.05;
    let mut w = DVector::zeros(X.ncols());
    let mut inverse = ridge.clone();
    for _ in 0..30 {
        let p = (X * &w).map(|z| 1.0 / (1.0 + (-z).exp()));
        let weighted = DMatrix::from_fn(X.nrows(), X.ncols(), |i, j| X[(i, j)] * p[i] * (1.0 - p[i]));
        inverse = (X.transpose() * weighted + &ridge).try_inverse().unwrap();
        w += &inverse * (X.transpose() * (y - p) - &ridge * &w);
    }
    (w, inverse.diagonal().map(f64::sqrt))
}

#[test]
fn the_regression_finds_coefficients_that_data_have() {
    let mut rng = Pcg64::seed_from_u64(1);
    let X = DMatrix::from_fn(20_000, 3, |_, j| if j == 2 { 1.0 } else { rng.random_range(-2.0..2.0) });
    let truth = DVector::from_column_slice(&[1.5, -0.7, 0.3]);
    let probability = (&X * &truth).map(|z: f64| 1.0 / (1.0 + (-z).exp()));
    let y = probability.map(|p| f64::from(u8::from(rng.random_bool(p))));
    let (found, error) = logistic_regression(&X, &y);
    for i in 0..3 {
        assert!((found[i] - truth[i]).abs() < 4.0 * error[i], "{found} {error}");
        assert!(error[i] < 0.04);
    }
}

/// `cargo test --release --workspace --test it what_tells_whether -- --ignored --nocapture`.
#[test]
#[ignore = "takes five minutes"]
fn what_tells_whether_a_catch_holds() {
    let setup =
        |object| Setup::load(&Choice { scenario: Some("honest"), object: Some(object), ..Choice::default() }).unwrap();
    let cells = ["banana", "pill_bottle"].map(|object| Cell::new(setup(object))).into();
    let evaluation = Evaluation { cells, seed: 1, first: 0, trials: 400 };
    let (mut rows, mut caught) = (Vec::new(), Vec::new());
    let threads = std::thread::available_parallelism().map_or(1, usize::from);
    let mut within_reach = [[0; 2]; 2];
    let mut add = |row: Row, _| {
        if !row.verdict.is_out_of_reach() {
            let of_object = &mut within_reach[usize::from(row.scene.object == "banana")];
            of_object[0] += usize::from(row.verdict.caught);
            of_object[1] += 1;
        }
        if let Some(features) = features(&row) {
            let object = f64::from(u8::from(row.scene.object == "banana"));
            rows.extend(features.into_iter().chain([object, 1.0]));
            caught.push(f64::from(u8::from(row.verdict.caught)));
        }
        Ok(())
    };
    evaluation.run(0, threads, &mut add).unwrap();
    let (w, error) =
        logistic_regression(&DMatrix::from_row_slice(caught.len(), FEATURES.len() + 2, &rows), &DVector::from(caught));
    println!("caught, of those within reach: bottle {:?}, banana {:?}", within_reach[0], within_reach[1]);
    let speed = w[5] / 1.4;
    for (i, name) in FEATURES.iter().enumerate() {
        println!("{name}: {:.2} ± {:.2}, a weight of {:.1}", w[i], error[i], w[i] / speed);
    }
    assert!(w[0] < 0.0 && w[1] < 0.0 && speed < 0.0, "what points at a finger, or is fast, is caught more often");
}
