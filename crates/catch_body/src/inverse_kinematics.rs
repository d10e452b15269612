//! Inverse kinematics: numerical for any arm; in closed form for [six joints with three parallel
//! axes](ParallelAxesArm), for [seven with a spherical shoulder](SphericalShoulderArm), and for S-R-S arms:
//! seven joints, three axes that meet in a shoulder, one elbow, three that meet in a wrist, and no offsets.
//!
//! The position of the wrist fixes the elbow but for a swivel about the line from shoulder to wrist; each
//! swivel angle leaves eight solutions (sign of elbow, shoulder and wrist). After Shimizu et al., Analytical
//! Inverse Kinematic Computation for 7-DOF Redundant Manipulators with Joint Limits, IEEE T-RO 24(5), 2008,
//! but written for arbitrary directions of the axes: everything is expressed by the axes in W while all
//! joints are at zero.

mod angles;
mod arcs;
mod last_joint;
mod numerical;
mod parallel_axes;
mod spherical_shoulder;

pub use arcs::Branch;
pub use numerical::Ranges;
pub use parallel_axes::ParallelAxesArm;
pub use spherical_shoulder::SphericalShoulderArm;

use arcs::Harmonic;
use nalgebra::{Matrix3, Point3, Rotation3, Unit, Vector3};

use crate::{
    pose::Pose,
    robot::{JointVector, Robot},
};

/// Tolerance, in metres and radians, of an arm's deviation from the S-R-S geometry.
const TOLERANCE: f64 = 1e-6;

/// The geometry of an S-R-S arm at zero joint angles, in W.
#[derive(Debug, Clone)]
pub struct SrsArm {
    /// The shoulder in W, at which the first three axes meet.
    pub shoulder: Point3<f64>,
    /// Distances from shoulder to elbow and from elbow to wrist.
    upper_arm: f64,
    forearm: f64,
    /// Direction of the stretched arm.
    along: Unit<Vector3<f64>>,
    axes: [Unit<Vector3<f64>>; 7],
    /// Orientation of the gripper and position of the wrist in its frame.
    R_WG: Rotation3<f64>,
    p_GW: Point3<f64>,
}

/// Possible positions of the elbow for one pose of the gripper: a circle about the line from shoulder to
/// wrist.
#[derive(Debug, Clone, Copy)]
pub struct ElbowCircle {
    R_WG: Rotation3<f64>,
    /// Direction from shoulder to wrist.
    to_wrist: Vector3<f64>,
    /// Directions of swivel 0 and π/2.
    across: [Vector3<f64>; 2],
    /// Angle at the shoulder between the upper arm and the line to the wrist.
    shoulder_angle: f64,
    /// Angle in radians by which the elbow is bent; zero is stretched.
    elbow_bend: f64,
}

/// Three joints that rotate about u, b and u, as forms of the swivel angle: (x, y) of the first and the last
/// one's angles, for a positive middle one, and the cosine of the middle one's.
#[derive(Debug, Clone, Copy)]
struct EulerForms {
    along: Harmonic,
    first: [Harmonic; 2],
    last: [Harmonic; 2],
}

impl SrsArm {
    /// The S-R-S geometry of `robot`, `None` if it is of another kind.
    pub fn of(robot: &Robot) -> Option<Self> {
        if robot.dof() != 7 {
            return None;
        }
        let X_WL = robot.link_poses(&JointVector::zeros());
        let lines: [_; 7] = std::array::from_fn(|i| robot.joint_axis(&X_WL, i));
        let (axes, origins) = (lines.map(|it| it.0), lines.map(|it| it.1));
        let lies_along = |i: usize, along: &Vector3<f64>| {
            let off_line = along.cross(&(origins[i] - origins[0])).norm();
            axes[i].cross(along).norm() < TOLERANCE && off_line < TOLERANCE
        };
        // Point at which the axis of joint i crosses the line of joint 1 at a right angle.
        let crossing = |i: usize| {
            let along = axes[0].into_inner();
            let foot = origins[0] + along * along.dot(&(origins[i] - origins[0]));
            let off_axis = (foot - origins[i]).cross(&axes[i]).norm();
            (axes[i].dot(&along).abs() < TOLERANCE && off_axis < TOLERANCE).then_some(foot)
        };
        let (shoulder, elbow, wrist) = (crossing(1)?, crossing(3)?, crossing(5)?);
        let along = Unit::try_new(elbow - shoulder, TOLERANCE)?;
        let stretched = (wrist - elbow).dot(&along) > TOLERANCE;
        if !stretched || ![0, 2, 4, 6].iter().all(|&i| lies_along(i, &along)) {
            return None;
        }
        let X_WG = robot.gripper_in(&X_WL);
        Some(Self {
            shoulder,
            upper_arm: (elbow - shoulder).norm(),
            forearm: (wrist - elbow).norm(),
            along,
            axes,
            R_WG: X_WG.rotation.to_rotation_matrix(),
            p_GW: X_WG.inverse() * wrist,
        })
    }

