//! Inverse kinematics in closed form for arms of seven joints whose first three axes meet in a shoulder and
//! whose fifth and sixth meet in a wrist, with whatever offsets of the elbow and of the last axis.
//!
//! The last joint's angle is what is free. With it the wrist point W and the direction of axis 6 are known:
//! the distance from shoulder to wrist gives q4; axis 5, which passes through W, is at known angles to the
//! line from the shoulder and to axis 6, which leaves two directions; both together fix the orientation after
//! joint 3, and that and what is left the other five: 2·2·2 solutions. After He and Liu, Analytical Inverse
//! Kinematics for Franka Emika Panda, 2021, but written for arbitrary directions and offsets of the axes:
//! everything is expressed by the axes in W while all joints are at zero.

use nalgebra::{Matrix3, Point3, Vector3};

use super::{
    Ranges, TOLERANCE,
    angles::{AxisRotation, Sinusoid, angle, meeting_point, turned_into},
};
use crate::{
    pose::Pose,
    robot::{JointVector, Robot},
};

/// Solutions of one pose and angle of the last joint: how joint 4 is bent, on which side of the line from
/// shoulder to wrist axis 5 passes, and how joint 2 is.
pub(super) const BRANCHES: usize = 8;
/// Mask in which all branches are wanted.
pub(super) const ALL_BRANCHES: u8 = u8::MAX;

/// Directions that are closer to one line than this, as a sine, do not fix an orientation.
const SINGULAR: f64 = 1e-9;

/// The geometry of such an arm at zero joint angles, in W.
#[derive(Debug, Clone)]
pub struct SphericalShoulderArm {
    axes: [Vector3<f64>; 7],
    shoulder: Point3<f64>,
    /// Vectors from the elbow, a point on axis 4, to the wrist and to the shoulder.
    forearm: Vector3<f64>,
    upper_arm: Vector3<f64>,
    /// A point on the last axis, and the wrist from there.
    last: Point3<f64>,
    last_to_wrist: Vector3<f64>,
    /// Function of q4 that determines the distance from shoulder to wrist; height of axis 3 along axis 1 as a
    /// function of q2.
    bend: Sinusoid,
    height: Sinusoid,
    /// The inverse of the gripper's pose.
    X_GW: Pose,
}

impl SphericalShoulderArm {
    /// The geometry of `robot`, `None` if it is of another kind.
    pub fn of(robot: &Robot) -> Option<Self> {
        if robot.dof() != 7 {
            return None;
        }
        let X_WL = robot.link_poses(&JointVector::zeros());
        let lines: [_; 7] = std::array::from_fn(|i| robot.joint_axis(&X_WL, i));
        let shoulder = meeting_point([lines[0], lines[1]])?;
        // The third axis passes through it, and is not along the second.
        let (axis, point) = lines[2];
        let meet = (shoulder - point).cross(&axis).norm() < TOLERANCE && axis.cross(&lines[1].0).norm() > TOLERANCE;
        let wrist = meeting_point([lines[4], lines[5]])?;
        let axes = lines.map(|(axis, _)| axis.into_inner());
        let [a1, a2, a3, a4, ..] = axes;
        let (elbow, last) = (lines[3].1, lines[6].1);
        let (forearm, upper_arm) = (wrist - elbow, shoulder - elbow);
        let (fore, upper, level) = (across(&forearm, &a4), across(&upper_arm, &a4), across(&a3, &a2));
        meet.then(|| Self {
            axes,
            shoulder,
            forearm,
            upper_arm,
            last,
            last_to_wrist: wrist - last,
            bend: Sinusoid::new([fore.dot(&upper), a4.cross(&fore).dot(&upper)]),
            height: Sinusoid::new([a1.dot(&level), a1.dot(&a2.cross(&a3))]),
            X_GW: robot.gripper_in(&X_WL).inverse(),
        })
    }

