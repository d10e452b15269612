//! Inverse kinematics in closed form for arms of six joints whose second, third and fourth axes are parallel:
//! across the first, with the fifth and the sixth meeting in a wrist point.
//!
//! The wrist point W moves with link 4. Its offset along the parallel axes gives q1, the direction of the
//! last axis q5, what is left of the orientation q6 and the sum of q2, q3 and q4, and the triangle of joints
//! 2, 3 and 4 those: 2·2·2 solutions. After Hawkins, Analytic Inverse Kinematics for the Universal Robots
//! UR-5/UR-10 Arms, 2013, but written for arbitrary directions of the axes: everything is expressed by the
//! axes in W while all joints are at zero.

use nalgebra::{Point3, Rotation3, Unit, Vector3};

use super::{
    Ranges, TOLERANCE,
    angles::{Sinusoid, angle, meeting_point, turned_into},
};
use crate::{
    pose::Pose,
    robot::{JointVector, Robot},
};

/// A wrist whose last axis is closer than this to the parallel ones, as a sine, turns about one axis with two
/// joints.
const SINGULAR: f64 = 1e-9;

/// The geometry of such an arm at zero joint angles, in W.
#[derive(Debug, Clone)]
pub struct ParallelAxesArm {
    axes: [Unit<Vector3<f64>>; 6],
    /// Signs of the directions of axes 3 and 4: 1 along axis 2, −1 against it.
    signs: [f64; 2],
    /// A point on axis 1, and the origins of joints 2, 3 and 4 without what lies along these axes.
    base: Point3<f64>,
    joints: [Vector3<f64>; 3],
    wrist: Point3<f64>,
    /// Orientation of the gripper and position of the wrist point in its frame.
    R_WG: Rotation3<f64>,
    p_GW: Point3<f64>,
}

impl ParallelAxesArm {
    /// The geometry of `robot`, `None` if it is of another kind.
    pub fn of(robot: &Robot) -> Option<Self> {
        if robot.dof() != 6 {
            return None;
        }
        let X_WL = robot.link_poses(&JointVector::zeros());
        let lines: [_; 6] = std::array::from_fn(|i| robot.joint_axis(&X_WL, i));
        let (axes, origins) = (lines.map(|it| it.0), lines.map(|it| it.1));
        let are_parallel = [2, 3].iter().all(|&i| axes[i].cross(&axes[1]).norm() < TOLERANCE);
        let are_across = [(0, 1), (3, 4)].iter().all(|&(i, j)| axes[i].dot(&axes[j]).abs() < TOLERANCE);
        if !are_parallel || !are_across {
            return None;
        }
        let wrist = meeting_point([(axes[4], origins[4]), (axes[5], origins[5])])?;
        let across = |p: Point3<f64>| {
            let from = p - origins[0];
            from - axes[1].into_inner() * from.dot(&axes[1])
        };
        let joints = [across(origins[1]), across(origins[2]), across(origins[3])];
        let are_apart = joints.windows(2).all(|pair| (pair[1] - pair[0]).norm() > TOLERANCE);
        let X_WG = robot.gripper_in(&X_WL);
        are_apart.then(|| Self {
            signs: [axes[2].dot(&axes[1]).signum(), axes[3].dot(&axes[1]).signum()],
            axes,
            base: origins[0],
            joints,
            wrist,
            R_WG: X_WG.rotation.to_rotation_matrix(),
            p_GW: X_WG.inverse() * wrist,
        })
    }

    /// All joint positions within `ranges` that put the gripper at `X_WG`, of those that differ by whole
    /// turns the nearest to `from`.
    pub fn solutions(&self, X_WG: &Pose, from: &JointVector, ranges: &Ranges) -> Vec<JointVector> {
        let mut solutions = Vec::new();
        let to_wrist = X_WG * self.p_GW - self.base;
        // Rotation of the gripper from its orientation at zero.
        let R_turn = X_WG.rotation.to_rotation_matrix() * self.R_WG.inverse();
        let [a1, a2] = [self.axes[0].into_inner(), self.axes[1].into_inner()];
        // q1: seen from a link that has turned by it, the wrist point is as far along axis 2 as at zero.
        let offset = (self.wrist - self.base).dot(&a2);
        for q1 in Sinusoid::new([to_wrist.dot(&a2), to_wrist.dot(&a1.cross(&a2))]).angles_at(offset) {
            let back = Rotation3::from_axis_angle(&self.axes[0], -q1);
            let (M, to_wrist) = (back * R_turn, back * to_wrist);
            // q5: turning about axis 2 leaves the last axis' part along it, R(a5, q5)·a6 · a2.
            let [a5, a6] = [self.axes[4].into_inner(), self.axes[5].into_inner()];
            for q5 in Sinusoid::new([a6.dot(&a2), a5.cross(&a6).dot(&a2)]).angles_at((M * a6).dot(&a2)) {
                // q6: R(a6, −q6) takes R(a5, −q5)·a2 to Mᵀ·a2.
                let v = Rotation3::from_axis_angle(&self.axes[4], -q5) * a2;
                let q6 = if v.cross(&a6).norm() < SINGULAR { from[5] } else { -angle(&a6, &v, &(M.inverse() * a2)) };
                let rest =
                    M * Rotation3::from_axis_angle(&self.axes[5], -q6) * Rotation3::from_axis_angle(&self.axes[4], -q5);
                // The remaining rotation is about axis 2, by q2 ± q3 ± q4.
                let sum = angle(&a2, &a1, &(rest * a1));
                let forearm_to_wrist = self.wrist - self.base - self.joints[2];
                let r = to_wrist - Rotation3::from_axis_angle(&self.axes[1], sum) * forearm_to_wrist - self.joints[0];
                let r = r - a2 * r.dot(&a2);
                let [upper, fore] = [self.joints[1] - self.joints[0], self.joints[2] - self.joints[1]];
                let cos = (r.norm_squared() - upper.norm_squared() - fore.norm_squared())
                    / (2.0 * upper.norm() * fore.norm());
                if cos.abs() > 1.0 {
                    continue;
                }
                for bend in [libm::acos(cos), -libm::acos(cos)] {
                    let turn_3 = bend - angle(&a2, &upper, &fore);
                    let reached = upper + Rotation3::from_axis_angle(&self.axes[1], turn_3) * fore;
                    let q2 = angle(&a2, &reached, &r);
                    let [q3, q4] = [turn_3 * self.signs[0], (sum - q2 - turn_3) * self.signs[1]];
                    if let Some(q) = within([q1, q2, q3, q4, q5, q6], from, ranges) {
                        solutions.push(q);
                    }
                }
            }
        }
        solutions
    }
}

