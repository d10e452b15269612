//! The brain: catches thrown objects with a robot arm from depth images alone.
//!
//! The folders bear the headings of the paper (Cieślar, Zeng, Tedrake: CatchingBot, section III):
//! [`perception`] finds the object's pose in each set of images (III-B), [`trajectory_prediction`] its flight
//! (III-B), [`grasp_selection`] where to hold it (III-C), [`trajectory_optimization`] how to get there
//! (III-D), and [`control`] turns that into commands.
//!
//! Three stages can be exchanged: [`PoseEstimator`], [`FlightPredictor`] and [`CatchPlanner`]. Each owns its
//! settings and buffers, its inputs are values. What lasts from tick to tick is in the tracker and the
//! controller of [`CatchingBot`], whose [`tick`](CatchingBot::tick) reads like the paper's figure 2.
//!
//! Begin with [`CatchingBot`] (the brain of one object), [`Config`] (its settings) and
//! [`cycle::CatchingCycle`] (a life of many throws of several objects):
//!
//! ```
//! use catch_body::InputError;
//! use catch_bot::{CatchingBot, Config, Status};
//! use catch_cell::{Brain, CameraModel, Command, KnownObject, Observation};
//!
//! /// What the brain wants after one observation, and how far it got.
//! fn first_tick(
//!     robot: catch_body::Robot,
//!     gripper: catch_body::Gripper,
//!     cameras: Vec<CameraModel>,
//!     object: &KnownObject,
//!     observation: &Observation,
//! ) -> Result<(Command, Status), InputError> {
//!     let mut brain = CatchingBot::new(Config::default(), robot, gripper, cameras, object)?;
//!     let command = brain.tick(observation, &mut ());
//!     Ok((command, brain.report().status))
//! }
//! ```
//!
//! The brain does no I/O, reads no clock and draws no random numbers but from its own seed: the same
//! observations give the same commands, bit for bit.

pub mod control;
pub mod cycle;
pub mod grasp_selection;
pub mod perception;
mod preparation;
mod tracker;
pub mod trajectory_optimization;
pub mod trajectory_prediction;

use std::sync::Arc;

use catch_body::{Gripper, InputError, Robot};
use catch_cell::{Brain, CameraModel, Command, GripperMove, KnownObject, Observation, PixelWindow, Probe};

use control::{CatchPlanner, Controller, GripperPlan, Situation, opening};
use perception::{CameraStatus, ObjectPose, PoseEstimator, camera_offsets::CameraOffset};
use tracker::{
    Tracker,
    tracks::{Track, Tracks},
};
use trajectory_optimization::{CatchPlan, reach_map::ReachMap};
use trajectory_prediction::{FlightPredictor, FlightTrajectory};

pub use control::Status;
pub use preparation::{Config, Preparation};

/// Fingers that stand nearer than this to where they should wait are left there, in metres.
const WAITING_TOLERANCE_M: f64 = 0.001;

/// State and decision of the brain in its last tick, for observers.
#[derive(Debug, Clone, Default)]
pub struct Report {
    /// Status of the tick.
    pub status: Status,
    /// The newest pose, if this tick found one.
    pub pose: Option<ObjectPose>,
    /// The flight as predicted now.
    pub flight: Option<FlightTrajectory>,
    /// The plan that is being executed.
    pub plan: Option<CatchPlan>,
    /// Closing of the gripper as commanded last.
    pub closing: Option<GripperPlan>,
    /// Status of each camera.
    pub cameras: Vec<CameraStatus>,
    /// Numbers of numerical failures in this throw.
    pub numerical_failures: NumericalFailures,
}

/// Numbers of failures of arithmetic, which say nothing of feasibility: a program that a solver gave up, a
/// matrix that could not be factorized.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct NumericalFailures {
    /// Failures in trajectory prediction.
    pub prediction: u32,
    /// Failures in grasp selection and trajectory optimization.
    pub planning: u32,
}

