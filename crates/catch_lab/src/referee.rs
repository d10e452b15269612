//! The referee: the only place where truth meets score.

pub mod cell_samples;
mod counted;
pub mod faulty_cameras;
mod impact;
mod measures;
pub mod reason;
mod samples;

use catch_bot::{Report, Status, perception::Symmetry, trajectory_optimization::CatchPlan};
use catch_cell::LimitViolation;
use catch_sim::{FlightConditions, ThrownObject, Truth, TruthSample, free_flight::coasted};
use nalgebra::{Point3, UnitQuaternion};
use serde::{Deserialize, Serialize};

use crate::{
    reachability::oracle::Reach,
    scenario::setup::{Scene, Setup},
    trial::{StateSnapshot, Trial},
};
use counted::{CODE_DISTANCE_M, HELD_LATER_S, PAPER_DISTANCE_M, distance_along_z_m, is_held_at};
use impact::impact;
pub use measures::{LEADS_S, Measures};
use reason::Reason;
use samples::{is_squeezed, relative_velocity, sample_before};
pub use samples::{sample_at, undisturbed_position};

/// Start of the test in which the object has to be held, in seconds after the first contact.
const HELD_FROM_S: f64 = 0.5;
/// End of the test, in seconds after the first contact.
pub(crate) const HELD_UNTIL_S: f64 = 1.5;
/// Largest speed of a held object relative to the gripper.
const HELD_SPEED_MPS: f64 = 0.02;
/// Largest speed of a held object relative to the gripper during the disturbance test.
const DISTURBANCE_SPEED_MPS: f64 = 0.05;
/// Largest speed of a joint of an arm at rest.
const AT_REST_RADPS: f64 = 0.02;
/// Duration over which the speed in the hand is averaged, in seconds.
const SPEED_OVER_S: f64 = 0.01;
/// Largest time from the planned catch to the instant at which the object is nearest the grasp centre.
const NEAREST_WITHIN_S: f64 = 0.04;

/// The outcome of a trial.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Verdict {
    /// True if the object was caught and held: no command broke a limit; from 0.5 s to 1.5 s after the first
    /// contact, a gripper that was commanded to close squeezed the object, which lay still in it, with the
    /// arm at rest, also during the disturbance test; nothing else touched the object. The effect of the
    /// impact on the arm's motion decides nothing and is reported apart.
    pub caught: bool,
    /// True if the paper counts it as caught: at 0.875 s the object is less than 2.5 cm from the gripper
    /// along its z axis.
    pub caught_paper: bool,
    /// True if the authors' code counts it as caught: less than 5 cm.
    #[serde(default)]
    pub caught_paper_code: bool,
    /// True if the object is squeezed at 1.275 s, 0.4 s after the instant of the paper's measure.
    #[serde(default)]
    pub held_later: bool,
    /// True if the object was caught and held, with broken limits of the arm ignored.
    #[serde(default)]
    pub caught_beyond_limits: bool,
    /// Reason of the miss, for every trial in which the object was not caught.
    pub reason: Option<Reason>,
    /// Result of the oracle, for trials in which the object was not caught; `None` also where the oracle has
    /// none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub reach: Option<Reach>,
    /// Number of limits of the arm that commands broke; a throw is caught only if there is none.
    pub limit_violations: usize,
    /// The first of them.
    pub first_violation: Option<LimitViolation>,
    /// Number of limits that the measured motion exceeded, as an impact makes it do. No command did, so they
    /// decide nothing.
    #[serde(default)]
    pub motion_excursions: usize,
    /// Last planned time of the catch, if the brain had a plan.
    pub catch_time_s: Option<f64>,
    /// Time of the first contact of the gripper with the object.
    pub contact_s: Option<f64>,
    /// Further measures.
    #[serde(flatten)]
    pub measures: Measures,
}

impl Verdict {
    /// Returns whether the arm could not have caught the object, even with the flight given from the first
    /// image on.
    pub fn is_out_of_reach(&self) -> bool {
        self.reach.is_some_and(|reach| reach.from_first_image_s.is_none())
    }
}

