//! Detection of a held object, from the drive's own measurements.

use catch_cell::GraspState;

/// The fingers are where they were sent when they are this near, in metres.
const ARRIVED_M: f64 = 1e-4;
/// Fingers that move slower stand still.
const STANDING_MPS: f64 = 5e-3;
/// The fraction of the move's force that counts as all of it.
const ALL_FORCE: f64 = 0.95;
/// A part that was held is lost once the fingers have closed this much further, in metres; chosen.
const LOST_M: f64 = 1e-3;

/// Follows the fingers through moves.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct GraspWatch {
    pub state: GraspState,
    held_width_m: f64,
}

impl GraspWatch {
    /// A move begins.
    pub fn begin(&mut self, width_m: f64, target_m: f64) {
        self.state = match target_m - width_m {
            way if way.abs() < ARRIVED_M => GraspState::Idle,
            way if way > 0.0 => GraspState::Positioning,
            _ => GraspState::Grasping,
        };
    }

    /// A step has passed; `force_ratio` is the squeezing force over that of the move.
    pub fn update(&mut self, width_m: f64, rate_mps: f64, target_m: f64, force_ratio: f64) {
        let has_arrived = (width_m - target_m).abs() < ARRIVED_M;
        let presses = force_ratio > ALL_FORCE && rate_mps.abs() < STANDING_MPS;
        self.state = match self.state {
            GraspState::Positioning if has_arrived => GraspState::Idle,
            GraspState::Grasping if has_arrived => GraspState::NoPart,
            GraspState::Grasping if presses => {
                self.held_width_m = width_m;
                GraspState::Holding
            }
            GraspState::Holding if width_m < self.held_width_m - LOST_M => GraspState::PartLost,
            unchanged => unchanged,
        };
    }
}
