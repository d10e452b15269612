//! Replans: a running catch adjusted to a flight that is known better.

use catch_body::{
    JointVector, MAX_JOINTS, Pose,
    quadratic_program::{Hessian, Row, Square, Variables},
};
use nalgebra::{Point3, SMatrix, Vector3, Vector6};

use super::{
    CatchPlan, CatchSearch, Incoming, MIN_LEAD_S, Start,
    motion::{LimitScaling, REPLAN_SCALING},
    point_to_point::PointToPoint,
    posture::Posture,
    search::ReachableCatch,
    swept_volume::Entering,
};
use crate::{
    grasp_selection::{Grasp, Passing},
    trajectory_prediction::LocalFlight,
};

/// Changes of the arm angle that are tried for the same catch, in this order, in radians.
const ARM_ANGLES_RAD: [f64; 5] = [0.0, 0.2, -0.2, 0.4, -0.4];
/// Changes of the arm angle that are tried where the catch is shifted in time, in radians.
const SHIFTED_ARM_ANGLES_RAD: [f64; 3] = [0.0, 0.2, -0.2];
/// Shifts of the catch time that are tried where a catch cannot be made at its planned time, in seconds;
/// negative for sooner. The object moves by some 50 mm in 10 ms.
const SHIFTS_S: [f64; 6] = [0.01, -0.01, 0.02, -0.02, 0.04, 0.06];
/// Fractions of a correction that are tried where the whole is too much.
const CORRECTION_FRACTIONS: [f64; 3] = [0.75, 0.5, 0.25];
/// Time for the gripper to obey, in seconds: an opening that it could not have reached by then is not asked
/// for any more.
const SETTLING_S: f64 = 0.05;
/// Weights of the hand's position error along the axes of G, closing, approach and gap, where not all of it
/// can be corrected. An object beside the grasp centre meets a finger. An error along the approach makes the
/// fingers close sooner or later.
const SHIFTS: Vector3<f64> = Vector3::new(1.0, 0.1, 0.4);
/// A turn about each of these counts as much as a shift along the closing direction by so many metres per
/// radian.
const LEVERS_M: Vector3<f64> = Vector3::new(0.015, 0.025, 0.025);
/// Fractions of its reachability interval that each joint may use where the arm cannot make a correction as a
/// whole, or the approach is not free with it: what a joint at the end of its interval cannot do, the others
/// do.
const REACH_FRACTIONS: [f64; 3] = [0.97, 0.9, 0.8];
/// Keeps the joints near the plan where the correction leaves them free, in m².
const DAMPING: f64 = 1e-5;
/// A posture is much nearer if it leaves less than this fraction of what the hand is off by.
const MUCH_NEARER: f64 = 0.75;
/// Largest position error that a posture may leave, in metres, if the approach is free with it.
const NEAR_ENOUGH_M: f64 = 0.004;

/// Start of the correction of a running catch, and the flight to which it is corrected.
pub struct Correction<'a> {
    start: &'a Start,
    incoming: &'a Incoming<'a>,
    plan: &'a CatchPlan,
    local_flight: LocalFlight,
    /// The plan's: of all that hold the object alike the one that turns the gripper least. What cannot be
    /// seen of an orientation is not followed.
    pub grasp: Grasp,
}

impl<'a> Correction<'a> {
    /// Correction of this plan, with its catch at `catch_s`.
    pub fn new(start: &'a Start, incoming: &'a Incoming<'a>, plan: &'a CatchPlan, catch_s: f64) -> Self {
        let local_flight = incoming.flight.local_flight_at(catch_s);
        let R_WO = local_flight.X_WO.rotation;
        let planned_WO = plan.X_WG.rotation * plan.grasp.X_OG.rotation.inverse();
        let alike_WO = incoming.grasps.symmetry.nearest_alike(&planned_WO, &R_WO);
        let mut X_OG = R_WO.inverse() * alike_WO * plan.grasp.X_OG;
        // Each replan makes it from the last one's, and rounding must not add up.
        X_OG.rotation.renormalize();
        Self { start, incoming, plan, local_flight, grasp: Grasp { X_OG, ..plan.grasp.clone() } }
    }

    /// The gripper's pose in W that the grasp asks for.
    pub fn X_WG(&self) -> Pose {
        self.local_flight.X_WO * self.grasp.X_OG
    }
}

impl CatchSearch {
    /// Corrects a catch for a flight that is predicted better: same time and grasp, the elbow in the same
    /// position or close by.
    pub fn retarget(&self, to: &Correction) -> Option<CatchPlan> {
        // The next replan can use the part of the limits that a motion leaves: more is taken only where less
        // is not enough.
        let scaling = [0.0, 0.5, 1.0].map(|more| REPLAN_SCALING.toward(self.motion.moving_scaling(), more));
        let found = scaling.iter().find_map(|scaling| self.adjusted(to, &to.X_WG(), *scaling, &ARM_ANGLES_RAD))?;
        let found = self.opened(found, to);
        // A joint at the end of its reach has but one velocity there, so that the hand cannot follow the
        // object as it should.
        let mut near = self.within_reach(to, |[_, left_m]| left_m < NEAR_ENOUGH_M);
        let free = if found.approach_is_free { None } else { near.find(|it| it.approach_is_free) };
        Some(free.unwrap_or(found))
    }