/// Judges a trial.
pub fn judge(setup: &Setup, trial: &Trial) -> Verdict {
    let truth = &trial.truth;
    let contact_s = first_contact_s(truth);
    let evidence = Evidence::new(setup, trial, contact_s);
    let reason = reason::why_not_caught(&evidence);
    let servo = &truth.servo;
    let distance_m = distance_along_z_m(truth, &setup.object.origin_O);
    let is_within = |most_m: f64| distance_m.is_some_and(|distance_m| distance_m < most_m);
    Verdict {
        caught: reason.is_none(),
        caught_paper: is_within(PAPER_DISTANCE_M),
        caught_paper_code: is_within(CODE_DISTANCE_M),
        held_later: is_held_at(truth, HELD_LATER_S),
        caught_beyond_limits: reason::why_not_held(&evidence).is_none(),
        reason,
        reach: None,
        limit_violations: servo.command_violations.len(),
        first_violation: servo.command_violations.first().copied(),
        motion_excursions: servo.motion_violations.len(),
        catch_time_s: evidence.catch_s,
        contact_s,
        measures: evidence.measures(setup),
    }
}

/// Finds the time of the first contact of the gripper with the object.
fn first_contact_s(truth: &Truth) -> Option<f64> {
    truth.samples.iter().find(|sample| sample.contact.gripper()).map(|sample| sample.time_s)
}

/// The result of one trial.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Row {
    /// Scene of the trial.
    #[serde(flatten)]
    pub scene: Scene,
    /// Outcome of the trial.
    #[serde(flatten)]
    pub verdict: Verdict,
    /// Conditions drawn for the object and its flight; tables of older versions do not have them.
    pub conditions: Option<FlightConditions>,
}

impl Row {
    /// The row of throw number `index` of `seed`.
    pub fn new(setup: &Setup, seed: u64, index: u64, verdict: Verdict) -> Self {
        Self { scene: setup.scene(seed, index), verdict, conditions: Some(setup.flight_conditions(seed, index)) }
    }
}

/// The origin of the arena's O in the brain's O, which has its origin where the centre of mass would be at
/// uniform density: the object's true centre of mass, but for bodies as published.
pub fn true_com_O(setup: &Setup) -> Point3<f64> {
    setup.known().reference.X_RO.inverse_transform_point(&Point3::origin())
}

/// Data that the referee judges.
pub(crate) struct Evidence<'a> {
    pub truth: &'a Truth,
    pub snapshots: &'a [StateSnapshot],
    /// The first contact with the gripper.
    pub contact_s: Option<f64>,
    /// The last state snapshot before the catch, or before the end.
    pub last: Option<&'a Report>,
    /// Last planned time of the catch.
    pub catch_s: Option<f64>,
    /// The state at the planned catch, or at the end of the trial if that came first.
    pub at_catch: Option<&'a TruthSample>,
    /// Position of the object's O at the planned catch if nothing had touched the object.
    pub undisturbed_O: Option<Point3<f64>>,
    /// The object, where it is known.
    known: Option<Known<'a>>,
}

/// The object of a setup.
struct Known<'a> {
    object: &'a ThrownObject,
    /// Centre of mass as [`true_com_O`] has it.
    com_O: Point3<f64>,
    symmetry: Symmetry,
}

impl<'a> Evidence<'a> {
    fn new(setup: &'a Setup, trial: &'a Trial, contact_s: Option<f64>) -> Self {
        let (truth, snapshots) = (&trial.truth, &trial.snapshots[..]);
        let catch_s = snapshots
            .iter()
            .rev()
            .find_map(|snapshot| snapshot.report.as_ref()?.plan.as_ref())
            .map(|plan| plan.catch_s);
        let before = |snapshot: &&StateSnapshot| catch_s.is_none_or(|catch_s| snapshot.time_s <= catch_s);
        let last = snapshots.iter().rfind(before).and_then(|snapshot| snapshot.report.as_ref());
        Self {
            truth,
            snapshots,
            contact_s,
            last,
            catch_s,
            at_catch: catch_s.and_then(|at| sample_at(truth, at)),
            undisturbed_O: catch_s.and_then(|at| undisturbed_position(truth, &setup.object, at)),
            known: Some(Known {
                object: &setup.object,
                com_O: true_com_O(setup),
                symmetry: setup.known().reference.symmetry,
            }),
        }
    }

