//! The robot controller: how well it follows, and what it rejects and counts.

use catch_body::{JointVector, Robot};
use catch_cell::{ArmTrajectory, BSpline, Cell, Command, LimitKind, TrajectoryId, executor::PeakRatios};
use catch_sim::{
    Arena, ArenaConfig, Truth,
    config::{ControllerGains, RobotController, RobotErrors},
    random_streams::{Draws, Stream},
    servo::Servo,
};

use crate::setting;

fn arena(ready_q: &JointVector) -> Arena {
    let release = setting::release([9.0, 9.0, 9.0], [0.0; 3]);
    setting::arena(&ArenaConfig::default(), "tennis_ball", &release, ready_q)
}

/// Motion from rest to rest, close to a quintic polynomial: its values as control points, the ends three
/// times.
fn motion(start_s: f64, duration_s: f64, from: JointVector, to: JointVector) -> BSpline {
    let count = 16;
    let control_points: Vec<JointVector> = (0..count)
        .map(|i| {
            let u = (f64::from(i - 2) / f64::from(count - 5)).clamp(0.0, 1.0);
            from + (to - from) * (u * u * u * (10.0 - 15.0 * u + 6.0 * u * u))
        })
        .collect();
    let spans = control_points.len() - 3;
    let inner = (1..spans).map(|i| start_s + duration_s * i as f64 / spans as f64);
    let knots_s = [start_s; 4].into_iter().chain(inner).chain([start_s + duration_s; 4]).collect();
    BSpline { knots_s, control_points }
}

fn command(id: u64, spline: BSpline) -> Command {
    Command { arm: Some(ArmTrajectory { id: TrajectoryId(id), spline }), ..Default::default() }
}

fn send(arena: &mut Arena, id: u64, spline: BSpline) {
    let Ok(()) = arena.act(&command(id, spline));
}

fn senses(arena: &mut Arena, count: usize) {
    for _ in 0..count {
        let Ok(_) = arena.sense();
    }
}

/// The largest distance between the gripper where it was and where it should have been.
fn largest_tool_error(robot: &Robot, truth: &Truth, trajectory: &BSpline) -> f64 {
    let error = |sample: &catch_sim::TruthSample| {
        let wanted = robot.gripper_pose(&trajectory.setpoint(sample.time_s).q);
        (sample.X_WG.translation.vector - wanted.translation.vector).norm()
    };
    truth.samples.iter().map(error).fold(0.0, f64::max)
}

#[test]
fn a_fast_motion_is_followed_within_a_tenth_of_a_millimetre() {
    let robot = setting::robot();
    let from = robot.ready_q;
    let to = from + robot.joint_vector(&[0.27, -0.25, 0.27, 0.25, -0.39, -0.45, -0.45]).unwrap();
    let trajectory = motion(0.0, 0.5, from, to);
    let mut arena = arena(&from);
    let Ok(_) = arena.sense();
    send(&mut arena, 1, trajectory.clone());
    senses(&mut arena, 60);
    let truth = arena.truth();
    let fastest = truth.samples.iter().map(|sample| sample.dq.amax()).fold(0.0, f64::max);
    assert!(fastest > 1.5, "only {fastest} rad/s");
    let error = largest_tool_error(&robot, truth, &trajectory);
    assert_eq!(truth.servo.command_violations, []);
    assert!(error < 1e-4, "{error} m");
    assert_eq!(truth.servo.accepted_trajectories, 1);
    assert_eq!(truth.servo.torque_clamped_s, 0.0);
    let clearance = truth.servo.min_self_clearance_m.unwrap();
    assert!(clearance > 0.0 && truth.servo.min_floor_clearance_m.unwrap() > 0.0, "{clearance}");
}

