//! Interface of a real gripper drive: latency of commands, limits of the fingers' speed and acceleration, and
//! states that are rounded and come at a rate of their own.

use catch_body::Gripper;
use catch_cell::{GripperMove, GripperState};

/// The reported width and speed are rounded to this, in metres and m/s: the unit of the command set (Schunk,
/// WSG series, PROFIBUS interface, register WIDTH).
const WIDTH_STEP_M: f64 = 1e-5;
/// Natural frequency of the position controller in rad/s, below a third of the rate at which it runs.
pub(super) const BANDWIDTH_RADPS: f64 = 300.0;

/// The gripper's connection: it takes commands and gives states in a cycle of its own.
#[derive(Debug, Clone)]
pub(super) struct Interface {
    latency_s: f64,
    cycle_s: f64,
    /// Time of the first cycle.
    pub phase_s: f64,
    cycles_seen: u64,
    /// State of the last cycle.
    pub reported: GripperState,
}

impl Interface {
    /// `phase` is the fraction of a cycle that is left at t = 0.
    pub fn new(gripper: &Gripper, width_m: f64, phase: f64) -> Self {
        let cycle_s = 1.0 / gripper.drive.state_rate_hz;
        let reported = GripperState { width_m, speed_mps: 0.0, force_n: 0.0, grasp: catch_cell::GraspState::Idle };
        Self { latency_s: gripper.drive.latency_s, cycle_s, phase_s: phase * cycle_s, cycles_seen: 0, reported }
    }

    /// Time at which the fingers begin a move that is sent at `sent_s`, in seconds on the cell's clock.
    ///
    /// The command is under way for a constant time and is then taken by the next cycle, which comes U[0, 1]
    /// cycles later: the latency is uniform over one cycle around its mean. A mean below half a cycle leaves
    /// no time for the way.
    pub fn takes_effect_s(&self, sent_s: f64) -> f64 {
        if self.latency_s == 0.0 {
            return sent_s;
        }
        let arrives_s = sent_s + (self.latency_s - self.cycle_s / 2.0).max(0.0);
        let cycles = ((arrives_s - self.phase_s) / self.cycle_s).ceil();
        self.phase_s + cycles * self.cycle_s
    }

    /// Takes down the state if a cycle has passed.
    pub fn refresh(&mut self, time_s: f64, live: GripperState) {
        let cycles = ((time_s - self.phase_s) / self.cycle_s + 1e-6).floor() + 1.0;
        if cycles > self.cycles_seen as f64 {
            self.cycles_seen = cycles as u64;
            let rounded = |value: f64| (value / WIDTH_STEP_M).round() * WIDTH_STEP_M;
            self.reported = GripperState { width_m: rounded(live.width_m), speed_mps: rounded(live.speed_mps), ..live };
        }
    }
}

/// The setpoint of the width: it gathers speed, keeps to the highest and brakes in time.
#[derive(Debug, Clone)]
pub(super) struct Ramp {
    max_speed_mps: f64,
    max_acceleration_mps2: f64,
    time_s: f64,
    width_m: f64,
    rate_mps: f64,
    acceleration_mps2: f64,
    mass_kg: f64,
}

impl Ramp {
    /// `mass_kg` is what moves with each finger.
    pub fn new(gripper: &Gripper, width_m: f64, mass_kg: f64) -> Self {
        let Gripper { max_speed_mps, max_acceleration_mps2, .. } = *gripper;
        let (rate_mps, acceleration_mps2) = (0.0, 0.0);
        Self { max_speed_mps, max_acceleration_mps2, time_s: 0.0, width_m, rate_mps, acceleration_mps2, mass_kg }
    }

    /// The force on each finger that follows the ramp by itself.
    pub fn force_n(&self) -> f64 {
        self.mass_kg * self.acceleration_mps2 / 2.0
    }

    /// The setpoint at `time_s` and its rate; then one step ahead. It waits for fingers that are `lead_m`
    /// behind: something keeps them.
    pub fn advance(&mut self, time_s: f64, order: &GripperMove, actual_m: f64, lead_m: f64) -> [f64; 2] {
        let step_s = (time_s - self.time_s).max(0.0);
        self.time_s = time_s;
        let now @ [_, before_mps] = [self.width_m, self.rate_mps];
        let way = order.width_m - self.width_m;
        // No faster than it can brake on the way that is left: v² = 2·a·s.
        let brakes_from = (2.0 * self.max_acceleration_mps2 * way.abs()).sqrt();
        let wanted = way.signum() * order.speed_mps.min(self.max_speed_mps).min(brakes_from);
        let change = self.max_acceleration_mps2 * step_s;
        self.rate_mps += (wanted - self.rate_mps).clamp(-change, change);
        let next = self.width_m + f64::midpoint(before_mps, self.rate_mps) * step_s;
        // Rounding leaves a few steps' worth of speed at the end; more than that has to overshoot.
        if (order.width_m - next) * way <= 0.0 && self.rate_mps.abs() <= 3.0 * change {
            (self.width_m, self.rate_mps) = (order.width_m, 0.0);
        } else {
            self.width_m = next;
        }
        if (self.width_m - actual_m).abs() > lead_m {
            (self.width_m, self.rate_mps) = (self.width_m.clamp(actual_m - lead_m, actual_m + lead_m), 0.0);
        }
        let is_ramp = step_s > 0.0 && (self.rate_mps - before_mps).abs() <= 1.01 * change;
        self.acceleration_mps2 = if is_ramp { (self.rate_mps - before_mps) / step_s } else { 0.0 };
        now
    }
}
