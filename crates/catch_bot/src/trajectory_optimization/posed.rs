//! A catch whose time and pose are given: the redundancy, the joint velocities and the motion are still to be found.
//!
//! The arm is redundant, so a pose leaves arcs of swivel angles ([`SrsArm::swivels`]), cut to what each joint can reach in the
//! time: where none is left, the catch is out of reach whatever the redundancy. On the arcs the highest speed fraction is
//! sought, first with the exact bounds of [`super::reachability`], which are optimistic for a spline, then with the
//! spline's own range of end velocities. Within that range the spline's program is feasible, so nothing fails afterwards.

use catch_body::{
    JointVector, MAX_JOINTS, Pose,
    inverse_kinematics::{Branch, ElbowCircle, SrsArm},
    robot::Jacobian,
};
use catch_cell::BSpline;
use nalgebra::{Point3, Vector3};

use super::{
    CatchSplines, Planner, Refusal, Start,
    arrival::{Arrival, Weights, arrival, shortfall},
    joint_spline::{End, JointPoints, JointState},
    motion::{ROUNDING, Shares},
    reachability::{Interval, JointReach},
    search::effort,
};

/// Where the gripper is to be, and where the object goes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Target {
    /// When.
    pub catch_s: f64,
    /// Pose of the gripper then.
    pub X_WG: Pose,
    /// Velocity of the object then.
    pub v_WO: Vector3<f64>,
}

/// A motion to a given pose.
#[derive(Debug, Clone, PartialEq)]
pub struct PosedCatch {
    /// Joint positions at the catch.
    pub q: JointVector,
    /// Which of the arm's solutions that is.
    pub branch: Branch,
    /// Swivel angle of the elbow.
    pub swivel: f64,
    /// Share of the object's velocity at which the grasp centre moves along.
    pub speed_fraction: f64,
    /// The motion, ending at the catch.
    pub spline: BSpline,
}

/// Swivel angles that are looked at in each arc, as shares of it.
const SHARES_OF_ARC: [f64; 5] = [0.5, 0.25, 0.75, 0.05, 0.95];
/// A speed fraction this close to the best possible, relative, needs no further search.
const GOOD_ENOUGH: f64 = 5e-3;
/// Share of the acceleration limits at which the exact bounds are about those of a spline.
const SPLINE_SHARE: f64 = 0.97;
/// Steps of the search along the swivel for a higher speed fraction.
const REFINEMENTS: usize = 8;
/// Pieces of arcs that a proof may look at.
const PROOF_PIECES: usize = 4000;
/// No point of an arm that throws are caught with is farther from another, in metres.
const LONGEST_M: f64 = 2.0;
/// Distance from the extreme velocity of a spline at which another one surely has it, in rad/s.
const INSIDE: f64 = 1e-7;
/// Share of the acceleration limits at which the exact bounds are usually within a spline's reach.
const EASY_SHARE: f64 = 0.9;

/// A solution of the inverse kinematics.
#[derive(Clone, Copy)]
struct Posture {
    branch: Branch,
    swivel: f64,
    arc: [f64; 2],
    q: JointVector,
    effort: f64,
}

/// One call's circumstances.
struct Task<'a> {
    planner: &'a Planner,
    srs: &'a SrsArm,
    splines: &'a CatchSplines,
    start: &'a Start,
    target: &'a Target,
    circle: ElbowCircle,
    reaches: [JointReach; MAX_JOINTS],
}

impl Planner {
    /// The motion to `target` with the highest speed fraction over all redundancy. The acceleration at the start is free.
    ///
    /// # Errors
    /// [`Refusal::OutOfReach`] where no motion within the velocity and acceleration limits exists, whatever the redundancy;
    /// [`Refusal::NoMotion`] where none was found.
    pub fn catch_at(&self, start: &Start, target: &Target) -> Result<PosedCatch, Refusal> {
        let task = self.task(start, target)?;
        let mut postures = task.postures();
        if postures.is_empty() {
            return Err(Refusal::OutOfReach);
        }
        // Where the arm need not hurry, the first posture will do.
        postures.sort_by(|a, b| a.effort.total_cmp(&b.effort));
        if let Some(found) = postures.iter().find_map(|posture| task.easily(posture)) {
            return Ok(found);
        }
        // Else the most promising first, until none that is left can be better.
        let mut promising: Vec<(f64, Posture)> = postures
            .iter()
            .filter_map(|posture| Some((task.optimistic(&posture.q, 1.0)?, *posture)))
            .map(|(arrival, posture)| (arrival.speed_fraction, posture))
            .collect();
        promising.sort_by(|a, b| b.0.total_cmp(&a.0));
        let mut best: Option<PosedCatch> = None;
        let mut tried: Vec<[f64; 2]> = Vec::new();
        for (optimistic, posture) in &promising {
            let fraction = best.as_ref().map_or(-1.0, |it| it.speed_fraction);
            if *optimistic <= fraction * (1.0 + GOOD_ENOUGH) {
                break;
            }
            // The first posture of an arc is moved along it; the others are for arcs with no motion at the best place.
            let posture = if tried.contains(&posture.arc) { *posture } else { task.moved(posture, *optimistic) };
            tried.push(posture.arc);
            if let Some(found) = task.solve(&posture, fraction) {
                best = Some(found);
            }
        }
        match best {
            Some(found) => Ok(found),
            None if promising.is_empty() && task.is_proven_unreachable() => Err(Refusal::OutOfReach),
            None => Err(Refusal::NoMotion),
        }
    }

