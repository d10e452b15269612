//! A brain that lives for many throws, of several known objects: it waits, catches, holds, puts down, returns
//! and waits again.

mod explained;

use catch_body::JointVector;
use catch_cell::{
    ArmTrajectory, Brain, Command, GraspState, GripperMove, GripperState, Observation, PixelWindow, Probe,
};

use crate::{
    CatchingBot, Report,
    control::opening,
    grasp_selection::Grasp,
    perception::camera_offsets::MIN_CAMERAS,
    trajectory_optimization::CatchPlan,
    trajectory_prediction::{WINDOW, newest},
};

/// Time from the catch on for the fingers to close upon the object, in seconds.
const SQUEEZE_S: f64 = 0.3;
/// Time for which an object is held after the catch, in seconds: longer than a referee looks at it.
pub const HOLD_S: f64 = 1.6;
/// Time for the gripper to open and the object to fall out of it, in seconds.
const RELEASE_S: f64 = 0.5;
/// Fingers that have closed to less than this fraction of the object's width hold nothing.
const MIN_HELD_FRACTION: f64 = 0.5;
/// Largest number of times that the motions of one phase are sent: a motion that is rejected again and again
/// never will be accepted.
const MAX_SENT: usize = 20;
/// Time by which a motion may be overdue before it is sent anew, in seconds.
const MAX_OVERDUE_S: f64 = 0.05;

/// Phase of the catching cycle.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Phase {
    /// The arm stands in its ready pose; nothing that is known falls to it.
    Waiting,
    /// A known object falls to the arm, and is identified.
    Catching,
    /// The object is between the fingers, and the arm stands still.
    Holding,
    /// The object is carried to its placing pose.
    Placing,
    /// The hand is empty, and on its way to the ready pose.
    Returning,
    /// No motion leads back that keeps all limits and is accepted. The arm stands still until somebody resets
    /// the brain.
    Stranded,
}

/// Brains of several objects, one for each, in one life.
pub struct CatchingCycle {
    /// Placing posture: joint positions in radians, in which the gripper opens.
    place_q: JointVector,
    bots: Vec<CatchingBot>,
    phase: Phase,
    /// The object that flies or is held.
    active: usize,
    /// Start of the present phase, or, while an object is put down, the time since which the gripper has been
    /// open.
    since_s: f64,
    /// The motion from rest to rest that was sent last in the present phase.
    motion: Option<ArmTrajectory>,
    /// Motions of the present phase that were sent.
    sent: usize,
    has_released: bool,
}

impl CatchingCycle {
    /// Creates the cycle for objects by their brains, which must be of the same arm, gripper and cameras. A
    /// caught object is put down at the joint positions `place_q`, in radians.
    ///
    /// # Panics
    /// Without any object.
    pub fn new(place_q: JointVector, mut bots: Vec<CatchingBot>) -> Self {
        assert!(!bots.is_empty(), "a brain needs to know an object");
        bots.iter_mut().for_each(|it| it.tracker.compares_cameras = it.known.cameras.len() >= MIN_CAMERAS);
        let (phase, active) = (Phase::Waiting, 0);
        Self { place_q, bots, phase, active, since_s: 0.0, motion: None, sent: 0, has_released: false }
    }

    /// Phase of the cycle.
    pub fn phase(&self) -> Phase {
        self.phase
    }

    /// The object that flies or is held, by its place in the list of objects; while it waits the last one.
    pub fn object(&self) -> usize {
        self.active
    }

    /// State and decision of the active object's brain in the last tick; `None` unless it catches.
    pub fn report(&self) -> Option<&Report> {
        (self.phase == Phase::Catching).then(|| self.bots[self.active].report())
    }

    fn enter(&mut self, phase: Phase, now_s: f64) {
        (self.phase, self.since_s, self.motion, self.sent, self.has_released) = (phase, now_s, None, 0, false);
    }

