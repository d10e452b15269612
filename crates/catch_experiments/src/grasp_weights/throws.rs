//! Throws of many objects with given weights, kept on disk: a run that was stopped goes on where it was.

use std::{
    collections::BTreeMap,
    fs::{self, File, OpenOptions},
    io::{BufRead, BufReader, Write},
    path::{Path, PathBuf},
    sync::{Arc, Mutex},
};

use anyhow::{Context, Result};
use catch_bot::{
    CatchingBot, Report,
    control::TimeGridSearch,
    trajectory_optimization::{CatchSearch, MotionPlanner},
};
use catch_lab::{
    parallel,
    referee::{self, reason::Reason},
    scenario::setup::Setup,
    trial::{self, Trial},
};
use catch_sim::random_streams::{Draws, Stream};
use serde::{Deserialize, Serialize};

use super::weights::{self, Terms, Weights};
use crate::results;

/// Largest errors at the catch, of the prediction and of the object's position in the hand, with which a miss
/// is a fault of the grasp; the referee's own measures.
const LARGE_ERROR_M: f64 = 0.02;
/// Sources that the outcome of a throw depends on, from the root of the repository.
const SOURCES: &[&str] = &[
    "assets",
    "crates/catch_body",
    "crates/catch_bot",
    "crates/catch_cell",
    "crates/catch_lab",
    "crates/catch_recording",
    "crates/catch_sim",
];
/// Weights are drawn from a quarter to four times those in use.
const MOST_FACTOR: f64 = 4.0;

/// Throws that belong together.
#[derive(Debug)]
pub struct Batch {
    /// Name of the file that keeps them.
    pub name: String,
    /// Seed of everything random.
    pub seed: u64,
    /// Throws of each object.
    pub trials: u64,
    /// Weights in use.
    pub weights: Weights,
    /// True if every other throw draws its weights around these.
    pub draws_weights: bool,
}

/// A throw, and what came of it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Throw {
    /// Name of the object.
    pub object: String,
    /// Number of the throw.
    pub index: u64,
    /// True if the object was caught.
    pub caught: bool,
    /// Reason of the miss.
    reason: Option<Reason>,
    /// The cost terms of the plan at its catch, as the brain knew them last; none without a plan.
    pub terms: Option<Terms>,
    /// True if the object enters the open gripper on the planned approach without contact.
    pub approach_is_free: bool,
    prediction_error_m: Option<f64>,
    grasp_offset_m: Option<f64>,
}

/// Throws by the names of their objects and their numbers.
type Kept = BTreeMap<(String, u64), Throw>;

impl Throw {
    /// Returns the terms of the grasp, if it decided the outcome: there was a plan, prediction and hand were
    /// near enough, and a miss was one at the fingers.
    pub fn of_the_grasp(&self) -> Option<&Terms> {
        let is_near = |error_m: Option<f64>| error_m.is_some_and(|it| it <= LARGE_ERROR_M);
        let at_the_fingers = self.reason.is_none_or(|reason| {
            use Reason::{ClosedEarly, ClosedLate, Dropped, HitFinger, SlippedOut};
            matches!(reason, HitFinger | ClosedEarly | ClosedLate | SlippedOut | Dropped)
        });
        let decided = at_the_fingers && is_near(self.prediction_error_m) && is_near(self.grasp_offset_m);
        self.terms.as_ref().filter(|_| decided)
    }
}

impl Batch {
    /// All throws, object by object and in order; those that the folder keeps are not thrown again.
    ///
    /// # Errors
    /// If they cannot be kept.
    pub fn run(&self, setups: &[Setup], folder: &Path) -> Result<Vec<Throw>> {
        let (kept, file) = self.kept(setups, folder)?;
        let all = setups.iter().flat_map(|setup| (0..self.trials).map(move |index| (setup, index)));
        let missing: Vec<(&Setup, u64)> =
            all.filter(|(setup, index)| !kept.contains_key(&(setup.object.name.clone(), *index))).collect();
        setups.iter().filter(|setup| missing.iter().any(|(it, _)| std::ptr::eq(*it, *setup))).for_each(Setup::prepare);
        let file = Mutex::new(file);
        let thrown = parallel::map(missing.len(), |at| {
            let (setup, index) = missing[at];
            let throw = self.throw(setup, index);
            let line = serde_json::to_string(&throw)? + "\n";
            file.lock().expect("no thread panics while it holds the lock").write_all(line.as_bytes())?;
            Ok(throw)
        });
        let thrown = thrown.into_iter().collect::<Result<Vec<Throw>>>()?;
        let mut throws: Vec<Throw> = kept.into_values().chain(thrown).filter(|it| it.index < self.trials).collect();
        throws.sort_by(|a, b| (&a.object, a.index).cmp(&(&b.object, b.index)));
        Ok(throws)
    }

