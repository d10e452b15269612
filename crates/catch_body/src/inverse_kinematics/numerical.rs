//! Numerical inverse kinematics for arms without a closed form: damped Gauss–Newton from several starts, and
//! a walk along the redundancy from what it finds. Deterministic.

use nalgebra::{Cholesky, Matrix6, Point3, U6, Vector6};

use crate::{JointVector, MAX_JOINTS, Pose, Robot, robot::Jacobian};

/// Length in metres that counts as much as a radian, about that of a hand.
const LENGTH_M: f64 = 0.3;
/// Steps from one start.
const STEPS: usize = 14;
/// An error of this size, in metres and radians, is none.
const TOLERANCE: f64 = 1e-10;
/// Error of the position that counts as none where the orientation is free, in metres.
const TURNED_TOLERANCE_M: f64 = 1e-5;
/// Starts besides the first.
const STARTS: usize = 10;
/// Length of a step along the redundancy in radians, and the most steps each way.
const STRIDE_RAD: f64 = 0.12;
const STRIDES: usize = 10;
/// Solutions closer together than this are one.
const SAME_RAD: f64 = 0.03;

/// Starts closer together than this are one.
const NEARBY_RAD: f64 = 0.1;

/// Lowest and highest position of every joint.
pub type Ranges = [[f64; 2]; MAX_JOINTS];

impl Robot {
    /// The ranges that the arm's limits leave to its joints; zero beyond the last joint.
    pub fn joint_ranges(&self) -> Ranges {
        std::array::from_fn(|i| self.joints.get(i).map_or([0.0; 2], |it| [it.limits.lower, it.limits.upper]))
    }

    /// Joint positions in radians near `from` and within `ranges` that put the gripper at `X_WG`, its pose in
    /// W. `None` if the iteration finds none, which does not prove that there are none.
    ///
    /// Δq = Jᵀ(J·Jᵀ + λ·1)⁻¹·e with λ ∝ |e|² (Levenberg; Sugihara, Solvability-unconcerned inverse
    /// kinematics, 2011). A joint that a step would push out of its range stays at its end and leaves the
    /// rest to the others.
    pub fn nearby_solution(&self, X_WG: &Pose, from: &JointVector, ranges: &Ranges) -> Option<JointVector> {
        self.solution_near(X_WG, None, from, ranges)
    }

    /// Joint positions for arms whose joints are too few for every pose: within `ranges`, near `from` and
    /// near the middle. They put the point `p_G` of the gripper where it is at `X_WG`, and turn the gripper
    /// toward that pose as far as they can.
    pub fn turned_solutions(
        &self,
        X_WG: &Pose,
        p_G: &Point3<f64>,
        from: &JointVector,
        ranges: &Ranges,
    ) -> Vec<JointVector> {
        self.of_two_starts(from, ranges, |start| self.solution_near(X_WG, Some(p_G), start, ranges))
    }

    /// The iteration of [`nearby_solution`](Self::nearby_solution). Where the gripper may turn about a point,
    /// errors of the orientation count less with every step: in the end the position is exact.
    fn solution_near(
        &self,
        X_WG: &Pose,
        about_G: Option<&Point3<f64>>,
        from: &JointVector,
        ranges: &Ranges,
    ) -> Option<JointVector> {
        let (p_G, may_turn) = (about_G.copied().unwrap_or_default(), about_G.is_some());
        let mut length_m = LENGTH_M;
        let mut q = JointVector::from_fn(|i, _| from[i].clamp(ranges[i][0], ranges[i][1].max(ranges[i][0])));
        let mut before = f64::INFINITY;
        for step in 0..STEPS {
            let X_WL = self.link_poses(&q);
            let X_now = self.gripper_in(&X_WL);
            let mut error = Vector6::zeros();
            let turn = (X_WG.rotation * X_now.rotation.inverse()).scaled_axis();
            error.fixed_rows_mut::<3>(0).copy_from(&(turn * length_m));
            error.fixed_rows_mut::<3>(3).copy_from(&(X_WG * p_G - X_now * p_G));
            let size = error.norm();
            if size < TOLERANCE {
                return Some(q);
            }
            if may_turn && step + 1 == STEPS {
                return (error.fixed_rows::<3>(3).norm() < TURNED_TOLERANCE_M).then_some(q);
            }
            // An error that has not halved in a few steps is stuck at the ends of the ranges.
            if step % 4 == 3 && !may_turn {
                if size > before / 2.0 {
                    return None;
                }
                before = size;
            }
            let mut J = self.jacobian(&X_WL, &(X_now * p_G));
            J.fixed_rows_mut::<3>(0).scale_mut(length_m);
            if may_turn {
                length_m /= 2.0;
            }
            let mut delta = JointVector::zeros();
            let mut free = [true; MAX_JOINTS];
            // Joints at their ends are taken out once; a second round would seldom change anything.
            for _ in 0..2 {
                let damped = J * J.transpose() + Matrix6::identity() * (1e-12 + 1e-2 * size * size);
                delta = J.transpose() * damped.cholesky()?.solve(&error);
                for i in 0..self.dof() {
                    let next = q[i] + delta[i];
                    if free[i] && (next < ranges[i][0] || next > ranges[i][1]) {
                        free[i] = false;
                        J.column_mut(i).fill(0.0);
                    }
                }
            }
            for i in 0..self.dof() {
                q[i] = (q[i] + delta[i]).clamp(ranges[i][0], ranges[i][1].max(ranges[i][0]));
            }
        }
        None
    }

