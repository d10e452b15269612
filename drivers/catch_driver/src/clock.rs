//! The host's clock: a real one, or that of a simulated robot in lock-step.

use std::{
    sync::{
        Arc,
        atomic::{AtomicU64, Ordering},
    },
    time::Duration,
};

use rustix::time::{ClockId, clock_gettime};

/// Silence of a simulated device after which it counts as lost: its images may take long.
const PATIENCE: Duration = Duration::from_secs(60);

/// A clock for all threads.
#[derive(Debug, Clone, Default)]
pub enum Clock {
    /// The host's monotonic clock.
    #[default]
    Host,
    /// Time of the robot's newest state in ms. The robot waits for its answers, and they wait for the cell.
    LockStep(Arc<AtomicU64>),
}

impl Clock {
    /// A clock in lock-step with a simulated robot.
    pub fn lock_step() -> Self {
        Self::LockStep(Arc::default())
    }

    /// Time in seconds.
    pub fn now_s(&self) -> f64 {
        match self {
            Self::Host => {
                let now = clock_gettime(ClockId::Monotonic);
                now.tv_sec as f64 + now.tv_nsec as f64 * 1e-9
            }
            Self::LockStep(robot_ms) => robot_ms.load(Ordering::Relaxed) as f64 * 1e-3,
        }
    }

    /// Silence of a device after which it counts as lost, where it is `real` for a real one.
    pub fn patience(&self, real: Duration) -> Duration {
        match self {
            Self::Host => real,
            Self::LockStep(_) => PATIENCE,
        }
    }

    /// Takes notice of a state of the robot.
    pub fn hear(&self, time_ms: u64) {
        if let Self::LockStep(robot_ms) = self {
            robot_ms.store(time_ms, Ordering::Relaxed);
        }
    }
}
