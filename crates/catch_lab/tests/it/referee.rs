//! The referee against what is known: a caught throw, changed in one thing, is missed for that reason;
//! measures are as other formulas have them.

use std::{f64::consts::PI, sync::LazyLock};

use catch_bot::{NumericalFailures, Report, Status, perception::CameraStatus};
use catch_cell::{LimitKind, LimitViolation};
use catch_lab::{
    referee::{self, LEADS_S, Verdict, reason::Reason},
    scenario::setup::{Choice, Setup},
    trial::{self, Trial},
};
use catch_sim::{
    TruthSample,
    truth::{Contact, PeakRatios},
};
use nalgebra::{UnitQuaternion, Vector3};

const VIOLATION: LimitViolation = LimitViolation { joint: 0, kind: LimitKind::Velocity, ratio: 1.5, time_s: 0.3 };

/// A throw without air that is caught, and what the referee says of it.
static CAUGHT: LazyLock<(Setup, Trial, Verdict)> = LazyLock::new(|| {
    let setup = Setup::load(&Choice { scenario: Some("paper"), object: Some("banana"), ..Choice::default() }).unwrap();
    let trial = trial::run(&setup, 1, 0, &mut |_, _| Ok(())).unwrap();
    let verdict = referee::judge(&setup, &trial);
    (setup, trial, verdict)
});

fn judged(change: impl FnOnce(&mut Trial)) -> Verdict {
    let (setup, caught, _) = &*CAUGHT;
    let mut trial = caught.clone();
    change(&mut trial);
    referee::judge(setup, &trial)
}

fn contact_s() -> f64 {
    CAUGHT.2.contact_s.unwrap()
}

fn catch_s() -> f64 {
    CAUGHT.2.catch_time_s.unwrap()
}

/// Changes the samples from `from_s` after the first contact on until `until_s` after it.
fn samples(trial: &mut Trial, [from_s, until_s]: [f64; 2], change: impl Fn(&mut TruthSample)) {
    let during = |it: &&mut TruthSample| (from_s..until_s).contains(&(it.time_s - contact_s()));
    trial.truth.samples.iter_mut().filter(during).for_each(change);
}

fn reports(trial: &mut Trial, change: impl Fn(&mut Report)) {
    trial.snapshots.iter_mut().filter_map(|it| it.report.as_mut()).for_each(change);
}

const ALWAYS: [f64; 2] = [-10.0, 10.0];

/// Nothing ever touched the object.
fn untouched(trial: &mut Trial) {
    samples(trial, ALWAYS, |it| it.contact = Contact::default());
}

/// The object slides along the hand from `from_s` after the first contact on.
fn sliding(trial: &mut Trial, from_s: f64, speed_mps: f64) {
    samples(trial, [from_s, 10.0], |it| {
        it.X_WO.translation.vector += it.X_WG.rotation * Vector3::z() * (it.time_s - contact_s() - from_s) * speed_mps;
    });
}

#[test]
fn a_caught_throw_is_caught_by_every_measure() {
    let verdict = &CAUGHT.2;
    assert!(verdict.caught && verdict.caught_beyond_limits && verdict.held_later, "{verdict:?}");
    assert!(verdict.caught_paper && verdict.caught_paper_code && verdict.reason.is_none(), "{verdict:?}");
}

#[test]
fn limits_count_once_they_are_broken() {
    let by_command = judged(|it| it.truth.servo.command_violations.push(VIOLATION));
    assert_eq!((by_command.reason, by_command.caught), (Some(Reason::LimitViolation), false));
    assert!(by_command.caught_beyond_limits);
    assert_eq!((by_command.limit_violations, by_command.first_violation), (1, Some(VIOLATION)));
    // The effect of an impact on the motion is reported apart and decides nothing.
    let in_motion = judged(|it| it.truth.servo.motion_violations.push(VIOLATION));
    assert!(in_motion.caught, "{in_motion:?}");
    assert_eq!((in_motion.limit_violations, in_motion.first_violation, in_motion.motion_excursions), (0, None, 1));
}