    /// Returns the error of the last prediction before the catch.
    pub fn prediction_error_m(&self) -> Option<f64> {
        self.error_of(self.last?)
    }

    /// Returns the error of the newest prediction that the brain had `lead_s` before the catch.
    fn earlier_prediction_error_m(&self, lead_s: f64) -> Option<f64> {
        let by_s = self.catch_s? - lead_s + 1e-9;
        self.error_of(self.snapshots.iter().rfind(|snapshot| snapshot.time_s <= by_s)?.report.as_ref()?)
    }

    fn error_of(&self, report: &Report) -> Option<f64> {
        let flight = report.flight.as_ref()?;
        let predicted = flight.pose_at(self.catch_s?) * self.known.as_ref()?.com_O;
        Some((predicted - self.undisturbed_O?).norm())
    }

    /// Returns the error of the newest pose at the time of its image.
    pub fn pose_error_m(&self) -> Option<f64> {
        let (pose, sample) = self.snapshots.iter().rev().find_map(|snapshot| {
            let pose = snapshot.report.as_ref()?.pose.as_ref()?;
            let undisturbed = |sample: &TruthSample| self.first_contact_s().is_none_or(|touch| sample.time_s < touch);
            Some((pose, sample_at(self.truth, pose.capture_s).filter(|sample| undisturbed(sample))?))
        })?;
        Some(((pose.X_WO * self.known.as_ref()?.com_O).coords - sample.X_WO.translation.vector).norm())
    }

    /// Finds the time of the object's first contact with anything.
    pub fn first_contact_s(&self) -> Option<f64> {
        self.truth.samples.iter().find(|sample| sample.contact.any()).map(|sample| sample.time_s)
    }

    /// The plan that was carried out.
    pub fn plan(&self) -> Option<&CatchPlan> {
        self.last?.plan.as_ref()
    }

    /// Distance of the undisturbed object at the catch from its planned position in the gripper.
    pub fn grasp_offset_m(&self) -> Option<f64> {
        let p_GO = self.at_catch?.X_WG.inverse_transform_point(&self.undisturbed_O?);
        Some((p_GO - self.plan()?.grasp.X_OG.inverse_transform_point(&self.known.as_ref()?.com_O)).norm())
    }

    /// Rotation of the object from `R_WO` at the planned catch if nothing had touched it.
    fn turn_from(&self, R_WO: &UnitQuaternion<f64>) -> Option<f64> {
        let sample = self.before_contact()?;
        let known = self.known.as_ref()?;
        let (undisturbed, _) = coasted(known.object, (&sample.X_WO, &sample.V_WO), self.catch_s? - sample.time_s);
        Some(known.symmetry.turn_between(R_WO, &undisturbed.rotation).norm())
    }

    /// The instant midway between the first contacts of the two fingers, less that at which the undisturbed
    /// object's centre would have been nearest the grasp centre.
    fn contact_delay_s(&self, setup: &Setup) -> Option<f64> {
        let samples = &self.truth.samples;
        let first = |touches: fn(&TruthSample) -> bool| samples.iter().find(|it| touches(it)).map(|it| it.time_s);
        let (left_s, right_s) = (first(|it| it.contact.left_finger)?, first(|it| it.contact.right_finger)?);
        let near =
            |it: &&TruthSample| self.catch_s.is_some_and(|catch_s| (it.time_s - catch_s).abs() < NEAREST_WITHIN_S);
        let distance = |sample: &TruthSample| {
            let undisturbed = undisturbed_position(self.truth, &setup.object, sample.time_s)?;
            Some((undisturbed - sample.X_WG * setup.gripper.grasp_centre()).norm())
        };
        let distances = samples.iter().filter(near).filter_map(|sample| Some((sample.time_s, distance(sample)?)));
        let (nearest_s, _) = distances.min_by(|a, b| a.1.total_cmp(&b.1))?;
        Some(f64::midpoint(left_s, right_s) - nearest_s)
    }