    /// The wrist in the gripper's frame.
    pub fn wrist_in_gripper(&self) -> Point3<f64> {
        self.p_GW
    }

    /// Squared distances from shoulder to wrist, the least and the greatest in m², with the elbow's joint
    /// within a range in radians.
    pub fn wrist_distances_squared(&self, [low, high]: [f64; 2]) -> [f64; 2] {
        let (a, b) = (self.upper_arm, self.forearm);
        let least_bend = low.max(-high).max(0.0);
        let most_bend = high.max(-low).min(std::f64::consts::PI);
        [most_bend, least_bend].map(|bend| a * a + b * b + 2.0 * a * b * libm::cos(bend))
    }

    /// The elbow's circle for a pose of the gripper, `None` if the wrist is too far or too near.
    pub fn elbow_circle(&self, X_WG: &Pose) -> Option<ElbowCircle> {
        let to_wrist = X_WG * self.p_GW - self.shoulder;
        let distance = to_wrist.norm();
        let (a, b) = (self.upper_arm, self.forearm);
        // Law of cosines in the triangle shoulder, elbow, wrist.
        let cos_shoulder = (a * a + distance * distance - b * b) / (2.0 * a * distance);
        let cos_elbow = (a * a + b * b - distance * distance) / (2.0 * a * b);
        if !(cos_shoulder.abs() <= 1.0 && cos_elbow.abs() < 1.0) {
            return None;
        }
        let to_wrist = to_wrist / distance;
        let reference = if to_wrist.z.abs() > 0.95 { Vector3::x() } else { Vector3::z() };
        let first = (reference - to_wrist * to_wrist.dot(&reference)).normalize();
        Some(ElbowCircle {
            R_WG: X_WG.rotation.to_rotation_matrix(),
            to_wrist,
            across: [first, to_wrist.cross(&first)],
            shoulder_angle: libm::acos(cos_shoulder),
            elbow_bend: std::f64::consts::PI - libm::acos(cos_elbow),
        })
    }

    /// The joint positions of one branch that put the gripper in the circle's pose with the elbow at `swivel`
    /// radians, whether within limits or not.
    pub fn solve_branch(&self, circle: &ElbowCircle, swivel: f64, branch: Branch) -> JointVector {
        let aside = circle.across[0] * libm::cos(swivel) + circle.across[1] * libm::sin(swivel);
        let upper = circle.to_wrist * libm::cos(circle.shoulder_angle) + aside * libm::sin(circle.shoulder_angle);
        // The elbow's axis is perpendicular to the arm's plane: upper × forearm = axis · sin(bend).
        let elbow_sign = if branch.elbow { -1.0 } else { 1.0 };
        let elbow_axis = aside.cross(&circle.to_wrist) * elbow_sign;
        let q4 = elbow_sign * circle.elbow_bend;
        // R_03 takes (along, a4, along × a4) to (upper arm, elbow axis, their product).
        let before = basis(self.along.into_inner(), self.axes[3].into_inner());
        let R_03 = Rotation3::from_matrix_unchecked(basis(upper, elbow_axis) * before.transpose());
        let R_04 = R_03 * Rotation3::from_axis_angle(&self.axes[3], q4);
        let R_47 = R_04.inverse() * circle.R_WG * self.R_WG.inverse();
        let [q1, q2, q3] = self.euler_angles(&R_03, 0, branch.shoulder);
        let [q5, q6, q7] = self.euler_angles(&R_47, 4, branch.wrist);
        JointVector::from_column_slice(&[q1, q2, q3, q4, q5, q6, q7, 0.0])
    }