/// The fast motion by encoders of 17 bits a turn, a cycle old: rms and largest error of any joint in mrad,
/// and the worst of what the brain is told.
#[test]
#[expect(clippy::print_stdout, reason = "the figure of docs/explanation/physics.md")]
fn encoders_cost_little_tracking_and_no_stability() {
    let robot = setting::robot();
    let from = robot.ready_q;
    let to = from + robot.joint_vector(&[0.27, -0.25, 0.27, 0.25, -0.39, -0.45, -0.45]).unwrap();
    let trajectory = motion(0.0, 0.5, from, to);
    let release = setting::release([9.0, 9.0, 9.0], [0.0; 3]);
    let errors_mrad = |robot_errors: RobotErrors| {
        let config = ArenaConfig { robot_errors, ..ArenaConfig::default() };
        let mut arena = setting::arena(&config, "tennis_ball", &release, &from);
        let Ok(_) = arena.sense();
        send(&mut arena, 1, trajectory.clone());
        let mut told = [0.0f64; 2];
        for _ in 0..100 {
            let Ok(observation) = arena.sense();
            let last = arena.truth().samples.last().unwrap();
            told[0] = told[0].max((observation.arm.q - last.q).amax());
            told[1] = told[1].max((observation.arm.dq - last.dq).amax());
        }
        let errors: Vec<f64> = arena
            .truth()
            .samples
            .iter()
            .flat_map(|it| (it.q - trajectory.setpoint(it.time_s).q).iter().take(7).copied().collect::<Vec<_>>())
            .collect();
        let mean_square = errors.iter().map(|it| it * it).sum::<f64>() / errors.len() as f64;
        let after = arena.truth().samples.iter().filter(|it| it.time_s > 0.8);
        let chatter = after.map(|it| it.dq.amax()).fold(0.0, f64::max);
        let largest = errors.iter().fold(0.0f64, |most, it| most.max(it.abs()));
        ([mean_square.sqrt() * 1e3, largest * 1e3], told, chatter)
    };
    let encoders = RobotErrors { encoder_step_rad: 4.8e-5, encoder_sd_rad: 2.4e-5, ..RobotErrors::default() };
    let links = RobotErrors { link_mass_spread: 0.03, ..RobotErrors::default() };
    let both = RobotErrors { link_mass_spread: 0.03, ..encoders };
    let [ideal, encoders, links, both] = [RobotErrors::default(), encoders, links, both].map(errors_mrad);
    println!("[rms, largest] in mrad, told off by [rad, rad/s], rad/s at rest");
    println!("ideal {ideal:?}\nencoders {encoders:?}\nlinks off by 3 % {links:?}\nboth {both:?}");
    assert_eq!((ideal.1, links.1), ([0.0; 2], [0.0; 2]));
    for (of_encoders, without) in [(encoders, ideal), (both, links)] {
        let ([_, largest_mrad], [told_rad, told_radps], at_rest_radps) = of_encoders;
        assert!(told_rad > 1e-6 && told_rad < 2e-4, "{told_rad}");
        assert!(told_radps > 1e-4 && told_radps < 0.05, "{told_radps}");
        assert!(largest_mrad < without.0[1] + 0.2, "{largest_mrad} mrad");
        assert!(at_rest_radps < 0.01, "it moves at {at_rest_radps} rad/s at rest");
    }
}

/// A joint that is jammed for two seconds goes on without overshoot by what its integral gathered meanwhile.
#[test]
fn the_integral_does_not_wind_up() {
    let robot = setting::robot();
    let q = robot.ready_q;
    let gains = ControllerGains { integral_per_s3: 2e4, ..ControllerGains::default() };
    let config = RobotController { gains, ..RobotController::default() };
    let mut servo = Servo::new(robot, q, config, Draws::new(Stream::RobotController, 0, 0));
    let rest = JointVector::zeros();
    let free = servo.torque(0.0, 1e-3, &q, &rest);
    let jammed = q + JointVector::ith(6, 1.0);
    for step in 1..2000 {
        let torque = servo.torque(f64::from(step) * 1e-3, 1e-3, &jammed, &rest);
        assert!(torque[6] < 0.0, "{torque}");
    }
    assert!(servo.report.torque_clamped_s > 1.5, "{:?}", servo.report);
    let asked = (servo.torque(2.0, 1e-3, &q, &rest) - free).amax();
    assert!(servo.asked_radps2.amax() < 100.0, "{} rad/s²", servo.asked_radps2.amax());
    assert!(asked < 5.0, "{asked} N·m where nothing is to be done");
}

#[test]
fn a_command_that_breaks_a_limit_is_counted() {
    let robot = setting::robot();
    let from = robot.ready_q;
    let slow = robot.joint_vector(&[0.2, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]).unwrap();
    let mut arena = arena(&from);
    let Ok(_) = arena.sense();
    send(&mut arena, 1, motion(0.0, 1.0, from, from + slow));
    assert_eq!(arena.truth().servo.command_violations, []);
    send(&mut arena, 2, motion(0.0, 0.05, from, from + slow));
    let servo = &arena.truth().servo;
    assert_eq!(servo.accepted_trajectories, 2);
    for kind in [LimitKind::Velocity, LimitKind::Acceleration, LimitKind::Torque] {
        let found = servo.command_violations.iter().filter(|it| it.joint == 0 && it.kind == kind).count();
        assert_eq!(found, 1, "{kind:?} in {:?}", servo.command_violations);
    }
    let beyond = robot.joint_vector(&[0.0, 0.9, 0.0, 0.0, 0.0, 0.0, 0.0]).unwrap();
    send(&mut arena, 3, motion(0.0, 3.0, from, from + beyond));
    let last = arena.truth().servo.command_violations.last().unwrap();
    assert_eq!((last.joint, last.kind), (1, LimitKind::Position));
    assert!((last.ratio - (1.344 + 0.9) / 2.0944).abs() < 1e-9);
}

