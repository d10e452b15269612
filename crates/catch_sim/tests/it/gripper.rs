//! The gripper with the limits of a real one: how fast it closes, how hard it presses, when it obeys and what
//! it tells.

use catch_body::DriveControl;
use catch_cell::{GraspState, GripperMove, GripperState};
use catch_sim::{
    GripperDriveKind,
    gripper_drive::{DRIVE_MASS_KG, GripperDrive},
    physics::{World, WorldSettings},
    random_streams::{Draws, Stream},
};
use nalgebra::Point3;

use crate::{random_streams::furthest_from_uniform, setting};

const STEP_S: f64 = 1e-3;

fn drive(index: u64) -> GripperDrive {
    let gripper = setting::gripper();
    let mut draws = Draws::new(Stream::Gripper, 5, index);
    GripperDrive::new(GripperDriveKind::Real, &gripper, gripper.max_width_m, &mut draws)
}

fn close_at(start_s: f64) -> GripperMove {
    GripperMove { start_s, width_m: 0.0, speed_mps: 9.0, force_n: 500.0 }
}

/// A hand in the air with a ball in the middle of its fingers, or far away from it.
fn hand(ball_is_inside: bool) -> World {
    let gripper = setting::gripper();
    let settings = WorldSettings { drive_mass_kg: DRIVE_MASS_KG, ..setting::settings(0.6, 0.0) };
    let p_WG = Point3::new(0.0, 0.0, 2.0);
    let place = if ball_is_inside { [0.0, gripper.grasp_centre_y_m, 2.0] } else { [3.0, 0.0, 2.0] };
    let release = setting::release(place, [0.0; 3]);
    setting::fixed_hand(settings, p_WG, &gripper, gripper.max_width_m, &setting::object("tennis_ball"), &release)
}

/// State after one step: time, width, rate, force of each finger on the ball, reported state.
struct Sample {
    time_s: f64,
    width_m: f64,
    rate_mps: f64,
    finger_n: [f64; 2],
    state: GripperState,
}

/// Runs the hand without gravity, so that the ball waits to be taken.
fn run(world: &mut World, drive: &mut GripperDrive, steps: u32) -> Vec<Sample> {
    let step = |step: u32| {
        let time_s = f64::from(step) * STEP_S;
        let before = world.state();
        let mut loads = setting::no_loads();
        loads.gravity *= 0.0;
        loads.finger_force_n = drive.forces(time_s, before.finger_m, before.finger_mps);
        assert!(loads.finger_force_n.iter().sum::<f64>().abs() <= 160.0 + 1e-9, "two fingers of 80 N each");
        world.step(&loads);
        let state = world.state();
        Sample {
            time_s: time_s + STEP_S,
            width_m: state.finger_m[0] + state.finger_m[1],
            rate_mps: state.finger_mps[0] + state.finger_mps[1],
            finger_n: world.contact_forces.finger_n,
            state: drive.state(state.finger_m, state.finger_mps),
        }
    };
    (0..steps).map(step).collect()
}

/// 43 mm at 420 mm/s take 102 ms and gathering speed takes another 42 ms; asked for far more, it gives no
/// more.
#[test]
fn it_closes_no_faster_than_the_real_one() {
    let (mut world, mut drive) = (hand(false), drive(0));
    drive.receive(&[close_at(0.0)], 0.0);
    let samples = run(&mut world, &mut drive, 500);
    let passes = |width_m: f64| samples.iter().find(|it| it.width_m <= width_m).unwrap().time_s;
    let closing_s = passes(0.067) - passes(0.110 - 1e-6);
    assert!(closing_s >= 0.102, "{closing_s}");
    // v = a·t until v, the rest at v.
    let ideal_s = 0.420 / 5.0 + (0.043 - 0.420 * 0.420 / 10.0) / 0.420;
    assert!((closing_s - ideal_s).abs() < 0.004, "{closing_s} instead of {ideal_s}");
    let fastest = samples.iter().map(|it| it.rate_mps.abs()).fold(0.0, f64::max);
    assert!(fastest > 0.41 && fastest < 0.421, "{fastest}");
    let end = samples.last().unwrap();
    assert!(end.width_m < 1e-4 && end.state.grasp == GraspState::NoPart, "{:?}", end.state);
}

#[test]
fn it_presses_with_80_newtons_and_knows_that_it_holds_something() {
    let (mut world, mut drive) = (hand(true), drive(1));
    drive.receive(&[close_at(0.0)], 0.0);
    let samples = run(&mut world, &mut drive, 600);
    let touched_s = samples.iter().find(|it| it.finger_n[0] > 0.0).unwrap().time_s;
    let told_s = samples.iter().find(|it| it.state.grasp == GraspState::Holding).unwrap().time_s;
    // Told in the cycle after the fingers press with all their force and stand still.
    let presses = |it: &&Sample| it.state.force_n > 0.0 && it.rate_mps.abs() < 0.005 && it.finger_n[0] > 0.95 * 80.0;
    let pressed_s = samples.iter().find(presses).unwrap().time_s;
    assert!(told_s > touched_s && told_s < pressed_s + 2.0 / 140.0, "pressed at {pressed_s}, told at {told_s}");
    for sample in samples.iter().filter(|it| it.time_s > touched_s + 0.1) {
        for force_n in sample.finger_n {
            assert!(force_n > 79.0 && force_n < 80.1, "{force_n} at {}", sample.time_s);
        }
        assert_eq!(sample.state.grasp, GraspState::Holding);
        // The ball gives 3.3 mm on each side under 80 N.
        assert!((sample.state.width_m - (0.0672 - 2.0 * 0.0033)).abs() < 2e-4, "{:?}", sample.state);
        assert!(sample.state.force_n <= 80.0, "{:?}", sample.state);
    }
    let before = samples.iter().filter(|it| it.time_s < touched_s && it.state.width_m < 0.11);
    assert!(before.clone().count() > 20 && before.clone().all(|it| it.state.grasp == GraspState::Grasping));
}