    /// Looks for what falls to the arm, with the eyes of all known objects.
    fn wait(&mut self, observation: &Observation, probe: &mut dyn Probe) -> Command {
        let now_s = observation.time_s;
        let perceive = |bot: &mut CatchingBot| {
            bot.controller.acknowledge(observation, bot.tracker.flight());
            bot.perceive(observation)
        };
        let poses: Vec<_> = self.bots.iter_mut().map(perceive).collect();
        probe.stage_ended("perception");
        self.bots.iter_mut().for_each(|bot| {
            bot.predict(observation);
        });
        probe.stage_ended("trajectory_prediction");
        let Some(object) = self.identified(now_s) else { return Command::default() };
        self.active = object;
        self.enter(Phase::Catching, now_s);
        self.bots[object].tracker.begin_throw();
        self.bots[object].act_on(observation, poses[object], probe)
    }

    /// The object that falls to the arm: the one that explains the images best. A ball is also found in
    /// images of a bottle, and falls there as well.
    fn identified(&self, now_s: f64) -> Option<usize> {
        let falls = |bot: &CatchingBot| bot.tracker.tracks.falls_to(&bot.known.search.motion, now_s);
        let poses = |bot: &CatchingBot| newest(&bot.tracker.tracks.object.poses, WINDOW).iter().collect();
        let falling = self.bots.iter().enumerate().filter(|(_, bot)| falls(bot));
        explained::best(&falling.map(|(i, bot)| (i, poses(bot))).collect::<Vec<_>>())
    }

    fn catch(&mut self, observation: &Observation, probe: &mut dyn Probe) -> Command {
        let now_s = observation.time_s;
        let bot = &mut self.bots[self.active];
        let command = bot.tick(observation, probe);
        match bot.controller.plan() {
            Some(plan) if now_s > plan.catch_s + SQUEEZE_S && now_s > plan.trajectory.end_s() => {
                let holds = is_held(&observation.gripper, plan);
                self.enter(if holds { Phase::Holding } else { Phase::Returning }, now_s);
            }
            None if bot.tracker.tracks.is_over(&bot.known.search.motion, now_s) => {
                self.enter(Phase::Returning, now_s);
            }
            _ => {}
        }
        command
    }

    /// A tick of a phase in which nothing is looked for: no camera needs to read out a pixel.
    fn without_images(&mut self, phase: fn(&mut Self, &Observation) -> Command, observation: &Observation) -> Command {
        let command = phase(self, observation);
        let cameras = self.bots[self.active].known.cameras.len();
        let is_over = self.phase == Phase::Returning;
        Command { windows: (!is_over).then(|| vec![PixelWindow::default(); cameras]), ..command }
    }

    fn hold(&mut self, observation: &Observation) -> Command {
        let plan = self.bots[self.active].controller.plan();
        let caught_s = plan.map_or(self.since_s, |plan| plan.catch_s);
        if !plan.is_some_and(|plan| is_held(&observation.gripper, plan)) {
            self.enter(Phase::Returning, observation.time_s);
        } else if observation.time_s > caught_s + HOLD_S {
            self.enter(Phase::Placing, observation.time_s);
        }
        Command::default()
    }

    fn place(&mut self, observation: &Observation) -> Command {
        let now_s = observation.time_s;
        if self.has_released {
            if now_s > self.since_s + RELEASE_S {
                self.enter(Phase::Returning, now_s);
            }
            return Command::default();
        }
        let held = self.bots[self.active].controller.plan().map(|plan| plan.grasp.clone());
        match self.go(observation, self.place_q, held.as_ref()) {
            Progress::Going(command) => command,
            // Where there is no way the object is put down where the arm stands.
            Progress::Arrived | Progress::NoWay => {
                (self.has_released, self.since_s) = (true, now_s);
                Command { gripper: Some(self.opening(now_s)), ..Command::default() }
            }
        }
    }

    fn go_back(&mut self, observation: &Observation) -> Command {
        let now_s = observation.time_s;
        let ready_q = self.bots[self.active].known.search.motion.robot.ready_q;
        let must_open = !std::mem::replace(&mut self.has_released, true);
        let mut command = Command::default();
        match self.go(observation, ready_q, None) {
            Progress::Going(going) => command = going,
            Progress::Arrived => {
                let tracker = &self.bots[self.active].tracker;
                let offsets = tracker.flight().map_or_else(Vec::new, |flight| tracker.camera_offsets(flight));
                self.bots.iter_mut().for_each(|bot| bot.end_throw(&offsets));
                self.enter(Phase::Waiting, now_s);
            }
            Progress::NoWay => self.enter(Phase::Stranded, now_s),
        }
        Command { gripper: must_open.then(|| self.opening(now_s)), ..command }
    }

