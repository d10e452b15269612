//! The brain: catches thrown objects with a robot arm from depth images alone.
//!
//! The folders bear the headings of the paper (Cieślar, Zeng, Tedrake: CatchingBot, section III): [`perception`] finds the
//! object's pose in each set of images (III-B), [`trajectory_prediction`] its flight (III-B), [`grasp_selection`] where to hold
//! it (III-C), [`trajectory_optimization`] how to get there (III-D), and [`control`] turns that into commands. Each stage is
//! a function of values; all state is in [`CatchingBot`], and its [`tick`](CatchingBot::tick) reads like the paper's figure 2.
//!
//! The brain does no I/O, reads no clock and draws no random numbers but from its own seed: the same observations give the
//! same commands, bit for bit.

pub mod control;
pub mod grasp_selection;
pub mod perception;
pub mod trajectory_optimization;
pub mod trajectory_prediction;

use catch_body::{Gripper, Robot};
use catch_cell::{ArmTrajectory, Brain, CameraModel, Command, Observation, Probe, ReferenceScan};
use serde::{Deserialize, Serialize};

use control::GripperPlan;
use grasp_selection::GraspSet;
use perception::{ObjectPose, ReferenceModel};
use trajectory_optimization::{CatchPlan, Planner};
use trajectory_prediction::FlightTrajectory;

/// All settings of the brain, stage by stage.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Config {
    /// Seed of everything that is drawn at random.
    pub seed: u64,
    /// From images to the object's pose.
    pub perception: perception::Config,
    /// From poses to a flight.
    pub trajectory_prediction: trajectory_prediction::Config,
    /// Where and how to hold the object.
    pub grasp_selection: grasp_selection::Config,
    /// How the arm gets there.
    pub trajectory_optimization: trajectory_optimization::Config,
    /// Commands and their timing.
    pub control: control::Config,
}

/// How far the brain got in a tick: what it has, or what it lacks.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Status {
    /// Nothing that could be the object is in the images.
    #[default]
    NoObject,
    /// Too few poses agree on a flight.
    NoTrajectory,
    /// The object does not pass where the arm could be in time.
    OutOfReach,
    /// The object passes within reach, but no way of holding it was found.
    NoGrasp,
    /// A catch was chosen, but no motion to it that keeps all limits.
    NoPlan,
    /// A plan is being executed; the newest flight gave no better one.
    PlanKept,
    /// A new plan was made.
    Planned,
    /// Too late to change anything: the plan runs to its end.
    Committed,
}

/// What the brain knew and decided in its last tick, for whoever wants to look on.
#[derive(Debug, Clone, Default)]
pub struct Report {
    /// How far the tick got.
    pub status: Status,
    /// The newest pose, if this tick found one.
    pub pose: Option<ObjectPose>,
    /// The flight as predicted now.
    pub flight: Option<FlightTrajectory>,
    /// The plan that is being executed.
    pub plan: Option<CatchPlan>,
    /// Closing of the gripper as commanded last.
    pub closing: Option<GripperPlan>,
}

/// The catching robot's brain.
#[derive(Debug)]
pub struct CatchingBot {
    config: Config,
    cameras: Vec<CameraModel>,
    reference: ReferenceModel,
    grasps: GraspSet,
    planner: Planner,

    poses: Vec<ObjectPose>,
    flight: Option<FlightTrajectory>,
    plan: Option<CatchPlan>,
    executing: Option<ArmTrajectory>,
    closing: Option<GripperPlan>,
    report: Report,
}

impl CatchingBot {
    /// A brain for an arm with a gripper, cameras at known places, and an object known from a scan.
    pub fn new(
        config: Config,
        robot: Robot,
        gripper: Gripper,
        cameras: Vec<CameraModel>,
        reference_scan: &ReferenceScan,
    ) -> Self {
        let reference = ReferenceModel::from_scan(reference_scan, &config.perception);
        let grasps = GraspSet::sample(&reference, &gripper, &config.grasp_selection, config.seed);
        let planner = Planner::new(robot, gripper, config.trajectory_optimization.clone());
        Self {
            config,
            cameras,
            reference,
            grasps,
            planner,
            poses: Vec::new(),
            flight: None,
            plan: None,
            executing: None,
            closing: None,
            report: Report::default(),
        }
    }

    /// What the last tick knew and decided.
    pub fn report(&self) -> &Report {
        &self.report
    }

    /// The object as the brain knows it.
    pub fn reference(&self) -> &ReferenceModel {
        &self.reference
    }
}

impl Brain for CatchingBot {
    fn tick(&mut self, observation: &Observation, probe: &mut dyn Probe) -> Command {
        let _ = (observation, probe);
        Command::default()
    }
}