/// Peaks before the first contact are those of the motion that was commanded.
#[test]
fn peaks_in_flight_stand_apart_from_those_of_the_impact() {
    let measures = &CAUGHT.2.measures;
    assert!(measures.flight_velocity_ratio > 0.1 && measures.flight_velocity_ratio <= measures.peak_velocity_ratio);
    assert!(measures.flight_torque_ratio > 0.1 && measures.flight_torque_ratio <= measures.peak_torque_ratio);
    let in_flight = PeakRatios { velocity: 0.25, torque: 0.5 };
    let measures = judged(|it| it.truth.before_contact = Some(in_flight)).measures;
    assert_eq!((measures.flight_velocity_ratio, measures.flight_torque_ratio), (0.25, 0.5));
}

/// Fingers that nobody has told to close hold nothing, whatever lies between them.
#[test]
fn an_open_gripper_holds_nothing() {
    let open = |it: &mut TruthSample| it.commanded_width_m = it.width_m;
    let both = judged(|it| samples(it, ALWAYS, open));
    assert!(!both.caught && both.reason.is_some(), "{both:?}");
    let with_palm = |it: &mut TruthSample| {
        (it.contact.left_finger, it.contact.palm) = (false, true);
        open(it);
    };
    assert!(!judged(|it| samples(it, ALWAYS, with_palm)).caught);
}

/// Images ten times a second or a hundred: the object is shaken for half a second before the test ends.
#[test]
fn the_disturbance_lasts_half_a_second_at_every_rate_of_images() {
    let setup = |rate_hz: f64| {
        let settings = [format!("arena.frame_rate_hz={rate_hz}")];
        Setup::load(&Choice { scenario: Some("paper"), settings: &settings, ..Choice::default() }).unwrap()
    };
    for rate_hz in [10.0, 100.0] {
        let trial = trial::run(&setup(rate_hz), 1, 0, &mut |_, _| Ok(())).unwrap();
        let contact_s = trial.truth.samples.iter().find(|it| it.contact.gripper()).unwrap().time_s;
        let disturbed_s = trial.truth.disturbed_since_s.unwrap();
        assert!((disturbed_s - contact_s - 1.0).abs() < 1.5e-3, "{rate_hz} Hz: {}", disturbed_s - contact_s);
        assert!(trial.truth.samples.last().unwrap().time_s >= contact_s + 1.5 - 1.5e-3, "{rate_hz} Hz");
    }
}

/// A ball at rest in an open hand is no throw, nor is one that flies for longer than a trial lasts.
#[test]
fn what_is_no_throw_is_refused() {
    let (setup, ..) = &*CAUGHT;
    let fault = |position_m: [f64; 3], velocity_mps: [f64; 3]| {
        let text = format!(
            "[motion]\nkind = \"fixed\"\nposition_m = {position_m:?}\nvelocity_mps = {velocity_mps:?}\nspin_radps = [0.0, 0.0, 0.0]"
        );
        let throw = catch_sim::Throw::from_toml("still.toml", &text).unwrap();
        setup.with_throw("still".to_owned(), throw).check_throw(1, 0).err().map(|it| it.to_string())
    };
    let hand = setup.robot.gripper_pose(&setup.robot.ready_q) * setup.gripper.grasp_centre();
    for (position_m, part) in
        [(hand.coords.into(), "the palm"), ([2.0, 0.0, 0.01], "the floor"), ([0.0, 0.0, 0.2], "the arm")]
    {
        let said = fault(position_m, [0.0; 3]).unwrap();
        assert!(said.contains("still: motion") && said.contains("banana") && said.contains(part), "{said}");
        assert!(said.contains("touches nothing"), "{said}");
    }
    let said = fault([2.0, 0.0, 1.0], [0.0, 0.0, 40.0]).unwrap();
    assert!(said.contains("takes longer") && said.contains("within 5 s"), "{said}");
    assert_eq!(fault([2.0, 0.0, 1.0], [0.0, 0.0, 20.0]), None);
}

