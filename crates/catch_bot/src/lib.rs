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
mod method;
pub mod paper_method;
pub mod perception;
pub mod trajectory_optimization;
pub mod trajectory_prediction;

use std::{collections::VecDeque, sync::Arc};

use catch_body::{Gripper, JointVector, Pose, Robot, ray_cast::ArmSurface};
use catch_cell::{Brain, CameraModel, Command, Observation, PixelWindow, Probe, ReferenceScan};
use serde::{Deserialize, Serialize};

use control::{GripperPlan, sent_plans::SentPlans};
use grasp_selection::GraspSet;
pub use method::Method;

use perception::{ObjectPose, ReferenceModel, Surroundings, camera_alignment::CameraAlignment};
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
    /// Whose method it is.
    pub method: Method,
    /// What only the paper's method knows.
    pub paper_method: paper_method::Config,
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
    /// It passes within reach, but would hit the open gripper on its way in, whatever the grasp.
    Blocked,
    /// A catch was chosen, but no motion to it that keeps all limits.
    NoPlan,
    /// A plan is being executed; the newest flight gave no better one.
    PlanKept,
    /// The newest flight cannot be met exactly any more; the arm goes as near to it as it can.
    Approached,
    /// A new plan was made.
    Planned,
    /// Too late to change anything: the plan runs to its end.
    Committed,
}

impl Status {
    /// Whether the arm was sent a new motion.
    pub fn is_new_motion(self) -> bool {
        matches!(self, Self::Planned | Self::Approached)
    }
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

/// What is worked out before anything flies, once for any number of throws: the object's model from its scan, the ways of
/// holding it, the planner for the arm, and what the cameras see of the arm while it waits.
#[derive(Debug)]
pub struct Preparation {
    config: Config,
    cameras: Vec<CameraModel>,
    reference: ReferenceModel,
    grasps: GraspSet,
    planner: Planner,
    arm_surface: ArmSurface,
    alignment: CameraAlignment,
    workspace: perception::Workspace,
}

impl Preparation {
    /// For an arm with a gripper, cameras at known places, and an object known from a scan.
    ///
    /// The arm is expected to wait at [`Robot::ready_q`] with its gripper open; if it waits elsewhere, the first images take longer.
    pub fn new(
        config: Config,
        robot: Robot,
        gripper: Gripper,
        cameras: Vec<CameraModel>,
        reference_scan: &ReferenceScan,
    ) -> Self {
        let config = if config.method == Method::Paper { paper_method::with_its_stages(config) } else { config };
        let reference = ReferenceModel::from_scan(reference_scan, &config.perception);
        let grasps = GraspSet::sample(&reference, &gripper, &config.grasp_selection);
        let arm_surface = ArmSurface::new(&robot, &gripper);
        let X_WL = robot.link_poses(&robot.ready_q);
        let waiting = Surroundings { arm: &arm_surface, X_WL, width_m: gripper.max_width_m };
        let alignment = CameraAlignment::before_flight(&cameras, &waiting, &config.perception);
        let workspace = perception::Workspace::before_flight(&cameras, &waiting, &config.perception);
        let planner = Planner::new(robot, gripper, config.trajectory_optimization.clone());
        Self { config, cameras, reference, grasps, planner, arm_surface, alignment, workspace }
    }

    /// The object as the brain knows it.
    pub fn reference(&self) -> &ReferenceModel {
        &self.reference
    }

    /// The ways of holding it.
    pub fn grasps(&self) -> &GraspSet {
        &self.grasps
    }

    /// What moves the arm.
    pub fn planner(&self) -> &Planner {
        &self.planner
    }
}

/// An object that has not been seen for this long is looked for everywhere.
const LOST_S: f64 = 0.05;
/// Observations whose joint angles are remembered: longer than images can take to arrive.
const SENSED: usize = 64;
/// Poses that are remembered, more than any prediction looks back at.
const POSES: usize = 1024;

/// The catching robot's brain.
#[derive(Debug)]
pub struct CatchingBot {
    known: Arc<Preparation>,
    seed: u64,

