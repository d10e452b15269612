//! The box that the hand must not leave.

use catch_body::Robot;
use catch_cell::{ArmTrajectory, cell_file::SafeBox};
use nalgebra::Point3;

/// Interval in seconds at which a trajectory is compared with the box.
const SAMPLE_S: f64 = 4e-3;

/// The first time at which a trajectory has the wrist or the grasp centre outside of the box, and where.
pub fn leaves(bounds: &SafeBox, robot: &Robot, plan: &ArmTrajectory) -> Option<(f64, Point3<f64>)> {
    let count = ((plan.end_s() - plan.start_s()) / SAMPLE_S).ceil() as usize;
    (0..=count).map(|i| (plan.start_s() + i as f64 * SAMPLE_S).min(plan.end_s())).find_map(|time_s| {
        let X_WL = robot.link_poses(&plan.setpoint(time_s).q);
        let wrist = Point3::from(X_WL[robot.dof()].translation.vector);
        let hand = [wrist, robot.gripper_in(&X_WL) * robot.tool_G];
        hand.into_iter().find(|p_W| !bounds.contains(p_W)).map(|p_W| (time_s, p_W))
    })
}
