//! The weights of the grasp choice, fitted on objects on which no rate is reported.

mod fit;
mod throws;
mod training_objects;
mod weights;

use std::path::Path;

use anyhow::{Context, Result};
use catch_body::statistics::paired95;
use catch_lab::scenario::setup::{Choice, Setup};

use crate::{
    Findings, Options,
    results::{Entry, Table},
    spread::percent,
};
use fit::{FEATURES, Model, Observation, cross_validated, ordered_pairs};
use throws::{Batch, Throw};
use training_objects::listed;
use weights::{SETTINGS, Terms, Weights};

/// Folder of the throws, and of the objects' files.
const FOLDER: &str = "target/grasp-weights";
/// Groups of objects of which each is left out once.
const FOLDS: usize = 5;
/// Scales of the fitted weights that are tried. At one the cost of how well a catch holds varies among the
/// plans of an object as much as with the weights in use.
const SCALES: [f64; 3] = [0.5, 1.0, 2.0];
/// Groups of throws, by their probability, whose rate is compared with it.
const GROUPS: usize = 6;

const LEGEND: &str = "A ridge logistic regression of *caught* on the cost terms of the executed catch, with an intercept for each object. \
The objects are those of `grasp_weights/training_objects.toml`, without banana, pill bottle and tennis ball. The throws are the random ones of the \
scenario `honest`. Every other throw draws its weights from a quarter to four times those in use, with a logarithm that is uniform.

A throw is in the regression if its grasp decided the outcome. There was a plan, and at the catch the last prediction was off by 20 mm at most, \
and so was the object from its place in the hand. A miss is in it only if a finger hit the object, the fingers closed too early or too late, or the object \
slipped out or was lost. The terms are those of the last plan before the catch, by the last flight. Coefficients are changes of the log-odds \
per unit of a term. Those of terms with weights may not be positive, and have no standard error where this bound holds. The ridge is 1 on terms \
that are scaled to a standard deviation of one, and 0.1 on intercepts.

A *weight* is the negative of its coefficient, scaled. At scale 1 the weighted sum varies among the plans of an object as much as with the weights \
in use. The scale is the one by which most is caught of the next seed's throws of the same objects. AUC is the fraction of pairs of a catch \
and a miss of one object that are in the right order. One is of probabilities by a model of the other objects (five folds), one of the cost by the \
weights in use. The last table has objects that are in no other table, thrown alike with both weights (the seed after the next). Its \
interval is that of a paired difference, of 95 %.

Throws are kept in `target/grasp-weights`, so that the command goes on where it was stopped.";

/// Throws, the regression, the choice of its scale, and the comparison.
pub fn run(options: &Options) -> Result<Findings> {
    let (held_out, training) = setups()?;
    let known = training.first().context("training_objects.toml has no object")?.known();
    let today = weights::of(known.config());
    let folder = Path::new(FOLDER);
    let batch = |name: &str, later, weights| {
        let Options { seed, trials, .. } = *options;
        Batch { name: name.to_owned(), seed: seed + later, trials, weights, draws_weights: false }
    };
    let thrown = Batch { draws_weights: true, ..batch("fitted", 0, today) }.run(&training, folder)?;
    let observations: Vec<Observation> = thrown.iter().filter_map(Observation::of).collect();
    let model = Model::fit(&observations.iter().collect::<Vec<_>>())?;
    let probabilities = cross_validated(&observations, FOLDS)?;
    let unit = spread(&observations, &today) / spread(&observations, &model.weights(1.0));

    let mut scales = Table::new("Scales, on training objects", &["scale", "throws", "caught, %"]);
    let mut best: Option<(usize, Weights)> = None;
    for scale in SCALES {
        let weights = model.weights(scale * unit);
        let throws = batch(&format!("scale-{scale}"), 1, weights).run(&training, folder)?;
        let caught = throws.iter().filter(|it| it.caught).count();
        scales.rows.push(vec![Entry::Number(Some(scale)), Entry::Count(throws.len()), percent(caught, throws.len())]);
        if best.is_none_or(|(most, _)| caught > most) {
            best = Some((caught, weights));
        }
    }
    let (_, fitted) = best.context("no scale was tried")?;
    let [before, after] = [("in-use", today), ("chosen", fitted)].map(|(name, weights)| batch(name, 2, weights));
    let compared = comparison(&before.run(&held_out, folder)?, &after.run(&held_out, folder)?);
    Ok(Findings {
        legend: LEGEND.to_owned(),
        tables: vec![
            weights_table(&model, &today, &fitted),
            objects_table(&thrown, &observations, &probabilities, &today),
            calibration_table(&observations, &probabilities),
            scales,
            compared,
        ],
    })
}

