//! The ladder from `paper` to `honest`: the paper's assumptions, removed one after the other and one at a time.
//!
//! A rung takes over from the honest scenario the settings that make up one assumption, with those of the brain that must follow
//! (what it is told of the gripper, of latencies, of spin). The last rung of the climb is `honest` itself. All rungs draw from the
//! same streams, so that throw number 17 is the same wherever throws are random.

use std::path::PathBuf;

use catch_body::InputError;
use catch_bot::perception;

use serde::Serialize;

use crate::{
    assets::{Asset, Kind, Origin},
    evaluation::{Cell, Row},
    scenario::Scenario,
    setup::{COMMAND_LINE, Choice, Setup},
    statistics::CellSummary,
};

/// One assumption of the paper.
pub struct Rung {
    /// Name, that of its folder.
    pub name: &'static str,
    /// What is removed, in words.
    pub removes: &'static str,
    /// Takes it over from the honest scenario.
    change: fn(&mut Scenario, &Scenario),
    /// The throws from this rung on, where it is about throws.
    throws: Option<&'static [&'static str]>,
}

/// The rungs in their order. The first changes nothing.
pub const RUNGS: [Rung; 10] = [
    Rung { name: "paper", removes: "nothing", change: |_, _| {}, throws: Some(&["near", "far"]) },
    Rung {
        name: "sampled",
        removes: "the same throw every time",
        change: |_, _| {},
        throws: Some(&["near_sampled", "far_sampled"]),
    },
    Rung {
        name: "random",
        removes: "throws from one place, in one orientation",
        change: |scenario, honest| {
            scenario.throw.clone_from(&honest.throw);
            scenario.ready_rad.clone_from(&honest.ready_rad);
            // More grasp candidates are for orientations that nobody chose.
            scenario.brain.grasp_selection.turns_rad.clone_from(&honest.brain.grasp_selection.turns_rad);
        },
        throws: Some(&["random"]),
    },
    Rung {
        name: "gripper",
        removes: "the gripper without limits",
        change: |scenario, honest| {
            scenario.arena.gripper = honest.arena.gripper;
            scenario.brain.control.gripper_latency_s = honest.brain.control.gripper_latency_s;
            scenario.brain.grasp_selection.clone_from(&honest.brain.grasp_selection);
            scenario.brain.trajectory_optimization.clone_from(&honest.brain.trajectory_optimization);
        },
        throws: None,
    },
    Rung {
        name: "drag",
        removes: "the vacuum",
        change: |scenario, honest| {
            scenario.arena.drag = honest.arena.drag;
            scenario.arena.drag_spread = honest.arena.drag_spread;
            scenario.arena.wind = honest.arena.wind;
        },
        throws: None,
    },
    Rung {
        name: "spin",
        removes: "objects that do not turn",
        change: |scenario, honest| {
            scenario.arena.max_spin_radps = honest.arena.max_spin_radps;
            scenario.brain.trajectory_prediction.spin_prior_sd_radps =
                honest.brain.trajectory_prediction.spin_prior_sd_radps;
        },
        throws: None,
    },
    Rung {
        name: "depth",
        removes: "exact depths and images that never get lost",
        change: |scenario, honest| {
            scenario.arena.depth.model.clone_from(&honest.arena.depth.model);
            scenario.arena.depth.lost_frame_fraction = honest.arena.depth.lost_frame_fraction;
            let camera_sd_rad = scenario.brain.perception.camera_sd_rad;
            scenario.brain.perception = perception::Config { camera_sd_rad, ..honest.brain.perception.clone() };
        },
        throws: None,
    },
    Rung {
        name: "labels",
        removes: "images that tell which pixels show the object",
        change: |scenario, honest| {
            scenario.arena.labels = honest.arena.labels;
            scenario.arena.floor_visible = honest.arena.floor_visible;
        },
        throws: None,
    },
    Rung {
        name: "latency",
        removes: "images and commands that take no time",
        change: |scenario, honest| {
            scenario.clock = honest.clock;
            scenario.arena.latency_s = honest.arena.latency_s;
            scenario.arena.frame_rate_hz = honest.arena.frame_rate_hz;
            scenario.brain.control.expected_latency_s = honest.brain.control.expected_latency_s;
        },
        throws: None,
    },
    Rung {
        name: "errors",
        removes: "known materials, and cameras and a robot that know themselves",
        change: |scenario, honest| {
            scenario.arena.depth.calibration_sd_m = honest.arena.depth.calibration_sd_m;
            scenario.arena.depth.calibration_sd_rad = honest.arena.depth.calibration_sd_rad;
            scenario.arena.friction = honest.arena.friction;
            scenario.arena.restitution_scale = honest.arena.restitution_scale;
            scenario.arena.restitution_spread = honest.arena.restitution_spread;
            scenario.arena.robot_errors = honest.arena.robot_errors;
            // Labelled images show the object alone: no camera is aligned on the arm then.
            let aligned_sd_m = honest.brain.trajectory_prediction.systematic_sd_m;
            scenario.brain.trajectory_prediction.systematic_sd_m =
                if scenario.arena.labels { UNALIGNED_SD_M } else { aligned_sd_m };
            scenario.brain.perception.camera_sd_rad = honest.brain.perception.camera_sd_rad;
        },
        throws: None,
    },
];

/// What the cameras of `honest` leave in common if they are not aligned: 2 mm and 0.05° about each axis from 7 m, twenty of them.
const UNALIGNED_SD_M: f64 = 0.002;

/// A scenario of the ladder with its throws.
pub struct Step {
    /// Name, that of its folder.
    pub name: String,
    /// What is removed last, or alone.
    pub removes: &'static str,
    /// The scenario.
    pub scenario: Scenario,
    /// The ways of throwing.
    pub throws: &'static [&'static str],
}

