//! A catch whose time and pose are given: the redundancy, the joint velocities and the motion are still to be
//! found.
//!
//! The arm is redundant, so a pose leaves arcs of swivel angles
//! ([`posture`](catch_bot::trajectory_optimization::posture)), cut to what each joint can reach in the time:
//! where none is left, the catch is out of reach whatever the redundancy. On the arcs the highest speed
//! fraction is sought, first with the exact bounds of
//! [`reachability`](catch_bot::trajectory_optimization::reachability), which are optimistic for a spline,
//! then with the spline's own range of end velocities. Within that range the spline's program is feasible, so
//! nothing fails afterwards.

use catch_body::{JointVector, MAX_JOINTS, Pose, robot::Jacobian};
use catch_bot::grasp_selection;
use catch_bot::trajectory_optimization::{
    CatchSplines, MAX_SPEED_FRACTION, MotionPlanner, PlanningFailure, Start,
    failure_counter::FailureCounter,
    motion::{LimitScaling, ROUNDING},
    point_to_point::PointToPoint,
    posture::Posture,
    reachability::{Interval, ReachableSet, fraction_used},
    terminal_velocity::{TerminalVelocity, Weights},
};
use catch_cell::BSpline;
use nalgebra::{Point3, Vector3};

/// Target of a catch: pose of the gripper, and velocity of the object.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Target {
    /// Time of the catch, in seconds on the cell's clock.
    pub catch_s: f64,
    /// Pose of the gripper in W then.
    pub X_WG: Pose,
    /// Velocity of the object in W then, in m/s.
    pub v_WO: Vector3<f64>,
}

/// A motion to a given pose.
#[derive(Debug, Clone, PartialEq)]
pub struct PosedCatch {
    /// Joint positions at the catch.
    pub posture: Posture,
    /// Fraction of the object's velocity at which the grasp centre moves along.
    pub speed_fraction: f64,
    /// The motion, ending at the catch.
    pub spline: BSpline,
}

/// A speed fraction this close to the best possible, relative, needs no further search.
const GOOD_ENOUGH: f64 = 5e-3;
/// Fraction of the acceleration limits at which the exact bounds are about those of a spline.
const SPLINE_FRACTION: f64 = 0.97;
/// Steps of the search along the swivel for a higher speed fraction.
const REFINEMENTS: usize = 8;
/// Fraction of the acceleration limits at which the exact bounds are usually within a spline's reach.
const EASY_FRACTION: f64 = 0.9;

/// Inputs of one call.
pub(super) struct Task<'a> {
    pub planner: &'a MotionPlanner,
    splines: &'a CatchSplines,
    pub start: &'a Start,
    pub target: &'a Target,
    pub reaches: [ReachableSet; MAX_JOINTS],
    failures: FailureCounter,
    scaling: LimitScaling,
}

/// Plans catches whose time and pose are given, with the acceleration at the start free.
#[derive(Debug)]
pub struct PosedPlanner {
    /// Planner of the motions.
    pub motion: MotionPlanner,
    splines: CatchSplines,
}

impl PosedPlanner {
    /// Creates the planner over the motions that can be generated.
    pub fn new(motion: MotionPlanner) -> Self {
        let splines = CatchSplines::new(&[1.0; 10], false);
        Self { motion, splines }
    }

    /// The motion to `target` with the highest speed fraction over all redundancy.
    ///
    /// # Errors
    /// [`PlanningFailure::OutOfReach`] where no motion within the velocity and acceleration limits exists,
    /// whatever the redundancy; [`PlanningFailure::NoMotion`] where none was found.
    pub fn catch_at(&self, start: &Start, target: &Target) -> Result<PosedCatch, PlanningFailure> {
        let task = self.task(start, target);
        let mut postures = task.postures();
        if postures.is_empty() {
            return Err(if task.is_too_far() { PlanningFailure::OutOfReach } else { PlanningFailure::NoMotion });
        }
        // Where the arm need not hurry, the first posture will do.
        postures.sort_by(|a, b| a.0.total_cmp(&b.0));
        if let Some(found) = postures.iter().find_map(|(_, posture)| task.easily(posture)) {
            return Ok(found);
        }
        // Else the most promising first, until none that is left can be better.
        let mut promising: Vec<(f64, Posture)> = postures
            .iter()
            .filter_map(|(_, posture)| Some((task.optimistic(&posture.q, 1.0)?, *posture)))
            .map(|(terminal_velocity, posture)| (terminal_velocity.speed_fraction, posture))
            .collect();
        promising.sort_by(|a, b| b.0.total_cmp(&a.0));
        let mut best: Option<PosedCatch> = None;
        let mut tried: Vec<Option<[f64; 2]>> = Vec::new();
        for (optimistic, posture) in &promising {
            let fraction = best.as_ref().map_or(-1.0, |it| it.speed_fraction);
            if *optimistic <= fraction * (1.0 + GOOD_ENOUGH) {
                break;
            }
            // The first posture of an arc is moved along it; the others are for arcs with no motion at the
            // best place.
            let arc = posture.elbow.map(|elbow| elbow.arc);
            let posture = if tried.contains(&arc) { *posture } else { task.moved(posture, *optimistic) };
            tried.push(arc);
            if let Some(found) = task.solve(&posture, fraction) {
                best = Some(found);
            }
        }
        match best {
            Some(found) => Ok(found),
            None if promising.is_empty() && task.is_proven_unreachable() => Err(PlanningFailure::OutOfReach),
            None => Err(PlanningFailure::NoMotion),
        }
    }