/// A flight of more than two seconds is waited for.
#[test]
fn a_trial_lasts_until_the_flight_has_landed() {
    let (setup, ..) = &*CAUGHT;
    let up = "[motion]\nkind = \"fixed\"\nposition_m = [3.0, 0.0, 0.5]\nvelocity_mps = [0.0, 0.0, 15.0]\nspin_radps = [0.0, 0.0, 0.0]";
    let setup = setup.with_throw("up".to_owned(), catch_sim::Throw::from_toml("up.toml", up).unwrap());
    let trial = trial::run(&setup, 1, 0, &mut |_, _| Ok(())).unwrap();
    let last = trial.truth.samples.last().unwrap();
    let floor_s = trial.truth.samples.iter().find(|it| it.contact.floor).map(|it| it.time_s);
    assert!(floor_s.is_some_and(|it| it > 3.0 && last.time_s < it + 0.3), "{floor_s:?}, ends at {}", last.time_s);
}

/// The arena's account of a throw is what it was thrown with.
#[test]
fn conditions_are_those_of_the_trial() {
    let setup = Setup::load(&Choice { scenario: Some("honest"), ..Choice::default() }).unwrap();
    let (arena, release, drawn) = (setup.arena(1, 3), setup.release(1, 3), setup.conditions(1, 3));
    let told = arena.truth().conditions.clone().unwrap();
    let first = arena.truth().samples[0];
    assert_eq!(Vector3::from(told.flight.release.position_m), first.X_WO.translation.vector);
    assert!((Vector3::from(told.flight.release.spin_radps) - first.V_WO.angular).norm() < 1e-12);
    assert_eq!(told.flight.release.orientation_xyzw, <[f64; 4]>::from(release.q_WO.coords));
    assert_eq!((told.flight.friction, told.flight.restitution), (drawn.friction, drawn.restitution));
    assert_eq!((told.flight.drag_per_m, told.flight.mass_kg), (drawn.drag_per_m, setup.object.mass_kg));
    assert_eq!(told.flight, setup.flight_conditions(1, 3));
    // The arm is not the model's, the gripper sits where G is, and the cameras stand beside where they are
    // believed to.
    assert_eq!(told.cell.link_mass_ratios.len(), 7);
    assert!(told.cell.link_mass_ratios.iter().all(|it| (0.97..=1.03).contains(it) && *it != 1.0), "{told:?}");
    let mount_m = Vector3::from(told.cell.gripper_mount.position_m).norm();
    assert!((mount_m - 0.0005).abs() < 1e-9, "{mount_m}");
    assert!(told.cell.gripper_phase_s.is_some_and(|it| (0.0..0.1).contains(&it)), "{told:?}");
    assert_eq!(told.cell.cameras.len(), setup.cameras.len());
    for (truly, believed) in told.cell.cameras.iter().zip(&setup.cameras) {
        let off_m = (Vector3::from(truly.pose.position_m) - believed.X_WC.translation.vector).norm();
        assert!(off_m > 0.0 && off_m < 0.02, "{off_m}");
    }
    let text = serde_json::to_string(&told).unwrap();
    assert_eq!(serde_json::from_str::<catch_sim::ThrowConditions>(&text).unwrap(), told);
}