    /// Joint positions within `ranges` that put the gripper at `X_WG`, at most two: near `from` and near the
    /// middle of the ranges.
    pub fn first_solutions_within(&self, X_WG: &Pose, from: &JointVector, ranges: &Ranges) -> Vec<JointVector> {
        self.of_two_starts(from, ranges, |start| self.nearby_solution(X_WG, start, ranges))
    }

    /// Solutions of an iteration from two starts, at most two.
    fn of_two_starts(
        &self,
        from: &JointVector,
        ranges: &Ranges,
        solve: impl Fn(&JointVector) -> Option<JointVector>,
    ) -> Vec<JointVector> {
        if (0..self.dof()).any(|i| ranges[i][0] > ranges[i][1]) {
            return Vec::new();
        }
        let middle = JointVector::from_fn(|i, _| f64::midpoint(ranges[i][0], ranges[i][1]));
        // Of an arm that stands still the ranges lie about where it is.
        let starts = [Some(*from), ((middle - from).amax() > NEARBY_RAD).then_some(middle)];
        let mut found: Vec<JointVector> = Vec::with_capacity(starts.len());
        for q in starts.iter().flatten().filter_map(solve) {
            if found.iter().all(|known| (known - q).amax() >= SAME_RAD) {
                found.push(q);
            }
        }
        found
    }

    /// Some joint positions within `ranges` that put the gripper at `X_WG`, those along the null space of an
    /// arm of more than six joints among them. Starts at `from`, then all over the ranges.
    pub fn solutions_within(&self, X_WG: &Pose, from: &JointVector, ranges: &Ranges) -> Vec<JointVector> {
        let dof = self.dof();
        if (0..dof).any(|i| ranges[i][0] > ranges[i][1]) {
            return Vec::new();
        }
        let mut found: Vec<JointVector> = Vec::new();
        for start in 0..=STARTS {
            let seed = if start == 0 {
                *from
            } else {
                // Additive recurrence with the roots of xᵈ⁺¹ = x + 1 (Roberts, The unreasonable effectiveness
                // of quasirandom sequences, 2018).
                let root = (0..30).fold(2.0_f64, |x, _| libm::pow(1.0 + x, 1.0 / (dof as f64 + 1.0)));
                JointVector::from_fn(|i, _| {
                    let fraction = (0.5 + start as f64 / root.powi(i as i32 + 1)).fract();
                    if i < dof { ranges[i][0] + fraction * (ranges[i][1] - ranges[i][0]) } else { 0.0 }
                })
            };
            let Some(q) = self.nearby_solution(X_WG, &seed, ranges) else { continue };
            if found.iter().any(|known| (known - q).amax() < SAME_RAD) {
                continue;
            }
            found.push(q);
            for direction in 0..dof.saturating_sub(6) {
                for sign in [1.0, -1.0] {
                    self.walk(X_WG, &q, (direction, sign), ranges, &mut found);
                }
            }
        }
        found
    }