    /// The throws that a file keeps, and the file, open at its end; what another commit, scenario or list of
    /// objects left there is thrown away.
    fn kept(&self, setups: &[Setup], folder: &Path) -> Result<(Kept, File)> {
        let path: PathBuf = folder.join(format!("{}-seed-{}.jsonl", self.name, self.seed));
        fs::create_dir_all(folder).with_context(|| folder.display().to_string())?;
        let figures =
            |it: &Setup| format!("{:?}", (&it.known_object.figures, it.object.inertia_kgm2, it.object.mesh.volume()));
        let objects: Vec<String> = setups.iter().map(figures).collect();
        let (commit, scenario) = (results::last_change(SOURCES), setups.first().map(|it| &it.scenario));
        let identity = serde_json::to_string(&(commit, self.weights, self.draws_weights, scenario, objects))?;
        let mut lines = File::open(&path).map(|it| BufReader::new(it).lines()).into_iter().flatten();
        let mut kept = Kept::new();
        if lines.next().and_then(Result::ok).as_ref() == Some(&identity) {
            // The last line may be cut.
            let throws = lines.map_while(Result::ok).map_while(|line| serde_json::from_str::<Throw>(&line).ok());
            kept.extend(throws.map(|it| ((it.object.clone(), it.index), it)));
        }
        let mut text = identity + "\n";
        for throw in kept.values() {
            text += &(serde_json::to_string(throw)? + "\n");
        }
        fs::write(&path, text).with_context(|| path.display().to_string())?;
        Ok((kept, OpenOptions::new().append(true).open(&path)?))
    }

    fn throw(&self, setup: &Setup, index: u64) -> Throw {
        let mut brain = brain(setup, &self.weights_of(&setup.object.name, index), self.seed, index);
        let trial = trial::run_unobserved(&mut brain, setup, self.seed, index);
        let verdict = referee::judge(setup, &trial);
        let last = verdict.catch_time_s.and_then(|catch_s| last_report(&trial, catch_s));
        Throw {
            object: setup.object.name.clone(),
            index,
            caught: verdict.caught,
            reason: verdict.reason,
            terms: last.and_then(|report| weights::terms(setup, report)),
            approach_is_free: verdict.measures.approach_is_free.unwrap_or_default(),
            prediction_error_m: verdict.measures.prediction_error_m,
            grasp_offset_m: verdict.measures.grasp_offset_m,
        }
    }

    /// The weights of a throw: those in use, or, if it draws them, each times a factor whose logarithm is
    /// uniform.
    fn weights_of(&self, object: &str, index: u64) -> Weights {
        if !self.draws_weights || index.is_multiple_of(2) {
            return self.weights;
        }
        // Every object has draws of its own, whichever others are thrown.
        let of_name = object.bytes().fold(0_u64, |sum, byte| sum.wrapping_mul(31).wrapping_add(u64::from(byte)));
        let mut draws = Draws::new(Stream::GraspWeights, self.seed ^ of_name, index);
        self.weights.map(|weight| weight * libm::pow(MOST_FACTOR, draws.between([-1.0, 1.0])))
    }
}

/// Our brain with other weights in its planner.
fn brain(setup: &Setup, weights: &Weights, seed: u64, index: u64) -> CatchingBot {
    let known = setup.known().clone();
    let config = weights::with(known.config().clone(), weights);
    let motion = MotionPlanner::new(setup.robot.clone(), setup.gripper.clone(), config.trajectory_optimization);
    // The arm of `honest` has its inverse kinematics in closed form and needs no reach map.
    let search = Arc::new(CatchSearch::new(motion, None));
    let planner = TimeGridSearch::new(config.control, config.grasp_selection, known.grasps().clone(), search);
    let (estimator, predictor) = (known.pose_estimator(), known.flight_predictor(setup.brain_config(seed, index).seed));
    CatchingBot::with_stages(known, estimator, predictor, planner)
}

/// Finds the last report before the catch with a plan and a flight.
fn last_report(trial: &Trial, catch_s: f64) -> Option<&Report> {
    let mut reports = trial.snapshots.iter().filter(|it| it.time_s <= catch_s).filter_map(|it| it.report.as_ref());
    reports.rfind(|it| it.plan.is_some() && it.flight.is_some())
}

#[cfg(test)]
mod tests {
    use catch_bot::{Status, grasp_selection::Passing};
    use catch_lab::scenario::setup::Choice;
    use nalgebra::Point3;

    use super::*;

    fn setup() -> Setup {
        Setup::load(&Choice { scenario: Some("honest"), object: Some("banana"), ..Choice::default() }).unwrap()
    }

