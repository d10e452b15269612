//! The cell: senses every ten milliseconds, checks what the brain sends, and passes it on.

use std::{
    collections::BTreeMap,
    sync::mpsc::{Receiver, RecvTimeoutError},
    time::Duration,
};

use catch_body::JointVector;
use catch_cell::{
    ArmTrajectory, Cell, CellFault, Command, DepthFrame, GraspState, GripperMove, GripperState, Observation, Rejection,
};

use crate::{
    camera_socket::{Arrived, FrameStatus, ImageFaults},
    checker::{Bounds, Checker},
    control::{Control, Sample},
    hand::Hand,
    motion,
};

/// Interval of the observations in seconds.
const TICK_S: f64 = 0.01;
/// Silence of the hand after which it counts as lost, in seconds on the robot's clock. Its states come every
/// 10 to 17 ms.
const HAND_SILENCE_S: f64 = 0.25;
/// Silence before the first state: the robot releases its brakes.
const START: Duration = Duration::from_secs(5);
/// Time in seconds without a new image after which a camera counts as silent.
const SILENT_S: f64 = 0.25;
/// Largest drift of the robot's clock against the host's.
const DRIFT: f64 = 1e-4;

/// Where plans go, and what comes back.
#[derive(Debug)]
pub struct DrivenCell {
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

impl DrivenCell {
    /// A cell whose arm begins to be held where it stands. Errors name the device.
    ///
    /// # Errors
    /// If the robot does not begin the motion.
    pub fn begin(
        mut control: Control,
        bounds: &Bounds,
        (hand, images): (Option<Hand>, Receiver<Arrived>),
    ) -> Result<Self, CellFault> {
        let [watchdog, start] = [control.silence, START].map(|it| control.patience(it));
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

impl Cell for DrivenCell {
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