    /// Shows `found` all joint positions within `ranges` that put the gripper at `X_WG` with the last joint
    /// at `q7`, of those that differ by whole turns the nearest to `from`, each with its branch: which of the
    /// eight. Only branches are looked at for which `wanted`, one bit for each, says so.
    pub(super) fn for_each_solution(
        &self,
        (X_WG, q7): (&Pose, f64),
        from: &JointVector,
        ranges: &Ranges,
        wanted: u8,
        mut found: impl FnMut(usize, JointVector),
    ) {
        let [_, a2, a3, a4, a5, a6, a7] = self.axes;
        let Self { forearm, upper_arm, .. } = self;
        // The motion of the first six joints, from where all are at zero: X takes W to w and axes 5 and 6 to
        // r and u.
        let (X, back) = (X_WG * self.X_GW, AxisRotation::new(&a7, -q7));
        let R = X.rotation.to_rotation_matrix();
        let w = X * (self.last + back.of(&self.last_to_wrist));
        let (d, r, u) = (w - self.shoulder, R * back.of(&a5), R * back.of(&a6));
        let normal = d.cross(&u);
        let det = normal.norm_squared();
        if det < (SINGULAR * d.norm()).powi(2) {
            return;
        }
        // q4: the wrist is as far from the shoulder as it is.
        let inner = (forearm.norm_squared() + upper_arm.norm_squared() - d.norm_squared()) / 2.0
            - a4.dot(forearm) * a4.dot(upper_arm);
        for (bend, q4) in self.bend.angles_at(inner).enumerate() {
            if (wanted >> (4 * bend)) & 0b1111 == 0 {
                continue;
            }
            let Some(q4) = turned_into(q4, from[3], ranges[3]) else { continue };
            let turn_4 = AxisRotation::new(&a4, q4);
            let (v, along_5) = (turn_4.of(forearm) - upper_arm, turn_4.of(&a5));
            let Some(before) = axes_of(&v, &along_5) else { continue };
            // Axis 5: its parts along d and u, which are known, and what is left across both.
            let (along_d, along_u) = (along_5.dot(&v), a5.dot(&a6));
            let in_plane = d * ((along_d - along_u * d.dot(&u)) / det)
                + u * ((along_u * d.norm_squared() - along_d * d.dot(&u)) / det);
            let rest = (1.0 - in_plane.norm_squared()) / det;
            if rest < 0.0 {
                continue;
            }
            for (side, rest) in [rest.sqrt(), -rest.sqrt()].into_iter().enumerate() {
                if (wanted >> (4 * bend + 2 * side)) & 0b11 == 0 {
                    continue;
                }
                let Some(after) = axes_of(&d, &(in_plane + normal * rest)) else { continue };
                // The motion of the first three joints, and what follows joint 4.
                let first_three = |v: &Vector3<f64>| after * before.tr_mul(v);
                let last_two = |v: &Vector3<f64>| turn_4.back().of(&(before * after.tr_mul(v)));
                let Some(q5) = turned_into(angle(&a5, &a6, &last_two(&u)), from[4], ranges[4]) else { continue };
                let q6 = angle(&a6, &a5, &AxisRotation::new(&a5, -q5).of(&last_two(&r)));
                let Some(q6) = turned_into(q6, from[5], ranges[5]) else { continue };
                self.for_each_shoulder([first_three(&a2), first_three(&a3)], from, ranges, |flip, [q1, q2, q3]| {
                    let mut q = JointVector::zeros();
                    q.as_mut_slice()[..7].copy_from_slice(&[q1, q2, q3, q4, q5, q6, q7]);
                    found(4 * bend + 2 * side + flip, q);
                });
            }
        }
    }

    /// Shows `found` both ways in which the first three joints turn axes 2 and 3 into given directions, each
    /// with its number.
    fn for_each_shoulder(
        &self,
        [second, to]: [Vector3<f64>; 2],
        from: &JointVector,
        ranges: &Ranges,
        mut found: impl FnMut(usize, [f64; 3]),
    ) {
        let [a1, a2, a3, ..] = self.axes;
        // q2: the first joint leaves axis 3 at its angle to axis 1.
        let height = a1.dot(&to) - a1.dot(&a2) * a2.dot(&a3);
        for (flip, q2) in self.height.angles_at(height).enumerate() {
            let Some(q2) = turned_into(q2, from[1], ranges[1]) else { continue };
            let turn_2 = AxisRotation::new(&a2, q2);
            let third = turn_2.of(&a3);
            let q1 = if third.cross(&a1).norm() < SINGULAR { from[0] } else { angle(&a1, &third, &to) };
            let Some(q1) = turned_into(q1, from[0], ranges[0]) else { continue };
            let q3 = angle(&a3, &a2, &turn_2.back().of(&AxisRotation::new(&a1, -q1).of(&second)));
            let Some(q3) = turned_into(q3, from[2], ranges[2]) else { continue };
            found(flip, [q1, q2, q3]);
        }
    }
}

/// Component of a vector across an axis.
fn across(v: &Vector3<f64>, axis: &Vector3<f64>) -> Vector3<f64> {
    v - axis * axis.dot(v)
}

