//! Control: what to do about a flight, when the gripper closes, and how plans become commands.

mod controller;
mod decision;
pub mod sent_plans;
mod time_grid_search;

use catch_cell::GripperMove;
use serde::{Deserialize, Serialize};

pub use controller::Controller;
pub use decision::{CatchPlanner, Decision, Progress, Situation, Status};
pub use time_grid_search::TimeGridSearch;

use crate::trajectory_optimization::CatchPlan;
use catch_body::{Gripper, Pose, quantity};

/// Settings of control.
#[quantity::checked(default, deny_unknown_fields)]
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Config {
    /// Time from an observation until a command takes effect, in seconds: new motions start that much later.
    pub expected_latency_s: quantity::latency_s,
    /// Time from the start of a gripper move until the fingers move, in seconds; the gripper's own if nothing
    /// is said.
    pub gripper_latency_s: quantity::latency_s<Option<f64>>,
    /// Force of closing in N per finger; the gripper's own limit if it is lower.
    pub closing_force_n: quantity::force_n,
    /// A catch whose cost of holding has risen by this much, as the flight is known better, is given up for
    /// one that costs that much less.
    pub switching_hysteresis: quantity::weight,
}

impl Default for Config {
    fn default() -> Self {
        Self { expected_latency_s: 0.01, gripper_latency_s: None, closing_force_n: 80.0, switching_hysteresis: 0.5 }
    }
}

/// A plan that cannot be adjusted is kept while the object is expected within this distance of its grasp
/// centre, in metres.
const TOLERATED_MISS_M: f64 = 0.006;
/// A plan that cannot be adjusted is kept while the object's orientation differs by less than this, in
/// radians.
const TOLERATED_MISS_RAD: f64 = 0.03;

/// Timing and speed of the gripper's closing.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct GripperPlan {
    /// Start of the move that closes the fingers, in seconds on the cell's clock; the fingers follow
    /// [`Config::gripper_latency_s`] later.
    pub start_s: f64,
    /// Expected contact of the fingers with the object, on the same clock.
    pub contact_s: f64,
    /// Speed of closing in m/s, the fingers relative to each other.
    pub speed_mps: f64,
}

/// Returns whether a plan whose motion cannot be changed any more still meets the object, for which the
/// gripper would have to be at `X_WG`.
pub fn is_still_good(plan: &CatchPlan, X_WG: &Pose, gripper: &Gripper) -> bool {
    let missed_by = (X_WG * gripper.grasp_centre() - plan.X_WG * gripper.grasp_centre()).norm();
    missed_by < TOLERATED_MISS_M && X_WG.rotation.angle_to(&plan.X_WG.rotation) < TOLERATED_MISS_RAD
}

/// The time of the smallest distance within 30 ms of a guess, by golden-section search: object and gripper
/// pass each other on nearly straight lines there.
fn closest(guess_s: f64, distance: impl Fn(f64) -> f64) -> f64 {
    let ratio = (5.0_f64.sqrt() - 1.0) / 2.0;
    let (mut low, mut high) = (guess_s - 0.03, guess_s + 0.03);
    for _ in 0..20 {
        let width = (high - low) * ratio;
        if distance(high - width) < distance(low + width) { high = low + width } else { low = high - width }
    }
    (low + high) / 2.0
}

/// The moves of the fingers: open this wide, then squeeze. Where it is time to squeeze already nothing opens
/// them any more.
pub fn gripper_moves(
    now_s: f64,
    aperture_m: f64,
    closing: &GripperPlan,
    gripper: &Gripper,
    config: &Config,
) -> Vec<GripperMove> {
    let force_n = config.closing_force_n.min(gripper.max_force_n);
    let aperture = GripperMove { start_s: now_s, width_m: aperture_m, speed_mps: gripper.max_speed_mps, force_n };
    let squeezing = GripperMove { start_s: closing.start_s, width_m: 0.0, speed_mps: closing.speed_mps, force_n };
    if closing.start_s > now_s { vec![aperture, squeezing] } else { vec![squeezing] }
}

/// The move that brings the fingers this far apart, at once and as fast as they go.
pub fn opening(now_s: f64, width_m: f64, gripper: &Gripper) -> GripperMove {
    let (speed_mps, force_n) = (gripper.max_speed_mps, gripper.max_force_n);
    GripperMove { start_s: now_s, width_m, speed_mps, force_n }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn closest_approach_is_found() {
        assert!((closest(0.7, |time| libm::hypot(time - 0.7123_f64, 0.01)) - 0.7123).abs() < 1e-5);
    }

    /// A drive obeys the move that starts last.
    #[test]
    fn fingers_that_should_be_closing_are_not_opened() {
        let toml = include_str!("../../../../assets/grippers/wsg50.toml");
        let gripper = Gripper::from_toml("wsg50.toml", toml).unwrap();
        for start_s in [0.58, 0.59, 0.6] {
            let closing = GripperPlan { start_s, contact_s: 0.7, speed_mps: 0.42 };
            let moves = gripper_moves(0.59, 0.09, &closing, &gripper, &Config::default());
            assert_eq!(moves.len(), 1 + usize::from(start_s > 0.59));
            let last = moves.iter().max_by(|a, b| a.start_s.total_cmp(&b.start_s)).unwrap();
            assert_eq!(last.width_m, 0.0, "closing from {start_s} s on: {moves:?}");
        }
    }
}
