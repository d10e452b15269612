//! Proofs that a catch whose time and pose are given is out of reach. Where no arc of swivel angles is left,
//! there is nothing more to prove; here is what else can bar it.

use catch_body::{
    MAX_JOINTS,
    inverse_kinematics::{Branch, ElbowCircle, SrsArm},
    quadratic_program::{Hessian, MAX_VARIABLES, Row, Square, Variables},
    robot::Jacobian,
};
use catch_bot::trajectory_optimization::{MAX_SPEED_FRACTION, posture::PostureFinder, reachability::Interval};
use nalgebra::{Point3, SMatrix, Vector3};

use crate::posed::Task;

/// Pieces of arcs that a proof may look at.
const PROOF_PIECES: usize = 4000;

impl Task<'_> {
    /// Returns whether no swivel that the arm can reach leaves joint velocities that keep the direction.
    pub fn is_proven_unreachable(&self) -> bool {
        let PostureFinder::Srs(srs) = &self.planner.finder else { return false };
        let Some(circle) = srs.elbow_circle(&self.target.X_WG) else { return true };
        let proof = Proof { task: self, srs, circle };
        let mut pieces = PROOF_PIECES;
        let arcs = srs.swivels(&circle, &self.ranges());
        arcs.into_iter().all(|(branch, arc)| proof.is_barred(branch, arc, &mut pieces))
    }

    /// Returns whether no posture is left because there can be none: always so where they are found in closed
    /// form, else if the gripper cannot come so far, each joint moving it by no more than its angle times the
    /// length of the arm beyond it.
    pub fn is_too_far(&self) -> bool {
        let planner = self.planner;
        if matches!(planner.finder, PostureFinder::Srs(_)) {
            return true;
        }
        let from = planner.robot.gripper_pose(&self.start.state.q);
        let far = (from.translation.vector - self.target.X_WG.translation.vector).norm();
        let reached = (0..planner.robot.dof()).map(|i| {
            let angles = self.reaches[i].displacements();
            planner.extents_m[i] * angles.high.max(-angles.low)
        });
        far > reached.sum::<f64>()
    }
}

/// Inputs of the proof over the arcs of an S-R-S arm.
struct Proof<'a> {
    task: &'a Task<'a>,
    srs: &'a SrsArm,
    circle: ElbowCircle,
}

impl Proof<'_> {
    /// Returns whether an arc is proven to leave no velocities, by bisection: a direction λ separates all
    /// velocities that the grasp centre can have, wherever on the arc the elbow is, from the object's
    /// direction if
    ///
    /// ```text
    ///     max λᵀ·J_v·q̇  =  Σ max(λᵀJᵢ·q̇ᵢ) + Σ |ΔJᵢ|·max|q̇ᵢ|   <   min λᵀ·s·v_O  =  min(0, s_max·λᵀv_O)
    /// ```
    /// where q̇ᵢ has all values that it has anywhere on the arc and |ΔJᵢ| bounds how J's columns vary along
    /// it: a column z × (p − o) with p at rest turns with the joints before it, |ΔJᵢ| ≤ Σₖ |Δqₖ|·(|p − oᵢ| +
    /// |oᵢ − oₖ|) for k < i, and the far ends of the arm's parts bound both distances.
    fn is_barred(&self, branch: Branch, arc: [f64; 2], pieces: &mut usize) -> bool {
        if *pieces == 0 {
            return false;
        }
        *pieces -= 1;
        let (middle, half) = (f64::midpoint(arc[0], arc[1]), (arc[1] - arc[0]) / 2.0);
        self.is_barred_as_one(branch, middle, half)
            || (self.is_barred(branch, [arc[0], middle], pieces) && self.is_barred(branch, [middle, arc[1]], pieces))
    }

    fn is_barred_as_one(&self, branch: Branch, swivel: f64, half: f64) -> bool {
        let robot = &self.task.planner.robot;
        let q = self.srs.solve_branch(&self.circle, swivel, branch);
        let turns = self.srs.turned_by(&self.circle, swivel, branch, half + 1e-9);
        let mut bounds = [Interval { low: 0.0, high: 0.0 }; MAX_JOINTS];
        for (i, turn) in turns.iter().enumerate() {
            let far = self.task.reaches[i].displacements();
            let at = |by: f64| {
                let displacement = (q[i] + by - self.task.start.state.q[i]).clamp(far.low, far.high);
                self.task.reaches[i].terminal_velocities(displacement)
            };
            // Both ends rise with the displacement.
            bounds[i] = Interval { low: at(-turn).low - 1e-9, high: at(*turn).high + 1e-9 };
        }
        let jacobian = self.task.jacobian(&q);
        let Some(lambda) = shortfall(&jacobian, &self.task.target.v_WO, &bounds) else { return false };
        let X_WL = robot.link_poses(&q);
        let grasp_centre: Point3<f64> = self.task.target.X_WG * self.task.planner.gripper.grasp_centre();
        let mut reached = 0.0;
        for i in 0..turns.len() {
            let (_, origin) = robot.joint_axis(&X_WL, i);
            let along = lambda.dot(&jacobian.fixed_view::<3, 1>(3, i));
            let varied: f64 = (0..i)
                .map(|k| {
                    let (_, before) = robot.joint_axis(&X_WL, k);
                    // The distances vary along the arc, too: each by less than the turns before it move its
                    // ends.
                    let distance = (grasp_centre - origin).norm() + (origin - before).norm();
                    turns[k] * (distance + turns[..i].iter().sum::<f64>() * 2.0 * self.task.planner.longest_reach_m())
                })
                .sum();
            let Interval { low, high } = bounds[i];
            reached += (along * low).max(along * high) + varied * lambda.norm() * low.abs().max(high.abs());
        }
        reached < (MAX_SPEED_FRACTION * lambda.dot(&self.task.target.v_WO)).min(0.0)
    }
}

/// Shortfall between the velocities that the grasp centre can have within `bounds` and those along the
/// object's: the shortest difference s·v − J_v·q̇.
pub fn shortfall(jacobian: &Jacobian, v_WO: &Vector3<f64>, bounds: &[Interval; MAX_JOINTS]) -> Option<Vector3<f64>> {
    const S: usize = MAX_JOINTS;
    let linear = jacobian.fixed_rows::<3>(3);
    let mut A = SMatrix::<f64, 3, MAX_VARIABLES>::zeros();
    A.fixed_view_mut::<3, MAX_JOINTS>(0, 0).copy_from(&linear);
    A.set_column(S, &-v_WO);
    let H = A.transpose() * A + Square::identity() * 1e-6;
    let rows: [Row; S + 1] = std::array::from_fn(|i| Row::new(Variables::ith(i, 1.0)));
    let limits: [_; S + 1] =
        std::array::from_fn(|i| bounds.get(i).map_or([0.0, MAX_SPEED_FRACTION], |it| [it.low, it.high]));
    let x = Hessian::new(&H)?.minimize(&Variables::zeros(), &rows, &limits, 0).ok()?;
    Some(-A * x)
}
