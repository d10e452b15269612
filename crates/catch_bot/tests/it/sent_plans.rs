//! Plans that are still the arm's after some were rejected, lost or replaced.

use catch_body::{Gripper, JointVector, Pose, Robot, robot_file::RobotFiles, shape::Cuboid};
use catch_bot::{
    control::{Config, Controller, Decision, Progress, Status, sent_plans::SentPlans},
    grasp_selection::{Approach, Grasp},
    trajectory_optimization::{CatchPlan, terminal_velocity::Weights},
    trajectory_prediction::FlightTrajectory,
};
use catch_cell::{
    ArmState, BSpline, Command, GraspState, GripperMove, GripperState, Observation, RejectedTrajectory, Rejection,
    Setpoint, TrajectoryId,
};
use nalgebra::{Point3, Vector3};

/// A plan whose trajectory stands at `q` from `start_s` on.
fn plan(start_s: f64, q: f64) -> CatchPlan {
    let grasp = Grasp {
        X_OG: Pose::identity(),
        object_width_m: 0.05,
        aperture_m: 0.1,
        strength_m: 0.0,
        overhang_m: 0.0,
        held_G: Cuboid { centre: Point3::origin(), size: Vector3::zeros() },
    };
    CatchPlan {
        catch_s: start_s + 0.5,
        grasp,
        approach: Approach::TowardPalm,
        X_WG: Pose::identity(),
        q: JointVector::repeat(q),
        aperture_m: 0.1,
        approach_is_free: true,
        elbow: None,
        speed_fraction: 0.0,
        spin_radps: 0.0,
        weights: Weights::BALANCED,
        cost: 0.0,
        holding_cost: 0.0,
        trajectory: BSpline::at_rest(start_s, JointVector::repeat(q)),
    }
}

fn arm(time_s: f64, executing: Option<u64>, rejected: &[u64]) -> ArmState {
    let (q, dq) = (JointVector::zeros(), JointVector::repeat(1.0));
    let reject = |id: &u64| RejectedTrajectory { id: TrajectoryId(*id), reason: Rejection::Declined };
    ArmState {
        time_s,
        q,
        dq,
        commanded: Setpoint { q, dq, ddq: JointVector::zeros() },
        executing: executing.map(TrajectoryId),
        rejected: rejected.iter().map(reject).collect(),
    }
}

fn sent(starts_s: &[f64]) -> SentPlans {
    let mut plans = SentPlans::default();
    for (i, start_s) in starts_s.iter().enumerate() {
        let trajectory = plans.send(plan(*start_s, i as f64 + 1.0));
        assert_eq!(trajectory.id, TrajectoryId(i as u64 + 1));
    }
    plans
}

fn catches(plans: &SentPlans) -> Vec<f64> {
    plans.iter().map(|plan| plan.q[0]).collect()
}

#[test]
fn a_rejected_plan_is_dropped_with_those_that_went_on_from_it() {
    let mut plans = sent(&[0.0, 0.1, 0.2]);
    assert!(plans.acknowledge(&arm(0.05, Some(1), &[2])));
    assert_eq!(catches(&plans), [1.0]);
    assert!((plans.setpoint(0.3, &arm(0.05, Some(1), &[])).q[0] - 1.0).abs() < 1e-12);
    // The next one goes on from what executes, under a new identifier.
    assert_eq!(plans.send(plan(0.3, 9.0)).id, TrajectoryId(4));
}

#[test]
fn nothing_is_dropped_while_stamps_are_a_little_off() {
    let mut plans = sent(&[0.0, 0.1]);
    assert!(!plans.acknowledge(&arm(0.1004, Some(1), &[])));
    assert_eq!(catches(&plans), [1.0, 2.0]);
    assert!(!plans.acknowledge(&arm(0.11, Some(2), &[])));
    assert_eq!(catches(&plans), [2.0], "what has been replaced is forgotten");
}

#[test]
fn what_does_not_begin_has_been_lost() {
    let mut plans = sent(&[0.0, 0.1, 0.2]);
    assert!(plans.acknowledge(&arm(0.15, Some(1), &[])));
    assert_eq!(catches(&plans), [1.0]);
    let mut plans = sent(&[0.1]);
    assert!(plans.acknowledge(&arm(0.15, None, &[])));
    assert_eq!(plans.last(), None);
}

/// A moving arm whose trajectory nobody here has sent is not taken to stand still.
#[test]
fn what_somebody_else_has_sent_is_extrapolated() {
    let mut plans = SentPlans::default();
    let state = arm(0.5, Some(40), &[41]);
    assert!(!plans.acknowledge(&state));
    let ahead = plans.setpoint(0.51, &state);
    assert!((ahead.q[0] - 0.01).abs() < 1e-15 && ahead.dq[0] == 1.0);
    assert_eq!(plans.send(plan(0.51, 1.0)).id, TrajectoryId(42));
}

