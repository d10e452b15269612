//! The cell: senses every ten milliseconds, checks what the brain sends, and passes it on.

use std::{
    collections::BTreeMap,
    sync::{
        Arc,
        mpsc::{Receiver, RecvTimeoutError},
    },
    time::Duration,
};

use catch_body::{JointVector, Robot as Arm, robot::LimitScale};
use catch_cell::{
    ArmState, ArmTrajectory, Cell, CellFault, Command, DepthFrame, Executor, ExecutorConfig, GraspState, GripperMove,
    GripperState, Observation, Rejection, cell_file::SafeBox,
};
use franka::Robot;

use crate::{
    camera_socket::{Arrived, FrameStatus, ImageFaults},
    clock::Clock,
    control::{Control, Sample},
    enabling_key::EnablingKey,
    hand::Hand,
    margin, motion, safe_box,
};

/// Interval of the observations in seconds.
const TICK_S: f64 = 0.01;
/// Silence of the robot after which the link counts as dead.
pub const WATCHDOG: Duration = Duration::from_millis(20);
/// Silence of the hand after which it counts as lost, in seconds on the robot's clock. Its states come every 10 to
/// 17 ms.
const HAND_SILENCE_S: f64 = 0.25;
/// Silence before the first state: the robot releases its brakes.
const START: Duration = Duration::from_secs(5);
/// Time in seconds in which a plan reaches the 1 kHz thread.
const HANDOVER_S: f64 = 2e-3;
/// Time in seconds without a new image after which a camera counts as silent.
const SILENT_S: f64 = 0.25;
/// Largest drift of the robot's clock against the host's.
const DRIFT: f64 = 1e-4;

/// What bounds all motions of a cell.
#[derive(Debug, Clone)]
pub struct Bounds {
    /// The arm with its gripper and its maker's limits.
    pub arm: Arm,
    /// Fraction of these limits that motions may use, without the margin for lost packets.
    pub speed_scaling: f64,
    /// Box that the hand must not leave.
    pub safe_box: SafeBox,
}

impl Bounds {
    /// Scale of the limits within which plans are accepted over a link that loses up to `longest_run` answers
    /// in a row. None: over such a link nothing may move.
    pub fn limit_scale(&self, longest_run: u64) -> Option<LimitScale> {
        let by = self.speed_scaling;
        let acceleration = by.min(margin::acceleration_ratio(longest_run)?);
        Some(LimitScale { velocity: by, acceleration, torque: 1.0, jerk: by })
    }
}

/// Where plans go, and what comes back.
#[derive(Debug)]
pub struct FrankaCell {
    control: Control,
    checker: Checker,
    hand: Option<Hand>,
    /// Number of the hand's newest state, and when it came.
    hand_told: (u64, f64),
    images: Receiver<Arrived>,
    /// The newest state.
    sample: Sample,
    /// The host's clock less the robot's, by the states that came soonest.
    offset_s: f64,
    /// Silence of the robot after which the link counts as dead.
    pub watchdog: Duration,
    next_tick_s: f64,
    /// What was wrong with the images, by camera.
    pub image_faults: BTreeMap<usize, ImageFaults>,
    /// When the cameras took their newest images, as long as they are not silent.
    newest_s: BTreeMap<usize, f64>,
}

/// Decides which trajectories are executed.
#[derive(Debug)]
pub struct Checker {
    executor: Executor,
    safe_box: SafeBox,
    /// Answers lost in a row until now, and the most so far.
    run: u64,
    longest_run: u64,
}

impl Checker {
    /// A checker of plans for an arm that stands at `q`. None: nothing may move.
    pub fn new(bounds: &Bounds, q: JointVector, longest_run: u64) -> Option<Self> {
        let arm = bounds.arm.clone().with_limits_scaled(&bounds.limit_scale(longest_run)?);
        let executor = Executor::new(arm, q, ExecutorConfig::default());
        Some(Self { executor, safe_box: bounds.safe_box, run: 0, longest_run })
    }

    /// State of an arm that is exactly where its set-point is.
    pub fn imagined(&mut self, time_s: f64) -> ArmState {
        let now = self.executor.advance(time_s);
        self.executor.arm_state(time_s, now.q, now.dq)
    }

    /// Takes notice of the answers that were lost in a cycle.
    pub fn lost(&mut self, count: u64) {
        self.run = if count > 0 { self.run + count } else { 0 };
        self.longest_run = self.longest_run.max(self.run);
    }

    /// Checks a trajectory that arrives at `now_s`, against the box and the link's losses, too.
    ///
    /// # Errors
    /// The reason for the rejection, which the next arm state reports.
    pub fn receive(&mut self, plan: &ArmTrajectory, now_s: f64) -> Result<(), Rejection> {
        let link_is_bad = margin::acceleration_ratio(self.longest_run).is_none();
        // A spline that is none is rejected below.
        let leaves_box =
            plan.spline.is_valid() && safe_box::leaves(&self.safe_box, self.executor.robot(), plan).is_some();
        if link_is_bad || leaves_box {
            return Err(self.executor.decline(plan.id));
        }
        self.executor.receive(plan, now_s + HANDOVER_S).map(drop)
    }
}