    fn task<'a>(&'a self, start: &'a Start, target: &'a Target) -> Task<'a> {
        // Nothing is held back for replans.
        let scaling = LimitScaling { velocity: self.motion.config.velocity_scaling, acceleration: 1.0 - ROUNDING };
        let reaches = self.motion.reaches(start, target.catch_s - start.time_s, scaling);
        let failures = FailureCounter::default();
        Task { planner: &self.motion, splines: &self.splines, start, target, reaches, failures, scaling }
    }
}

impl Task<'_> {
    /// Interval of positions that each joint can reach, within its range.
    pub fn ranges(&self) -> [[f64; 2]; MAX_JOINTS] {
        self.planner.ranges(&self.reaches, &self.start.state.q)
    }

    /// Postures that the arm can reach, with the largest fraction of its reach that a joint uses.
    fn postures(&self) -> Vec<(f64, Posture)> {
        let found = self.planner.finder.postures(
            &self.planner.robot,
            &self.target.X_WG,
            &self.start.state.q,
            &self.ranges(),
            true,
        );
        found.into_iter().map(|posture| (self.reach_fraction(&posture.q), posture)).collect()
    }

    fn reach_fraction(&self, q: &JointVector) -> f64 {
        fraction_used(&self.reaches, &self.start.state.q, q, self.planner.robot.dof()).unwrap_or(2.0)
    }

    pub fn jacobian(&self, q: &JointVector) -> Jacobian {
        let grasp_centre: Point3<f64> = self.target.X_WG * self.planner.gripper.grasp_centre();
        self.planner.robot.jacobian(&self.planner.robot.link_poses(q), &grasp_centre)
    }

    fn point_to_point(&self, q: &JointVector) -> PointToPoint<'_> {
        PointToPoint {
            planner: self.planner,
            splines: self.splines,
            start: self.start,
            catch_s: self.target.catch_s,
            q: *q,
            v_WO: self.target.v_WO,
            restitution: grasp_selection::Config::default().expected_restitution(),
            jacobian: self.jacobian(q),
            scaling: self.scaling,
            weights: Weights::FASTEST,
            following: None,
            brakes: false,
            failures: &self.failures,
        }
    }

    /// The arrival within the exact bounds, of which no spline can do better.
    fn optimistic(&self, q: &JointVector, acceleration_scaling: f64) -> Option<TerminalVelocity> {
        self.point_to_point(q).terminal_velocity(&self.exact_bounds(q, acceleration_scaling)?)
    }

    fn exact_bounds(&self, q: &JointVector, acceleration_scaling: f64) -> Option<[Interval; MAX_JOINTS]> {
        let mut bounds = [Interval { low: 0.0, high: 0.0 }; MAX_JOINTS];
        for i in 0..self.planner.robot.dof() {
            let mut reach = self.reaches[i];
            reach.acceleration *= acceleration_scaling;
            let displacement = q[i] - self.start.state.q[i];
            let far = reach.displacements();
            if displacement < far.low - 1e-9 || displacement > far.high + 1e-9 {
                return None;
            }
            bounds[i] = reach.terminal_velocities(displacement.clamp(far.low, far.high));
        }
        Some(bounds)
    }

    /// The motion to a posture at the highest speed fraction, if the arm need not exhaust its limits for it.
    fn easily(&self, posture: &Posture) -> Option<PosedCatch> {
        let enough = MAX_SPEED_FRACTION * (1.0 - GOOD_ENOUGH);
        let terminal_velocity = self
            .optimistic(&posture.q, EASY_FRACTION)
            .filter(|terminal_velocity| terminal_velocity.speed_fraction >= enough)?;
        self.finished(posture, &terminal_velocity, self.point_to_point(&posture.q).splines_for(&terminal_velocity)?)
    }

    /// The motion to a posture with the highest speed fraction that a spline can have, if that is above
    /// `least`.
    fn solve(&self, posture: &Posture, least: f64) -> Option<PosedCatch> {
        let (terminal_velocity, points) =
            self.point_to_point(&posture.q).best(self.exact_bounds(&posture.q, 1.0)?, least)?;
        self.finished(posture, &terminal_velocity, points)
    }

    fn finished(
        &self,
        posture: &Posture,
        terminal_velocity: &TerminalVelocity,
        control_points: Vec<JointVector>,
    ) -> Option<PosedCatch> {
        let (start_s, duration_s) = (self.start.time_s, self.target.catch_s - self.start.time_s);
        let knots_s = self.splines.at.knots.iter().map(|knot| start_s + knot * duration_s).collect();
        let spline = BSpline { knots_s, control_points };
        let (posture, speed_fraction) = (*posture, terminal_velocity.speed_fraction);
        self.planner.keeps_torque(&spline).then_some(PosedCatch { posture, speed_fraction, spline })
    }

    /// Moves the elbow within its arc toward higher speed fractions, by steps that shrink where they do not
    /// help. What counts are exact bounds a little inside the limits, which are about those of a spline.
    fn moved(&self, posture: &Posture, optimistic: f64) -> Posture {
        let value = |q: &JointVector| self.optimistic(q, SPLINE_FRACTION).map_or(-1.0, |it| it.speed_fraction);
        let mut best = *posture;
        let mut most = value(&posture.q).min(optimistic);
        let mut step = posture.elbow.map_or(0.0, |it| (it.arc[1] - it.arc[0]) / 8.0);
        for _ in 0..REFINEMENTS {
            let better = [step, -step].iter().find_map(|by| {
                let swivel = best.elbow?.swivel + by;
                let next = self.planner.finder.moved(&self.target.X_WG, &best, swivel)?;
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
}