/// The drive measures its fingers only, so here they alone are moved.
#[test]
fn a_part_that_slips_out_is_lost() {
    let mut drive = drive(2);
    drive.receive(&[close_at(0.0)], 0.0);
    let mut grasps = Vec::new();
    for step in 0..400 {
        let half_m = match step {
            0..50 => 0.055,
            50..200 => 0.03,
            _ => 0.028,
        };
        drive.forces(f64::from(step) * STEP_S, [half_m; 2], [0.0; 2]);
        let grasp = drive.state([half_m; 2], [0.0; 2]).grasp;
        if grasps.last() != Some(&grasp) {
            grasps.push(grasp);
        }
    }
    assert_eq!(grasps, [GraspState::Idle, GraspState::Grasping, GraspState::Holding, GraspState::PartLost]);
}

/// Latency of the fingers: uniformly within one cycle around 30 ms, whatever the scene.
#[test]
fn latencies_are_spread_over_one_cycle() {
    const SENT_S: f64 = 0.1;
    let latency = |index: u64| {
        let mut drive = drive(index);
        // Sent again and again until it is due, as a brain would.
        for tick in 0..=10 {
            drive.receive(&[close_at(SENT_S)], f64::from(tick) * 0.01);
        }
        let mut obeys = (0..).filter(|&step| {
            let [left, right] = drive.forces(f64::from(step) * 1e-4, [0.055; 2], [0.0; 2]);
            left + right < 0.0
        });
        f64::from(obeys.next().unwrap()) * 1e-4 - SENT_S
    };
    let latencies: Vec<f64> = (0..1000).map(latency).collect();
    let half_s = 0.5 / 140.0;
    // A tenth of a millisecond of sampling, and one step until the first force.
    let fractions: Vec<f64> = latencies.iter().map(|it| (it - 1.5e-4 - (0.03 - half_s)) / (2.0 * half_s)).collect();
    assert!(fractions.iter().all(|fraction| (-0.02..1.02).contains(fraction)), "{latencies:?}");
    let furthest = furthest_from_uniform(fractions);
    assert!(furthest < 1.63 / 1000f64.sqrt() + 0.014, "{furthest}");
}

#[test]
fn states_come_at_140_hertz_in_hundredths_of_a_millimetre() {
    let (mut world, mut drive) = (hand(false), drive(3));
    // Slow enough to move all the time.
    drive.receive(&[GripperMove { speed_mps: 0.1, ..close_at(0.0) }], 0.0);
    let samples = run(&mut world, &mut drive, 1000);
    let moving = &samples[50..950];
    let changes = moving.windows(2).filter(|pair| pair[0].state.width_m != pair[1].state.width_m).count();
    assert!((125..=127).contains(&changes), "{changes} in 0.9 s");
    for sample in &samples {
        let steps = sample.state.width_m / 1e-5;
        assert!((steps - steps.round()).abs() < 1e-6);
        assert!((sample.state.width_m - sample.width_m).abs() < 0.1 * (1.0 / 140.0 + 2.0 * STEP_S));
    }
}

/// Entries of a command that the drive does not use have no effect.
#[test]
fn drives_obey_what_they_can() {
    let width_after_m = |control: DriveControl, width_m: f64| {
        let mut gripper = setting::gripper();
        gripper.drive.control = control;
        let mut drive = setting::ideal_drive(&gripper, gripper.max_width_m);
        let crawl = GripperMove { start_s: 0.0, width_m, speed_mps: 0.01, force_n: 1.0 };
        drive.receive(&[crawl], 0.0);
        let mut world = hand(false);
        run(&mut world, &mut drive, 300).last().unwrap().width_m
    };
    let open_m = setting::gripper().max_width_m;
    assert!((width_after_m(DriveControl::SpeedAndForce, 0.06) - (open_m - 0.003)).abs() < 1e-3, "at 10 mm/s for 0.3 s");
    assert!((width_after_m(DriveControl::Position, 0.06) - 0.06).abs() < 1e-3, "at full speed");
    assert!((width_after_m(DriveControl::TwoState, 0.06) - open_m).abs() < 1e-3, "open");
    assert!(width_after_m(DriveControl::TwoState, 0.05) < 1e-3, "closed");
}

/// Fingers of 15 g stand where they were sent.
#[test]
fn light_fingers_do_not_chatter() {
    let mut gripper = setting::gripper();
    gripper.finger_mass_kg = 0.015;
    let mut drive = setting::ideal_drive(&gripper, gripper.max_width_m);
    drive.receive(&[GripperMove { start_s: 0.0, width_m: 0.06, speed_mps: f64::INFINITY, force_n: 70.0 }], 0.0);
    let p_WG = Point3::new(0.0, 0.0, 2.0);
    let release = setting::release([3.0, 0.0, 2.0], [0.0; 3]);
    let ball = setting::object("tennis_ball");
    let settings = setting::settings(0.6, 0.0);
    let mut world = setting::fixed_hand(settings, p_WG, &gripper, gripper.max_width_m, &ball, &release);
    let samples = run(&mut world, &mut drive, 200);
    assert!(samples[100..].iter().all(|it| (it.width_m - 0.06).abs() < 1e-3 && it.rate_mps.abs() < 0.05));
}