/// The edge itself is allowed.
#[test]
fn a_command_at_its_limits_is_not_counted() {
    let mut robot = setting::robot();
    let from = robot.ready_q;
    let to = from + robot.joint_vector(&[0.3, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]).unwrap();
    let trajectory = motion(0.0, 0.5, from, to);
    let peak = |kind: LimitKind, robot: &Robot| PeakRatios::of(robot, &trajectory).highest(kind);
    let (velocity, acceleration) = (peak(LimitKind::Velocity, &robot), peak(LimitKind::Acceleration, &robot));
    robot.joints[0].limits.velocity *= velocity;
    robot.joints[0].limits.acceleration *= acceleration;
    let peaks = PeakRatios::of(&robot, &trajectory);
    assert_eq!(peaks.violations(), []);
    robot.joints[0].limits.velocity *= 1.0 - 1e-8;
    assert_eq!(PeakRatios::of(&robot, &trajectory).violations().len(), 1);
}

#[test]
fn late_and_discontinuous_commands_are_refused_and_the_old_one_goes_on() {
    let robot = setting::robot();
    let from = robot.ready_q;
    let to = from + robot.joint_vector(&[0.2, 0.1, 0.0, 0.0, 0.0, 0.0, 0.0]).unwrap();
    let trajectory = motion(0.0, 0.6, from, to);
    let mut arena = arena(&from);
    let Ok(_) = arena.sense();
    send(&mut arena, 1, trajectory.clone());
    senses(&mut arena, 20);
    // Continuous, but 1 ms too late.
    send(&mut arena, 2, motion(0.199, 0.6, from, to));
    assert_eq!(arena.truth().servo.late_trajectories, 1);
    // Under way for 20 ms, so late on arrival.
    arena.act_after(0.02, &command(3, BSpline::at_rest(0.21, from)));
    assert_eq!(arena.truth().servo.late_trajectories, 1);
    // In time, but 10 mrad away.
    let away = JointVector::ith(0, 0.01);
    send(&mut arena, 4, motion(0.7, 0.6, to + away, from));
    assert_eq!(arena.truth().servo.rejected_trajectories, 1);
    // Does not end at rest.
    let mut endless = motion(0.7, 0.6, to, from);
    *endless.control_points.last_mut().unwrap() = from + JointVector::ith(0, 0.1);
    send(&mut arena, 5, endless);
    // Not a number.
    let mut broken = motion(0.7, 0.6, to, from);
    broken.control_points[4][0] = f64::NAN;
    send(&mut arena, 6, broken);
    assert_eq!(arena.truth().servo.rejected_trajectories, 3);
    senses(&mut arena, 45);
    let servo = &arena.truth().servo;
    assert_eq!((servo.late_trajectories, servo.accepted_trajectories), (2, 1));
    let error = largest_tool_error(&robot, arena.truth(), &trajectory);
    assert!(error < 1e-4, "{error} m");
}

#[test]
fn trajectories_are_spliced_where_the_next_one_starts() {
    let robot = setting::robot();
    let from = robot.ready_q;
    let step = robot.joint_vector(&[0.2, 0.1, 0.0, 0.0, 0.0, 0.0, 0.0]).unwrap();
    let (first, second) = (motion(0.0, 0.4, from, from + step), motion(0.4, 0.4, from + step, from + step * 2.0));
    let mut arena = arena(&from);
    let Ok(_) = arena.sense();
    send(&mut arena, 1, first.clone());
    // Sent long before it starts; the third would continue the second and is dropped when another takes its
    // place.
    send(&mut arena, 2, second.clone());
    send(&mut arena, 3, motion(0.8, 0.4, from + step * 2.0, from));
    send(&mut arena, 4, motion(0.8, 0.5, from + step * 2.0, from + step));
    senses(&mut arena, 140);
    assert_eq!(arena.truth().servo.accepted_trajectories, 4);
    for sample in &arena.truth().samples {
        let wanted = match sample.time_s {
            t if t < 0.4 => first.setpoint(t),
            t if t < 0.8 => second.setpoint(t),
            t => motion(0.8, 0.5, from + step * 2.0, from + step).setpoint(t),
        };
        assert!((sample.q - wanted.q).amax() < 2e-4, "at {}", sample.time_s);
    }
}