/// A changed trial has the reason of the change; none where it is still a catch.
#[test]
fn a_throw_that_was_held_is_lost_for_one_reason() {
    let while_held = [0.8, 0.81];
    let disturbed_s = CAUGHT.1.truth.disturbed_since_s.unwrap() - contact_s();
    let outcome = |change: &dyn Fn(&mut Trial)| judged(change).reason;
    let touched = |part: fn(&mut Contact)| outcome(&move |it| samples(it, while_held, |it| part(&mut it.contact)));
    let let_go = |from_s: f64| outcome(&move |it| samples(it, [from_s, 10.0], |it| it.contact = Contact::default()));
    let slid = |from_s: f64, speed_mps: f64| outcome(&move |it| sliding(it, from_s, speed_mps));
    let moving = |radps: f64| outcome(&move |it| samples(it, while_held, |it| it.dq[3] = radps));
    assert_eq!(outcome(&|it| it.truth.diverged_s = Some(0.1)), Some(Reason::SimulationDiverged));
    assert_eq!(outcome(&|it| it.truth.servo.min_self_clearance_m = Some(0.0)), Some(Reason::ArmCollision));
    assert_eq!(outcome(&|it| it.truth.servo.min_floor_clearance_m = Some(-0.01)), Some(Reason::ArmCollision));
    assert_eq!(touched(|it| it.arm = true), Some(Reason::HitArm));
    assert_eq!(touched(|it| it.obstacle = true), Some(Reason::HitObstacle));
    assert_eq!(touched(|it| it.floor = true), Some(Reason::HitFloor));
    assert_eq!((moving(0.019), moving(-0.021)), (None, Some(Reason::MovedOn)));
    // One finger and the palm hold, too, if the fingers have closed; one finger alone does not.
    assert_eq!(touched(|it| (it.left_finger, it.palm) = (false, true)), None);
    assert_eq!(touched(|it| (it.left_finger, it.palm) = (false, false)), Some(Reason::Dropped));
    assert_eq!((let_go(0.3), let_go(0.7)), (Some(Reason::SlippedOut), Some(Reason::Dropped)));
    // Nor do fingers that still move, with the palm.
    let closing = |it: &mut TruthSample| {
        (it.contact.left_finger, it.contact.palm) = (false, true);
        it.width_m += 0.2 * (it.time_s - contact_s());
    };
    assert_eq!(outcome(&|it| samples(it, while_held, closing)), Some(Reason::Dropped));
    // Held long enough, but not when the test begins.
    assert_eq!(outcome(&|it| samples(it, [0.5, 0.51], |it| it.contact = Contact::default())), Some(Reason::Dropped));
    // It may move twice as fast while the world shakes.
    assert_eq!((slid(0.6, 0.015), slid(0.6, 0.025)), (None, Some(Reason::Dropped)));
    assert_eq!((slid(disturbed_s, 0.035), slid(disturbed_s, 0.06)), (None, Some(Reason::Dropped)));
}

/// A throw that both fingers never held is missed for the first cause in the order in which things go wrong.
#[test]
fn a_throw_that_was_never_held_is_missed_for_its_cause() {
    let aside = Vector3::new(0.0, 0.1, 0.0);
    let missed = |change: &dyn Fn(&mut Trial)| {
        let verdict = judged(|it| {
            untouched(it);
            change(it);
        });
        verdict.reason.unwrap()
    };
    let hand_aside = |it: &mut Trial| samples(it, ALWAYS, |it| it.X_WG.translation.vector += aside);
    let flight_aside = |it: &mut Trial| reports(it, |it| it.flight.iter_mut().for_each(|it| it.p_WOcm += aside));
    let pose_aside =
        |it: &mut Trial| reports(it, |it| it.pose.iter_mut().for_each(|it| it.X_WO.translation.vector += aside));
    let stuck_at =
        |status: Status| missed(&move |it: &mut Trial| reports(it, |it| (it.plan, it.status) = (None, status)));
    assert_eq!(missed(&|_| ()), Reason::ClosedLate);
    assert_eq!(missed(&hand_aside), Reason::MissedPosition);
    assert_eq!(missed(&flight_aside), Reason::Prediction);
    let both_aside = |it: &mut Trial| {
        flight_aside(it);
        pose_aside(it);
    };
    assert_eq!(missed(&both_aside), Reason::Perception);
    let late = |it: &mut Trial| {
        let servo = &mut it.truth.servo;
        (servo.accepted_trajectories, servo.late_trajectories) = (0, 1);
    };
    assert_eq!(missed(&late), Reason::Late);
    assert_eq!(missed(&|it| it.truth.servo.accepted_trajectories = 0), Reason::ClosedLate);
    let by_status = [
        (Status::NoObject, Reason::Perception),
        (Status::NoTrajectory, Reason::Prediction),
        (Status::OutOfReach, Reason::OutOfReach),
        (Status::NoGrasp, Reason::NoGrasp),
        (Status::Blocked, Reason::Blocked),
        (Status::NoPlan, Reason::NoPlan),
        (Status::OutOfBudget, Reason::OutOfBudget),
    ];
    assert!(by_status.iter().all(|(status, reason)| stuck_at(*status) == *reason));
    // The object meets one part of the hand, with the fingers this far open.
    let plan = CAUGHT.1.snapshots.iter().rev().find_map(|it| it.report.as_ref()?.plan.clone()).unwrap();
    let meets_from = |from_s: f64, part: fn(&mut Contact), width_m: f64| {
        missed(&move |it: &mut Trial| {
            samples(it, [from_s, 0.01], |it| {
                part(&mut it.contact);
                it.width_m = width_m;
            });
        })
    };
    let meets = |part: fn(&mut Contact), width_m: f64| meets_from(0.0, part, width_m);
    let finger = |it: &mut Contact| it.left_finger = true;
    let palm = |it: &mut Contact| it.palm = true;
    let object_m = plan.grasp.object_width_m;
    assert_eq!(meets(finger, plan.aperture_m - 0.001), Reason::HitFinger);
    assert_eq!(meets(palm, plan.aperture_m - 0.001), Reason::ClosedLate);
    assert_eq!(meets(finger, object_m - 0.003), Reason::ClosedEarly);
    assert_eq!(meets(finger, object_m - 0.001), Reason::SlippedOut);
    // At the contact with the fingers the object was more than 2 cm short of its place.
    assert_eq!(meets_from(catch_s() - contact_s() - 0.015, finger, object_m), Reason::ClosedEarly);
    // Contacts after that with the gripper are no cause.
    let then_arm = |it: &mut Trial| {
        samples(it, [0.0, 0.01], |it| (it.contact.left_finger, it.width_m) = (true, object_m));
        samples(it, [0.02, 0.03], |it| it.contact.arm = true);
    };
    assert_eq!(missed(&then_arm), Reason::SlippedOut);
    // Poses that are off since it was touched tell nothing of perception.
    let pushed = |it: &mut Trial| {
        samples(it, [-0.1, -0.09], |it| it.contact.left_finger = true);
        flight_aside(it);
        reports(it, |it| {
            let since_touch = it.pose.iter_mut().filter(|it| it.capture_s >= contact_s() - 0.1);
            since_touch.for_each(|it| it.X_WO.translation.vector += aside);
        });
    };
    assert_eq!(missed(&pushed), Reason::Prediction);
    let arm_first = |it: &mut Trial| samples(it, [-0.1, -0.09], |it| it.contact.arm = true);
    assert_eq!(missed(&arm_first), Reason::HitArm);
    let obstacle_first = |it: &mut Trial| samples(it, [-0.1, -0.09], |it| it.contact.obstacle = true);
    assert_eq!(missed(&obstacle_first), Reason::HitObstacle);
}

