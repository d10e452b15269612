//! Forward kinematics and Jacobians of a serial arm.

use nalgebra::{Point3, Unit, UnitQuaternion, Vector3};

use crate::{
    pose::{Pose, Twist},
    robot::{Jacobian, JointVector, MAX_JOINTS, Robot},
};

/// Poses of an arm's links in the world, base link first. Entries beyond the last link repeat it.
pub type LinkPoses = [Pose; MAX_JOINTS + 1];

impl Robot {
    /// Pose of every link in W for the joint positions `q` in radians: entry 0 is the base, entry i + 1 the
    /// link that joint i (from zero) moves.
    pub fn link_poses(&self, q: &JointVector) -> LinkPoses {
        let mut X_WL = [self.X_WB; MAX_JOINTS + 1];
        for i in 0..MAX_JOINTS {
            X_WL[i + 1] = X_WL[i];
            if let Some(joint) = self.joints.get(i) {
                X_WL[i + 1] *= joint.X_PL;
                X_WL[i + 1].rotation *= UnitQuaternion::from_axis_angle(&joint.axis, q[i]);
            }
        }
        X_WL
    }

    /// Forward kinematics: the pose X_WG of the gripper in W for the joint positions `q` in radians.
    pub fn gripper_pose(&self, q: &JointVector) -> Pose {
        self.gripper_in(&self.link_poses(q))
    }

    /// Pose of the gripper in W, from link poses that are already known.
    pub fn gripper_in(&self, X_WL: &LinkPoses) -> Pose {
        X_WL[MAX_JOINTS] * self.X_LG
    }

    /// Axis of joint `i` (from zero) in W and the origin of its link.
    pub fn joint_axis(&self, X_WL: &LinkPoses, i: usize) -> (Unit<Vector3<f64>>, Point3<f64>) {
        let X_WL = &X_WL[i + 1];
        (X_WL.rotation * self.joints[i].axis, Point3::from(X_WL.translation.vector))
    }

    /// Jacobian of the last link's angular velocity and of the velocity of a point at `p_WP` that moves with
    /// it, in W.
    ///
    /// Column i is (zᵢ, zᵢ × (p − oᵢ)) with the joint's axis zᵢ through oᵢ (Siciliano et al., Robotics, eq.
    /// 3.30).
    pub fn jacobian(&self, X_WL: &LinkPoses, p_WP: &Point3<f64>) -> Jacobian {
        let mut jacobian = Jacobian::zeros();
        for i in 0..self.dof() {
            let (axis, origin) = self.joint_axis(X_WL, i);
            jacobian.fixed_view_mut::<3, 1>(0, i).copy_from(&axis);
            jacobian.fixed_view_mut::<3, 1>(3, i).copy_from(&axis.cross(&(p_WP - origin)));
        }
        jacobian
    }

    /// Spatial velocity of the gripper's frame in W, in rad/s and m/s, at the joint positions `q` in radians
    /// and velocities `dq` in rad/s.
    pub fn gripper_twist(&self, q: &JointVector, dq: &JointVector) -> Twist {
        let X_WL = self.link_poses(q);
        let p_WG = Point3::from(self.gripper_in(&X_WL).translation.vector);
        let V_WG = self.jacobian(&X_WL, &p_WG) * dq;
        Twist { angular: V_WG.fixed_rows::<3>(0).into(), linear: V_WG.fixed_rows::<3>(3).into() }
    }

    /// Speed of the hand in m/s: the higher one of the last link's origin and of the tool. No point between
    /// them is faster, such as the flange.
    pub fn hand_speed_mps(&self, q: &JointVector, dq: &JointVector) -> f64 {
        let X_WL = self.link_poses(q);
        let points = [Point3::from(X_WL[MAX_JOINTS].translation.vector), self.gripper_in(&X_WL) * self.tool_G];
        let speed = |p_WP: Point3<f64>| (self.jacobian(&X_WL, &p_WP) * dq).fixed_rows::<3>(3).norm();
        points.map(speed).into_iter().fold(0.0, f64::max)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::robot_file::tests::iiwa;
    use proptest::prelude::*;

    #[test]
    fn stretched_out_arm_stands_straight_up() {
        let X_WG = iiwa().gripper_pose(&JointVector::zeros());
        assert!((X_WG.translation.vector - Vector3::new(0.0, 0.0, 0.36 + 0.42 + 0.4 + 0.081 + 0.05375)).norm() < 1e-9);
        assert!((X_WG * Vector3::y() - Vector3::z()).norm() < 1e-9, "the gripper points away from the arm");
    }

    proptest! {
        /// The Jacobian against central differences of the forward kinematics.
        #[test]
        fn jacobian_matches_finite_differences(q in prop::array::uniform7(-2.0f64..2.0)) {
            let robot = iiwa();
            let q = robot.joint_vector(&q).unwrap();
            let X_WL = robot.link_poses(&q);
            let X_WG = robot.gripper_in(&X_WL);
            let jacobian = robot.jacobian(&X_WL, &X_WG.translation.vector.into());
            let step = 1e-6;
            for i in 0..robot.dof() {
                let at = |sign: f64| robot.gripper_pose(&(q + JointVector::ith(i, sign * step)));
                let (before, after) = (at(-1.0), at(1.0));
                let linear = (after.translation.vector - before.translation.vector) / (2.0 * step);
                let angular = (after.rotation * before.rotation.inverse()).scaled_axis() / (2.0 * step);
                prop_assert!((jacobian.fixed_view::<3, 1>(3, i) - linear).norm() < 1e-8);
                prop_assert!((jacobian.fixed_view::<3, 1>(0, i) - angular).norm() < 1e-8);
            }
        }
    }
}