    /// The cameras, as far as images of the arm have told where they look.
    alignment: CameraAlignment,
    /// What the encoders said lately: (time, arm, opening of the gripper), oldest first.
    sensed: VecDeque<(f64, JointVector, f64)>,
    poses: Vec<ObjectPose>,
    flight: Option<FlightTrajectory>,
    plan: Option<CatchPlan>,
    /// Looks for a plan in a row that found none.
    refusals: usize,
    /// Cost of holding at which the running catch was chosen, or compared last.
    settled_cost: f64,
    /// The plans that the arm was sent and has not rejected.
    sent: SentPlans,
    workspace: perception::Workspace,
    prediction_workspace: trajectory_prediction::Workspace,
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
        let seed = config.seed;
        Self::prepared(Arc::new(Preparation::new(config, robot, gripper, cameras, reference_scan)), seed)
    }

    /// A brain that shares what was worked out beforehand; it draws at random from `seed` instead of [`Config::seed`].
    pub fn prepared(known: Arc<Preparation>, seed: u64) -> Self {
        Self {
            alignment: known.alignment.clone(),
            workspace: known.workspace.clone(),
            known,
            seed,
            sensed: VecDeque::with_capacity(SENSED),
            poses: Vec::with_capacity(POSES),
            flight: None,
            plan: None,
            refusals: 0,
            settled_cost: 0.0,
            sent: SentPlans::default(),
            prediction_workspace: trajectory_prediction::Workspace::default(),
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
        self.known.reference()
    }

    /// All ways of holding it that its shape allows.
    pub fn grasps(&self) -> &GraspSet {
        self.known.grasps()
    }
}

/// The arm as it was at a time, between what was sensed before and after.
fn surroundings<'a>(
    known: &'a Preparation,
    sensed: &VecDeque<(f64, JointVector, f64)>,
    time_s: f64,
) -> Option<Surroundings<'a>> {
    let after = sensed.iter().position(|sensed| sensed.0 >= time_s).unwrap_or(sensed.len().saturating_sub(1));
    let (before, after) = (sensed.get(after.saturating_sub(1))?, sensed.get(after)?);
    let span_s = after.0 - before.0;
    let share = if span_s > 0.0 { ((time_s - before.0) / span_s).clamp(0.0, 1.0) } else { 1.0 };
    let q = before.1 + (after.1 - before.1) * share;
    let X_WL = known.planner.robot().link_poses(&q);
    Some(Surroundings { arm: &known.arm_surface, X_WL, width_m: before.2 + (after.2 - before.2) * share })
}