    /// Follows the redundancy from `q`, adding what it passes until it leaves the ranges or comes to what is
    /// known.
    fn walk(
        &self,
        X_WG: &Pose,
        q: &JointVector,
        (direction, sign): (usize, f64),
        ranges: &Ranges,
        found: &mut Vec<JointVector>,
    ) {
        let mut q = *q;
        let mut heading: Option<JointVector> = None;
        for _ in 0..STRIDES {
            let Some(null_space) = NullSpace::at(self, &q) else { return };
            let along = match heading {
                Some(heading) => null_space.project(&heading),
                None => null_space.directions()[direction] * sign,
            };
            let Some(along) = along.try_normalize(1e-6) else { return };
            heading = Some(along);
            let Some(next) = self.nearby_solution(X_WG, &(q + along * STRIDE_RAD), ranges) else { return };
            if (next - q).norm() < STRIDE_RAD / 4.0 || found.iter().any(|known| (known - next).amax() < SAME_RAD) {
                return;
            }
            found.push(next);
            q = next;
        }
    }

    /// The direction of unit length in which joints can move at `q` without the gripper, in which that joint
    /// moves most that can; `None` without redundancy.
    pub fn self_motion(&self, q: &JointVector) -> Option<JointVector> {
        if self.dof() <= 6 { None } else { NullSpace::at(self, q)?.directions().first()?.try_normalize(1e-6) }
    }
}

/// Joint motions that leave the gripper where it is.
struct NullSpace {
    J: Jacobian,
    factor: Cholesky<f64, U6>,
    dof: usize,
}

impl NullSpace {
    fn at(robot: &Robot, q: &JointVector) -> Option<Self> {
        let X_WL = robot.link_poses(q);
        let J = robot.jacobian(&X_WL, &Point3::from(robot.gripper_in(&X_WL).translation.vector));
        let damped = J * J.transpose() + Matrix6::identity() * 1e-9;
        Some(Self { J, factor: damped.cholesky()?, dof: robot.dof() })
    }

    /// Projects a joint motion onto the null space: the part of it that does not move the gripper.
    fn project(&self, v: &JointVector) -> JointVector {
        v - self.J.transpose() * self.factor.solve(&(self.J * v))
    }

    /// Null-space projections of each joint's motion, the longest first.
    fn directions(&self) -> Vec<JointVector> {
        let mut all: Vec<JointVector> = (0..self.dof).map(|i| self.project(&JointVector::ith(i, 1.0))).collect();
        all.sort_by(|a, b| b.norm().total_cmp(&a.norm()));
        all
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::robot_file::tests::iiwa;
    use nalgebra::{UnitQuaternion, Vector3};

    /// Five joints hold a point where it is asked for, and mostly turn the hand no farther than they must.
    #[test]
    fn a_hand_turns_about_a_point() {
        let mut robot = iiwa();
        robot.joints.truncate(5);
        let ranges = robot.joint_ranges();
        let p_G = Point3::new(0.01, 0.09, 0.0);
        let mut least_turned = 0;
        for sample in 0..200 {
            let unit = |i: usize| (0.5 + f64::from(sample) * libm::sqrt([2.0, 3.0, 5.0, 7.0, 11.0][i])).fract() - 0.5;
            let q = JointVector::from_fn(|i, _| if i < 5 { 1.6 * ranges[i][1] * unit(i) } else { 0.0 });
            let turn = UnitQuaternion::from_scaled_axis(Vector3::from_fn(|i, _| 0.6 * unit(4 - i)));
            let X_WG = robot.gripper_pose(&q);
            let turned = X_WG.rotation * turn;
            let wanted = Pose::from_parts((X_WG * p_G - turned * p_G).into(), turned);
            let found = robot.turned_solutions(&wanted, &p_G, &q.add_scalar(0.05), &ranges);
            let X_now = found.first().map(|found| robot.gripper_pose(found));
            assert!(X_now.is_none_or(|it| (it * p_G - wanted * p_G).norm() < 1e-5));
            least_turned += usize::from(X_now.is_some_and(|it| it.rotation.angle_to(&turned) < turn.angle() + 1e-3));
        }
        assert!(least_turned > 180, "{least_turned} of 200");
    }
}
