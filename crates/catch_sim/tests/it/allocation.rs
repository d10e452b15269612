//! A step of the arena allocates nothing.
//!
//! The arenas have no cameras: each image is a new one for the brain, but it comes every 10 ms only. The list
//! of the true states grows with each step; the few times at which it moves to a place twice as large are
//! allowed for. The object is a ball: for two shapes with corners the collision library copies the points of
//! the step before, and it gathers those of an overlap in lists of its own.

use catch_cell::{ArmTrajectory, BSpline, Cell, Command, GripperMove, TrajectoryId};
use catch_sim::{
    Arena, ArenaConfig, Contact, Equipment, GripperDriveKind, Release, TruthSample,
    aerodynamics::AerodynamicsConfig,
    config::{ControllerGains, RobotController, RobotErrors},
};
use nalgebra::{Point3, Vector3};

use crate::setting;

/// All that costs something in a step.
fn busy(gripper: GripperDriveKind) -> ArenaConfig {
    let gains = ControllerGains { integral_per_s3: 1e3, ..ControllerGains::default() };
    ArenaConfig {
        gripper,
        drag: true,
        aerodynamics: AerodynamicsConfig { drag_anisotropy: 0.5, max_magnus: 0.01, max_spin_decay_per_s: 0.5 },
        robot_errors: RobotErrors { encoder_sd_rad: 1e-5, ..RobotErrors::default() },
        robot_controller: RobotController { gains, ..RobotController::default() },
        ..ArenaConfig::default()
    }
}

/// What happens in 1.2 s in which an arena closes its gripper and turns its wrist.
fn observed(config: ArenaConfig, release: &Release) -> Vec<TruthSample> {
    let robot = setting::robot();
    let equipment = Equipment::new(config, robot.clone(), setting::gripper(), setting::object("tennis_ball"), vec![]);
    let mut arena = Arena::new(&equipment, release, (&robot.ready_q, setting::WIDTH_M), 0, 0);
    let Ok(_) = arena.sense();
    let turned = robot.ready_q + robot.joint_vector(&[0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.2]).unwrap();
    let control_points = [[robot.ready_q; 3], [turned; 3]].concat();
    let spline = BSpline { knots_s: vec![0.1, 0.1, 0.1, 0.1, 0.5, 0.7, 1.1, 1.1, 1.1, 1.1], control_points };
    let arm = Some(ArmTrajectory { id: TrajectoryId(1), spline });
    let close = GripperMove { start_s: 0.04, width_m: 0.0, speed_mps: f64::INFINITY, force_n: 80.0 };
    let Ok(()) = arena.act(&Command { arm, gripper: Some(vec![close]), ..Command::default() });
    for _ in 0..120 {
        let capacity = arena.truth().samples.capacity();
        let allocated = allocation_counter::measure(|| drop(arena.sense()));
        let grew = u64::from(arena.truth().samples.capacity() > capacity);
        // The first steps make the buffers as large as they need to be.
        assert!(allocated.count_total == grew || arena.time_s() < 0.02, "until {} s: {allocated:?}", arena.time_s());
    }
    assert_eq!(arena.truth().servo.accepted_trajectories, 1);
    arena.truth().samples.clone()
}

#[test]
fn steps_of_a_flight_allocate_nothing() {
    let release = Release { omega_WO: Vector3::new(9.0, 5.0, -7.0), ..setting::release([9.0; 3], [-2.0, 3.0, 4.0]) };
    let samples = observed(busy(GripperDriveKind::Real), &release);
    assert!(samples.iter().all(|it| !it.contact.any()));
}

/// The ball rebounds from the palm, and 20 ms later it is squeezed; and it falls to the floor.
#[test]
fn steps_of_a_contact_allocate_nothing() {
    let (robot, gripper) = (setting::robot(), setting::gripper());
    let X_WG = robot.gripper_pose(&robot.ready_q);
    let before_palm = X_WG * Point3::new(0.0, gripper.palm_y_m() + 0.0336 + 0.02, 0.0);
    let release = Release { p_WO: before_palm, v_WO: X_WG * -Vector3::y(), ..setting::release([0.0; 3], [0.0; 3]) };
    let samples = observed(busy(GripperDriveKind::Ideal), &release);
    let count = |is_so: &dyn Fn(&Contact) -> bool| samples.iter().filter(|it| is_so(&it.contact)).count();
    let (palm, squeezed) = (count(&|it| it.palm), count(&|it| it.left_finger && it.right_finger));
    assert!(palm > 0 && squeezed > 1000, "{palm} {squeezed}");
    let fallen = observed(busy(GripperDriveKind::Real), &setting::release([2.0, 2.0, 0.3], [0.1, 0.0, 0.0]));
    assert!(fallen.iter().any(|it| it.contact.floor));
}