    /// Angles of joints `first`, `first + 1`, `first + 2`, whose product of rotations is `R`; the middle one
    /// is negative if `turned_over`.
    ///
    /// With u the first and third axis, b the second and c = b × u: R·u = u·cos β + (c·cos α + b·sin α)·sin
    /// β.
    fn euler_angles(&self, R: &Rotation3<f64>, first: usize, turned_over: bool) -> [f64; 3] {
        let u = self.along.into_inner();
        let b = self.axes[first + 1].into_inner();
        let c = b.cross(&u);
        let signs = [self.axes[first].dot(&u).signum(), self.axes[first + 2].dot(&u).signum()];
        let turned = R * u;
        let (along_b, along_c) = (turned.dot(&b), turned.dot(&c));
        let sign = if turned_over { -1.0 } else { 1.0 };
        let beta = sign * libm::atan2(libm::hypot(along_b, along_c), turned.dot(&u));
        let alpha = libm::atan2(sign * along_b, sign * along_c);
        let rest = (Rotation3::new(u * alpha) * Rotation3::new(b * beta)).inverse() * (R * c);
        let gamma = libm::atan2(rest.dot(&b), rest.dot(&c));
        [alpha * signs[0], beta, gamma * signs[1]]
    }
}

/// An orthonormal basis from two perpendicular directions and their product.
fn basis(first: Vector3<f64>, second: Vector3<f64>) -> Matrix3<f64> {
    Matrix3::from_columns(&[first, second, first.cross(&second)])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::robot_file::tests::iiwa;
    use proptest::prelude::*;

    #[test]
    fn iiwa_is_an_srs_arm() {
        let arm = SrsArm::of(&iiwa()).unwrap();
        assert!((arm.upper_arm - 0.42).abs() < 1e-9 && (arm.forearm - 0.4).abs() < 1e-9);
    }

    #[test]
    fn an_arm_with_offsets_is_not() {
        let mut robot = iiwa();
        robot.joints[3].X_PL.translation.x += 0.02;
        assert!(SrsArm::of(&robot).is_none());
    }

    proptest! {
        /// A swivel angle is in a branch's arcs exactly if that branch keeps the ranges there.
        #[test]
        fn arcs_are_where_the_ranges_hold(
            unit in prop::array::uniform7(-0.99f64..0.99), low in prop::array::uniform7(-3.1f64..2.0),
            width in prop::array::uniform7(0.5f64..7.0),
        ) {
            let robot = iiwa();
            let arm = SrsArm::of(&robot).unwrap();
            let q = robot.per_joint(|joint| joint.limits.upper).component_mul(&robot.joint_vector(&unit).unwrap());
            prop_assume!(q[1].abs() > 0.01 && q[3].abs() > 0.01 && q[5].abs() > 0.01);
            let circle = arm.elbow_circle(&robot.gripper_pose(&q)).unwrap();
            let mut ranges = Ranges::default();
            (0..7).for_each(|i| ranges[i] = [low[i], (low[i] + width[i]).min(3.1)]);
            let arcs = arm.swivels(&circle, &ranges);
            for branch in Branch::ALL {
                for step in -300..300 {
                    let swivel = f64::from(step) * 0.01 + 0.003;
                    let q = arm.solve_branch(&circle, swivel, branch);
                    let contains = arcs.iter().any(|(of, [low, high])| *of == branch && (*low..=*high).contains(&swivel));
                    // Distance by which the worst joint is inside its range.
                    let inside = (0..7).map(|i| (q[i] - ranges[i][0]).min(ranges[i][1] - q[i])).fold(9.0, f64::min);
                    prop_assert!(inside.abs() < 1e-9 || contains == (inside > 0.0), "{branch:?} {swivel} {q}");
                }
            }
        }

        /// The distance from shoulder to wrist determines how far the elbow is bent, and bending it more or
        /// less takes the wrist out of the range.
        #[test]
        fn the_wrist_is_as_far_away_as_the_elbow_lets_it(
            unit in prop::array::uniform7(-0.99f64..0.99), below in 0.001f64..1.0, above in 0.001f64..1.0,
        ) {
            let robot = iiwa();
            let arm = SrsArm::of(&robot).unwrap();
            let q = robot.per_joint(|joint| joint.limits.upper).component_mul(&robot.joint_vector(&unit).unwrap());
            prop_assume!(q[3].abs() > 0.01);
            let distance = (robot.gripper_pose(&q) * arm.wrist_in_gripper() - arm.shoulder).norm_squared();
            let within = |range| {
                let [least, most] = arm.wrist_distances_squared(range);
                (least..=most).contains(&distance)
            };
            prop_assert!(within([q[3] - below, q[3] + above]));
            let bend = q[3].abs();
            prop_assert!(!within([bend + 1e-6, bend + above]) && !within([-bend - below, -bend - 1e-6]));
            prop_assert!(!within([0.0, bend - 1e-6]));
        }

        /// No joint rotates by more than its bound while the elbow moves.
        #[test]
        fn joints_turn_no_more_than_claimed(
            unit in prop::array::uniform7(-0.99f64..0.99), swivel in -3.1f64..3.1, by in 0.001f64..0.3, fraction in -1.0f64..1.0,
        ) {
            let robot = iiwa();
            let arm = SrsArm::of(&robot).unwrap();
            let q = robot.per_joint(|joint| joint.limits.upper).component_mul(&robot.joint_vector(&unit).unwrap());
            prop_assume!(q[3].abs() > 0.01);
            let circle = arm.elbow_circle(&robot.gripper_pose(&q)).unwrap();
            for branch in Branch::ALL {
                let most = arm.turned_by(&circle, swivel, branch, by);
                let before = arm.solve_branch(&circle, swivel, branch);
                let after = arm.solve_branch(&circle, swivel + fraction * by, branch);
                for i in 0..7 {
                    let turn = (after[i] - before[i]).abs();
                    let turn = turn.min(std::f64::consts::TAU - turn);
                    prop_assert!(turn <= most[i] + 1e-9, "joint {i} turns by {turn}, not {}", most[i]);
                }
            }
        }

        /// FK ∘ IK is the identity for every solution, and the pose's own joint angles are among them.
        #[test]
        fn solutions_reach_the_pose(unit in prop::array::uniform7(-0.99f64..0.99), swivel in -3.1f64..3.1) {
            let robot = iiwa();
            let arm = SrsArm::of(&robot).unwrap();
            let q = robot.per_joint(|joint| joint.limits.upper).component_mul(&robot.joint_vector(&unit).unwrap());
            prop_assume!(q[1].abs() > 0.01 && q[3].abs() > 0.01 && q[5].abs() > 0.01);
            let X_WL = robot.link_poses(&q);
            let X_WG = robot.gripper_in(&X_WL);
            let circle = arm.elbow_circle(&X_WG).unwrap();
            // The elbow's own swivel.
            let at_zero = robot.link_poses(&JointVector::zeros())[3].rotation;
            let upper = X_WL[3].rotation * (at_zero.inverse() * arm.along.into_inner());
            let own = libm::atan2(upper.dot(&circle.across[1]), upper.dot(&circle.across[0]));
            let solutions = |swivel| Branch::ALL.map(|branch| arm.solve_branch(&circle, swivel, branch));
            for solution in solutions(swivel).into_iter().chain(solutions(own)) {
                let reached = robot.gripper_pose(&solution);
                prop_assert!((reached.translation.vector - X_WG.translation.vector).norm() < 1e-9);
                prop_assert!(reached.rotation.angle_to(&X_WG.rotation) < 1e-7);
            }
            prop_assert!(solutions(own).iter().any(|solution| (solution - q).amax() < 1e-6), "{q} not among them");
        }
    }
}
