//! Pose estimation and flight prediction in the arena: the brain sees the first 200 ms of a throw, and its
//! poses and predictions are compared with the truth.

use anyhow::Result;
use catch_bot::{CatchingBot, Report};
use catch_cell::{Brain, Cell, Command, Observation, PixelWindow};
use catch_lab::{
    assets::Kind,
    parallel,
    scenario::setup::{Choice, Setup},
};
use catch_sim::{Truth, TruthSample};
use nalgebra::Vector3;

use crate::{
    Options,
    results::{Entry, Table},
    spread::{median, percent},
};

/// Duration for which the brain sees the object, in seconds.
const SEEN_S: f64 = 0.2;
/// Time of the first comparison of the prediction, in seconds; the second is at the end.
const EARLY_S: f64 = 0.1;
/// Time for which positions are predicted, in seconds: shortly before objects are caught.
const PREDICTED_FOR_S: f64 = 0.55;
/// A first pose that is farther off is a wrong one.
const WRONG_M: f64 = 0.01;
/// Least rotation error of a wrong first pose, in radians.
const WRONG_RAD: f64 = 0.2;
/// 95 % of χ² with three degrees of freedom.
const CHI_SQUARED_95: f64 = 7.815;

/// Throws of a condition, in turn.
const THROWS: [&str; 2] = ["near_sampled", "far_sampled"];

/// Depth noises with the settings that make them.
const NOISES: [(&str, &[&str]); 3] = [
    ("none", &[]),
    (
        "2 mm",
        &[
            "arena.depth.model={ gaussian = { sd_m = 0.002 } }",
            "brain.perception.depth_noise={ constant_m = 0.002, quadratic_per_m = 0.0 }",
        ],
    ),
    ("stereo, 114 mm at 7 m", &["camera=stereo7", "arena.depth.model=\"stereo7\""]),
];

/// Runs a throw of which the brain sees the first images, and returns the true states; `tick` is one tick of
/// it.
pub fn look(
    setup: &Setup,
    seed: u64,
    index: u64,
    tick: &mut dyn FnMut(&mut CatchingBot, &Observation) -> Command,
) -> Truth {
    let (mut arena, mut brain) = (setup.arena(seed, index), setup.brain(seed, index));
    loop {
        let Ok(observation) = arena.sense();
        if observation.time_s > PREDICTED_FOR_S + 0.005 {
            return arena.truth().clone();
        }
        let command = if observation.time_s < SEEN_S - 0.005 {
            tick(&mut brain, &observation)
        } else {
            // No camera needs to read out a pixel any more.
            let windows = Some(vec![PixelWindow::default(); setup.cameras.len()]);
            Command { windows, ..Command::default() }
        };
        let Ok(()) = arena.act(&command);
    }
}

/// Errors over the throws of one condition.
#[derive(Debug, Default)]
struct Errors {
    throws: usize,
    /// First poses that are right.
    right_at_first: usize,
    /// Ticks with new images and without a pose, and all with images.
    missing: [usize; 2],
    pose_m: Vec<f64>,
    pose_rad: Vec<f64>,
    /// Errors of the predicted position, early and at the end.
    predicted_m: [Vec<f64>; 2],
    /// Errors of the predicted orientation at the end.
    predicted_rad: Vec<f64>,
    /// Predicted positions at the end whose error lies within the claimed 95 %.
    covered: usize,
}

/// The state at a time, if nothing had touched the object by then.
fn untouched_at(truth: &Truth, time_s: f64) -> Option<&TruthSample> {
    let at = truth.samples.iter().position(|sample| sample.time_s >= time_s - 1e-6)?;
    truth.samples[..=at].iter().all(|sample| !sample.contact.any()).then(|| &truth.samples[at])
}

/// A throw of which the brain saw the first images.
struct Throw {
    truth: Truth,
    /// Time of each tick, and what the brain knew then.
    reports: Vec<(f64, Report)>,
}

impl Throw {
    fn seen(setup: &Setup, seed: u64, index: u64) -> Self {
        let mut reports = Vec::new();
        let truth = look(setup, seed, index, &mut |brain, observation| {
            let command = brain.tick(observation, &mut ());
            reports.push((observation.time_s, brain.report().clone()));
            command
        });
        Self { truth, reports }
    }
}

