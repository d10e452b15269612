//! A brain that lives for many throws, of several known objects: it waits, catches, holds, puts down, returns
//! and waits again.

mod explained;

use catch_body::JointVector;
use catch_cell::{
    ArmTrajectory, Brain, Command, GraspState, GripperMove, GripperState, Observation, PixelWindow, Probe,
};
use nalgebra::Point3;

use crate::{
    CatchingBot, Report,
    control::opening,
    grasp_selection::Grasp,
    perception::{ObjectPose, camera_offsets::MIN_CAMERAS},
    trajectory_optimization::CatchPlan,
};
use explained::Explained;

/// Images after which an object in flight is identified: with the first one nothing has moved yet.
const IDENTIFY_IMAGES: usize = 3;
/// Least speed of an object in flight, in m/s.
const MIN_FLIGHT_MPS: f64 = 0.5;
/// Largest speed of an object in flight, in m/s; a faster one has been exchanged for another object.
const MAX_FLIGHT_MPS: f64 = 30.0;
/// Longest time between two images of one flight, in seconds.
const MAX_GAP_S: f64 = 0.1;
/// An object that has been followed for so long without a plan is not caught any more, in seconds.
const GIVE_UP_S: f64 = 1.5;
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
/// Least time between two images that determine a speed, in seconds.
const LEAST_SPAN_S: f64 = 0.005;

/// Phase of the catching cycle.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Phase {
    /// The arm stands in its ready pose; nothing flies that is known.
    Waiting,
    /// An object is in flight, and identified.
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

/// A known object's brain, and how well the object explains what flies.
struct Candidate {
    bot: CatchingBot,
    /// Mismatch between this object and the images of the present flight.
    explained: Explained,
    /// Images of the present flight.
    images: usize,
    /// Time and position at which the object was seen last.
    seen: Option<(f64, Point3<f64>)>,
    /// True if the object stood still there.
    rests: bool,
}

