//! Why an object was not caught: one reason per trial, from the truth.

use std::fmt::Display;

use catch_bot::Status;
use serde::{Deserialize, Serialize};

use super::{Evidence, is_squeezed, sample_at, touches_gripper};

/// Beyond this a prediction or a pose explains why the gripper missed.
const LARGE_ERROR_M: f64 = 0.02;
/// An object that both fingers have held this long has been grasped.
const GRASPED_AFTER_S: f64 = 0.02;
/// How far along z of the gripper the fingers can still touch the middle of an object.
const PASSING_M: f64 = 0.05;

/// Why an object was not caught.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Reason {
    /// The physics broke down; the trial says nothing.
    SimulationDiverged,
    /// A command broke a limit of the arm.
    LimitViolation,
    /// The arm touched itself or the floor.
    ArmCollision,
    /// The object was never seen, or seen in the wrong place.
    Perception,
    /// The flight was not recognised, or predicted wrongly.
    Prediction,
    /// The arm could not be there in time.
    OutOfReach,
    /// No way of holding the object was found.
    NoGrasp,
    /// No motion within the limits was found.
    NoPlan,
    /// Motions were planned but came too late.
    Late,
    /// The object met the arm.
    HitArm,
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
}

impl Display for Reason {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Self::SimulationDiverged => "the simulation diverged",
            Self::LimitViolation => "a command broke a limit of the arm",
            Self::ArmCollision => "the arm touched itself or the floor",
            Self::Perception => "the object was not seen where it was",
            Self::Prediction => "the flight was not predicted well enough",
            Self::OutOfReach => "out of reach in the time there was",
            Self::NoGrasp => "no way of holding it was found",
            Self::NoPlan => "no motion within the limits was found",
            Self::Late => "the motion came too late",
            Self::HitArm => "it hit the arm",
            Self::HitFinger => "it hit a finger",
            Self::ClosedEarly => "the fingers closed too early",
            Self::ClosedLate => "the fingers closed too late",
            Self::MissedPosition => "the gripper was in the wrong place",
            Self::SlippedOut => "it slipped out of the closing fingers",
            Self::Dropped => "it was held and then lost",
        })
    }
}

/// The one reason why the object was not caught; `None` if it was.
pub(crate) fn why_not_caught(evidence: &Evidence) -> Option<Reason> {
    let servo = &evidence.truth.servo;
    if evidence.truth.diverged_s.is_some() {
        return Some(Reason::SimulationDiverged);
    }
    if !servo.command_violations.is_empty() {
        return Some(Reason::LimitViolation);
    }
    if [servo.min_self_clearance_m, servo.min_floor_clearance_m].iter().flatten().any(|&clearance| clearance <= 0.0) {
        return Some(Reason::ArmCollision);
    }
    let touched_else = evidence.truth.samples.iter().find(|sample| sample.contact.arm || sample.contact.floor);
    if evidence.contact_s.is_some() && evidence.first_not_held_s().is_none() {
        // Held; but a catch by way of the arm or the floor is none.
        return touched_else.map(|_| Reason::HitArm);
    }
    if evidence.catch_s.is_none() {
        return Some(without_a_plan(evidence));
    }
    if touched_else
        .is_some_and(|sample| sample.contact.arm && evidence.contact_s.is_none_or(|touch| sample.time_s < touch))
    {
        return Some(Reason::HitArm);
    }
    Some(with_a_plan(evidence))
}

/// The brain never had a plan: the reason is how far it got.
fn without_a_plan(evidence: &Evidence) -> Reason {
    match evidence.furthest_status() {
        Status::NoObject => Reason::Perception,
        Status::NoTrajectory if evidence.pose_error_m().is_some_and(|error| error > LARGE_ERROR_M) => {
            Reason::Perception
        }
        Status::NoTrajectory => Reason::Prediction,
        Status::OutOfReach => Reason::OutOfReach,
        Status::NoGrasp => Reason::NoGrasp,
        Status::NoPlan | Status::PlanKept | Status::Planned | Status::Committed => Reason::NoPlan,
    }
}

/// The brain tried.
fn with_a_plan(evidence: &Evidence) -> Reason {
    if let Some(grasped_for_s) = evidence.contact_s.and_then(|_| grasped_for_s(evidence)) {
        // Both fingers had it: either for good, or it was on its way out all the time.
        let held = evidence
            .contact_s
            .is_some_and(|touch| evidence.first_not_held_s().is_some_and(|lost| lost > touch + 0.5 + 2e-3));
        return if held || grasped_for_s > 0.5 { Reason::Dropped } else { Reason::SlippedOut };
    }
    if evidence.prediction_error_m().is_some_and(|error| error > LARGE_ERROR_M) {
        let seen_wrong = evidence.pose_error_m().is_some_and(|error| error > LARGE_ERROR_M);
        return if seen_wrong { Reason::Perception } else { Reason::Prediction };
    }
    if evidence.truth.servo.accepted_trajectories == 0 && evidence.truth.servo.late_trajectories > 0 {
        return Reason::Late;
    }
    let Some(p_GO) = evidence.undisturbed_in_gripper() else { return Reason::Late };
    let Some(at_catch) = evidence.at_catch else { return Reason::Late };
    let centred =
        (p_GO - evidence.grasp_centre_G).component_mul(&nalgebra::Vector3::new(1.0, 1.0, 0.0)).norm() <= LARGE_ERROR_M;
    let object_width_m =
        evidence.last.and_then(|report| report.plan.as_ref()).map_or(0.0, |plan| plan.grasp.object_width_m);

    // How wide the gripper was when the object reached it.
    let arrival =
        evidence.contact_s.or(evidence.catch_s).and_then(|at| sample_at(evidence.truth, at)).unwrap_or(at_catch);
    if arrival.width_m < object_width_m - 2e-3 {
        return Reason::ClosedEarly;
    }
    if evidence.contact_s.is_none() {
        return if centred { Reason::ClosedLate } else { Reason::MissedPosition };
    }
    let first = arrival;
    let p_GO_first = first.X_WG.inverse_transform_point(&first.X_WO.translation.vector.into());
    let between = p_GO_first.x.abs() < first.width_m / 2.0 && p_GO_first.z.abs() < PASSING_M;
    let closing =
        evidence.last.and_then(|report| report.closing).is_some_and(|closing| first.time_s >= closing.start_s);
    match (between, closing) {
        (true, true) => Reason::SlippedOut,
        (true, false) if first.contact.palm => Reason::ClosedLate,
        (false, true) => Reason::ClosedLate,
        _ => Reason::HitFinger,
    }
}

/// How long in total the object was squeezed, if long enough to have been grasped.
fn grasped_for_s(evidence: &Evidence) -> Option<f64> {
    let samples = &evidence.truth.samples;
    let squeezed = samples.windows(2).filter(|pair| touches_gripper(&pair[1]) && is_squeezed(&pair[0], &pair[1]));
    let total_s: f64 = squeezed.map(|pair| pair[1].time_s - pair[0].time_s).sum();
    (total_s >= GRASPED_AFTER_S).then_some(total_s)
}