impl FrankaCell {
    /// Begins to hold the arm where it stands. Errors name the device.
    ///
    /// # Errors
    /// If the robot does not begin the motion.
    pub fn begin(
        robot: Arc<Robot>,
        bounds: &Bounds,
        key: EnablingKey,
        (hand, images): (Option<Hand>, Receiver<Arrived>),
        clock: Clock,
    ) -> Result<Self, CellFault> {
        let (watchdog, start) = (clock.patience(WATCHDOG), clock.patience(START));
        let mut control = Control::begin(robot, bounds.arm.clone(), key, clock);
        let Ok(sample) = control.next(start) else {
            return Err(CellFault::ProtectiveStop { cause: control.cause() });
        };
        let checker = Checker::new(bounds, sample.echo, 0);
        let Some(checker) = checker else {
            return Err(CellFault::ProtectiveStop { cause: "the link loses too much".to_owned() });
        };
        Ok(Self {
            control,
            checker,
            hand,
            hand_told: (0, 0.0),
            images,
            offset_s: sample.heard_s - sample.time_s,
            sample,
            watchdog,
            next_tick_s: 0.0,
            image_faults: BTreeMap::new(),
            newest_s: BTreeMap::new(),
        })
    }

    /// Sends the arm straight to `q`, and waits until it stands there.
    ///
    /// # Errors
    /// As [`Cell::sense`]; a rejection by the checks.
    pub fn go_to(&mut self, q: JointVector, id: u64) -> Result<(), CellFault> {
        let start_s = self.sample.time_s + 0.05;
        let from = self.checker.executor.setpoint(start_s).q;
        let way = motion::straight(id, start_s, [from, q], self.checker.executor.robot(), 0.99);
        self.send(&way).map_err(|why| CellFault::ProtectiveStop { cause: format!("the way to the pose: {why}") })?;
        while self.sample.time_s < way.end_s() + 0.1 {
            self.sense()?;
        }
        Ok(())
    }

    /// Waits for a state.
    fn hear(&mut self) -> Result<(), CellFault> {
        if self.sample.has_stopped {
            return Err(CellFault::ProtectiveStop { cause: self.control.cause() });
        }
        match self.control.next(self.watchdog) {
            Ok(sample) => {
                self.offset_s =
                    (self.offset_s + DRIFT * (sample.time_s - self.sample.time_s)).min(sample.heard_s - sample.time_s);
                self.checker.lost(sample.lost);
                self.sample = sample;
                Ok(())
            }
            Err(RecvTimeoutError::Disconnected) => Err(CellFault::ProtectiveStop { cause: self.control.cause() }),
            Err(RecvTimeoutError::Timeout) => Err(CellFault::LostConnection {
                device: "arm".to_owned(),
                cause: format!("no state for {} ms", self.watchdog.as_millis()),
            }),
        }
    }

    fn send(&mut self, plan: &ArmTrajectory) -> Result<(), Rejection> {
        self.checker.receive(plan, self.sample.time_s)?;
        // A thread that is gone is told by the next state.
        let _ = self.control.plans.send(plan.clone());
        Ok(())
    }

    /// The images that arrived, without those that show another time than they say.
    fn frames(&mut self) -> Vec<DepthFrame> {
        let time_s = self.sample.time_s;
        let mut frames = Vec::new();
        for Arrived { mut frame, status, .. } in self.images.try_iter() {
            frame.capture_s -= self.offset_s;
            self.image_faults.entry(frame.camera).or_default().count(status);
            let is_misdated = matches!(status, FrameStatus::Frozen | FrameStatus::Swapped);
            // One that was captured before the motion began, or lies ahead, is none of this cell's clock.
            if !is_misdated && (0.0..=time_s).contains(&frame.capture_s) {
                self.newest_s.insert(frame.camera, frame.capture_s);
                frames.push(frame);
            }
        }
        for (camera, _) in self.newest_s.extract_if(.., |_, newest_s| time_s > *newest_s + SILENT_S) {
            self.image_faults.entry(camera).or_default().silent += 1;
        }
        frames
    }

    fn gripper(&mut self) -> Result<GripperState, CellFault> {
        let Some(hand) = &self.hand else {
            return Ok(GripperState { width_m: 0.0, speed_mps: 0.0, force_n: 0.0, grasp: GraspState::Idle });
        };
        let lost = |cause| CellFault::LostConnection { device: "gripper".to_owned(), cause };
        let (state, number) = hand.state().map_err(lost)?;
        if number > self.hand_told.0 {
            self.hand_told = (number, self.sample.time_s);
        } else if self.sample.time_s > self.hand_told.1 + HAND_SILENCE_S {
            return Err(lost(format!("no state for {:.0} ms", HAND_SILENCE_S * 1e3)));
        }
        Ok(state)
    }
}

impl Cell for FrankaCell {
    type Error = CellFault;

