//! Rigs that nobody placed: two cameras somewhere around the arm, calibrated on it, and how well their catch
//! rates are expected.

use std::ops::Range;

use anyhow::Result;
use catch_body::pose::look_at;
use catch_cell::CameraModel;
use catch_lab::{
    assets::Kind,
    camera_placement::{self, FlightScore, PlacementStudy, expected_rate},
    scenario::setup::{Choice, Setup},
};
use catch_sim::random_streams::{Draws, Stream};
use nalgebra::{Matrix3, Point3, Vector3};
use serde::{Deserialize, Serialize};

use crate::{
    Options, kept,
    rates::judged,
    results::{Entry, Table},
    spread::{percent, rate},
};

/// Rigs to which expected rates are fitted.
const FITTED: Range<u64> = 0..10;
/// Rigs that are reported.
const REPORTED: Range<u64> = 10..20;
/// Throws of a kind on each rig, per trial of the page.
const PER_TRIAL: f64 = 0.125;
/// Parts of equal width into which expected rates are divided.
const BINS: usize = 5;
/// Throws of each object on each rig.
const THROWS: [&str; 2] = ["random", "by_hand"];
/// What coefficients cost, so that a fit to few throws has a solution.
const RIDGE: f64 = 0.01;
/// Time for which two cameras have to see a flight, in seconds.
const SEEN_S: f64 = 0.25;

/// Width, height, focal length in pixels, and images a second.
const IMAGES: [(u32, u32, f64, f64); 3] = [(848, 480, 433.0, 90.0), (848, 480, 433.0, 90.0), (640, 576, 504.0, 30.0)];

/// One throw: what the rig knows of it, and what came of it.
#[derive(Debug, Clone, Serialize, Deserialize)]
struct Thrown {
    caught: bool,
    shown_by_two_s: f64,
    features: [f64; 3],
}

/// Two cameras 1.5 to 3.5 m from the base and 0.8 to 2.5 m high, which look at the working space.
fn cameras(kind: &CameraModel, rig: u64) -> Vec<CameraModel> {
    let mut draws = Draws::new(Stream::Calibration, rig, 2);
    let mut camera = || {
        let around = draws.between([-std::f64::consts::PI, std::f64::consts::PI]);
        let away_m = draws.between([1.5, 3.5]);
        let eye = Point3::new(away_m * libm::cos(around), away_m * libm::sin(around), draws.between([0.8, 2.5]));
        let aim = Point3::new(draws.between([0.2, 0.8]), draws.between([-0.4, 0.4]), draws.between([0.3, 0.9]));
        let (width_px, height_px, focal_px, rate_hz) = IMAGES[(draws.unit() * IMAGES.len() as f64) as usize];
        CameraModel {
            X_WC: look_at(&eye, &aim),
            width_px,
            height_px,
            focal_px,
            principal_px: [f64::from(width_px) / 2.0, f64::from(height_px) / 2.0],
            rate_hz: Some(rate_hz),
            ..kind.clone()
        }
    };
    vec![camera(), camera()]
}

/// The throws of an object on a rig.
fn thrown(rig: u64, setup: &Setup, options: &Options) -> Result<Vec<Thrown>> {
    let seed = options.seed + rig;
    let trials = (PER_TRIAL * options.trials as f64).ceil() as u64;
    let config = camera_placement::Config { seed, throws: trials, ..Default::default() };
    let score = PlacementStudy::new(setup, &config)?.score(&setup.used_cameras(seed));
    let is_round = expected_rate::is_round(setup);
    let result = |(caught, flight): (bool, &FlightScore)| {
        let features = expected_rate::features(flight, is_round);
        Thrown { caught, shown_by_two_s: flight.shown_by_two_s, features }
    };
    let caught = judged(setup, seed, 0..trials, |_, verdict| verdict.caught);
    Ok(caught.into_iter().zip(&score.flights).map(result).collect())
}

/// All throws of a rig, by throw and object.
fn of_rig(rig: u64, options: &Options) -> Result<Vec<(&'static str, &'static str, Vec<Thrown>)>> {
    let load = |throw, object| -> Result<Setup> {
        let choice = Choice { scenario: Some("lab"), object: Some(object), throw: Some(throw), ..Choice::default() };
        let mut setup = Setup::load(&choice)?;
        setup.cameras = cameras(&setup.cameras[0], rig);
        Ok(setup)
    };
    let first = load(THROWS[0], Kind::Object.names()[0])?;
    let kinds =
        THROWS.into_iter().flat_map(|throw| Kind::Object.names().into_iter().map(move |object| (throw, object)));
    let all = kinds.map(|(throw, object)| {
        let setup = load(throw, object)?.sharing_calibrations(&first);
        let name = format!("{rig}-{throw}-{object}-{}-{}", options.seed, options.trials);
        Ok((throw, object, kept::part("anywhere", &name, || thrown(rig, &setup, options))?))
    });
    all.collect()
}