    /// Shifts the catch a little sooner or later with the same grasp, where the arm is in time and the
    /// approach is free.
    pub fn shifted(&self, to: &Correction) -> Option<CatchPlan> {
        let Correction { start, incoming, plan, .. } = *to;
        let in_time = |later_s: &&f64| **later_s > 0.0 || plan.catch_s + **later_s > start.time_s + MIN_LEAD_S;
        let scaling = self.motion.moving_scaling();
        SHIFTS_S.iter().filter(in_time).find_map(|later_s| {
            let correction = Correction::new(start, incoming, plan, plan.catch_s + later_s);
            let found = self.adjusted(&correction, &correction.X_WG(), scaling, &SHIFTED_ARM_ANGLES_RAD)?;
            Some(self.opened(found, &correction)).filter(|it| it.approach_is_free)
        })
    }

    /// Moves the catch as near to the flight as the arm can still come.
    pub fn nearest(&self, to: &Correction) -> Option<CatchPlan> {
        let scaling = self.motion.moving_scaling();
        let in_part = || {
            CORRECTION_FRACTIONS.iter().find_map(|part| {
                let X_WG = to.plan.X_WG.try_lerp_slerp(&to.X_WG(), *part, 1e-9)?;
                Some(self.opened(self.adjusted(to, &X_WG, scaling, &[0.0])?, to))
            })
        };
        let much_nearer = |[planned_m, left_m]: [f64; 2]| left_m < MUCH_NEARER * planned_m;
        self.within_reach(to, much_nearer).next().or_else(in_part)
    }

    /// Adjusts the catch in the nearest posture by each fraction of the joints' reach. `is_near` decides
    /// whether a posture is near enough, from the hand's errors in the plan's posture and in that one.
    fn within_reach(&self, to: &Correction, is_near: fn([f64; 2]) -> bool) -> impl Iterator<Item = CatchPlan> {
        let (wanted, motion) = (to.X_WG(), &self.motion);
        REACH_FRACTIONS.into_iter().filter_map(move |fraction| {
            let (posture, off_m) = self.nearest_posture(to, &wanted, fraction)?;
            let at = || self.at_posture(to, &motion.robot.gripper_pose(&posture.q), motion.moving_scaling(), posture);
            Some(self.opened(is_near(off_m).then(at)??, to))
        })
    }

    /// The posture near the plan's whose gripper is nearest to `X_WG`, every joint within this fraction of
    /// its reachability interval:
    ///
    /// min |W·(J·Δq − (Δθ, Δp))|² + ε·|Δq|², low ≤ Δq ≤ high
    ///
    /// with what the hand is off by in the plan's posture and in this one, weighed, in metres.
    fn nearest_posture(&self, to: &Correction, X_WG: &Pose, fraction: f64) -> Option<(Posture, [f64; 2])> {
        let (motion, robot, Correction { start, plan, .. }) = (&self.motion, &self.motion.robot, to);
        let (centre, R_GW) = (motion.gripper.grasp_centre(), X_WG.rotation.inverse());
        let weighed = |turn: Vector3<f64>, shift: Vector3<f64>| {
            let [turn, shift] = [(turn, LEVERS_M), (shift, SHIFTS)].map(|(it, by)| (R_GW * it).component_mul(&by));
            Vector6::new(turn.x, turn.y, turn.z, shift.x, shift.y, shift.z)
        };
        let error_of =
            |it: &Pose| weighed((X_WG.rotation * it.rotation.inverse()).scaled_axis(), X_WG * centre - it * centre);
        let planned = robot.gripper_pose(&plan.q);
        let error = error_of(&planned);
        let mut jacobian = robot.jacobian(&robot.link_poses(&plan.q), &(planned * centre));
        for mut joint in jacobian.column_iter_mut() {
            joint.copy_from(&weighed(joint.fixed_rows::<3>(0).into(), joint.fixed_rows::<3>(3).into()));
        }
        let (mut H, mut gradient) = (Square::identity(), Variables::zeros());
        let squares = jacobian.transpose() * jacobian + SMatrix::<f64, MAX_JOINTS, MAX_JOINTS>::identity() * DAMPING;
        H.fixed_view_mut::<MAX_JOINTS, MAX_JOINTS>(0, 0).copy_from(&squares);
        gradient.fixed_rows_mut::<MAX_JOINTS>(0).copy_from(&(jacobian.transpose() * -error));
        let joints = motion.reaches(start, plan.catch_s - start.time_s, motion.moving_scaling());
        let ranges = motion.ranges(&joints, &start.state.q);
        let rows: [Row; MAX_JOINTS] = std::array::from_fn(|i| Row::new(Variables::ith(i, 1.0)));
        let bounds = std::array::from_fn::<_, MAX_JOINTS, _>(|i| {
            let [low, high] = ranges[i].map(|it| it - plan.q[i]);
            let unused = (1.0 - fraction) * joints[i].displacements().half_width();
            [low + unused, high - unused]
        });
        let dof = robot.dof();
        let failures = to.incoming.failures;
        let hessian = failures.factor(Hessian::new(&H))?;
        let step = failures.solution(hessian.minimize(&gradient, &rows[..dof], &bounds[..dof], 0))?;
        let step: JointVector = step.fixed_rows::<MAX_JOINTS>(0).into_owned();
        let posture = Posture { q: plan.q + step, elbow: plan.elbow };
        let left_m = error_of(&robot.gripper_pose(&posture.q)).norm();
        Some((posture, [error.norm(), left_m]))
    }