    fn sense(&mut self) -> Result<Observation, CellFault> {
        self.hear()?;
        while self.sample.time_s < self.next_tick_s {
            self.hear()?;
        }
        // A tick that took long is not made up for.
        while let Ok(sample) = self.control.samples.try_recv() {
            self.checker.lost(sample.lost);
            self.sample = sample;
        }
        let Sample { time_s, q, dq, .. } = self.sample;
        self.next_tick_s = time_s + TICK_S;
        self.checker.executor.advance(time_s);
        let arm = self.checker.executor.arm_state(time_s, q, dq);
        Ok(Observation { time_s, arm, gripper: self.gripper()?, frames: self.frames() })
    }

    fn act(&mut self, command: &Command) -> Result<(), CellFault> {
        while let Ok(sample) = self.control.samples.try_recv() {
            self.checker.lost(sample.lost);
            self.sample = sample;
        }
        if let Some(plan) = &command.arm {
            // The next arm state reports a rejection.
            let _ = self.send(plan);
        }
        if let (Some(moves), Some(hand)) = (&command.gripper, &self.hand) {
            let on_host = |it: &GripperMove| GripperMove { start_s: it.start_s + self.offset_s, ..*it };
            hand.receive(moves.iter().map(on_host).collect());
        }
        Ok(())
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use catch_body::robot_file::RobotFiles;
    use catch_cell::LimitKind;

    pub(crate) fn fr3() -> Arm {
        let files = RobotFiles {
            urdf_file: "robot.urdf",
            urdf: include_str!("../../../assets/robots/fr3/robot.urdf"),
            toml_file: "robot.toml",
            toml: include_str!("../../../assets/robots/fr3/robot.toml"),
        };
        Arm::from_files(&files).unwrap()
    }

    pub(crate) fn bounds() -> Bounds {
        let safe_box = SafeBox { low_m: [-2.0; 3], high_m: [2.0; 3] };
        Bounds { arm: fr3(), speed_scaling: 1.0, safe_box }
    }

    fn moved(bounds: &Bounds, id: u64, fraction: f64) -> ArmTrajectory {
        let from = bounds.arm.ready_q;
        motion::straight(id, 0.1, [from, from + JointVector::ith(1, 0.3)], &bounds.arm, fraction)
    }

    #[test]
    fn plans_beyond_the_margin_are_rejected() {
        let bounds = bounds();
        let mut checker = Checker::new(&bounds, bounds.arm.ready_q, 0).unwrap();
        let Err(Rejection::Limit(broken)) = checker.receive(&moved(&bounds, 1, 0.9), 0.0) else { panic!("taken") };
        assert_eq!(broken.kind, LimitKind::Acceleration);
        assert!((broken.ratio - 0.9 / 0.85).abs() < 0.01, "{}", broken.ratio);
        assert_eq!(checker.receive(&moved(&bounds, 2, 0.84), 0.0), Ok(()));
    }

    #[test]
    fn a_tenth_of_the_speed_is_a_tenth_of_the_limits() {
        let bounds = Bounds { speed_scaling: 0.1, ..bounds() };
        let mut checker = Checker::new(&bounds, bounds.arm.ready_q, 0).unwrap();
        assert!(matches!(checker.receive(&moved(&bounds, 1, 0.11), 0.0), Err(Rejection::Limit(_))));
        assert_eq!(checker.receive(&moved(&bounds, 2, 0.099), 0.0), Ok(()));
    }

    #[test]
    fn a_link_that_loses_more_than_the_margin_survives_gets_no_plan() {
        let bounds = bounds();
        let mut checker = Checker::new(&bounds, bounds.arm.ready_q, 0).unwrap();
        for _ in 0..5 {
            checker.lost(margin::LONGEST_RUN);
            checker.lost(0);
        }
        assert_eq!(checker.receive(&moved(&bounds, 1, 0.3), 0.0), Ok(()));
        (0..=margin::LONGEST_RUN).for_each(|_| checker.lost(1));
        assert_eq!(checker.receive(&moved(&bounds, 2, 0.3), 0.0), Err(Rejection::Declined));
        assert_eq!(bounds.limit_scale(margin::LONGEST_RUN + 1), None);
    }

    #[test]
    fn a_plan_out_of_the_box_is_declined_and_told() {
        let mut bounds = bounds();
        bounds.safe_box.high_m[2] = 0.01;
        let mut checker = Checker::new(&bounds, bounds.arm.ready_q, 0).unwrap();
        assert_eq!(checker.receive(&moved(&bounds, 1, 0.3), 0.0), Err(Rejection::Declined));
        assert_eq!(checker.imagined(0.0).rejected.len(), 1);
    }

    #[test]
    fn a_plan_that_comes_too_late_for_the_handover_is_rejected() {
        let bounds = bounds();
        let mut checker = Checker::new(&bounds, bounds.arm.ready_q, 0).unwrap();
        assert!(matches!(checker.receive(&moved(&bounds, 1, 0.3), 0.099), Err(Rejection::Late { .. })));
    }
}