/// Loads the setups of the objects that are held out, and of the others.
fn setups() -> Result<(Vec<Setup>, Vec<Setup>)> {
    let folder = Path::new(FOLDER).join("objects");
    let (mut held_out, mut training) = (Vec::new(), Vec::new());
    for object in listed()? {
        let path = object.written(&folder)?.display().to_string();
        let setup = Setup::load(&Choice { scenario: Some("honest"), object: Some(&path), ..Choice::default() })?;
        if object.held_out { held_out.push(setup) } else { training.push(setup) }
    }
    Ok((held_out, training))
}

/// Standard deviation of the cost about the mean of each object.
fn spread(observations: &[Observation], weights: &Weights) -> f64 {
    let squares: f64 = by_object(observations)
        .map(|(_, of_object)| {
            let costs: Vec<f64> = of_object.iter().map(|(_, it)| weights::cost(weights, &it.terms)).collect();
            let mean = costs.iter().sum::<f64>() / costs.len() as f64;
            costs.iter().map(|cost| (cost - mean).powi(2)).sum::<f64>()
        })
        .sum();
    (squares / observations.len().max(1) as f64).sqrt()
}

/// The observations of each object with their numbers.
fn by_object(observations: &[Observation]) -> impl Iterator<Item = (&str, Vec<(usize, &Observation)>)> {
    let mut objects: Vec<&str> = observations.iter().map(|it| it.object.as_str()).collect();
    objects.sort_unstable();
    objects.dedup();
    objects
        .into_iter()
        .map(|object| (object, observations.iter().enumerate().filter(|(_, it)| it.object == object).collect()))
}

fn weights_table(model: &Model, today: &Weights, fitted: &Weights) -> Table {
    let columns = ["setting", "in use", "fitted", "coefficient", "standard error"];
    let mut table = Table::new("Weights", &columns);
    let number = |it: f64| Entry::Number(Some(it));
    for j in 0..FEATURES {
        let setting = SETTINGS.get(j).map_or("none: touches the open gripper".to_owned(), |it| format!("`brain.{it}`"));
        table.rows.push(vec![
            Entry::text(setting),
            Entry::Number(today.get(j).copied()),
            Entry::Number(fitted.get(j).copied()),
            number(model.coefficients[j]),
            Entry::Number(model.standard_errors[j]),
        ]);
    }
    table
}