/// The angles, each by as many whole turns off that it is within its range and near `from`.
fn within(angles: [f64; 6], from: &JointVector, ranges: &Ranges) -> Option<JointVector> {
    let mut q = JointVector::zeros();
    for (i, angle) in angles.into_iter().enumerate() {
        q[i] = turned_into(angle, from[i], ranges[i])?;
    }
    Some(q)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        MAX_JOINTS,
        robot_file::tests::{iiwa, ur10e},
    };
    use proptest::prelude::*;

    #[test]
    fn the_kind_is_recognized_by_its_geometry() {
        assert!(ParallelAxesArm::of(&ur10e()).is_some() && ParallelAxesArm::of(&iiwa()).is_none());
        // An axis that is not parallel, a wrist whose axes do not meet.
        let mut oblique = ur10e();
        oblique.joints[2].X_PL.rotation *= nalgebra::UnitQuaternion::from_euler_angles(0.01, 0.0, 0.01);
        let mut apart = ur10e();
        apart.joints[5].X_PL.translation.vector += Vector3::new(0.01, 0.01, 0.01);
        assert!(ParallelAxesArm::of(&oblique).is_none() && ParallelAxesArm::of(&apart).is_none());
        // The pose of the base and the direction in which a joint counts do not matter.
        let mut mirrored = ur10e();
        mirrored.joints[2].axis = -mirrored.joints[2].axis;
        mirrored.X_WB = Pose::new(Vector3::new(0.3, -0.2, 0.5), Vector3::new(0.5, 1.0, -0.3));
        assert!(ParallelAxesArm::of(&mirrored).is_some());
    }

    proptest! {
        /// FK ∘ IK is the identity for every solution, the pose's own joint angles are among them, and so is
        /// what iteration finds.
        #[test]
        fn solutions_reach_the_pose_and_are_all_there_are(
            q in prop::array::uniform6(-3.1f64..3.1), start in prop::array::uniform6(-3.1f64..3.1), mirrors in 0u8..8,
        ) {
            let mut robot = ur10e();
            for joint in (1..4).filter(|joint| mirrors >> (joint - 1) & 1 == 1) {
                robot.joints[joint].axis = -robot.joints[joint].axis;
            }
            robot.X_WB = Pose::new(Vector3::new(0.3, -0.2, 0.5), Vector3::new(0.5, 1.0, -0.3));
            let arm = ParallelAxesArm::of(&robot).unwrap();
            let [q, start] = [q, start].map(|it| robot.joint_vector(&it).unwrap());
            prop_assume!(libm::sin(q[2]).abs() > 0.02 && libm::sin(q[4]).abs() > 0.02);
            let X_WG = robot.gripper_pose(&q);
            let solutions = arm.solutions(&X_WG, &q, &robot.joint_ranges());
            for found in &solutions {
                let reached = robot.gripper_pose(found);
                prop_assert!((reached.translation.vector - X_WG.translation.vector).norm() < 1e-8);
                prop_assert!(reached.rotation.angle_to(&X_WG.rotation) < 1e-8);
            }
            prop_assert!(solutions.iter().any(|found| (found - q).amax() < 1e-6), "{q}");
            if let Some(iterated) = robot.nearby_solution(&X_WG, &start, &robot.joint_ranges()) {
                let near = arm.solutions(&X_WG, &iterated, &robot.joint_ranges());
                prop_assert!(near.iter().any(|found| (found - iterated).amax() < 1e-4), "{iterated}");
            }
        }

        /// Whole turns are taken where the range asks for them.
        #[test]
        fn solutions_keep_their_ranges(q in prop::array::uniform6(-6.0f64..6.0)) {
            let robot = ur10e();
            let q = robot.joint_vector(&q).unwrap();
            prop_assume!(libm::sin(q[2]).abs() > 0.02 && libm::sin(q[4]).abs() > 0.02);
            let ranges: Ranges = std::array::from_fn(|i| [q[i] - 0.2, q[i] + 0.3]);
            let found = ParallelAxesArm::of(&robot).unwrap().solutions(&robot.gripper_pose(&q), &q, &ranges);
            prop_assert!(found.iter().any(|it| (it - q).amax() < 1e-6));
            prop_assert!(found.iter().all(|it| (0..MAX_JOINTS).all(|i| (ranges[i][0]..=ranges[i][1]).contains(&it[i]))));
        }
    }
}
