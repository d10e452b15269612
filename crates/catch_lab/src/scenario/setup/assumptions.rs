//! Assumptions of a scenario about arm, gripper and cameras, in words.

use catch_sim::{GripperDriveKind, config::RobotErrors, depth_noise::DepthModel};

use super::Setup;
use crate::scenario::{Clock, Scenario};

impl Setup {
    /// Arm, gripper and cameras, and what the scenario's settings assume of them and of the air, in one line.
    pub fn equipment_and_assumptions(&self) -> String {
        let Scenario { robot, gripper, arena, clock, calibration, .. } = &self.scenario;
        let depth = &arena.depth;
        let is_exact =
            depth.model == DepthModel::Perfect && depth.calibration_sd_m == 0.0 && depth.calibration_sd_rad == 0.0;
        let mut cameras =
            format!("{} {}", self.cameras.len(), if is_exact { "exact cameras" } else { "noisy cameras" });
        if self.cameras.len() == 1 {
            cameras.pop();
        }
        cameras += if arena.labels { " with labels" } else { " without labels" };
        if calibration.is_some() {
            cameras += ", calibrated by the arm";
        }
        let drive = match arena.gripper {
            GripperDriveKind::Real => "a gripper as fast as its file says",
            GripperDriveKind::Ideal | GripperDriveKind::Position => "a gripper without a speed limit",
        };
        let mut assumed = vec![cameras, drive.to_owned()];
        let ideal = [
            (arena.robot_errors == RobotErrors::default(), "an arm that knows itself exactly"),
            (!arena.drag, "no air"),
            (*clock == Clock::Free, "no time to compute"),
        ];
        assumed.extend(ideal.into_iter().filter(|(holds, _)| *holds).map(|(_, words)| words.to_owned()));
        format!("{robot} with {gripper}: {}", assumed.join(", "))
    }
}