    fn opening(&self, now_s: f64) -> Vec<GripperMove> {
        // Wide enough for whatever is thrown next.
        let width_m = self.bots.iter().map(CatchingBot::waiting_width_m).fold(0.0, f64::max);
        vec![opening(now_s, width_m, &self.bots[self.active].known.search.motion.gripper)]
    }

    /// Towards `to`, and whether the arm is there. A motion that was rejected or lost is sent anew.
    fn go(&mut self, observation: &Observation, to: JointVector, held: Option<&Grasp>) -> Progress {
        let (now_s, arm) = (observation.time_s, &observation.arm);
        if let Some(motion) = &self.motion {
            let is_lost = arm.rejected.iter().any(|it| it.id == motion.id)
                || (arm.executing != Some(motion.id) && now_s > motion.start_s() + MAX_OVERDUE_S);
            if !is_lost {
                let is_over = now_s > motion.spline.end_s();
                return if is_over { Progress::Arrived } else { Progress::Going(Command::default()) };
            }
        }
        let bot = &mut self.bots[self.active];
        let (known, from) = (bot.known.clone(), arm.commanded.q);
        if (from - to).amax() < 1e-9 {
            return Progress::Arrived;
        }
        let planner = &known.search.motion;
        let start_s = now_s + known.config.control.expected_latency_s;
        // Straight, else by way of a pose that is known to be clear.
        let vias = [None, Some(planner.robot.ready_q), Some(self.place_q)];
        let mut ways = vias.iter().filter_map(|via| planner.rest_to_rest(start_s, &from, via.as_ref(), &to, held));
        let Some(spline) = ways.next().filter(|_| self.sent < MAX_SENT) else { return Progress::NoWay };
        self.sent += 1;
        let trajectory = ArmTrajectory { id: bot.controller.next_id(), spline };
        self.motion = Some(trajectory.clone());
        Progress::Going(Command { arm: Some(trajectory), ..Command::default() })
    }
}

/// Returns whether the object is held: the gripper reports so, or the fingers are as far apart as the object
/// of the plan keeps them. The report alone is not enough: a gripper that squeezes a soft object further
/// reports that it has lost it.
fn is_held(gripper: &GripperState, plan: &CatchPlan) -> bool {
    gripper.grasp == GraspState::Holding || gripper.width_m > MIN_HELD_FRACTION * plan.grasp.object_width_m
}

/// Progress of a motion.
enum Progress {
    /// The motion is on its way.
    Going(Command),
    /// The motion has arrived.
    Arrived,
    /// No motion keeps all limits and clearances.
    NoWay,
}

impl Brain for CatchingCycle {
    fn tick(&mut self, observation: &Observation, probe: &mut dyn Probe) -> Command {
        match self.phase {
            Phase::Waiting => self.wait(observation, probe),
            Phase::Catching => self.catch(observation, probe),
            Phase::Holding => self.without_images(Self::hold, observation),
            Phase::Placing => self.without_images(Self::place, observation),
            Phase::Returning => self.go_back(observation),
            Phase::Stranded => Command::default(),
        }
    }

