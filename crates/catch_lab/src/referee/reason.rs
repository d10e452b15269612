//! Reason why an object was not caught: one per trial, from the truth.

use std::fmt::Display;

use catch_bot::{Status, trajectory_optimization::CatchPlan};
use catch_sim::truth::Contact;
use serde::{Deserialize, Serialize};

use super::{
    Evidence, HELD_FROM_S,
    samples::{is_squeezed, sample_at},
};

/// Beyond this a prediction or a pose explains why the gripper missed.
const LARGE_ERROR_M: f64 = 0.02;
/// An object that both fingers have held this long has been grasped.
const GRASPED_AFTER_S: f64 = 0.02;
/// Fingers that are this much closer than the object is wide, when it comes, have closed before it.
const CLOSED_TOO_FAR_M: f64 = 2e-3;
/// Fingers that have moved less than this have not begun to close.
const STILL_OPEN_M: f64 = 2e-3;

/// Reason why an object was not caught.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Reason {
    /// The physics broke down; the trial says nothing.
    SimulationDiverged,
    /// A command broke a limit of the arm.
    LimitViolation,
    /// The arm touched itself, the floor or an obstacle.
    ArmCollision,
    /// The object was never seen, or seen in the wrong place.
    Perception,
    /// The flight was not recognised, or predicted wrongly.
    Prediction,
    /// The arm could not be there in time.
    OutOfReach,
    /// No way of holding the object was found.
    NoGrasp,
    /// The object would have hit the open gripper on its approach in every grasp.
    Blocked,
    /// No motion within the limits was found.
    NoPlan,
    /// The search for a catch was cut short by its bound on the work.
    OutOfBudget,
    /// Motions were planned but came too late.
    Late,
    /// The object met the arm.
    HitArm,
    /// The object met an obstacle before it met the gripper.
    HitObstacle,
    /// The object met a finger from outside or before the fingers closed.
    HitFinger,
    /// The fingers had closed before the object was between them.
    ClosedEarly,
    /// The object had passed before the fingers closed.
    ClosedLate,
    /// The gripper was not where the object was.
    MissedPosition,
    /// The object was between the closing fingers and escaped.
    SlippedOut,
    /// The object was held and then lost.
    Dropped,
    /// The hand took the object along to the floor, or the object was there before.
    HitFloor,
    /// The object was held, but the arm did not come to rest.
    MovedOn,
}

impl Display for Reason {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Self::SimulationDiverged => "the simulation diverged",
            Self::LimitViolation => "a command broke a limit of the arm",
            Self::ArmCollision => "the arm touched itself, the floor or an obstacle",
            Self::Perception => "the object was not seen where it was",
            Self::Prediction => "the flight was not predicted well enough",
            Self::OutOfReach => "out of reach in the time there was",
            Self::NoGrasp => "no way of holding it was found",
            Self::Blocked => "it could not come into the open gripper",
            Self::NoPlan => "no motion within the limits was found",
            Self::OutOfBudget => "the search for a catch ran out of budget",
            Self::Late => "the motion came too late",
            Self::HitArm => "it hit the arm",
            Self::HitObstacle => "it hit an obstacle",
            Self::HitFinger => "it hit a finger",
            Self::ClosedEarly => "the fingers closed too early",
            Self::ClosedLate => "the fingers closed too late",
            Self::MissedPosition => "the gripper was in the wrong place",
            Self::SlippedOut => "it slipped out of the closing fingers",
            Self::HitFloor => "it was held, but touched the floor",
            Self::Dropped => "it was held and then lost",
            Self::MovedOn => "it was held, but the arm did not come to rest",
        })
    }
}

/// The one reason why the object was not caught; `None` if it was.
pub(crate) fn why_not_caught(evidence: &Evidence) -> Option<Reason> {
    let why_not_held = why_not_held(evidence);
    let breaks_limits = !evidence.truth.servo.command_violations.is_empty();
    let is_broken = breaks_limits && why_not_held != Some(Reason::SimulationDiverged);
    if is_broken { Some(Reason::LimitViolation) } else { why_not_held }
}