/// Brains of several objects, one for each, in one life.
pub struct CatchingCycle {
    /// Placing posture: joint positions in radians, in which the gripper opens.
    place_q: JointVector,
    candidates: Vec<Candidate>,
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
        let candidate = |bot| Candidate { bot, explained: Explained::default(), images: 0, seen: None, rests: false };
        let candidates = bots.into_iter().map(candidate).collect();
        let (phase, active) = (Phase::Waiting, 0);
        Self { place_q, candidates, phase, active, since_s: 0.0, motion: None, sent: 0, has_released: false }
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
        (self.phase == Phase::Catching).then(|| self.candidates[self.active].bot.report())
    }

    fn enter(&mut self, phase: Phase, now_s: f64) {
        (self.phase, self.since_s, self.motion, self.sent, self.has_released) = (phase, now_s, None, 0, false);
    }

    /// Looks for what flies, with the eyes of all known objects; as long as the last one lies still its own
    /// will do.
    fn wait(&mut self, observation: &Observation, probe: &mut dyn Probe) -> Command {
        let last = self.active;
        let mut newest = vec![None; self.candidates.len()];
        newest[last] = self.candidates[last].look(observation);
        let rests = newest[last].is_some() && self.candidates[last].rests;
        for (i, candidate) in self.candidates.iter_mut().enumerate().filter(|(i, _)| *i != last) {
            if rests {
                candidate.forget();
            } else {
                newest[i] = candidate.look(observation);
            }
        }
        probe.stage_ended("perception");
        let most = self.candidates.iter().map(|it| it.images).max().unwrap_or(0);
        if most < IDENTIFY_IMAGES {
            return Command::default();
        }
        // An object whose model cannot be brought to lie on what is seen in some images is not the one.
        let seen = self.candidates.iter().enumerate().filter(|(_, it)| it.images > 0 && it.images + 1 >= most);
        self.active = explained::best(&seen.map(|(i, it)| (i, it.explained))).unwrap_or(self.active);
        self.enter(Phase::Catching, observation.time_s);
        self.candidates[self.active].bot.act_on(observation, newest[self.active], probe)
    }

    fn catch(&mut self, observation: &Observation, probe: &mut dyn Probe) -> Command {
        let now_s = observation.time_s;
        let bot = &mut self.candidates[self.active].bot;
        let command = bot.tick(observation, probe);
        match bot.controller.plan() {
            Some(plan) if now_s > plan.catch_s + SQUEEZE_S && now_s > plan.trajectory.end_s() => {
                let holds = is_held(&observation.gripper, plan);
                self.enter(if holds { Phase::Holding } else { Phase::Returning }, now_s);
            }
            None if now_s > self.since_s + GIVE_UP_S => self.enter(Phase::Returning, now_s),
            _ => {}
        }
        command
    }

    /// A tick of a phase in which nothing is looked for: no camera needs to read out a pixel.
    fn without_images(&mut self, phase: fn(&mut Self, &Observation) -> Command, observation: &Observation) -> Command {
        let command = phase(self, observation);
        let cameras = self.candidates[self.active].bot.known.cameras.len();
        let is_over = self.phase == Phase::Returning;
        Command { windows: (!is_over).then(|| vec![PixelWindow::default(); cameras]), ..command }
    }

    fn hold(&mut self, observation: &Observation) -> Command {
        let plan = self.candidates[self.active].bot.controller.plan();
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
        let held = self.candidates[self.active].bot.controller.plan().map(|plan| plan.grasp.clone());
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
        let ready_q = self.candidates[self.active].bot.known.search.motion.robot.ready_q;
        let must_open = !std::mem::replace(&mut self.has_released, true);
        let mut command = Command::default();
        match self.go(observation, ready_q, None) {
            Progress::Going(going) => command = going,
            Progress::Arrived => {
                let tracker = &self.candidates[self.active].bot.tracker;
                let offsets = tracker.flight().map_or_else(Vec::new, |flight| tracker.camera_offsets(flight));
                for candidate in &mut self.candidates {
                    candidate.bot.end_throw(&offsets);
                    candidate.forget();
                }
                self.enter(Phase::Waiting, now_s);
            }
            Progress::NoWay => self.enter(Phase::Stranded, now_s),
        }
        Command { gripper: must_open.then(|| self.opening(now_s)), ..command }
    }

    fn opening(&self, now_s: f64) -> Vec<GripperMove> {
        // Wide enough for whatever is thrown next.
        let width_m = self.candidates.iter().map(|it| it.bot.waiting_width_m()).fold(0.0, f64::max);
        vec![opening(now_s, width_m, &self.candidates[self.active].bot.known.search.motion.gripper)]
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
        let bot = &mut self.candidates[self.active].bot;
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

impl Candidate {
    /// Takes in new images. What rests, and what was somewhere else a moment ago, begins anew.
    fn look(&mut self, observation: &Observation) -> Option<ObjectPose> {
        self.bot.controller.acknowledge(observation, self.bot.tracker.flight());
        let pose = self.bot.perceive(observation)?;
        // Images of cameras that run freely come in any order, and so close to each other that they tell no
        // speed.
        if self.seen.is_some_and(|(before_s, _)| pose.capture_s < before_s + LEAST_SPAN_S) {
            return Some(pose);
        }
        let p_WO = Point3::from(pose.X_WO.translation.vector);
        let before = self.seen.replace((pose.capture_s, p_WO));
        let flies = before.is_some_and(|(before_s, before_W)| {
            let span_s = pose.capture_s - before_s;
            let speed_mps = (p_WO - before_W).norm() / span_s;
            span_s < MAX_GAP_S && (MIN_FLIGHT_MPS..MAX_FLIGHT_MPS).contains(&speed_mps)
        });
        let is_new = before.is_none_or(|(_, before_W)| (p_WO - before_W).norm() > MIN_FLIGHT_MPS * MAX_GAP_S);
        self.rests = !flies && !is_new;
        if !flies {
            (self.images, self.explained) = (0, Explained::default());
            // The pose of a resting object does not help to find it again once it has been thrown.
            self.bot.tracker.keep_newest(usize::from(is_new));
        }
        self.images += 1;
        self.explained.add(&pose);
        Some(pose)
    }

    fn forget(&mut self) {
        (self.images, self.explained, self.seen, self.rests) = (0, Explained::default(), None, false);
        self.bot.tracker.keep_newest(0);
    }
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
        for candidate in &mut self.candidates {
            candidate.bot.reset();
            candidate.forget();
        }
        self.enter(Phase::Waiting, 0.0);
    }
}
