//! A hand on a connection of its own: one thread moves it, another reads its states.
//!
//! The protocols of hands know a move to a width, and a move that closes until something stops the fingers.
//! Each is answered when it has ended, and nothing else begins before. So a move to the width zero is a
//! grasp; and no other move begins that could still run when it is time to grasp.

use std::{
    sync::{
        Arc, Mutex, MutexGuard, PoisonError,
        mpsc::{self, Receiver, RecvTimeoutError, Sender},
    },
    thread,
    time::Duration,
};

use catch_cell::{GraspState, GripperMove, GripperQueue, GripperState};

use crate::clock::Clock;

/// A hand's protocol. Errors say why the connection is lost.
pub trait Fingers: Send + Sync {
    /// Waits for the next state: the width in metres, and whether something is held.
    ///
    /// # Errors
    /// If there will be none any more.
    fn next_state(&self) -> Result<(f64, bool), String>;

    /// Moves the fingers, and waits until they stand. A grasp that meets nothing is no fault, nor is a move
    /// that the hand refuses.
    ///
    /// # Errors
    /// If the hand cannot be told.
    fn execute(&self, step: &GripperMove) -> Result<(), String>;
}

/// Interval at which due moves are looked for.
const POLL: Duration = Duration::from_millis(1);
/// Time in seconds that a move takes in addition to its way at full speed: latency, acceleration, answer.
const POSITIONING_S: f64 = 0.15;
/// Change of the width in metres that is worth a move.
const STEP_M: f64 = 2e-4;
/// A width in metres below which a move is a grasp.
const CLOSED_M: f64 = 1e-6;

/// A gripper that moves by itself at the times it was told.
#[derive(Debug, Clone)]
pub struct Hand {
    moves: Sender<Vec<GripperMove>>,
    seen: Arc<Seen>,
}

/// What the hand told last, and how many states it told so far; or why it tells none any more.
pub type Told = Result<(GripperState, u64), String>;

#[derive(Debug)]
struct Seen(Mutex<Told>);

impl Seen {
    fn lock(&self) -> MutexGuard<'_, Told> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Hand {
    /// A hand that is connected. Both threads end with the connection, or with the hand.
    ///
    /// # Errors
    /// If the hand tells no state.
    pub fn new(fingers: Arc<dyn Fingers>, clock: Clock) -> Result<Self, String> {
        let first = told(fingers.next_state()?, None, clock.now_s());
        let (moves, received) = mpsc::channel();
        let seen = Arc::new(Seen(Mutex::new(Ok((first, 1)))));
        let (reader, shared, now) = (fingers.clone(), Arc::downgrade(&seen), clock.clone());
        thread::spawn(move || {
            let (mut before, mut count) = ((now.now_s(), first), 1);
            while let Some(seen) = shared.upgrade() {
                let read = reader.next_state();
                // What a move found out stays.
                if seen.lock().is_err() {
                    return;
                }
                let state = read.map(|state| told(state, Some(before), now.now_s()));
                count += 1;
                *seen.lock() = state.map(|state| {
                    before = (now.now_s(), state);
                    (state, count)
                });
            }
        });
        let shared = Arc::downgrade(&seen);
        thread::spawn(move || {
            if let Err(cause) = follow(&*fingers, &received, Mover::new(first.width_m), &clock)
                && let Some(seen) = shared.upgrade()
            {
                *seen.lock() = Err(cause);
            }
        });
        Ok(Self { moves, seen })
    }

    /// Replaces the moves that have not begun; they start at times of the host's clock.
    pub fn receive(&self, moves: Vec<GripperMove>) {
        // A thread that is gone is told by the states.
        let _ = self.moves.send(moves);
    }

    /// The newest state, and how many there were so far.
    ///
    /// # Errors
    /// What the connection told as it ended.
    pub fn state(&self) -> Told {
        self.seen.lock().clone()
    }
}