/// Without air the undisturbed object flies along one parabola from the release on.
#[test]
fn errors_are_those_against_the_parabola_of_the_release() {
    let (setup, trial, verdict) = &*CAUGHT;
    let release = &trial.truth.samples[0];
    let com_O = referee::true_com_O(setup);
    let g = catch_body::dynamics::gravity();
    let com_W = |t: f64| release.X_WO.translation.vector + release.V_WO.linear * t + g * (t * t / 2.0);
    let error_by = |until_s: f64| {
        let known = trial.snapshots.iter().rfind(|it| it.time_s <= until_s).and_then(|it| it.report.as_ref()).unwrap();
        let predicted = known.flight.as_ref().unwrap().pose_at(catch_s()) * com_O;
        (predicted.coords - com_W(catch_s())).norm()
    };
    // The engine's steps of 1 ms leave the parabola by less than this.
    let near = |a: Option<f64>, b: f64| (a.unwrap() - b).abs() < 2e-5;
    let measures = &verdict.measures;
    assert!(near(measures.prediction_error_m, error_by(catch_s())), "{measures:?}");
    for (error_m, lead_s) in measures.prediction_errors_m.into_iter().zip(LEADS_S) {
        assert!(near(error_m, error_by(catch_s() - lead_s + 1e-9)), "{lead_s}: {measures:?}");
    }
    // It does not spin.
    assert!(release.V_WO.angular.norm() < 1e-9, "{:?}", release.V_WO);
    let known = trial.snapshots.iter().rfind(|it| it.time_s <= catch_s()).and_then(|it| it.report.as_ref()).unwrap();
    // A banana looks the same after half a turn about one of its axes; the other two lead far away.
    let R_WO = known.flight.as_ref().unwrap().pose_at(catch_s()).rotation;
    let half_turns = [Vector3::x(), Vector3::y(), Vector3::z()].map(|axis| UnitQuaternion::from_scaled_axis(axis * PI));
    let alike = half_turns.iter().map(|turn| R_WO * turn).chain([R_WO]);
    let turned_rad = alike.map(|it| it.angle_to(&release.X_WO.rotation)).fold(PI, f64::min);
    assert!(near(measures.prediction_rotation_error_rad, turned_rad), "{turned_rad} {measures:?}");
    let at = |time_s: f64| trial.truth.samples.iter().find(|it| it.time_s > time_s - 0.5e-3).unwrap();
    let plan =
        trial.snapshots.iter().rfind(|it| it.time_s <= catch_s()).and_then(|it| it.report.as_ref()?.plan.clone());
    let (plan, X_WG, centre_G) = (plan.unwrap(), at(catch_s()).X_WG, setup.gripper.grasp_centre());
    let wanted_W = X_WG * (plan.grasp.X_OG.inverse() * com_O);
    assert!(near(measures.grasp_offset_m, (wanted_W.coords - com_W(catch_s())).norm()), "{measures:?}");
    assert!(near(measures.tracking_error_m, (X_WG * centre_G - plan.X_WG * centre_G).norm()), "{measures:?}");
    let moved: f64 = at(catch_s()).q.iter().zip(setup.robot.ready_q.iter()).map(|(a, b)| (a - b).abs()).sum();
    assert!(near(measures.joint_travel_rad, moved), "{measures:?}");
}

