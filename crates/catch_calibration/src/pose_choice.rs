//! Poses of the arm that are most informative about the cameras' poses: greedy choice among random ones.
//!
//! The information about a camera that a pose gives is that of the measurements which would be compared in
//! its image. The determinant of the information on the camera's pose, the nuisances eliminated, is to grow
//! (D-optimal design).

use std::f64::consts::PI;

use catch_body::{Gripper, JointVector, Robot, clearance::ArmClearance, ray_cast::ArmSurface};
use catch_cell::CameraModel;
use nalgebra::DMatrix;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;

use super::{
    ArmSample, Config, depths,
    normal_equations::{ImageEquations, Row},
    parameters::{CameraState, FIRST_NUISANCE, OF_CAMERA, PosedArm, Shared},
    rendering::Rendering,
    silhouettes,
};
use catch_bot::trajectory_optimization::MotionPlanner;

/// Poses to choose among.
const CANDIDATES: usize = 100;
/// Random poses that are tried for the choice, at most.
const TRIES: usize = 5000;
/// The arm keeps this far from itself and its surroundings, in metres.
const CLEARANCE_M: f64 = 0.04;
/// Fraction of each joint's range.
const RANGE: f64 = 0.85;
/// Images are so many times smaller for the choice.
const SMALLER: u32 = 4;
/// Standard deviation of the number of pixels on a line across a silhouette.
const SHOWN_SD_PX: f64 = 0.9;

/// Information of one pose on each camera.
struct Candidate {
    q: JointVector,
    information: Vec<DMatrix<f64>>,
}

/// The poses that tell most, in an order of short ways from the ready pose on.
pub fn choose_poses(
    config: &Config,
    planner: &MotionPlanner,
    gripper: &Gripper,
    cameras: &[CameraModel],
) -> Vec<JointVector> {
    let robot = &planner.robot;
    let surface = ArmSurface::new(robot, gripper);
    let small: Vec<CameraModel> = cameras.iter().map(smaller).collect();
    let mut candidates: Vec<Candidate> = clear_poses(config, robot, gripper)
        .into_iter()
        .map(|q| {
            let sample = ArmSample { time_s: 0.0, q, dq: JointVector::zeros(), width_m: gripper.max_width_m };
            let of = |camera: &CameraModel| information(config, robot, &surface, &sample, camera);
            Candidate { q, information: small.iter().map(of).collect() }
        })
        .collect();
    let prior = DMatrix::identity(OF_CAMERA, OF_CAMERA);
    let mut sums = vec![prior; cameras.len()];
    let mut chosen: Vec<JointVector> = Vec::new();
    while chosen.len() < config.poses && !candidates.is_empty() {
        let gain =
            |it: &Candidate| -> f64 { sums.iter().zip(&it.information).map(|(sum, own)| log_det(&(sum + own))).sum() };
        let best = candidates.iter().map(gain).enumerate().max_by(|one, two| one.1.total_cmp(&two.1));
        let Some((best, _)) = best else { break };
        let it = candidates.swap_remove(best);
        // Every chosen pose can be reached by way of the ready pose.
        if planner.rest_to_rest(0.0, &robot.ready_q, None, &it.q, None).is_some() {
            sums.iter_mut().zip(&it.information).for_each(|(sum, own)| *sum += own);
            chosen.push(it.q);
        }
    }
    in_short_order(robot, chosen)
}

/// Random poses clear of everything.
fn clear_poses(config: &Config, robot: &Robot, gripper: &Gripper) -> Vec<JointVector> {
    let clearance = ArmClearance::new(robot, gripper);
    let mut random = Pcg64::seed_from_u64(config.seed);
    let mut poses = Vec::new();
    for _ in 0..TRIES {
        if poses.len() == CANDIDATES {
            break;
        }
        let at = JointVector::from_fn(|_, _| random.random_range(-1.0..=1.0));
        let middle = robot.per_joint(|it| f64::midpoint(it.limits.lower, it.limits.upper));
        let half = robot.per_joint(|it| RANGE * ((it.limits.upper - it.limits.lower) / 2.0).min(PI));
        let q = middle + half.component_mul(&at);
        let X_WL = robot.link_poses(&q);
        if clearance.least(&X_WL, gripper.max_width_m) > CLEARANCE_M {
            poses.push(q);
        }
    }
    poses
}