    fn reset(&mut self) {
        self.bots.iter_mut().for_each(Brain::reset);
        self.enter(Phase::Waiting, 0.0);
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use catch_cell::DepthFrame;
    use nalgebra::Point3;

    use super::*;
    use crate::{
        Situation, Status,
        control::{CatchPlanner, Decision},
        perception::{ObjectPose, PerceptionStatus, PoseEstimator, Prior, View},
        tracker::{
            tests::{observation, preparation},
            tracks::tests::{pose, thrown},
        },
    };

    /// Where something is at a time, if anything is in sight.
    type Path = fn(f64) -> Option<Point3<f64>>;

    /// Finds an object on a path, whose silhouette is off by so much.
    struct OnPath(Path, f64);

    impl PoseEstimator for OnPath {
        fn estimate(&mut self, view: &View<'_>, _: Prior) -> Result<ObjectPose, PerceptionStatus> {
            let p_WO = self.0(view.capture_s()).ok_or(PerceptionStatus::NoPoints)?;
            Ok(ObjectPose { silhouette_mismatch: Some(self.1), ..pose(view.capture_s(), p_WO) })
        }

        fn estimate_all(&mut self, view: &View<'_>, _: &[catch_body::Pose], found: &mut Vec<ObjectPose>) {
            found.extend(self.estimate(view, Prior::Anywhere).ok());
        }
    }

    /// Finds no catch.
    struct NoCatch;

    impl CatchPlanner for NoCatch {
        fn plan(&mut self, _: &Situation<'_>) -> Decision {
            Decision { status: Status::NoGrasp, plan: None, progress: Default::default() }
        }
    }

    /// Phase and object of the cycle after each of 120 images a hundredth of a second apart, with objects
    /// that are found with so large mismatches.
    fn phases(path: Path, mask: Option<&[bool]>, mismatches: [f64; 3]) -> Vec<(Phase, usize)> {
        let known = Arc::new(preparation());
        let bot = |mismatch| {
            let predictor = Box::new(known.flight_predictor(0));
            CatchingBot::with_stages(known.clone(), Box::new(OnPath(path, mismatch)), predictor, Box::new(NoCatch))
        };
        let mut cycle = CatchingCycle::new(known.search.motion.robot.ready_q, mismatches.map(bot).into());
        let tick = |i| {
            let time_s = 0.01 * f64::from(i);
            let (window, depth_m, mask) = (PixelWindow::default(), Vec::new(), mask.map(<[bool]>::to_vec));
            let frames = vec![DepthFrame { camera: 0, capture_s: time_s, window, depth_m, mask }];
            cycle.tick(&observation(time_s, &known, frames), &mut ());
            (cycle.phase(), cycle.object())
        };
        (0..120).map(tick).collect()
    }

    /// The images during which the second object is caught, which is once.
    fn caught(phases: &[(Phase, usize)]) -> std::ops::Range<usize> {
        let is_caught = |it: &(Phase, usize)| *it == (Phase::Catching, 1);
        let (first, last) = (phases.iter().position(is_caught).unwrap(), phases.iter().rposition(is_caught).unwrap());
        assert!(phases[first..=last].iter().all(is_caught), "{phases:?}");
        assert!(phases[..first].iter().all(|it| it.0 == Phase::Waiting), "{phases:?}");
        assert_eq!(phases.last().unwrap().0, Phase::Waiting, "{phases:?}");
        first..last
    }

    #[test]
    fn a_hand_is_not_caught() {
        let phases = phases(|time_s| Some(Point3::new(1.6 - 1.2 * time_s, 0.2, 0.9)), None, [1.0; 3]);
        assert!(phases.iter().all(|it| it.0 == Phase::Waiting), "{phases:?}");
    }

    /// The object that explains the images best is taken for the one that falls. Where no catch is found, the
    /// next throw is waited for once this one is over.
    #[test]
    fn what_falls_is_identified_and_given_up_when_it_has_passed() {
        let caught = caught(&phases(|time_s| (time_s < 0.3).then(|| thrown(time_s)), None, [0.9, 0.4, 0.7]));
        assert!((4..12).contains(&caught.start), "it is seen to fall at once, but not by chance: {caught:?}");
        // It falls to the floor at 0.86 s.
        assert!((60..87).contains(&caught.end), "{caught:?}");
    }

    /// Masks show an object also where it lies, before it is thrown.
    #[test]
    fn an_object_that_lay_in_sight_is_caught_as_soon_as_one_that_did_not() {
        let path: Path = |time_s| match time_s < 0.3 {
            true => Some(Point3::new(0.4, 0.6, 0.2)),
            false => Some(thrown(time_s - 0.3)),
        };
        let lay = caught(&phases(path, Some(&[true]), [0.9, 0.4, 0.7]));
        let alone = caught(&phases(|time_s| Some(thrown(time_s)), Some(&[true]), [0.9, 0.4, 0.7]));
        assert!(lay.start.abs_diff(alone.start + 30) <= 1, "{lay:?} {alone:?}");
    }
}