/// Returns the reason why the object was not held, with the arm's limits ignored.
pub(crate) fn why_not_held(evidence: &Evidence) -> Option<Reason> {
    let servo = &evidence.truth.servo;
    if evidence.truth.diverged_s.is_some() {
        return Some(Reason::SimulationDiverged);
    }
    if [servo.min_self_clearance_m, servo.min_floor_clearance_m].iter().flatten().any(|&clearance| clearance <= 0.0) {
        return Some(Reason::ArmCollision);
    }
    let met = |part: fn(&Contact) -> bool| evidence.truth.samples.iter().find(|sample| part(&sample.contact));
    let touched_else = met(|it| it.arm || it.floor || it.obstacle);
    if evidence.contact_s.is_some() && evidence.first_not_held_s().is_none() {
        // Held; but a catch by way of the arm or the floor is none, nor one by an arm that moves on.
        let by_way_of = touched_else.map(|sample| match sample.contact {
            Contact { arm: true, .. } => Reason::HitArm,
            Contact { obstacle: true, .. } => Reason::HitObstacle,
            _ => Reason::HitFloor,
        });
        return by_way_of.or_else(|| evidence.moved_on().then_some(Reason::MovedOn));
    }
    let is_before_gripper = |time_s: f64| evidence.contact_s.is_none_or(|touch| time_s < touch);
    let was_in_time = |time_s: f64| evidence.catch_s.is_none_or(|catch_s| time_s < catch_s);
    if met(|it| it.obstacle).is_some_and(|it| is_before_gripper(it.time_s) && was_in_time(it.time_s)) {
        return Some(Reason::HitObstacle);
    }
    if evidence.catch_s.is_none() {
        return Some(without_a_plan(evidence));
    }
    if touched_else.is_some_and(|sample| sample.contact.arm && is_before_gripper(sample.time_s)) {
        return Some(Reason::HitArm);
    }
    Some(with_a_plan(evidence))
}

/// The brain never had a plan: the reason is how far it got, or, if it does not tell, what the truth shows.
fn without_a_plan(evidence: &Evidence) -> Reason {
    let Some(status) = evidence.furthest_status() else { return with_a_plan(evidence) };
    match status {
        Status::NoObject => Reason::Perception,
        Status::NoTrajectory if evidence.pose_error_m().is_some_and(|error| error > LARGE_ERROR_M) => {
            Reason::Perception
        }
        Status::NoTrajectory => Reason::Prediction,
        Status::OutOfReach => Reason::OutOfReach,
        Status::NoGrasp => Reason::NoGrasp,
        Status::Blocked => Reason::Blocked,
        Status::OutOfBudget => Reason::OutOfBudget,
        Status::NoPlan | Status::PlanKept | Status::Approached | Status::Planned | Status::Committed => Reason::NoPlan,
    }
}

/// The brain tried.
fn with_a_plan(evidence: &Evidence) -> Reason {
    if let Some(grasped_for_s) = evidence.contact_s.and_then(|_| grasped_for_s(evidence)) {
        if met_the_floor_in_hand(evidence) {
            return Reason::HitFloor;
        }
        // Both fingers had it: for good, or it was on its way out all the time.
        let test_began = evidence.contact_s.map(|touch| touch + HELD_FROM_S + 2e-3);
        let held = evidence.first_not_held_s().zip(test_began).is_some_and(|(lost, began)| lost > began);
        return if held || grasped_for_s > HELD_FROM_S { Reason::Dropped } else { Reason::SlippedOut };
    }
    if evidence.prediction_error_m().is_some_and(|error| error > LARGE_ERROR_M) {
        let seen_wrong = evidence.pose_error_m().is_some_and(|error| error > LARGE_ERROR_M);
        return if seen_wrong { Reason::Perception } else { Reason::Prediction };
    }
    if evidence.truth.servo.accepted_trajectories == 0 && evidence.truth.servo.late_trajectories > 0 {
        return Reason::Late;
    }
    if evidence.grasp_offset_m().is_none_or(|offset| offset > LARGE_ERROR_M) {
        return Reason::MissedPosition;
    }
    let Some(first) = evidence.contact_s.and_then(|at| sample_at(evidence.truth, at)) else {
        // It was where the plan wanted it, and flew on.
        return Reason::ClosedLate;
    };
    let width_m = |pick: fn(&CatchPlan) -> f64| evidence.plan().map_or(0.0, pick);
    if first.width_m < width_m(|plan| plan.grasp.object_width_m) - CLOSED_TOO_FAR_M {
        return Reason::ClosedEarly;
    }
    let still_open = first.width_m > width_m(|plan| plan.aperture_m) - STILL_OPEN_M;
    match evidence.progress_m() {
        // Open fingers are in the way of an object that comes in crooked; off the palm it bounces.
        _ if still_open && !first.contact.palm => Reason::HitFinger,
        _ if still_open => Reason::ClosedLate,
        Some(progress) if progress > LARGE_ERROR_M => Reason::ClosedLate,
        Some(progress) if progress < -LARGE_ERROR_M => Reason::ClosedEarly,
        _ => Reason::SlippedOut,
    }
}

/// Returns whether both fingers had the object when it first touched the floor.
fn met_the_floor_in_hand(evidence: &Evidence) -> bool {
    let at_floor = evidence.truth.samples.windows(2).find(|pair| pair[1].contact.floor);
    at_floor.is_some_and(|pair| is_squeezed(&pair[0], &pair[1]))
}

/// Total time for which the object was squeezed, if long enough to have been grasped.
fn grasped_for_s(evidence: &Evidence) -> Option<f64> {
    let samples = &evidence.truth.samples;
    let squeezed = samples.windows(2).filter(|pair| pair[1].contact.gripper() && is_squeezed(&pair[0], &pair[1]));
    let total_s: f64 = squeezed.map(|pair| pair[1].time_s - pair[0].time_s).sum();
    (total_s >= GRASPED_AFTER_S).then_some(total_s)
}