/// Velocities in the hand against differences of positions in the hand.
#[test]
fn velocities_in_the_hand_are_those_of_positions_in_the_hand() {
    let (_, trial, verdict) = &*CAUGHT;
    let free = trial.truth.samples.iter().take_while(|it| !it.contact.any() && it.time_s < catch_s() - 1e-9);
    let free: Vec<&TruthSample> = free.collect();
    let [before, last] = free[free.len() - 2..] else { panic!("nothing flew") };
    let p_GO = |it: &TruthSample| it.X_WG.inverse_transform_point(&it.X_WO.translation.vector.into());
    let v_G = (p_GO(last) - p_GO(before)) / (last.time_s - before.time_s);
    let measures = &verdict.measures;
    let near = |a: Option<f64>, b: f64| (a.unwrap() - b).abs() < 0.02;
    assert!(near(measures.relative_speed_mps, v_G.norm()), "{v_G} {measures:?}");
    assert!(near(measures.sideways_fraction, v_G.x.abs() / v_G.norm()), "{v_G} {measures:?}");
    assert!(near(measures.palm_fraction, -v_G.y / v_G.norm()), "{v_G} {measures:?}");
}

/// The hand takes from the object what stops it relative to the hand, and each part of the hand touches it
/// when the samples say so.
#[test]
fn impulses_and_instants_of_contact_are_those_of_the_samples() {
    let (setup, trial, verdict) = &*CAUGHT;
    let (samples, measures) = (&trial.truth.samples, &verdict.measures);
    let first = samples.iter().position(|it| it.time_s >= contact_s()).unwrap();
    let last = samples.iter().rposition(|it| it.time_s < contact_s() + 0.02).unwrap();
    let (before, after) = (&samples[first - 1], &samples[last]);
    let weight = catch_body::dynamics::gravity() * (after.time_s - before.time_s);
    let impulse_ns = (after.V_WO.linear - before.V_WO.linear - weight).norm() * setup.object.mass_kg;
    assert!((measures.catch_impulse_ns.unwrap() - impulse_ns).abs() < 1e-9, "{impulse_ns} {measures:?}");
    let touched = |part: fn(&Contact) -> bool| samples.iter().find(|it| part(&it.contact)).unwrap().time_s;
    let midway_s = f64::midpoint(touched(|it| it.left_finger), touched(|it| it.right_finger));
    // The instant at which the parabola from the release on comes nearest to the grasp centre.
    let (release, g) = (&samples[0], catch_body::dynamics::gravity());
    let distance_m = |it: &TruthSample| {
        let t = it.time_s;
        let p_W = release.X_WO.translation.vector + release.V_WO.linear * t + g * (t * t / 2.0);
        (p_W - (it.X_WG * setup.gripper.grasp_centre()).coords).norm()
    };
    let near = samples.iter().filter(|it| (it.time_s - catch_s()).abs() < 0.04);
    let nearest = near.min_by(|a, b| distance_m(a).total_cmp(&distance_m(b))).unwrap();
    let delay_s = midway_s - nearest.time_s;
    assert!((measures.contact_delay_s.unwrap() - delay_s).abs() < 1.5e-3, "{delay_s} {measures:?}");
    let peak_ns = judged(|it| it.truth.samples[first].contact.peak_impulse_ns = 7.0).measures.peak_contact_impulse_ns;
    assert!((peak_ns - 7.0).abs() < 1e-12 && measures.peak_contact_impulse_ns < 7.0);
}

