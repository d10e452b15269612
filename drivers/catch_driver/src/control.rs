//! A thread that answers the arm, whatever its protocol, and tells the cell what it saw.

use std::{
    sync::{
        Arc,
        atomic::{AtomicBool, Ordering},
        mpsc::{Receiver, RecvTimeoutError, Sender, channel},
    },
    thread::{self, JoinHandle},
    time::Duration,
};

use catch_body::JointVector;
use catch_cell::ArmTrajectory;

use crate::{clock::Clock, enabling_key::EnablingKey};

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
    /// States that did not arrive since the last sample.
    pub missed: u64,
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
    /// Silence of a real robot after which the link counts as dead.
    pub silence: Duration,
    /// In lock-step: lets one cycle be answered.
    permits: Option<Sender<()>>,
    stop: Arc<AtomicBool>,
    thread: Option<JoinHandle<Result<(), String>>>,
    clock: Clock,
}

/// What the thread is connected with.
#[derive(Debug)]
pub struct Link {
    /// Plans that were checked.
    pub plans: Receiver<ArmTrajectory>,
    /// The host's clock.
    pub clock: Clock,
    samples: Sender<Sample>,
    permitted: Option<Receiver<()>>,
    stop: Arc<AtomicBool>,
    key: EnablingKey,
}

impl Link {
    /// In lock-step: waits until the cell lets a cycle be answered.
    pub fn wait(&self) {
        if let Some(permitted) = &self.permitted {
            // A cell that is gone waits for nothing.
            let _ = permitted.recv();
        }
    }

    /// Tells what a cycle saw.
    pub fn tell(&self, sample: Sample) {
        // A cell that is gone needs no samples.
        let _ = self.samples.send(sample);
    }

    /// Returns whether the arm has to brake to rest.
    pub fn has_to_stop(&self) -> bool {
        self.stop.load(Ordering::Relaxed) || !self.key.is_held()
    }
}

impl Control {
    /// Begins a motion: `follow` holds the arm and executes plans in a thread of its own, until it has to
    /// stop or the robot ends the motion, and then says why.
    pub fn begin(
        key: EnablingKey,
        clock: Clock,
        silence: Duration,
        follow: impl FnOnce(&Link) -> Result<(), String> + Send + 'static,
    ) -> Self {
        let (plans, taken) = channel();
        let (seen, samples) = channel();
        let (permits, permitted) = match clock {
            Clock::Host => (None, None),
            Clock::LockStep(_) => Some(channel()).unzip(),
        };
        let stop = Arc::new(AtomicBool::new(false));
        let link = Link { plans: taken, clock: clock.clone(), samples: seen, permitted, stop: stop.clone(), key };
        let thread = thread::spawn(move || follow(&link));
        Self { plans, samples, silence, permits, stop, thread: Some(thread), clock }
    }

    /// Silence of a device after which it counts as lost, where it is `real` for a real one.
    pub fn patience(&self, real: Duration) -> Duration {
        self.clock.patience(real)
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
            Some(Ok(Err(fault))) => fault,
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