/// Axes of a frame by one direction and another beside it, as columns; `None` if both are along one line.
fn axes_of(first: &Vector3<f64>, beside: &Vector3<f64>) -> Option<Matrix3<f64>> {
    let x = first.try_normalize(0.0)?;
    let z = x.cross(beside).try_normalize(SINGULAR)?;
    Some(Matrix3::from_columns(&[x, z.cross(&x), z]))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::robot_file::tests::{iiwa, named, ur10e};
    use proptest::prelude::*;

    #[test]
    fn the_kind_is_recognized_by_its_geometry() {
        for name in ["panda", "fr3", "xarm7", "iiwa14"] {
            assert!(SphericalShoulderArm::of(&named(name)).is_some(), "{name}");
        }
        assert!(SphericalShoulderArm::of(&ur10e()).is_none());
        let mut apart = iiwa();
        apart.joints[2].X_PL.translation.vector += Vector3::new(0.01, 0.01, 0.01);
        assert!(SphericalShoulderArm::of(&apart).is_none());
    }

    proptest! {
        /// FK ∘ IK is the identity for every solution, the pose's own joint angles are among them, and so is
        /// what iteration finds.
        #[test]
        fn solutions_reach_the_pose_and_are_all_there_are(
            fractions in prop::array::uniform7(0.01f64..0.99), start in prop::array::uniform7(0.01f64..0.99), arm in 0usize..3,
        ) {
            let mut robot = named(["panda", "fr3", "xarm7"][arm]);
            robot.X_WB = Pose::new(Vector3::new(0.3, -0.2, 0.5), Vector3::new(0.5, 1.0, -0.3));
            let (closed, ranges) = (SphericalShoulderArm::of(&robot).unwrap(), robot.joint_ranges());
            let at = |it: [f64; 7]| {
                let q: [f64; 7] = std::array::from_fn(|i| ranges[i][0] + it[i] * (ranges[i][1] - ranges[i][0]));
                robot.joint_vector(&q).unwrap()
            };
            let (q, start) = (at(fractions), at(start));
            let X_WG = robot.gripper_pose(&q);
            // Iteration may end at the end of a range, where rounding decides.
            let nearly = ranges.map(|[low, high]| [low - 1e-5, high + 1e-5]);
            let solutions = |near: &JointVector| {
                let mut found = Vec::new();
                closed.for_each_solution((&X_WG, near[6]), near, &nearly, ALL_BRANCHES, |branch, q| {
                    assert!(branch < BRANCHES);
                    found.push(q);
                });
                found
            };
            for found in solutions(&q) {
                let reached = robot.gripper_pose(&found);
                prop_assert!((reached.translation.vector - X_WG.translation.vector).norm() < 1e-6);
                prop_assert!(reached.rotation.angle_to(&X_WG.rotation) < 1e-6);
            }
            let is_among = |near: &JointVector| solutions(near).iter().any(|found| (found - near).amax() < 1e-4);
            // Away from where two solutions become one: the first six joints alone can move the gripper in
            // all directions.
            let is_regular = |q: &JointVector| {
                let X_WL = robot.link_poses(q);
                let mut J = robot.jacobian(&X_WL, &Point3::from(robot.gripper_in(&X_WL).translation.vector));
                J.column_mut(6).fill(0.0);
                (J * J.transpose()).determinant() > 1e-8
            };
            prop_assert!(!is_regular(&q) || is_among(&q), "{q}");
            if let Some(iterated) = robot.nearby_solution(&X_WG, &start, &ranges) {
                prop_assert!(!is_regular(&iterated) || is_among(&iterated), "{iterated}");
            }
        }

        /// Whole turns are taken where the range asks for them, and ranges are kept.
        #[test]
        fn solutions_keep_their_ranges(fractions in prop::array::uniform7(0.1f64..0.9)) {
            let robot = named("xarm7");
            let (closed, limits) = (SphericalShoulderArm::of(&robot).unwrap(), robot.joint_ranges());
            let q: [f64; 7] = std::array::from_fn(|i| limits[i][0] + fractions[i] * (limits[i][1] - limits[i][0]));
            let q = robot.joint_vector(&q).unwrap();
            let ranges: Ranges = std::array::from_fn(|i| [q[i] - 0.2, q[i] + 0.3]);
            let mut found = Vec::new();
            closed.for_each_solution((&robot.gripper_pose(&q), q[6]), &q, &ranges, ALL_BRANCHES, |_, q| found.push(q));
            prop_assert!(found.iter().all(|it| (0..7).all(|i| (ranges[i][0]..=ranges[i][1]).contains(&it[i]))));
        }
    }
}