/// The probability that is expected of a throw.
fn expected(thrown: &Thrown) -> f64 {
    expected_rate::probability(&expected_rate::COEFFICIENTS, &thrown.features)
}

/// Rates of some throws: caught, expected, and caught of those that two cameras see long enough.
fn figures<'a>(thrown: impl Iterator<Item = &'a Thrown>) -> Vec<Entry> {
    let thrown: Vec<&Thrown> = thrown.collect();
    let seen: Vec<&&Thrown> = thrown.iter().filter(|it| it.shown_by_two_s >= SEEN_S).collect();
    let sum: f64 = thrown.iter().map(|it| expected(it)).sum();
    vec![
        Entry::Count(thrown.len()),
        rate(thrown.iter().filter(|it| it.caught).count(), thrown.len()),
        Entry::Number((!thrown.is_empty()).then(|| 100.0 * sum / thrown.len() as f64)),
        percent(seen.len(), thrown.len()),
        rate(seen.iter().filter(|it| it.caught).count(), seen.len()),
    ]
}

/// Each rig, each throw, and how reliable the expected rates are.
pub fn tables(options: &Options) -> Result<Vec<Table>> {
    const FIGURES: [&str; 5] = ["throws", "caught, %", "expected, %", "seen, %", "caught of these, %"];
    let columns = |first: &[&'static str]| [first, &FIGURES].concat();
    let mut by_rig = Table::new("Two cameras anywhere, by rig", &columns(&["rig"])[..4]);
    let mut by_throw = Table::new("Two cameras anywhere, by throw", &columns(&["throw", "object"]));
    let of = |rigs: Range<u64>| rigs.map(|rig| Ok((rig, of_rig(rig, options)?))).collect::<Result<Vec<_>>>();
    let (fitted, all) = (of(FITTED)?, of(REPORTED)?);
    for (rig, thrown) in &all {
        let row = figures(thrown.iter().flat_map(|it| &it.2));
        by_rig.rows.push([&[Entry::Count(*rig as usize)], &row[..3]].concat());
    }
    let thrown = || all.iter().flat_map(|it| &it.1);
    for throw in THROWS {
        for object in Kind::Object.names() {
            let those = thrown().filter(|it| (it.0, it.1) == (throw, object)).flat_map(|it| &it.2);
            by_throw.rows.push([vec![Entry::text(throw), Entry::text(object)], figures(those)].concat());
        }
    }
    by_throw.rows.push([vec![Entry::text("all"), Entry::text("all")], figures(thrown().flat_map(|it| &it.2))].concat());
    let mut reliability = Table::new("Expected and found", &["expected", "throws", "expected, %", "found, %"]);
    for bin in 0..BINS {
        let those = thrown().flat_map(|it| &it.2).filter(|it| {
            let expected = expected(it);
            ((expected * BINS as f64) as usize).min(BINS - 1) == bin
        });
        let [from, to] = [bin, bin + 1].map(|it| 100 * it / BINS);
        let [throws, found, expected, ..] = &figures(those)[..] else { continue };
        reliability.rows.push(vec![
            Entry::Text(format!("{from} to {to} %")),
            throws.clone(),
            expected.clone(),
            found.clone(),
        ]);
    }
    let mut coefficients = Table::new("Coefficients of expected rates", &["of", "ball", "other", "decision"]);
    let thrown: Vec<&Thrown> = fitted.iter().flat_map(|it| &it.1).flat_map(|it| &it.2).collect();
    for (name, row) in [("in use", Vector3::from(expected_rate::COEFFICIENTS)), ("these throws", regression(&thrown))] {
        let row = row.iter().map(|it| Entry::Number(Some(*it)));
        coefficients.rows.push([Entry::text(name)].into_iter().chain(row).collect());
    }
    Ok(vec![by_rig, by_throw, reliability, coefficients])
}

/// Coefficients of a logistic regression of catches, by Newton's method.
fn regression(thrown: &[&Thrown]) -> Vector3<f64> {
    let mut coefficients = Vector3::zeros();
    for _ in 0..20 {
        let (mut gradient, mut curvature) = (Vector3::zeros(), Matrix3::identity() * RIDGE);
        for it in thrown {
            let features = Vector3::from(it.features);
            let probability = expected_rate::probability(&coefficients.into(), &it.features);
            gradient += features * (f64::from(it.caught) - probability);
            curvature += features * features.transpose() * (probability * (1.0 - probability));
        }
        gradient -= coefficients * RIDGE;
        coefficients += curvature.cholesky().map_or(Vector3::zeros(), |it| it.solve(&gradient));
    }
    coefficients
}