/// Moves the fingers until the connection is lost, or nobody sends moves any more.
fn follow(
    fingers: &dyn Fingers,
    received: &Receiver<Vec<GripperMove>>,
    mut mover: Mover,
    clock: &Clock,
) -> Result<(), String> {
    loop {
        match received.recv_timeout(POLL) {
            Ok(moves) => mover.receive(&moves, clock.now_s()),
            Err(RecvTimeoutError::Timeout) => {}
            Err(RecvTimeoutError::Disconnected) => return Ok(()),
        }
        // A move may have taken long: what was sent since is newer.
        for moves in received.try_iter() {
            mover.receive(&moves, clock.now_s());
        }
        if let Some(step) = mover.due(clock.now_s()) {
            fingers.execute(&step)?;
        }
    }
}

/// Returns whether a move closes until something stops the fingers.
pub fn is_grasp(step: &GripperMove) -> bool {
    step.width_m <= CLOSED_M
}

/// Decides which command the hand gets next.
#[derive(Debug)]
struct Mover {
    queue: GripperQueue,
    /// The newest move whose time has come.
    wanted: Option<GripperMove>,
    /// Width that was commanded last.
    commanded_m: f64,
    /// When it will be time to grasp.
    grasp_s: f64,
}

impl Mover {
    fn new(width_m: f64) -> Self {
        Self { queue: GripperQueue::default(), wanted: None, commanded_m: width_m, grasp_s: f64::INFINITY }
    }

    fn receive(&mut self, moves: &[GripperMove], now_s: f64) {
        let grasps = moves.iter().filter(|it| is_grasp(it)).map(|it| it.start_s);
        self.grasp_s = grasps.fold(f64::INFINITY, f64::min);
        self.queue.receive(moves, now_s);
    }

    /// The command that the idle hand gets now.
    fn due(&mut self, now_s: f64) -> Option<GripperMove> {
        while let Some(step) = self.queue.take_due(now_s, |start_s| start_s) {
            self.wanted = Some(step);
        }
        let step = self.wanted?;
        let way_m = (step.width_m - self.commanded_m).abs();
        let ends_s = now_s + way_m / step.speed_mps + POSITIONING_S;
        if way_m < STEP_M || (!is_grasp(&step) && ends_s > self.grasp_s) {
            return None;
        }
        self.commanded_m = step.width_m;
        Some(step)
    }
}

/// A state of the protocol, and the one before it with its time, by which the speed is known.
fn told((width_m, is_held): (f64, bool), before: Option<(f64, GripperState)>, now_s: f64) -> GripperState {
    let speed_mps = match before {
        Some((before_s, before)) if now_s > before_s => (width_m - before.width_m) / (now_s - before_s),
        _ => 0.0,
    };
    let grasp = if is_held { GraspState::Holding } else { GraspState::Idle };
    GripperState { width_m, speed_mps, force_n: 0.0, grasp }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn step(start_s: f64, width_m: f64) -> GripperMove {
        GripperMove { start_s, width_m, speed_mps: 0.1, force_n: 70.0 }
    }

    fn due(mover: &mut Mover, now_s: f64) -> Option<f64> {
        mover.due(now_s).map(|it| it.width_m)
    }

    #[test]
    fn the_fingers_are_positioned_and_then_grasp_once() {
        let mut mover = Mover::new(0.08);
        mover.receive(&[step(1.0, 0.08), step(2.0, 0.0)], 1.0);
        assert_eq!(due(&mut mover, 1.0), None, "they are there");
        mover.receive(&[step(1.1, 0.074), step(2.0, 0.0)], 1.1);
        mover.receive(&[step(1.2, 0.073), step(2.0, 0.0)], 1.2);
        assert_eq!(due(&mut mover, 1.3), Some(0.073), "the newest");
        assert_eq!(due(&mut mover, 1.99), None);
        assert_eq!(due(&mut mover, 2.0), Some(0.0));
        mover.receive(&[step(2.0, 0.0)], 2.01);
        assert_eq!(due(&mut mover, 2.02), None, "they grasp already");
        mover.receive(&[step(3.0, 0.08)], 3.0);
        assert_eq!(due(&mut mover, 3.0), Some(0.08));
    }

    #[test]
    fn nothing_begins_that_could_delay_a_grasp() {
        let mut mover = Mover::new(0.08);
        mover.receive(&[step(1.9, 0.07), step(2.0, 0.0)], 1.9);
        assert_eq!(due(&mut mover, 1.9), None);
        assert_eq!(due(&mut mover, 2.0), Some(0.0));
    }
}
