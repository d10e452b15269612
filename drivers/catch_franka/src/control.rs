//! The 1 kHz thread: answers each state of the robot, and tells the cell what it saw.

use std::{
    sync::{
        Arc,
        atomic::{AtomicBool, Ordering},
        mpsc::{Receiver, RecvTimeoutError, Sender, channel},
    },
    thread::{self, JoinHandle},
    time::Duration,
};

use catch_body::{JointVector, Robot as Arm};
use catch_cell::ArmTrajectory;
use franka::{FrankaResult, JointPositions, MoveControllerMode, Robot, RobotState, realtime};

use crate::{
    clock::Clock,
    enabling_key::EnablingKey,
    setpoint::{Cycle, Sensed},
};

/// One cycle, as the cell gets it.
#[derive(Debug, Clone, Copy)]
pub struct Sample {
    /// Time of the state on the cell's clock.
    pub time_s: f64,
    /// Time at which it came, on the host's clock.
    pub heard_s: f64,
    /// Positions of the encoders.
    pub q: JointVector,
    /// Velocities of the encoders.
    pub dq: JointVector,
    /// Set-point that was executed last.
    pub echo: JointVector,
    /// Answers that were lost since the last sample.
    pub lost: u64,
    /// Fraction of the last hundred answers that arrived, as the robot counts them.
    pub success_rate: f64,
    /// Time from the state to its answer in seconds.
    pub answer_s: f64,
    /// True for the last one: the arm has braked to rest.
    pub has_stopped: bool,
}

/// A motion under way.
#[derive(Debug)]
pub struct Control {
    /// Where checked plans go.
    pub plans: Sender<ArmTrajectory>,
    /// What each cycle saw.
    pub samples: Receiver<Sample>,
    /// In lock-step: lets one cycle be answered.
    permits: Option<Sender<()>>,
    stop: Arc<AtomicBool>,
    thread: Option<JoinHandle<FrankaResult<()>>>,
}

impl Control {
    /// Begins to hold the arm, and executes plans while `key` is held.
    pub fn begin(robot: Arc<Robot>, arm: Arm, key: EnablingKey, clock: Clock) -> Self {
        let (plans, taken) = channel();
        let (seen, samples) = channel();
        let (permits, permitted) = match clock {
            Clock::Host => (None, None),
            Clock::LockStep(_) => Some(channel()).unzip(),
        };
        let link = Link { plans: taken, samples: seen, permitted, clock };
        let stop = Arc::new(AtomicBool::new(false));
        let stopped = stop.clone();
        let thread = thread::spawn(move || {
            // Where the priority is not granted `doctor` shows what that costs.
            let _ = realtime::set_current_thread_to_highest_scheduler_priority();
            follow(&robot, arm, &link, || stopped.load(Ordering::Relaxed) || !key.is_held())
        });
        Self { plans, samples, permits, stop, thread: Some(thread) }
    }

    /// Waits for the next sample.
    ///
    /// # Errors
    /// If none comes in time, or none will come any more.
    pub fn next(&self, within: Duration) -> Result<Sample, RecvTimeoutError> {
        if let Some(permits) = &self.permits {
            // A thread that is gone is told by the samples.
            let _ = permits.send(());
        }
        self.samples.recv_timeout(within)
    }

    /// Brakes to rest and ends the motion.
    pub fn stop(&self) {
        self.stop.store(true, Ordering::Relaxed);
    }

    /// Waits for the end of the motion, and says what ended it.
    pub fn cause(&mut self) -> String {
        match self.thread.take().map(JoinHandle::join) {
            Some(Ok(Err(fault))) => fault.to_string(),
            Some(Ok(Ok(()))) if self.stop.load(Ordering::Relaxed) => "stopped as asked".to_owned(),
            Some(Ok(Ok(()))) => "the enabling key was released".to_owned(),
            Some(Err(_)) | None => "the control thread ended".to_owned(),
        }
    }
}

impl Drop for Control {
    fn drop(&mut self) {
        self.stop();
        self.permits = None;
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

fn joints(values: [f64; 7]) -> JointVector {
    JointVector::from_fn(|i, _| values.get(i).copied().unwrap_or(0.0))
}

fn sensed(state: &RobotState) -> Sensed {
    Sensed { time_ms: state.time.as_millis(), echo: joints(state.q_d) }
}

/// What the thread is connected with.
struct Link {
    plans: Receiver<ArmTrajectory>,
    samples: Sender<Sample>,
    permitted: Option<Receiver<()>>,
    clock: Clock,
}

/// Answers states until the arm has stopped, or the robot ends the motion.
fn follow(
    robot: &Robot,
    arm: Arm,
    Link { plans, samples, permitted, clock }: &Link,
    has_to_stop: impl Fn() -> bool,
) -> FrankaResult<()> {
    let mut control = robot.start_joint_position_control(MoveControllerMode::JointImpedance)?;
    let mut state = control.read_once()?.0;
    let mut cycle = Cycle::new(arm, &sensed(&state), state.time.as_millis());
    loop {
        clock.hear(state.time.as_millis());
        let heard_s = clock.now_s();
        if let Some(permitted) = permitted {
            // A cell that is gone waits for nothing.
            let _ = permitted.recv();
        }
        while let Ok(plan) = plans.try_recv() {
            cycle.take(&plan);
        }
        if has_to_stop() {
            cycle.stop();
        }
        let answer = cycle.answer(&sensed(&state));
        let mut q = JointPositions::new(std::array::from_fn(|i| answer.q[i]));
        q.motion_finished = answer.has_stopped;
        if !answer.has_stopped {
            control.write_once(&q, None)?;
        }
        // A cell that is gone needs no samples.
        let _ = samples.send(Sample {
            time_s: cycle.time_s(state.time.as_millis()),
            heard_s,
            q: joints(state.q),
            dq: joints(state.dq),
            echo: joints(state.q_d),
            lost: answer.lost,
            success_rate: state.control_command_success_rate,
            answer_s: clock.now_s() - heard_s,
            has_stopped: answer.has_stopped,
        });
        if answer.has_stopped {
            return control.write_once(&q, None);
        }
        state = control.read_once()?.0;
    }
}
