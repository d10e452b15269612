//! A session of calibration: the arm goes through poses and rests in each while the cameras look.

use catch_body::JointVector;
use catch_cell::{ArmTrajectory, Brain, CameraModel, Command, Observation, PixelWindow, Probe, TrajectoryId};

use super::{
    ArmSample, Config,
    averaged_image::{AveragedImage, Averaging},
};
use catch_bot::trajectory_optimization::MotionPlanner;

/// Time for which the arm settles in each pose before the images, in seconds.
const SETTLING_S: f64 = 0.25;
/// A motion that is not executed so long after it should be was lost, in seconds.
const OVERDUE_S: f64 = 0.5;
/// Longest time that images may be under way, in seconds.
const LATEST_IMAGE_S: f64 = 0.3;
/// Motions that are tried to one pose.
const TRIES: usize = 3;

/// Observations of a session: arm and images.
#[derive(Debug, Clone, Default)]
pub struct Session {
    /// The arm at each tick, in the order of time.
    pub arm: Vec<ArmSample>,
    /// Full images, those of one pose as one.
    pub images: Vec<AveragedImage>,
}

/// Moves the arm through poses and collects what the cameras see: a brain like any other, for any cell.
#[derive(Debug)]
pub struct CalibrationRun {
    config: Config,
    planner: MotionPlanner,
    poses: Vec<JointVector>,
    full: Vec<PixelWindow>,
    phase: Phase,
    next_pose: usize,
    tries: usize,
    sent: u64,
    averaging: Averaging,
    session: Session,
}

#[derive(Debug, Clone, Copy)]
enum Phase {
    /// No motion is under way.
    Ready,
    /// A motion to a pose is under way; `has_looked` is true if images in motion have been asked for.
    Moving { id: TrajectoryId, start_s: f64, end_s: f64, has_looked: bool },
    /// Looking since then.
    Looking { from_s: f64, images: usize },
    /// The last images are under way.
    Ending { from_s: f64 },
    /// All poses are done.
    Done,
}

impl CalibrationRun {
    /// A run for an arm and cameras; the poses in the order in which they are taken.
    pub fn new(config: Config, planner: MotionPlanner, cameras: &[CameraModel], poses: Vec<JointVector>) -> Self {
        let full = cameras.iter().map(CameraModel::full_window).collect();
        Self {
            config,
            planner,
            poses,
            full,
            phase: Phase::Ready,
            next_pose: 0,
            tries: 0,
            sent: 0,
            averaging: Averaging::default(),
            session: Session::default(),
        }
    }

    /// Returns whether all poses have been taken, or skipped where no motion leads there.
    pub fn is_done(&self) -> bool {
        matches!(self.phase, Phase::Done)
    }

    /// Observations of the run.
    pub fn into_session(mut self) -> Session {
        self.averaging.end(&mut self.session);
        self.session
    }

    fn blind(&self) -> Vec<PixelWindow> {
        vec![PixelWindow::default(); self.full.len()]
    }

    /// A motion to the next pose that can be reached.
    fn depart(&mut self, observation: &Observation) -> Command {
        let from = observation.arm.commanded.q;
        while let Some(to) = self.poses.get(self.next_pose) {
            let start_s = observation.time_s + self.config.expected_latency_s;
            let ready_q = self.planner.robot.ready_q;
            let spline = (self.tries < TRIES)
                .then(|| {
                    let mut ways = [None, Some(&ready_q)].into_iter();
                    ways.find_map(|via| self.planner.rest_to_rest(start_s, &from, via, to, None))
                })
                .flatten();
            let Some(spline) = spline else {
                (self.next_pose, self.tries) = (self.next_pose + 1, 0);
                continue;
            };
            self.tries += 1;
            self.sent += 1;
            let id = TrajectoryId(self.sent);
            self.phase = Phase::Moving { id, start_s, end_s: spline.end_s(), has_looked: false };
            return Command { arm: Some(ArmTrajectory { id, spline }), windows: Some(self.blind()), gripper: None };
        }
        self.phase = Phase::Ending { from_s: observation.time_s };
        Command { windows: Some(self.blind()), ..Command::default() }
    }
}

impl Brain for CalibrationRun {
    fn tick(&mut self, observation: &Observation, _: &mut dyn Probe) -> Command {
        let (now_s, arm) = (observation.time_s, &observation.arm);
        let width_m = observation.gripper.width_m;
        self.session.arm.push(ArmSample { time_s: arm.time_s, q: arm.q, dq: arm.dq, width_m });
        observation.frames.iter().for_each(|frame| self.averaging.add(frame, &self.full));
        self.averaging.advance(&mut self.session, arm.time_s);
        match self.phase {
            Phase::Ready => self.depart(observation),
            Phase::Moving { id, start_s, end_s, has_looked } => {
                let is_lost = arm.rejected.iter().any(|it| it.id == id)
                    || (arm.executing != Some(id) && now_s > start_s + OVERDUE_S);
                if is_lost {
                    return self.depart(observation);
                }
                if now_s > end_s + SETTLING_S {
                    (self.next_pose, self.tries) = (self.next_pose + 1, 0);
                    self.phase = Phase::Looking { from_s: now_s, images: 0 };
                    return Command { windows: Some(self.full.clone()), ..Command::default() };
                }
                let looks = !has_looked && now_s > f64::midpoint(start_s, end_s);
                self.phase = Phase::Moving { id, start_s, end_s, has_looked: has_looked || looks };
                let windows = if looks { self.full.clone() } else { self.blind() };
                Command { windows: Some(windows), ..Command::default() }
            }
            Phase::Looking { from_s, images } if images + 1 < self.config.images_per_pose => {
                self.phase = Phase::Looking { from_s, images: images + 1 };
                Command::default()
            }
            Phase::Looking { .. } => self.depart(observation),
            Phase::Ending { from_s } => {
                if now_s > from_s + LATEST_IMAGE_S {
                    self.phase = Phase::Done;
                }
                Command::default()
            }
            Phase::Done => Command::default(),
        }
    }

    fn reset(&mut self) {
        (self.phase, self.next_pose, self.tries) = (Phase::Ready, 0, 0);
        (self.averaging, self.session) = (Averaging::default(), Session::default());
    }
}
