//! The Franka Hand.

use std::sync::Arc;

use catch_cell::GripperMove;
use catch_driver::hand::{Fingers, is_grasp};
use franka::{FrankaError, Gripper};

struct FrankaHand(Gripper);

/// Connects.
///
/// # Errors
/// If the hand does not answer.
pub fn connect(address: &str) -> Result<Arc<dyn Fingers>, String> {
    Ok(Arc::new(FrankaHand(Gripper::new(address).map_err(|fault| fault.to_string())?)))
}

impl Fingers for FrankaHand {
    fn next_state(&self) -> Result<(f64, bool), String> {
        let state = self.0.read_once().map_err(|fault| fault.to_string())?;
        Ok((state.width, state.is_grasped))
    }

    fn execute(&self, step: &GripperMove) -> Result<(), String> {
        // The protocol's speed is that of one finger.
        let speed_mps = step.speed_mps / 2.0;
        let ended = if is_grasp(step) {
            // Whatever is between the fingers counts as grasped.
            self.0.grasp(0.0, speed_mps, step.force_n, 0.1, 0.1)
        } else {
            self.0.move_gripper(step.width_m, speed_mps)
        };
        match ended {
            Err(FrankaError::Network(cause)) => Err(cause),
            Ok(_) | Err(_) => Ok(()),
        }
    }
}
