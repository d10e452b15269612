//! The gripper's drive: moves the fingers and squeezes.

use catch_body::Gripper;
use catch_cell::{GripperMove, GripperState};

/// Position controller of each finger.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Gains {
    /// Force per metre, in N/m.
    pub stiffness_npm: f64,
    /// Force per speed, in N·s/m.
    pub damping_nspm: f64,
}

impl Gains {
    /// As stiff as a controller at 1 kHz may be with fingers of 50 g: it follows within a millisecond, and a finger that is
    /// stopped by an object presses with all its force 2 ms later.
    pub const IDEAL: Self = Self { stiffness_npm: 10_000.0, damping_nspm: 40.0 };
}

/// Times closer than this are the same.
const SAME_TIME_S: f64 = 1e-9;

/// Executes gripper moves.
#[derive(Debug, Clone)]
pub struct GripperDrive {
    gains: Gains,
    max_width_m: f64,
    max_force_n: f64,
    active: ActiveMove,
    /// Moves that have not started, soonest first.
    pending: Vec<GripperMove>,
    refused_moves: u32,
    squeeze_n: f64,
}

/// A move and where it started from.
#[derive(Debug, Clone, Copy)]
struct ActiveMove {
    order: GripperMove,
    from_m: f64,
    since_s: f64,
}

impl GripperDrive {
    /// The ideal drive; it holds the fingers `width_m` apart.
    pub fn new(gripper: &Gripper, width_m: f64) -> Self {
        Self::with_gains(gripper, width_m, Gains::IDEAL)
    }

    /// A drive with a controller of its own.
    pub fn with_gains(gripper: &Gripper, width_m: f64, gains: Gains) -> Self {
        let order =
            GripperMove { start_s: 0.0, width_m, speed_mps: gripper.max_speed_mps, force_n: gripper.max_force_n };
        Self {
            gains,
            max_width_m: gripper.max_width_m,
            max_force_n: gripper.max_force_n,
            active: ActiveMove { order, from_m: width_m, since_s: 0.0 },
            pending: Vec::new(),
            refused_moves: 0,
            squeeze_n: 0.0,
        }
    }

    /// Moves that were refused because a number was not finite, or speed or force not above zero.
    pub fn refused_moves(&self) -> u32 {
        self.refused_moves
    }

    /// Replaces all moves that have not started. One that should have started begins at once.
    pub fn receive(&mut self, moves: Vec<GripperMove>) {
        let given = moves.len();
        self.pending = moves;
        self.pending.retain(|order| {
            let finite = order.start_s.is_finite() && order.width_m.is_finite();
            // An infinite speed is a jump of the setpoint, which an ideal drive may be asked for.
            finite && order.speed_mps > 0.0 && order.force_n > 0.0
        });
        self.refused_moves += (given - self.pending.len()) as u32;
        self.pending.sort_by(|a, b| a.start_s.total_cmp(&b.start_s));
    }

    /// Forces that open the left and the right finger during the step that begins at `time_s`, from their distances to the
    /// middle and their speeds.
    ///
    /// The fingers are geared to each other: one controller acts on their mean, with a force up to that of the move, and
    /// another stands for the gear that keeps them symmetrical; it must also work while the first is at its limit.
    pub fn forces(&mut self, time_s: f64, finger_m: [f64; 2], finger_mps: [f64; 2]) -> [f64; 2] {
        while self.pending.first().is_some_and(|order| order.start_s <= time_s + SAME_TIME_S) {
            let order = self.pending.remove(0);
            let width_m = order.width_m.clamp(0.0, self.max_width_m);
            self.active = ActiveMove {
                order: GripperMove { width_m, ..order },
                from_m: finger_m[0] + finger_m[1],
                since_s: time_s,
            };
        }
        let [wanted_m, wanted_mps] = self.setpoint(time_s).map(|of_width| of_width / 2.0);
        let Gains { stiffness_npm, damping_nspm } = self.gains;
        let limit = self.active.order.force_n.min(self.max_force_n);
        let mean = [(finger_m[0] + finger_m[1]) / 2.0, (finger_mps[0] + finger_mps[1]) / 2.0];
        let skew = [(finger_m[0] - finger_m[1]) / 2.0, (finger_mps[0] - finger_mps[1]) / 2.0];
        let opening = stiffness_npm * (wanted_m - mean[0]) + damping_nspm * (wanted_mps - mean[1]);
        let opening = opening.clamp(-limit, limit);
        let levelling = (stiffness_npm * skew[0] + damping_nspm * skew[1]).clamp(-self.max_force_n, self.max_force_n);
        self.squeeze_n = -opening;
        [opening - levelling, opening + levelling]
    }

    /// The width that is wanted at `time_s` and its rate.
    fn setpoint(&self, time_s: f64) -> [f64; 2] {
        let ActiveMove { order, from_m, since_s } = self.active;
        let way = order.width_m - from_m;
        let travelled = order.speed_mps * (time_s - since_s).max(0.0);
        if order.speed_mps.is_finite() && travelled < way.abs() {
            [from_m + way.signum() * travelled, way.signum() * order.speed_mps]
        } else {
            [order.width_m, 0.0]
        }
    }

    /// What the gripper reports of itself.
    pub fn state(&self, finger_m: [f64; 2], finger_mps: [f64; 2]) -> GripperState {
        GripperState {
            width_m: finger_m[0] + finger_m[1],
            speed_mps: finger_mps[0] + finger_mps[1],
            force_n: self.squeeze_n,
        }
    }
}