    /// The plan's grasp where the object passes, with the gripper at `X_WG`, the elbow moved by the first of
    /// these angles that will do.
    fn adjusted(&self, to: &Correction, X_WG: &Pose, scaling: LimitScaling, elbows_rad: &[f64]) -> Option<CatchPlan> {
        let (known, motion, start) = (Posture { q: to.plan.q, elbow: to.plan.elbow }, &self.motion, to.start);
        if let Some(p_GO) = self.pivot_G(to.incoming, &to.grasp) {
            let joints = motion.reaches(start, to.local_flight.time_s - start.time_s, scaling);
            let ranges = motion.ranges(&joints, &start.state.q);
            let found = motion.robot.turned_solutions(X_WG, &p_GO, &known.q, &ranges);
            let q = found.into_iter().next()?;
            return self.at_posture(to, &motion.robot.gripper_pose(&q), scaling, Posture { q, elbow: None });
        }
        elbows_rad.iter().find_map(|offset| {
            let posture = motion.finder.adjusted(&motion.robot, X_WG, &known, *offset)?;
            self.at_posture(to, X_WG, scaling, posture)
        })
    }

    /// Adjusts the catch in this posture.
    fn at_posture(&self, to: &Correction, X_WG: &Pose, scaling: LimitScaling, posture: Posture) -> Option<CatchPlan> {
        let Correction { start, incoming, plan, local_flight, grasp } = to;
        let LocalFlight { time_s: catch_s, X_WO, V_WO, .. } = *local_flight;
        let q = posture.q;
        let base = Point3::from(self.motion.robot.X_WB.translation.vector);
        let passing = Passing::new(&X_WO, &V_WO.linear, &base, &incoming.config.weights);
        let still_cost = passing.rank_alone(0, grasp).still_cost;
        let point_to_point = self.motion.point_to_point((start, incoming), local_flight, X_WG, &q, scaling);
        let point_to_point = PointToPoint { weights: plan.weights, ..point_to_point };
        let joints = self.motion.reaches(start, catch_s - start.time_s, scaling);
        let bounds = self.motion.terminal_velocity_bounds(&joints, &start.state.q, &q)?;
        let CatchPlan { approach, cost, .. } = **plan;
        let reachable = ReachableCatch { catch_s, approach, X_WG: *X_WG, posture, cost, still_cost };
        let best = point_to_point.best(bounds, -1.0)?;
        let found = self.finish(incoming, &reachable, grasp, best, &point_to_point)?;
        self.motion.is_safe(&found.trajectory, catch_s, grasp).then_some(found)
    }

    /// Chooses the aperture of the plan: as before, or narrower for slow fingers, if the approach is free
    /// with it; else the narrowest with a free approach, or, where there is none any more, the widest: it
    /// hits least. The aperture stays where it is too late to change it.
    pub fn opened(&self, plan: CatchPlan, to: &Correction) -> CatchPlan {
        let (incoming, local_flight, had_m) = (to.incoming, &to.local_flight, to.plan.aperture_m);
        // Slow fingers come nearer as the flight is known better.
        let entering = Entering { incoming, local_flight, grasp: &plan.grasp };
        let nearer_m = self.pre_closed_m(&plan.X_WG, &entering).filter(|nearer_m| *nearer_m < had_m);
        let kept = [nearer_m.unwrap_or(had_m), had_m];
        if let Some(aperture_m) = self.first_with_free_approach(&kept, &plan, &entering) {
            return CatchPlan { aperture_m, approach_is_free: true, ..plan };
        }
        let aperture = self.aperture(&plan, incoming, local_flight);
        let aperture_m = aperture.unwrap_or(self.motion.gripper.max_width_m);
        let fingers = incoming.config.closing(&self.motion.gripper);
        let takes_s = fingers.duration_s((aperture_m - had_m).abs())
            + fingers.duration_s(aperture_m - plan.grasp.object_width_m)
            + SETTLING_S;
        let is_late = to.start.time_s + takes_s > plan.catch_s;
        let (aperture_m, approach_is_free) = if is_late { (had_m, false) } else { (aperture_m, aperture.is_some()) };
        CatchPlan { aperture_m, approach_is_free, ..plan }
    }
}