/// An arm that waits, its gripper open, and the controller for it.
fn controller() -> (Controller, Observation) {
    let files = RobotFiles {
        urdf_file: "robot.urdf",
        urdf: include_str!("../../../../assets/robots/iiwa14/robot.urdf"),
        toml_file: "robot.toml",
        toml: include_str!("../../../../assets/robots/iiwa14/robot.toml"),
    };
    let robot = Robot::from_files(&files).unwrap();
    let toml = include_str!("../../../../assets/grippers/wsg50.toml");
    let gripper = Gripper::from_toml("wsg50.toml", toml).unwrap();
    let fingers = GripperState { width_m: 0.1, speed_mps: 0.0, force_n: 0.0, grasp: GraspState::Idle };
    let observation = Observation { time_s: 0.0, arm: arm(0.0, None, &[]), gripper: fingers, frames: Vec::new() };
    (Controller::new(Config::default(), Default::default(), robot, gripper), observation)
}

fn send(controller: &mut Controller, observation: &Observation, plan: CatchPlan) -> Vec<GripperMove> {
    let decision = Decision { status: Status::Planned, plan: Some(plan), progress: Progress::default() };
    controller.command(observation, decision, &FlightTrajectory::default()).gripper.unwrap()
}

#[test]
fn the_gripper_moves_of_a_rejected_plan_are_withdrawn() {
    let (mut controller, mut observation) = controller();
    let flight = FlightTrajectory::default();
    assert!(send(&mut controller, &observation, plan(0.0, 0.0)).iter().any(|it| it.width_m == 0.0));
    (observation.time_s, observation.arm) = (0.01, arm(0.01, None, &[1]));
    controller.acknowledge(&observation, Some(&flight));
    assert_eq!((controller.plan(), controller.closing), (None, None));
    assert_eq!(controller.amended(Command::default()).gripper, Some(Vec::new()));
    assert_eq!(controller.amended(Command::default()).gripper, None, "once is enough");
}

#[test]
fn fingers_that_close_for_a_rejected_plan_are_opened() {
    let (mut controller, mut observation) = controller();
    send(&mut controller, &observation, plan(0.0, 0.0));
    let started_s = controller.closing.unwrap().start_s + 0.005;
    (observation.time_s, observation.arm) = (started_s, arm(started_s, None, &[1]));
    controller.acknowledge(&observation, Some(&FlightTrajectory::default()));
    let moves = controller.amended(Command::default()).gripper.unwrap();
    assert!(moves.len() == 1 && moves[0].width_m > 0.1 && moves[0].start_s <= started_s, "{moves:?}");
}

/// The arm goes on as before, and so does the hand, also where it is too late for another plan.
#[test]
fn the_gripper_closes_for_the_plan_that_runs_again() {
    let (mut controller, mut observation) = controller();
    let before = send(&mut controller, &observation, plan(0.0, 0.0));
    (observation.time_s, observation.arm) = (0.01, arm(0.01, Some(1), &[]));
    let earlier = CatchPlan { catch_s: 0.3, ..plan(0.02, 0.0) };
    let rejected = send(&mut controller, &observation, earlier);
    assert_ne!(rejected.last().map(|it| it.start_s), before.last().map(|it| it.start_s));
    (observation.time_s, observation.arm) = (0.02, arm(0.02, Some(1), &[2]));
    controller.acknowledge(&observation, Some(&FlightTrajectory::default()));
    assert_eq!(controller.plan().map(|it| it.catch_s), Some(0.5));
    let moves = controller.amended(Command::default()).gripper.unwrap();
    assert_eq!(moves.last().unwrap().width_m, 0.0);
    assert!((moves.last().unwrap().start_s - before.last().unwrap().start_s).abs() < 1e-9, "{moves:?}");
}

/// A cell that forgets a trajectory which has ended does not make the hand let go.
#[test]
fn a_hand_stays_closed_after_the_catch() {
    let (mut controller, mut observation) = controller();
    send(&mut controller, &observation, plan(0.0, 0.0));
    let closing = controller.closing;
    (observation.time_s, observation.arm) = (0.6, arm(0.6, None, &[]));
    controller.acknowledge(&observation, Some(&FlightTrajectory::default()));
    assert_eq!(controller.amended(Command::default()).gripper, None);
    assert_eq!(controller.closing, closing);
}