    #[test]
    fn a_brain_with_the_weights_in_use_is_the_scenarios() {
        let setup = setup();
        let today = weights::of(setup.known().config());
        let outcome = |trial: Trial| {
            let last = trial.truth.samples.last().map(|it| it.X_WO);
            (trial.snapshots.last().and_then(|it| it.report.as_ref()?.plan.clone()), last)
        };
        let of_scenario = outcome(trial::run_unobserved(&mut setup.brain(7, 1), &setup, 7, 1));
        assert!(of_scenario.0.is_some());
        assert!(of_scenario == outcome(trial::run_unobserved(&mut brain(&setup, &today, 7, 1), &setup, 7, 1)));
        let others = today.map(|it| 4.0 * it);
        assert!(of_scenario != outcome(trial::run_unobserved(&mut brain(&setup, &others, 7, 1), &setup, 7, 1)));
    }

    /// The planner's cost of how well a catch holds is the terms' by their weights, and comfort.
    #[test]
    fn terms_are_what_the_weights_multiply() {
        let setup = setup();
        let config = setup.known().config();
        let (today, mut compared) = (weights::of(config), 0);
        let trial = trial::run_unobserved(&mut setup.brain(7, 1), &setup, 7, 1);
        for report in trial.snapshots.iter().filter_map(|it| it.report.as_ref()) {
            let (Status::Planned, Some(plan), Some(flight)) = (report.status, &report.plan, &report.flight) else {
                continue;
            };
            let comfort_alone = weights::with(config.clone(), &[0.0; weights::SETTINGS.len()]).grasp_selection.weights;
            let base = Point3::from(setup.robot.X_WB.translation.vector);
            let (X_WO, v_WO) = (flight.pose_at(plan.catch_s), flight.twist_at(plan.catch_s).linear);
            let comfort = Passing::new(&X_WO, &v_WO, &base, &comfort_alone).rank_alone(0, &plan.grasp).still_cost;
            let terms = weights::terms(&setup, report).unwrap();
            let found = weights::cost(&today, &terms) + comfort;
            assert!((found - plan.holding_cost).abs() < 1e-3, "{found} {}", plan.holding_cost);
            compared += 1;
        }
        assert!(compared >= 5, "{compared}");
    }

    #[test]
    fn throws_that_are_kept_are_not_thrown_again_and_a_cut_line_is() {
        let setup = setup();
        let folder = std::env::temp_dir().join(format!("catch_experiments_throws_{}", std::process::id()));
        let (name, weights) = ("some".to_owned(), weights::of(setup.known().config()));
        let batch = Batch { name, seed: 3, trials: 2, weights, draws_weights: true };
        let setups = [setup];
        let first = batch.run(&setups, &folder).unwrap();
        assert!(
            first.len() == 2 && batch.weights_of("banana", 1) != weights && batch.weights_of("banana", 0) == weights
        );
        // A kept result is believed: another outcome in the file comes back.
        let path = folder.join("some-seed-3.jsonl");
        let other = |it: &Throw| serde_json::to_string(&Throw { caught: !it.caught, ..it.clone() }).unwrap();
        let text = fs::read_to_string(&path).unwrap();
        let identity = text.lines().next().unwrap();
        let cut = serde_json::to_string(&first[1]).unwrap();
        fs::write(&path, format!("{identity}\n{}\n{}", other(&first[0]), &cut[..cut.len() / 2])).unwrap();
        let again = batch.run(&setups, &folder).unwrap();
        assert!(again[0].caught != first[0].caught && again[1] == first[1]);
        // Other weights in use: nothing that is kept counts.
        let others = Batch { weights: weights.map(|it| 2.0 * it), draws_weights: false, trials: 0, ..batch };
        assert!(others.run(&setups, &folder).unwrap().is_empty());
        assert_eq!(fs::read_to_string(&path).unwrap().lines().count(), 1);
        fs::remove_dir_all(folder).unwrap();
    }

    #[test]
    fn misses_that_are_no_fault_of_the_grasp_are_left_out() {
        let throw = |reason: Option<Reason>, error_m| Throw {
            object: String::new(),
            index: 0,
            caught: reason.is_none(),
            reason,
            terms: Some([0.0; weights::SETTINGS.len()]),
            approach_is_free: true,
            prediction_error_m: Some(error_m),
            grasp_offset_m: Some(0.001),
        };
        assert!(throw(None, 0.001).of_the_grasp().is_some());
        assert!(throw(Some(Reason::SlippedOut), 0.001).of_the_grasp().is_some());
        for reason in [Reason::HitArm, Reason::Prediction, Reason::MissedPosition, Reason::LimitViolation, Reason::Late]
        {
            assert!(throw(Some(reason), 0.001).of_the_grasp().is_none(), "{reason}");
        }
        // Also of what was caught: the rule must not choose by the outcome.
        assert!(throw(None, 0.05).of_the_grasp().is_none());
        assert!(Throw { terms: None, ..throw(None, 0.001) }.of_the_grasp().is_none());
    }
}
