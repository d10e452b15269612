//! Calibration of the cameras of a simulated cell on its arm.

use catch_body::JointVector;
use catch_bot::{
    calibration::{CalibrationRun, Config, Session, pose_choice::choose_poses},
    trajectory_optimization::MotionPlanner,
};
use catch_cell::{Brain, CameraModel, Cell};
use catch_sim::{Arena, Release, cameras::DepthCameras};
use nalgebra::{Point3, UnitQuaternion, Vector3};

use crate::scenario::setup::Setup;

/// Where the thrown object lies, out of the cameras' range.
const OUT_OF_SIGHT_M: [f64; 3] = [45.0, 45.0, 0.3];
/// No session takes longer than this, in seconds.
const LONGEST_S: f64 = 600.0;

/// What a session of calibration in the arena gave.
#[derive(Debug, Clone)]
pub struct ArenaSession {
    /// What was seen.
    pub session: Session,
    /// The poses that were chosen.
    pub poses: Vec<JointVector>,
    /// How long it took on the cell's clock.
    pub robot_time_s: f64,
    /// Commands that broke a limit.
    pub limit_violations: usize,
}

/// The settings of a calibration for the cameras of a setup: what their data sheet says.
pub fn config(setup: &Setup, seed: u64) -> Config {
    let focal_px = setup.cameras.first().map_or(1.0, |camera| camera.focal_px);
    let sheet = setup.scenario.arena.depth.model.data_sheet(focal_px);
    let errors = &setup.scenario.arena.robot_errors;
    let least = Config::default().inverse_depth_sd_per_m / 10.0;
    Config {
        inverse_depth_sd_per_m: (sheet.constant_m + sheet.quadratic_per_m).max(least),
        common_fraction: sheet.common_fraction,
        expected_latency_s: setup.scenario.brain.control.expected_latency_s,
        mount_sd_m: errors.tool_position_m,
        mount_sd_rad: errors.tool_rotation_deg.to_radians(),
        seed,
        ..Config::default()
    }
}

/// Where the cameras of a scene truly stand. No brain may see it.
pub fn true_cameras(setup: &Setup, seed: u64, index: u64) -> Vec<CameraModel> {
    DepthCameras::new(&setup.cameras, &setup.scenario.arena.depth, seed, index).cameras().to_vec()
}

/// Lets the arm go through poses chosen for cameras that are believed to stand as `guesses`, in the scene (`seed`, `index`).
pub fn run_session(setup: &Setup, config: &Config, guesses: &[CameraModel], seed: u64, index: u64) -> ArenaSession {
    let settings = setup.brain_config(seed, index).config().trajectory_optimization;
    let planner = MotionPlanner::new(setup.robot.clone(), setup.gripper.clone(), settings);
    let poses = choose_poses(config, &planner, &setup.gripper, guesses);
    let mut run = CalibrationRun::new(config.clone(), planner, guesses, poses.clone());
    let release = Release {
        p_WO: Point3::from(OUT_OF_SIGHT_M),
        v_WO: Vector3::zeros(),
        q_WO: UnitQuaternion::identity(),
        omega_WO: Vector3::zeros(),
        path: None,
    };
    let mut arena = Arena::new(setup.equipment(), &release, &setup.robot.ready_q, seed, index);
    let mut now_s = 0.0;
    while !run.is_done() && now_s < LONGEST_S {
        let Ok(observation) = arena.sense();
        now_s = observation.time_s;
        let command = run.tick(&observation, &mut ());
        arena.act_after(setup.scenario.clock.delay_s(0.0), &command);
    }
    let servo = &arena.truth().servo;
    let limit_violations = servo.command_violations.len() + servo.motion_violations.len();
    ArenaSession { session: run.into_session(), poses, robot_time_s: now_s, limit_violations }
}