/// Table of the throws of each object, and of the separation of its catches from its misses by a model that
/// has not seen it.
fn objects_table(thrown: &[Throw], observations: &[Observation], probabilities: &[f64], today: &Weights) -> Table {
    let columns = [
        "object",
        "throws",
        "caught, %",
        "in the regression",
        "of these missed",
        "AUC, left out",
        "AUC, weights in use",
    ];
    let mut table = Table::new("Training objects", &columns);
    let area = |(right, pairs): (f64, usize)| Entry::Number((pairs > 0).then(|| right / pairs as f64));
    let mut all = [(0.0, 0); 2];
    for (object, of_object) in by_object(observations) {
        let scored = |score: &dyn Fn(usize, &Terms) -> f64| {
            let one = |(i, it): &(usize, &Observation)| (score(*i, &it.terms), it.caught);
            ordered_pairs(&of_object.iter().map(one).collect::<Vec<_>>())
        };
        let both = [scored(&|i, _| probabilities[i]), scored(&|_, terms| -weights::cost(today, terms))];
        for (sum, (right, pairs)) in all.iter_mut().zip(both) {
            *sum = (sum.0 + right, sum.1 + pairs);
        }
        let throws = || thrown.iter().filter(|it| it.object == object);
        let missed = of_object.iter().filter(|(_, it)| !it.caught).count();
        let counts = [Entry::Count(of_object.len()), Entry::Count(missed)];
        let rate = percent(throws().filter(|it| it.caught).count(), throws().count());
        let first = vec![Entry::text(object), Entry::Count(throws().count()), rate];
        table.rows.push([first, counts.to_vec(), both.map(area).to_vec()].concat());
    }
    let missed = observations.iter().filter(|it| !it.caught).count();
    let rate = percent(thrown.iter().filter(|it| it.caught).count(), thrown.len());
    let first = vec![Entry::text("all"), Entry::Count(thrown.len()), rate];
    let counts = vec![Entry::Count(observations.len()), Entry::Count(missed)];
    table.rows.push([first, counts, all.map(area).to_vec()].concat());
    table
}

/// Chances of objects that a model has not seen, and what came of them.
fn calibration_table(observations: &[Observation], probabilities: &[f64]) -> Table {
    let mut table =
        Table::new("Calibration of probabilities, objects left out", &["throws", "mean probability, %", "caught, %"]);
    let mut order: Vec<usize> = (0..probabilities.len()).collect();
    order.sort_by(|a, b| probabilities[*a].total_cmp(&probabilities[*b]));
    for group in order.chunks(order.len().div_ceil(GROUPS).max(1)) {
        let mean = group.iter().map(|&i| probabilities[i]).sum::<f64>() / group.len() as f64;
        let caught = group.iter().filter(|&&i| observations[i].caught).count();
        let entries = [Entry::Count(group.len()), Entry::Number(Some(100.0 * mean)), percent(caught, group.len())];
        table.rows.push(entries.to_vec());
    }
    table
}

/// Compares the same throws with the weights in use and with the fitted ones.
fn comparison(before: &[Throw], after: &[Throw]) -> Table {
    let columns =
        ["object", "throws", "weights in use, %", "fitted, %", "gained", "lost", "difference, points", "from", "to"];
    let mut table = Table::new("Objects that are held out", &columns);
    let row = |name: &str, is_meant: &dyn Fn(&Throw) -> bool| {
        let pairs: Vec<[bool; 2]> =
            before.iter().zip(after).filter(|(it, _)| is_meant(it)).map(|(a, b)| [a.caught, b.caught]).collect();
        let count = |is: [bool; 2]| pairs.iter().filter(|it| **it == is).count();
        let (both, lost, gained) = (count([true, true]), count([true, false]), count([false, true]));
        let [low, high] = paired95(gained, lost, pairs.len());
        let difference = (gained as f64 - lost as f64) / pairs.len().max(1) as f64;
        let points = [difference, low, high].map(|it| Entry::Number(Some(100.0 * it)));
        let first = vec![Entry::text(name), Entry::Count(pairs.len())];
        let rates = vec![percent(both + lost, pairs.len()), percent(both + gained, pairs.len())];
        let changes = vec![Entry::Count(gained), Entry::Count(lost)];
        [first, rates, changes, points.to_vec()].concat()
    };
    let mut objects: Vec<&str> = before.iter().map(|it| it.object.as_str()).collect();
    objects.dedup();
    table.rows.extend(objects.iter().map(|object| row(object, &|it| it.object == *object)));
    table.rows.push(row("all", &|_| true));
    table
}