    /// The same catch for a target that has moved a little: the elbow stays where it is.
    pub fn retarget_at(&self, start: &Start, target: &Target, known: &PosedCatch) -> Result<PosedCatch, Refusal> {
        let task = self.task(start, target)?;
        let q = task.srs.solve_branch(&task.circle, known.swivel, known.branch);
        let posture =
            Posture { branch: known.branch, swivel: known.swivel, arc: [known.swivel; 2], q, effort: task.effort(&q) };
        let found =
            (posture.effort <= 1.0).then(|| task.easily(&posture).or_else(|| task.solve(&posture, -1.0))).flatten();
        let close = |it: &PosedCatch| it.speed_fraction >= known.speed_fraction * 0.98;
        match found.filter(close) {
            Some(found) => Ok(found),
            None => self.catch_at(start, target),
        }
    }

    fn task<'a>(&'a self, start: &'a Start, target: &'a Target) -> Result<Task<'a>, Refusal> {
        let srs = self.srs.as_ref().ok_or(Refusal::NoMotion)?;
        let circle = srs.elbow_circle(&target.X_WG).ok_or(Refusal::OutOfReach)?;
        let shares = Shares { velocity: self.config.velocity_share, acceleration: 1.0 - ROUNDING };
        let reaches = self.reaches(start, target.catch_s - start.time_s, shares);
        Ok(Task { planner: self, srs, splines: &self.standing_splines, start, target, circle, reaches })
    }
}