/// The catching robot's brain, made of a pose estimator, a flight predictor and a catch planner.
pub struct CatchingBot {
    /// The models and tables that were prepared beforehand.
    pub known: Arc<Preparation>,
    estimator: Box<dyn PoseEstimator>,
    predictor: Box<dyn FlightPredictor>,
    planner: Box<dyn CatchPlanner>,

    tracker: Tracker,
    controller: Controller,
    /// True once the fingers have been told in this throw how far apart to wait.
    has_opened: bool,
    report: Report,
}

impl CatchingBot {
    /// A brain for an arm with a gripper, cameras at known places, and an object known from a scan and some
    /// figures ([`Config::given`]). Arms that are served by a [`ReachMap`] get one, which takes some seconds;
    /// who has stored it makes the brain of a [`Preparation`] and its [stages](Self::with_stages).
    ///
    /// # Errors
    /// A setting that is out of its range.
    pub fn new(
        config: Config,
        robot: Robot,
        gripper: Gripper,
        cameras: Vec<CameraModel>,
        object: &KnownObject,
    ) -> Result<Self, InputError> {
        let robot = robot.with_mount_of(&gripper);
        let reach_map = ReachMap::serves(&robot).then(|| Arc::new(ReachMap::new(&robot)));
        let config = config.given(&object.figures, &cameras);
        let known = Preparation::new(config, (robot, reach_map), gripper, cameras, &object.scan)?;
        let (estimator, predictor) = (Box::new(known.pose_estimator()), Box::new(known.flight_predictor(0)));
        let planner = Box::new(known.catch_planner());
        Ok(Self::with_stages(Arc::new(known), estimator, predictor, planner))
    }

    /// A brain of these stages. Those of [`Preparation`] are ours.
    pub fn with_stages(
        known: Arc<Preparation>,
        estimator: Box<dyn PoseEstimator>,
        predictor: Box<dyn FlightPredictor>,
        planner: Box<dyn CatchPlanner>,
    ) -> Self {
        let tracker = Tracker::new(&known, false);
        let Config { control, grasp_selection, .. } = known.config.clone();
        let motion = &known.search.motion;
        let controller = Controller::new(control, grasp_selection, motion.robot.clone(), motion.gripper.clone());
        let (has_opened, report) = (false, Report::default());
        Self { known, estimator, predictor, planner, tracker, controller, has_opened, report }
    }

    /// State and decision of the last tick.
    pub fn report(&self) -> &Report {
        &self.report
    }
}

impl Brain for CatchingBot {
    /// The paper's figure 2: images → pose → flight → grasp and plan → command.
    fn tick(&mut self, observation: &Observation, probe: &mut dyn Probe) -> Command {
        let now_s = observation.time_s;
        self.controller.acknowledge(observation, self.tracker.flight());
        let command = if self.controller.is_committed(now_s) {
            // Nothing that may still be seen changes anything: no camera needs to read out a pixel.
            let windows = Some(vec![PixelWindow::default(); self.known.cameras.len()]);
            self.close_report(Status::Committed, None, Command { windows, ..Command::default() })
        } else {
            let pose = self.perceive(observation);
            probe.stage_ended("perception");
            if self.predict(observation) {
                probe.stage_ended("trajectory_prediction");
            }
            self.act_on(observation, pose, probe)
        };
        let command = self.controller.amended(command);
        let opening = self.opening(observation);
        Command { gripper: command.gripper.or(opening), ..command }
    }

    fn reset(&mut self) {
        self.tracker = Tracker::new(&self.known, self.tracker.compares_cameras);
        self.forget_flight();
    }
}

impl CatchingBot {
    /// Distance between the fingers of the hand that waits for a throw, in metres.
    pub fn waiting_width_m(&self) -> f64 {
        self.planner.waiting_width_m().unwrap_or(self.known.search.motion.gripper.max_width_m)
    }