impl Errors {
    fn add(&mut self, setup: &Setup, Throw { truth, reports }: &Throw) {
        let symmetry = setup.known().reference.symmetry;
        self.throws += 1;
        let mut is_first = true;
        for (_, report) in reports {
            self.missing[1] += 1;
            let Some(pose) = &report.pose else {
                self.missing[0] += 1;
                continue;
            };
            let Some(sample) = untouched_at(truth, pose.capture_s) else { continue };
            let off_m = (pose.X_WO.translation.vector - sample.X_WO.translation.vector).norm();
            let off_rad = symmetry.turn_between(&pose.X_WO.rotation, &sample.X_WO.rotation).norm();
            if std::mem::take(&mut is_first) {
                self.right_at_first += usize::from(off_m < WRONG_M && off_rad < WRONG_RAD);
            }
            self.pose_m.push(off_m);
            self.pose_rad.push(off_rad);
        }
        let Some(then) = untouched_at(truth, PREDICTED_FOR_S) else { return };
        for (at, seen_s) in [EARLY_S, SEEN_S].into_iter().enumerate() {
            let last = reports.iter().rfind(|(time_s, _)| *time_s < seen_s - 0.005);
            let Some(flight) = last.and_then(|(_, report)| report.flight.as_ref()) else { continue };
            let X_WO = flight.pose_at(PREDICTED_FOR_S);
            let error: Vector3<f64> = X_WO.translation.vector - then.X_WO.translation.vector;
            self.predicted_m[at].push(error.norm());
            if at == 1 {
                self.predicted_rad.push(symmetry.turn_between(&X_WO.rotation, &then.X_WO.rotation).norm());
                let covariance = flight.covariance_at(PREDICTED_FOR_S).fixed_view::<3, 3>(0, 0).into_owned();
                let squared = covariance.cholesky().map_or(f64::INFINITY, |factor| error.dot(&factor.solve(&error)));
                self.covered += usize::from(squared < CHI_SQUARED_95);
            }
        }
    }

    fn entries(&self) -> [(&'static str, Entry); 10] {
        let [early_m, late_m] = &self.predicted_m;
        [
            ("throws", Entry::Count(self.throws)),
            ("first pose right, %", percent(self.right_at_first, self.throws)),
            ("images without pose, %", percent(self.missing[0], self.missing[1])),
            ("pose, mm", median(&self.pose_m, 1e3)),
            ("pose, °", median(&self.pose_rad, 180.0 / std::f64::consts::PI)),
            ("position from 100 ms, mm", median(early_m, 1e3)),
            ("position from 200 ms, mm", median(late_m, 1e3)),
            ("orientation from 200 ms, °", median(&self.predicted_rad, 180.0 / std::f64::consts::PI)),
            ("within 95 %, %", percent(self.covered, late_m.len())),
            ("without", Entry::Count(self.throws - late_m.len())),
        ]
    }
}

/// Table by depth noise, with labels and without.
pub fn table(options: &Options) -> Result<Table> {
    let mut table = Table::new("Poses and predictions by noise", &[]);
    for (noise, settings) in NOISES {
        for (labels, unlabelled) in [("yes", None), ("no", Some("arena.labels=false"))] {
            let settings: Vec<String> = settings.iter().copied().chain(unlabelled).map(str::to_owned).collect();
            for object in Kind::Object.names() {
                let labels = [("noise", noise), ("labels", labels), ("object", object)];
                let entries = errors(object, &settings, options)?.entries();
                table.add(labels.map(|(column, it)| (column, Entry::text(it))).into_iter().chain(entries));
            }
        }
    }
    Ok(table)
}

/// Errors over the throws of an object in the scenario `paper` with these settings.
fn errors(object: &str, settings: &[String], options: &Options) -> Result<Errors> {
    let load = |throw| {
        let (scenario, object) = (Some("paper"), Some(object));
        Setup::load(&Choice { scenario, object, throw: Some(throw), settings, ..Choice::default() })
    };
    let setups = THROWS.into_iter().map(load).collect::<Result<Vec<_>, _>>()?;
    setups.iter().for_each(Setup::prepare);
    let setup = |index: usize| &setups[index % setups.len()];
    let throws = parallel::map(options.trials as usize, |index| Throw::seen(setup(index), options.seed, index as u64));
    let mut all = Errors::default();
    throws.iter().enumerate().for_each(|(index, throw)| all.add(setup(index), throw));
    Ok(all)
}