    /// Distance of the object past its planned position in the gripper at its first contact, along its
    /// direction of motion.
    pub fn progress_m(&self) -> Option<f64> {
        let sample = self.before_contact()?;
        let planned_GO = self.plan()?.grasp.X_OG.inverse().translation.vector;
        let p_GO = sample.X_WG.inverse_transform_point(&sample.X_WO.translation.vector.into());
        let way_W = relative_velocity(sample, self.known.as_ref()?.object).try_normalize(1e-6)?;
        Some((p_GO.coords - planned_GO).dot(&sample.X_WG.rotation.inverse_transform_vector(&way_W)))
    }

    /// The last state before anything touched the object, or that at the planned catch if it came first.
    fn before_contact(&self) -> Option<&TruthSample> {
        let at = self.first_contact_s().map_or(self.catch_s?, |touch| self.catch_s.map_or(touch, |at| at.min(touch)));
        sample_before(self.truth, at)
    }

    fn measures(&self, setup: &Setup) -> Measures {
        let servo = &self.truth.servo;
        let (plan, grasp_centre_G) = (self.plan(), setup.gripper.grasp_centre());
        let velocity_G = self
            .before_contact()
            .map(|sample| sample.X_WG.rotation.inverse_transform_vector(&relative_velocity(sample, &setup.object)));
        let impulses =
            self.truth.samples.iter().filter(|sample| sample.contact.gripper()).map(|it| it.contact.peak_impulse_ns);
        // Nothing that touched the gripper: all of the trial was before it.
        let before_contact = self.truth.before_contact.unwrap_or_else(|| servo.into());
        let impact = self.contact_s.map(|contact_s| impact(self.truth, contact_s, &setup.object, &setup.robot));
        Measures {
            prediction_error_m: self.prediction_error_m(),
            prediction_rotation_error_rad: self
                .last
                .and_then(|report| report.flight.as_ref())
                .zip(self.catch_s)
                .and_then(|(flight, catch_s)| self.turn_from(&flight.pose_at(catch_s).rotation)),
            prediction_errors_m: LEADS_S.map(|lead_s| self.earlier_prediction_error_m(lead_s)),
            tracking_error_m: self
                .at_catch
                .zip(plan)
                .map(|(sample, plan)| (sample.X_WG * grasp_centre_G - plan.X_WG * grasp_centre_G).norm()),
            grasp_offset_m: self.grasp_offset_m(),
            grasp_rotation_error_rad: self.at_catch.zip(plan).and_then(|(sample, plan)| {
                self.turn_from(&(sample.X_WG.rotation * plan.grasp.X_OG.rotation.inverse()))
            }),
            contact_delay_s: self.contact_delay_s(setup),
            relative_speed_mps: velocity_G.map(|it| it.norm()),
            sideways_fraction: velocity_G.and_then(|it| Some(it.try_normalize(1e-6)?.x.abs())),
            palm_fraction: velocity_G.and_then(|it| Some(-it.try_normalize(1e-6)?.y)),
            grasp_width_m: plan.map(|plan| plan.grasp.object_width_m),
            grasp_overhang_m: plan.map(|plan| plan.grasp.overhang_m),
            grasp_strength_m: plan.map(|plan| plan.grasp.strength_m),
            approach_is_free: plan.map(|plan| plan.approach_is_free),
            joint_travel_rad: self.at_catch.map(|sample| (sample.q - setup.robot.ready_q).abs().sum()),
            peak_contact_impulse_ns: impulses.fold(0.0, f64::max),
            catch_impulse_ns: impact.map(|it| it.impulse_ns),
            catch_joint_impulse_nms: impact.map(|it| it.joint_impulse_nms),
            contact_stop_ratio: impact.and_then(|it| Some(it.stop?.ratio)),
            contact_stop_joint: impact.and_then(|it| it.stop?.joint),
            peak_velocity_ratio: servo.peak_velocity_ratio,
            peak_acceleration_ratio: servo.peak_acceleration_ratio,
            peak_torque_ratio: servo.peak_torque_ratio,
            flight_velocity_ratio: before_contact.velocity,
            flight_torque_ratio: before_contact.torque,
            torque_clamped_s: servo.torque_clamped_s,
            late_trajectories: servo.late_trajectories,
            rejected_trajectories: servo.rejected_trajectories,
            discontinuous_trajectories: servo.discontinuous_trajectories,
            numerical_failures: measures::numerical_failures(self.snapshots),
            min_self_clearance_m: servo.min_self_clearance_m,
            min_floor_clearance_m: servo.min_floor_clearance_m,
            ..faulty_cameras::counted(self.snapshots)
        }
    }

