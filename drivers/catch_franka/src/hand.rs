//! The Franka Hand, on a connection of its own: one thread moves it, another reads its states.

use std::{
    sync::{
        Arc, Mutex, PoisonError,
        mpsc::{self, RecvTimeoutError, Sender},
    },
    thread,
    time::Duration,
};

use catch_cell::{GraspState, GripperMove, GripperQueue, GripperState};
use franka::{FrankaResult, Gripper, realtime::monotonic_ns};

/// Interval at which due moves are looked for.
const POLL: Duration = Duration::from_millis(1);

/// A gripper that moves by itself at the times it was told.
#[derive(Debug)]
pub struct Hand {
    moves: Sender<Vec<GripperMove>>,
    state: Arc<Mutex<Result<GripperState, String>>>,
}

impl Hand {
    /// Connects. Both threads end with the connection, or with the hand.
    ///
    /// # Errors
    /// If the hand does not answer.
    pub fn connect(address: &str) -> FrankaResult<Self> {
        let gripper = Arc::new(Gripper::new(address)?);
        let first = gripper.read_once()?;
        let state = Arc::new(Mutex::new(Ok(told(&first, None))));
        let (moves, received) = mpsc::channel();
        let (reader, shared) = (gripper.clone(), Arc::downgrade(&state));
        thread::spawn(move || {
            let mut before = first;
            while let Some(state) = shared.upgrade() {
                let now = reader.read_once();
                let seen = now.as_ref().map(|now| told(now, Some(&before))).map_err(ToString::to_string);
                let is_over = seen.is_err();
                *state.lock().unwrap_or_else(PoisonError::into_inner) = seen;
                match now {
                    Ok(now) if !is_over => before = now,
                    _ => return,
                }
            }
        });
        thread::spawn(move || {
            let mut queue = GripperQueue::default();
            loop {
                match received.recv_timeout(POLL) {
                    Ok(list) => {
                        let list: Vec<GripperMove> = list;
                        queue.receive(&list, host_s());
                    }
                    Err(RecvTimeoutError::Timeout) => {}
                    Err(RecvTimeoutError::Disconnected) => return,
                }
                while let Some(step) = queue.take_due(host_s(), |start_s| start_s) {
                    // A grasp that meets nothing is no fault; a lost connection is told by the states.
                    let _ = execute(&gripper, &step);
                }
            }
        });
        Ok(Self { moves, state })
    }

    /// Replaces the moves that have not begun; they start at times of the host's clock.
    pub fn receive(&self, moves: Vec<GripperMove>) {
        // A thread that is gone is told by the states.
        let _ = self.moves.send(moves);
    }

    /// The newest state, or why there is none any more.
    ///
    /// # Errors
    /// What the connection told as it ended.
    pub fn state(&self) -> Result<GripperState, String> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }
}

/// The host's monotonic clock in seconds.
pub fn host_s() -> f64 {
    monotonic_ns() as f64 * 1e-9
}

/// Closes with force, or opens. The protocol's speed is that of one finger.
fn execute(gripper: &Gripper, step: &GripperMove) -> FrankaResult<bool> {
    let speed_mps = step.speed_mps / 2.0;
    if step.width_m < gripper.read_once()?.width {
        // Whatever is between the fingers counts as grasped.
        gripper.grasp(step.width_m.max(0.0), speed_mps, step.force_n, 0.1, 0.1)
    } else {
        gripper.move_gripper(step.width_m, speed_mps)
    }
}

fn told(now: &franka::GripperState, before: Option<&franka::GripperState>) -> GripperState {
    let speed_mps = before.map_or(0.0, |before| {
        let passed_s = now.time.as_secs_f64() - before.time.as_secs_f64();
        if passed_s > 0.0 { (now.width - before.width) / passed_s } else { 0.0 }
    });
    let grasp = if now.is_grasped { GraspState::Holding } else { GraspState::Idle };
    // The protocol tells no force.
    GripperState { width_m: now.width, speed_mps, force_n: 0.0, grasp }
}