/// What became of the throws on a step.
#[derive(Debug, Clone, Serialize)]
pub struct StepSummary {
    /// Name of the step.
    pub step: String,
    /// What it removes, in words.
    pub removes: &'static str,
    /// Each object, all its throws together.
    pub objects: Vec<CellSummary>,
}

impl StepSummary {
    /// Counts the trials of a step, whose cells come object by object.
    pub fn of(step: &Step, cells: &[Cell], rows: &[Row]) -> Self {
        let summary = |of_object: &[Cell]| {
            let object = &of_object[0].setup.scenario.object;
            let rows: Vec<&Row> = rows.iter().filter(|row| row.scene.object == *object).collect();
            let is_fixed = of_object.iter().all(|cell| cell.throw_is_fixed);
            CellSummary::of(object, &step.throws.join(", "), &rows, is_fixed)
        };
        let objects = cells.chunks(step.throws.len().max(1)).map(summary).collect();
        Self { step: step.name.clone(), removes: step.removes, objects }
    }
}

/// The steps: first the climb, each rung upon those below it, then each rung alone upon the first.
///
/// # Errors
/// Faults in the two scenarios.
pub fn steps() -> Result<Vec<Step>, InputError> {
    let (paper, honest) = (built_in("paper")?, built_in("honest")?);
    let step = |name: String, rung: &Rung, mut scenario: Scenario, throws: &'static [&'static str]| {
        name.clone_into(&mut scenario.name);
        Step { name, removes: rung.removes, scenario, throws }
    };
    let mut steps = Vec::new();
    let (mut scenario, mut throws) = (paper.clone(), RUNGS[0].throws.unwrap_or_default());
    for (i, rung) in RUNGS.iter().enumerate() {
        (rung.change)(&mut scenario, &honest);
        throws = rung.throws.unwrap_or(throws);
        steps.push(step(format!("{:02}-{}", i + 1, rung.name), rung, scenario.clone(), throws));
    }
    if let Some(last) = steps.last_mut() {
        // The top bears the name of what it is.
        (last.scenario.name, last.scenario.description) = (honest.name.clone(), honest.description.clone());
    }
    for rung in &RUNGS[1..] {
        let mut scenario = paper.clone();
        (rung.change)(&mut scenario, &honest);
        let throws = rung.throws.or(RUNGS[0].throws).unwrap_or_default();
        steps.push(step(format!("only-{}", rung.name), rung, scenario, throws));
    }
    Ok(steps)
}

fn asset(name: &str) -> Result<Asset, InputError> {
    Asset::find(Kind::Scenario, name, &Origin::BuiltIn(PathBuf::new()), (COMMAND_LINE, "--ladder"))
}

fn built_in(name: &str) -> Result<Scenario, InputError> {
    let asset = asset(name)?;
    Scenario::from_toml(&asset.file, &asset.text)
}

impl Step {
    /// Reads all that one of its cells needs.
    ///
    /// # Errors
    /// As [`Setup::load`].
    pub fn setup(&self, robot: Option<&str>, object: &str, throw: &str) -> Result<Setup, InputError> {
        let file = format!("ladder step {}", self.name);
        let text = toml::to_string(&self.scenario)
            .map_err(|fault| InputError::new(&file, "the scenario", fault, "one that can be written"))?;
        let asset = Asset { name: self.scenario.name.clone(), file, text, ..asset("paper")? };
        Setup::of_scenario(&asset, &Choice { robot, object: Some(object), throw: Some(throw), ..Choice::default() })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// If a setting of the honest scenario is no part of any rung, the top of the ladder is not honest.
    #[test]
    fn the_ladder_ends_at_honest() {
        let steps = steps().unwrap();
        assert_eq!(steps[0].scenario, Scenario { name: "01-paper".to_owned(), ..built_in("paper").unwrap() });
        let top = &steps[RUNGS.len() - 1];
        assert_eq!(top.scenario, built_in("honest").unwrap());
        assert_eq!(top.throws, ["random"]);
        let honest = Setup::load(&Choice { scenario: Some("honest"), object: Some("banana"), ..Choice::default() });
        let top = top.setup(None, "banana", "random").unwrap();
        assert_eq!(top.scenario, honest.unwrap().scenario);
    }

    #[test]
    fn every_rung_but_those_of_throws_changes_the_scenario() {
        let steps = steps().unwrap();
        assert_eq!(steps.len(), 2 * RUNGS.len() - 1);
        let same = |a: &Scenario, b: &Scenario| {
            Scenario { name: a.name.clone(), description: a.description.clone(), ..b.clone() } == *a
        };
        for pair in steps[..RUNGS.len()].windows(2) {
            assert!(
                !same(&pair[0].scenario, &pair[1].scenario) || pair[0].throws != pair[1].throws,
                "{}",
                pair[1].name
            );
        }
        for step in &steps[RUNGS.len()..] {
            assert!(!same(&steps[0].scenario, &step.scenario) || step.throws != steps[0].throws, "{}", step.name);
        }
    }

    /// Common random numbers: the same throw on every rung where throws are random, as far as it is not its speed through the air.
    #[test]
    fn throws_are_the_same_on_all_rungs() {
        let steps = steps().unwrap();
        let release = |step: &Step| step.setup(None, "banana", "random").unwrap().release(1, 17);
        let random: Vec<_> = steps.iter().filter(|step| step.throws == ["random"]).map(release).collect();
        assert!(random.len() > 8);
        assert!(random.iter().all(|it| (it.p_WO, it.q_WO) == (random[0].p_WO, random[0].q_WO)));
    }
}