    /// Finds the first time during the test at which the object was not held; `None` if it was held to the
    /// end.
    pub fn first_not_held_s(&self) -> Option<f64> {
        let contact_s = self.contact_s?;
        let (from, until) = (contact_s + HELD_FROM_S, contact_s + HELD_UNTIL_S);
        let mut test = self.truth.samples.windows(2).filter(|pair| (from..=until).contains(&pair[1].time_s));
        let disturbance =
            |sample: &TruthSample| self.truth.disturbed_since_s.is_some_and(|since| sample.time_s > since);
        let lost = test.find(|pair| {
            let most = if disturbance(&pair[1]) { DISTURBANCE_SPEED_MPS } else { HELD_SPEED_MPS };
            !is_squeezed(&pair[0], &pair[1]) || self.speed_in_hand_mps(&pair[1]) >= most
        });
        let end_s = self.truth.samples.last().map_or(0.0, |sample| sample.time_s);
        // A trial that ended before the test did had no object to hold any more.
        lost.map(|pair| pair[1].time_s).or_else(|| (end_s < until - 1e-6).then_some(end_s))
    }

    /// Returns whether the arm moved while the object should have been held at rest, before the disturbance
    /// test.
    pub fn moved_on(&self) -> bool {
        let Some(contact_s) = self.contact_s else { return false };
        let until_s = self.truth.disturbed_since_s.unwrap_or(f64::INFINITY).min(contact_s + HELD_UNTIL_S);
        let mut held = self.truth.samples.iter().filter(|it| (contact_s + HELD_FROM_S..until_s).contains(&it.time_s));
        held.any(|sample| sample.dq.amax() > AT_REST_RADPS)
    }

    /// Speed of the object relative to the gripper, over the last 10 ms. The speed of a single step would not
    /// do: when the physics changes the points at which two faces touch, a held object jerks by hundredths of
    /// a millimetre within one.
    fn speed_in_hand_mps(&self, now: &TruthSample) -> f64 {
        let Some(before) = sample_at(self.truth, now.time_s - SPEED_OVER_S) else { return f64::INFINITY };
        let p_GO = |sample: &TruthSample| sample.X_WG.inverse_transform_point(&sample.X_WO.translation.vector.into());
        (p_GO(now) - p_GO(before)).norm() / (now.time_s - before.time_s)
    }

    /// The furthest that the brain got, if it tells.
    pub fn furthest_status(&self) -> Option<Status> {
        let rank = |status: Status| match status {
            Status::NoObject => 0,
            Status::NoTrajectory => 1,
            Status::OutOfReach => 2,
            Status::NoGrasp => 3,
            Status::Blocked => 4,
            Status::NoPlan => 5,
            Status::OutOfBudget => 6,
            Status::PlanKept | Status::Approached | Status::Planned | Status::Committed => 7,
        };
        self.snapshots.iter().filter_map(|it| Some(it.report.as_ref()?.status)).max_by_key(|&status| rank(status))
    }
}