/// The counts of the servo and the brain are passed on.
#[test]
fn what_servo_and_brain_count_is_in_the_measures() {
    let by_servo = judged(|it| {
        let servo = &mut it.truth.servo;
        (servo.torque_clamped_s, servo.peak_velocity_ratio) = (0.25, 0.5);
        (servo.peak_acceleration_ratio, servo.peak_torque_ratio) = (0.75, 1.25);
        (servo.late_trajectories, servo.rejected_trajectories, servo.discontinuous_trajectories) = (3, 4, 5);
        (servo.min_self_clearance_m, servo.min_floor_clearance_m) = (Some(0.1), Some(0.2));
    });
    let it = by_servo.measures;
    assert_eq!((it.torque_clamped_s, it.peak_velocity_ratio), (0.25, 0.5));
    assert_eq!((it.peak_acceleration_ratio, it.peak_torque_ratio), (0.75, 1.25));
    assert_eq!((it.late_trajectories, it.rejected_trajectories, it.discontinuous_trajectories), (3, 4, 5));
    assert_eq!((it.min_self_clearance_m, it.min_floor_clearance_m), (Some(0.1), Some(0.2)));
    let statuses = {
        use CameraStatus::{Blinded, Displaced, Frozen, Good, Silent, Swapped, Uncalibrated};
        let faulty = [vec![Blinded], vec![Frozen; 2], vec![Silent; 3], vec![Displaced; 4], vec![Swapped; 5]];
        let faulty = [faulty.concat(), vec![Uncalibrated; 6]];
        [vec![Good], faulty.concat()].concat()
    };
    let it = judged(|it| reports(it, |it| it.cameras.clone_from(&statuses))).measures;
    let by_status =
        [it.blinded_cameras, it.frozen_cameras, it.silent_cameras, it.displaced_cameras, it.swapped_cameras];
    assert_eq!((by_status, it.uncalibrated_cameras), ([1, 2, 3, 4, 5], 6));
    let counted = |it: &mut Report| it.numerical_failures = NumericalFailures { prediction: 2, planning: 5 };
    assert_eq!(judged(|it| reports(it, counted)).measures.numerical_failures, 7);
}

/// The paper's measures look at one instant along one axis.
#[test]
fn the_papers_measures_look_along_z_of_the_gripper() {
    let counted = |along: Vector3<f64>| {
        let verdict = judged(|it| samples(it, ALWAYS, |it| it.X_WO.translation.vector += it.X_WG.rotation * along));
        (verdict.caught_paper, verdict.caught_paper_code)
    };
    let (setup, trial, _) = &*CAUGHT;
    let at = trial.truth.samples.iter().find(|it| it.time_s > 0.875 - 0.5e-3).unwrap();
    let z_m = at.X_WG.inverse_transform_point(&(at.X_WO * setup.object.origin_O)).z;
    let to = |z: f64| counted(Vector3::new(0.0, 0.0, z - z_m));
    assert_eq!([0.024, 0.026, 0.049, 0.051].map(to), [(true, true), (false, true), (false, true), (false, false)]);
    assert_eq!([-0.024, -0.026, -0.049, -0.051].map(to), [(true, true), (false, true), (false, true), (false, false)]);
    assert_eq!(counted(Vector3::new(0.2, 0.2, 0.0)), (true, true));
    let let_go =
        |from_s: f64| judged(|it| samples(it, [from_s - contact_s(), 10.0], |it| it.contact = Contact::default()));
    assert!(let_go(1.28).held_later && !let_go(1.27).held_later);
}