impl Task<'_> {
    /// What each joint can reach, within its range.
    fn ranges(&self) -> [[f64; 2]; 7] {
        let margin = self.planner.config.position_margin_rad;
        std::array::from_fn(|i| {
            let far = self.reaches[i].displacements();
            let limits = &self.planner.robot.joints[i].limits;
            let q = self.start.state.q[i];
            [(limits.lower + margin).max(q + far.low), (limits.upper - margin).min(q + far.high)]
        })
    }

    /// Some solutions of every arc that the arm can reach.
    fn postures(&self) -> Vec<Posture> {
        let mut postures = Vec::with_capacity(64);
        for (branch, arcs) in self.srs.swivels(&self.circle, &self.ranges()) {
            for &arc in arcs.iter() {
                for share in SHARES_OF_ARC {
                    let swivel = arc[0] + share * (arc[1] - arc[0]);
                    postures.push(self.posture(branch, arc, swivel));
                }
            }
        }
        postures
    }

    fn posture(&self, branch: Branch, arc: [f64; 2], swivel: f64) -> Posture {
        let q = self.srs.solve_branch(&self.circle, swivel, branch);
        Posture { branch, swivel, arc, q, effort: self.effort(&q) }
    }

    fn effort(&self, q: &JointVector) -> f64 {
        effort(&self.reaches, &self.start.state.q, q, self.planner.robot.dof()).unwrap_or(2.0)
    }

    fn jacobian(&self, q: &JointVector) -> Jacobian {
        let grasp_centre: Point3<f64> = self.target.X_WG * self.planner.gripper.grasp_centre();
        self.planner.robot.jacobian(&self.planner.robot.link_poses(q), &grasp_centre)
    }

    fn arrival(&self, jacobian: &Jacobian, bounds: &[Interval; MAX_JOINTS]) -> Option<Arrival> {
        let most = self.planner.config.max_speed_fraction;
        arrival(jacobian, &self.target.v_WO, bounds, most, &Weights::FASTEST)
    }

    /// The arrival within the exact bounds, of which no spline can do better.
    fn optimistic(&self, q: &JointVector, acceleration_share: f64) -> Option<Arrival> {
        self.arrival(&self.jacobian(q), &self.exact_bounds(q, acceleration_share)?)
    }

    fn exact_bounds(&self, q: &JointVector, acceleration_share: f64) -> Option<[Interval; MAX_JOINTS]> {
        let mut bounds = [Interval { low: 0.0, high: 0.0 }; MAX_JOINTS];
        for i in 0..self.planner.robot.dof() {
            let mut reach = self.reaches[i];
            reach.acceleration *= acceleration_share;
            let displacement = q[i] - self.start.state.q[i];
            let far = reach.displacements();
            if displacement < far.low - 1e-9 || displacement > far.high + 1e-9 {
                return None;
            }
            bounds[i] = reach.arrival_velocities(displacement.clamp(far.low, far.high));
        }
        Some(bounds)
    }

    /// The motion to a posture at the highest speed fraction, if the arm need not exhaust its limits for it.
    fn easily(&self, posture: &Posture) -> Option<PosedCatch> {
        let enough = self.planner.config.max_speed_fraction * (1.0 - GOOD_ENOUGH);
        let arrival = self.optimistic(&posture.q, EASY_SHARE).filter(|arrival| arrival.speed_fraction >= enough)?;
        let duration_s = self.target.catch_s - self.start.time_s;
        let mut points = vec![JointVector::zeros(); self.splines.at.control_points()];
        for i in 0..self.planner.robot.dof() {
            self.set_points(&mut points, i, &self.joint_spline(i, posture.q[i], arrival.dq[i], duration_s)?);
        }
        self.finished(posture, &arrival, points)
    }

    /// The motion to a posture with the highest speed fraction that a spline can have, if that is above `least`.
    ///
    /// It starts from the exact bounds; a joint whose spline does not exist there gets the spline's own bound on that side.
    fn solve(&self, posture: &Posture, least: f64) -> Option<PosedCatch> {
        let dof = self.planner.robot.dof();
        let duration_s = self.target.catch_s - self.start.time_s;
        let mut bounds = self.exact_bounds(&posture.q, 1.0)?;
        let jacobian = self.jacobian(&posture.q);
        let mut points = vec![JointVector::zeros(); self.splines.at.control_points()];
        for _ in 0..=2 * dof {
            let arrival = self.arrival(&jacobian, &bounds).filter(|it| it.speed_fraction > least)?;
            let mut all = true;
            for (i, bound) in bounds.iter_mut().enumerate().take(dof) {
                match self.joint_spline(i, posture.q[i], arrival.dq[i], duration_s) {
                    Some(joint) => self.set_points(&mut points, i, &joint),
                    None => {
                        all = false;
                        *bound = self.cut(i, posture.q[i], arrival.dq[i], bound)?;
                    }
                }
            }
            if all {
                return self.finished(posture, &arrival, points);
            }
        }
        None
    }

    /// The bounds of joint `i` cut to what a spline can do, on the side on which it cannot have the end velocity `dq`.
    fn cut(&self, i: usize, q: f64, dq: f64, bound: &Interval) -> Option<Interval> {
        let state = &self.start.state;
        let duration_s = self.target.catch_s - self.start.time_s;
        let limits = self.planner.limits(i, state, self.shares());
        let start = JointState { q: state.q[i], dq: state.dq[i], ddq: state.ddq[i] };
        let extreme = |sign: f64| {
            let found = self.splines.range.end_velocity(&start, &End::Extreme { q, sign }, duration_s, &limits)?;
            // A hair inside, so that rounding cannot make the program for this end infeasible.
            Some(found - sign * INSIDE)
        };
        let upper_first = bound.high - dq < dq - bound.low;
        for side in [upper_first, !upper_first] {
            let at = extreme(if side { 1.0 } else { -1.0 })?;
            if side && at < dq {
                return Some(Interval { low: bound.low.min(at), high: at });
            }
            if !side && at > dq {
                return Some(Interval { low: at, high: bound.high.max(at) });
            }
        }
        None
    }

    fn joint_spline(&self, i: usize, q: f64, dq: f64, duration_s: f64) -> Option<JointPoints> {
        let state = &self.start.state;
        let limits = self.planner.limits(i, state, self.shares());
        let start = JointState { q: state.q[i], dq: state.dq[i], ddq: state.ddq[i] };
        let end = End::At { q, dq, ddq: [f64::NEG_INFINITY, f64::INFINITY] };
        self.splines.at.solve(&start, &end, duration_s, &limits, self.planner.robot.comfortable_q[i])
    }

    fn set_points(&self, points: &mut [JointVector], i: usize, joint: &JointPoints) {
        for (point, value) in points.iter_mut().zip(joint) {
            point[i] = *value;
        }
    }

    fn finished(&self, posture: &Posture, arrival: &Arrival, control_points: Vec<JointVector>) -> Option<PosedCatch> {
        let (start_s, duration_s) = (self.start.time_s, self.target.catch_s - self.start.time_s);
        let knots_s = self.splines.at.knots.iter().map(|knot| start_s + knot * duration_s).collect();
        let spline = BSpline { knots_s, control_points };
        let Posture { q, branch, swivel, .. } = *posture;
        let speed_fraction = arrival.speed_fraction;
        self.planner.keeps_torque(&spline).then_some(PosedCatch { q, branch, swivel, speed_fraction, spline })
    }

    fn shares(&self) -> Shares {
        Shares { velocity: self.planner.config.velocity_share, acceleration: 1.0 - ROUNDING }
    }

    /// Moves the elbow within its arc toward higher speed fractions, by steps that shrink where they do not help. What counts
    /// are exact bounds a little inside the limits, which are about those of a spline.
    fn moved(&self, posture: &Posture, optimistic: f64) -> Posture {
        let value = |q: &JointVector| self.optimistic(q, SPLINE_SHARE).map_or(-1.0, |it| it.speed_fraction);
        let mut best = *posture;
        let mut most = value(&posture.q).min(optimistic);
        let mut step = (posture.arc[1] - posture.arc[0]) / 8.0;
        for _ in 0..REFINEMENTS {
            let better = [step, -step].iter().find_map(|by| {
                let swivel = (best.swivel + by).clamp(posture.arc[0], posture.arc[1]);
                let next = self.posture(posture.branch, posture.arc, swivel);
                let fraction = value(&next.q);
                (fraction > most).then_some((fraction, next))
            });
            match better {
                Some(found) => (most, best) = found,
                None => step /= 2.0,
            }
        }
        best
    }

    /// Whether no swivel that the arm can reach leaves joint velocities that keep the direction.
    fn is_proven_unreachable(&self) -> bool {
        let mut pieces = PROOF_PIECES;
        self.srs
            .swivels(&self.circle, &self.ranges())
            .iter()
            .all(|(branch, arcs)| arcs.iter().all(|arc| self.is_barred(*branch, *arc, &mut pieces)))
    }

    /// Whether an arc is proven to leave no velocities, by halves: a direction λ separates all that the grasp centre can do,
    /// wherever on the arc the elbow is, from the object's direction if
    ///
    /// ```text
    ///     max λᵀ·J_v·q̇  =  Σ max(λᵀJᵢ·q̇ᵢ) + Σ |ΔJᵢ|·max|q̇ᵢ|   <   min λᵀ·s·v_O  =  min(0, s_max·λᵀv_O)
    /// ```
    /// where q̇ᵢ has all values that it has anywhere on the arc and |ΔJᵢ| bounds how J's columns vary along it: a column
    /// z × (p − o) with p at rest turns with the joints before it, |ΔJᵢ| ≤ Σₖ |Δqₖ|·(|p − oᵢ| + |oᵢ − oₖ|) for k < i, and
    /// the far ends of the arm's parts bound both distances.
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
        let robot = &self.planner.robot;
        let q = self.srs.solve_branch(&self.circle, swivel, branch);
        let turns = self.srs.turned_by(&self.circle, swivel, branch, half + 1e-9);
        let mut bounds = [Interval { low: 0.0, high: 0.0 }; MAX_JOINTS];
        for (i, turn) in turns.iter().enumerate() {
            let far = self.reaches[i].displacements();
            let at = |by: f64| {
                let displacement = (q[i] + by - self.start.state.q[i]).clamp(far.low, far.high);
                self.reaches[i].arrival_velocities(displacement)
            };
            // Both ends rise with the displacement.
            bounds[i] = Interval { low: at(-turn).low - 1e-9, high: at(*turn).high + 1e-9 };
        }
        let jacobian = self.jacobian(&q);
        let most = self.planner.config.max_speed_fraction;
        let Some(lambda) = shortfall(&jacobian, &self.target.v_WO, &bounds, most) else { return false };
        let X_WL = robot.link_poses(&q);
        let grasp_centre: Point3<f64> = self.target.X_WG * self.planner.gripper.grasp_centre();
        let mut reached = 0.0;
        for i in 0..turns.len() {
            let (_, origin) = robot.joint_axis(&X_WL, i);
            let along = lambda.dot(&jacobian.fixed_view::<3, 1>(3, i));
            let varied: f64 = (0..i)
                .map(|k| {
                    let (_, before) = robot.joint_axis(&X_WL, k);
                    // The distances vary along the arc, too: each by less than the turns before it move its ends.
                    let distance = (grasp_centre - origin).norm() + (origin - before).norm();
                    turns[k] * (distance + turns[..i].iter().sum::<f64>() * 2.0 * LONGEST_M)
                })
                .sum();
            let Interval { low, high } = bounds[i];
            reached += (along * low).max(along * high) + varied * lambda.norm() * low.abs().max(high.abs());
        }
        reached < (most * lambda.dot(&self.target.v_WO)).min(0.0)
    }
}