impl Brain for CatchingBot {
    /// The paper's figure 2: images → pose → flight → grasp and plan → command.
    fn tick(&mut self, observation: &Observation, probe: &mut dyn Probe) -> Command {
        self.report = Report::default();
        let now_s = observation.time_s;
        if self.sent.acknowledge(&observation.arm, self.known.config.control.lost_after_s) {
            self.plan = self.sent.last().cloned();
        }
        if self.is_committed(now_s) {
            // Nothing that may still be seen changes anything: no camera needs to read out a pixel.
            let windows = Some(vec![PixelWindow::default(); self.known.cameras.len()]);
            return self.close_report(Status::Committed, Command { windows, ..Command::default() });
        }

        if self.sensed.len() == SENSED {
            self.sensed.pop_front();
        }
        self.sensed.push_back((observation.arm.time_s, observation.arm.q, observation.gripper.width_m));

        // III-B: pose of the object in the newest images, started from where the last flight says it is.
        for frames in observation.frames.chunk_by(|a, b| a.capture_s == b.capture_s) {
            let expected = self.expected_pose(frames[0].capture_s);
            let surroundings = surroundings(&self.known, &self.sensed, frames[0].capture_s);
            let config = &self.known.config.perception;
            self.alignment.observe(frames, &self.known.cameras, surroundings.as_ref(), config);
            let found = perception::find_object(
                frames,
                self.alignment.cameras(),
                &self.known.reference,
                expected.as_ref(),
                surroundings.as_ref(),
                config,
                &mut self.workspace,
            );
            if let Ok(mut pose) = found {
                if let Some(X_WO) = &expected {
                    pose.X_WO.rotation =
                        self.known.reference.symmetry.nearest_alike(&X_WO.rotation, &pose.X_WO.rotation);
                }
                if self.poses.len() == POSES {
                    self.poses.drain(..POSES / 2);
                }
                self.poses.push(pose);
                self.report.pose = Some(pose);
            }
        }
        probe.stage_ended("perception");
        if self.poses.is_empty() {
            return self.close_report(Status::NoObject, Command::default());
        }

        // III-B: the flight that the poses agree on.
        let flight = trajectory_prediction::predict(
            &self.poses,
            self.flight.as_ref(),
            self.known.reference.symmetry,
            &self.known.config.trajectory_prediction,
            self.seed,
            &mut self.prediction_workspace,
        );
        probe.stage_ended("trajectory_prediction");
        let Ok(mut flight) = flight else {
            return self.close_report(Status::NoTrajectory, Command::default());
        };
        if let Some(previous) = &self.flight {
            let R_WO = previous.pose_at(flight.time_s).rotation;
            flight.R_WO = self.known.reference.symmetry.nearest_alike(&R_WO, &flight.R_WO);
        }

        // III-C and III-D: the running plan for the new flight, or a new grasp and plan.
        let start = self.start(observation);
        let (status, plan) = self.decide(&start, &flight);
        probe.stage_ended("trajectory_optimization");

        let mut command = self.command(now_s, status, plan, &flight);
        command.windows = self.windows(observation, &flight);
        self.flight = Some(flight);
        probe.stage_ended("control");
        self.close_report(status, command)
    }

    fn reset(&mut self) {
        let mut sent = std::mem::take(&mut self.sent);
        sent.clear();
        *self = Self { sent, ..Self::prepared(self.known.clone(), self.seed) };
    }
}

impl CatchingBot {
    /// Too late to change anything.
    fn is_committed(&self, now_s: f64) -> bool {
        self.plan.as_ref().is_some_and(|plan| now_s > plan.catch_s - self.known.config.control.commit_s)
    }

    /// The part of each camera's next images that may show the object, once it is tracked in images without masks (sensors that
    /// tell objects apart read out the right pixels by themselves). Full images if it has been lost.
    fn windows(&self, observation: &Observation, flight: &FlightTrajectory) -> Option<Vec<PixelWindow>> {
        let unlabelled = observation.frames.iter().any(|frame| frame.mask.is_none());
        let newest_s = observation.frames.iter().map(|frame| frame.capture_s).fold(f64::NEG_INFINITY, f64::max);
        if !unlabelled || newest_s > flight.time_s + LOST_S {
            return None;
        }
        let count = self.sensed.len();
        let period_s = if count > 1 { self.sensed[count - 1].0 - self.sensed[count - 2].0 } else { 0.0 };
        let next_s = observation.time_s + period_s;
        let (p_WO, v_WO) = (flight.pose_at(next_s).translation.vector, flight.twist_at(next_s).linear);
        let doubt_m = 3.0 * flight.position_sd_at(next_s) + v_WO.norm() * period_s;
        let radius_m = self.known.reference.radius_m + self.known.config.perception.gate_m + doubt_m;
        let window =
            |camera: &CameraModel| camera.window_around(&camera.X_WC.inverse_transform_point(&p_WO.into()), radius_m);
        Some(self.alignment.cameras().iter().map(window).collect())
    }

    /// Where the object should be: on the last flight, or, before there is one, where it was seen last. The latter keeps an
    /// object that looks the same from two sides from turning over between the first images.
    fn expected_pose(&self, time_s: f64) -> Option<Pose> {
        let flight = self.flight.as_ref().map(|flight| flight.pose_at(time_s));
        flight.or_else(|| self.poses.last().map(|pose| pose.X_WO))
    }

    fn close_report(&mut self, status: Status, command: Command) -> Command {
        self.report.status = status;
        self.report.flight.clone_from(&self.flight);
        self.report.plan.clone_from(&self.plan);
        self.report.closing = self.closing;
        command
    }
}