    /// The move of the fingers to where they wait, if they stand elsewhere when a throw begins.
    fn opening(&mut self, observation: &Observation) -> Option<Vec<GripperMove>> {
        let width_m = self.planner.waiting_width_m()?;
        let is_first = !std::mem::replace(&mut self.has_opened, true) && self.controller.plan().is_none();
        let must_move = is_first && (observation.gripper.width_m - width_m).abs() > WAITING_TOLERANCE_M;
        must_move.then(|| vec![opening(observation.time_s, width_m, &self.known.search.motion.gripper)])
    }

    /// III-B: pose of the object in the newest images, started from where the last flight says it is.
    fn perceive(&mut self, observation: &Observation) -> Option<ObjectPose> {
        self.tracker.sense(observation);
        self.tracker.track(&observation.frames, &self.known, &mut *self.estimator)
    }

    /// III-B: the flight that the poses agree on. Returns whether there was anything new to predict it from.
    fn predict(&mut self, observation: &Observation) -> bool {
        let tracks = &mut self.tracker.tracks;
        let is_new = !observation.frames.is_empty() && !tracks.object.poses.is_empty();
        if is_new {
            tracks.predict(&mut *self.predictor, &self.known);
        }
        is_new
    }

    fn close_report(&mut self, status: Status, pose: Option<ObjectPose>, command: Command) -> Command {
        let Self { tracker, controller, .. } = self;
        self.report.flight.clone_from(&tracker.tracks.object.flight);
        (self.report.status, self.report.pose, self.report.closing) = (status, pose, controller.closing);
        self.report.plan = controller.plan().cloned();
        self.report.cameras.clone_from(&tracker.health.statuses);
        let (prediction, planning) = (self.predictor.numerical_failures(), self.planner.numerical_failures());
        self.report.numerical_failures = NumericalFailures { prediction, planning };
        command
    }

    /// The throw is over, the next one begins; what is known of the cameras stays, also by how far they were
    /// off in it.
    fn end_throw(&mut self, offsets: &[CameraOffset]) {
        self.tracker.end_throw(offsets, &self.known);
        self.forget_flight();
    }

    fn forget_flight(&mut self) {
        self.estimator.reset();
        self.predictor.reset();
        self.planner.reset();
        self.controller.reset();
        self.has_opened = false;
        self.report = Report::default();
    }

    /// III-C and III-D: acts on what has been seen so far; `pose` is the newest, if this tick found one.
    fn act_on(&mut self, observation: &Observation, pose: Option<ObjectPose>, probe: &mut dyn Probe) -> Command {
        if self.tracker.tracks.object.poses.is_empty() {
            return self.close_report(Status::NoObject, pose, Command::default());
        }
        let windows = self.tracker.windows(observation, &self.known);
        if observation.frames.is_empty() {
            // What the last images showed has been acted on.
            let status = self.report.status.without_images(self.controller.plan().is_some());
            return self.close_report(status, None, Command { windows, ..Command::default() });
        }
        let Tracks { object: Track { poses, flight }, flies, .. } = &self.tracker.tracks;
        let (true, [first, ..], Some(flight)) = (flies, &poses[..], flight) else {
            return self.close_report(Status::NoTrajectory, pose, Command { windows, ..Command::default() });
        };

        // The running plan for the new flight, or a new grasp and plan.
        let decision = self.planner.plan(&Situation {
            observed_s: self.tracker.observed_s(),
            first_seen_s: first.capture_s,
            start: self.controller.start(observation),
            sensed: (observation.arm.q, observation.arm.dq),
            flight,
            running: self.controller.plan(),
            closing: self.controller.closing,
            progress: self.controller.progress,
        });
        probe.stage_ended("trajectory_optimization");

        let status = decision.status;
        let command = Command { windows, ..self.controller.command(observation, decision, flight) };
        probe.stage_ended("control");
        self.close_report(status, pose, command)
    }
}
