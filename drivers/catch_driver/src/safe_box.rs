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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::checker::tests::{bounds, fr3};
    use crate::motion;
    use catch_body::JointVector;

    #[test]
    fn a_plan_out_of_the_box_is_found_where_it_leaves_it() {
        let (robot, bounds) = (fr3(), bounds());
        let plan = motion::straight(1, 0.0, [robot.ready_q, robot.ready_q + JointVector::ith(0, 0.8)], &robot, 0.5);
        assert_eq!(leaves(&bounds.safe_box, &robot, &plan), None);
        let X_WL = robot.link_poses(&robot.ready_q);
        let ys = [X_WL[robot.dof()].translation.y, (robot.gripper_in(&X_WL) * robot.tool_G).y];
        let (low, high) = (ys[0].min(ys[1]) - 0.05, ys[0].max(ys[1]) + 0.05);
        let tight = SafeBox { low_m: [-2.0, low, -2.0], high_m: [2.0, high, 2.0] };
        let (time_s, p_W) = leaves(&tight, &robot, &plan).unwrap();
        let beyond_m = (low - p_W.y).max(p_W.y - high);
        assert!(time_s > 0.0 && beyond_m > 0.0 && beyond_m < 0.01, "{time_s} {p_W}");
    }
}