fn smaller(camera: &CameraModel) -> CameraModel {
    let by = f64::from(SMALLER);
    CameraModel {
        X_WC: camera.X_WC,
        width_px: camera.width_px / SMALLER,
        height_px: camera.height_px / SMALLER,
        focal_px: camera.focal_px / by,
        principal_px: camera.principal_px.map(|it| it / by),
        ..camera.clone()
    }
}

/// Information about a camera that an image of a pose would give.
fn information(
    config: &Config,
    robot: &Robot,
    surface: &ArmSurface,
    sample: &ArmSample,
    camera: &CameraModel,
) -> DMatrix<f64> {
    let small = Config { edge_px: 1, silhouette_px: 2, ..config.clone() };
    let exact = Shared::default();
    let posed = PosedArm::new(robot, sample, &exact);
    let rendering = Rendering::new(camera, surface, &posed.X_WL, posed.width_m);
    let mut found = Vec::new();
    depths::measure(&mut found, &rendering, camera, None, &small);
    silhouettes::measure(&mut found, &rendering, camera, None, &small);
    let state = CameraState { X_WC: camera.X_WC, nuisance: [0.0; OF_CAMERA - FIRST_NUISANCE] };
    let mut equations = ImageEquations::new(OF_CAMERA + 1, 0.0);
    let mut row = Row::new();
    let images = config.images_per_pose as f64;
    let offset_sd = config.inverse_depth_sd_per_m * (config.common_fraction / images).sqrt();
    let by = f64::from(SMALLER);
    for it in &found {
        posed.row(&mut row, it, &state, offset_sd);
        // One pixel stands for all of those that it covers, one line for as many, and a pixel along it for as
        // many.
        let weight = if it.is_depth() {
            by * by / (config.inverse_depth_sd_per_m.powi(2) * (1.0 - config.common_fraction).max(0.01))
        } else {
            by * by * by / (SHOWN_SD_PX * SHOWN_SD_PX)
        };
        equations.add(&row, 0.0, images * weight);
    }
    let mut information = DMatrix::zeros(OF_CAMERA, OF_CAMERA);
    equations.eliminated().add_to(&mut information, 1.0);
    information
}

/// Logarithm of the determinant of the information on a pose, the nuisances eliminated: that of the whole
/// over that of the nuisances.
fn log_det(information: &DMatrix<f64>) -> f64 {
    let nuisances = OF_CAMERA - FIRST_NUISANCE;
    let part = information.view((FIRST_NUISANCE, FIRST_NUISANCE), (nuisances, nuisances)).into_owned();
    let of =
        |matrix: DMatrix<f64>| matrix.cholesky().map_or(0.0, |it| 2.0 * it.l_dirty().diagonal().map(libm::log).sum());
    of(information.clone()) - of(part)
}

/// The nearest pose next, by how long the slowest joint takes; then parts of the way are turned round while
/// that makes it shorter (2-opt).
fn in_short_order(robot: &Robot, mut poses: Vec<JointVector>) -> Vec<JointVector> {
    let duration = |from: &JointVector, to: &JointVector| {
        let slowest = |i: usize| (to[i] - from[i]).abs() / robot.joints[i].limits.velocity;
        (0..robot.dof()).map(slowest).fold(0.0, f64::max)
    };
    let mut way = vec![robot.ready_q];
    while !poses.is_empty() {
        let at = way[way.len() - 1];
        let nearest = (0..poses.len()).min_by(|a, b| duration(&at, &poses[*a]).total_cmp(&duration(&at, &poses[*b])));
        let Some(nearest) = nearest else { break };
        way.push(poses.swap_remove(nearest));
    }
    let whole = |way: &[JointVector]| -> f64 { way.windows(2).map(|it| duration(&it[0], &it[1])).sum() };
    let mut is_shorter = true;
    while std::mem::take(&mut is_shorter) {
        for first in 1..way.len() {
            for last in first + 1..way.len() {
                let before = whole(&way);
                way[first..=last].reverse();
                if whole(&way) < before - 1e-9 {
                    is_shorter = true;
                } else {
                    way[first..=last].reverse();
                }
            }
        }
    }
    way.split_off(1)
}
