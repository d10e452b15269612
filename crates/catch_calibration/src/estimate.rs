//! The calibration as a whole.

use catch_body::{Gripper, Robot};
use catch_cell::CameraModel;
use nalgebra::{DMatrix, Matrix6};

use super::{
    CAMERA_PARAMETERS, Calibration, CalibrationStatus, CameraCalibration, Config, Session,
    averaged_image::{AveragedImage, StillImage},
    coarse::{self, PosedPoints},
    fine::{Estimate, Observed, Problem, SMALL},
    parameters::{CameraState, FIRST_LINK_SD_M, FIRST_NUISANCE, OF_CAMERA, SCALE_SD, TIME_OFFSET, TIME_OFFSET_SD_S},
};

/// Images of one camera, at least.
const LEAST_IMAGES: usize = 3;
/// A last step of this many claimed standard deviations is no end.
const LARGE_STEP_SD: f64 = 0.5;
/// Residuals of depths over the data sheet's standard deviation beyond which the model is not what the images
/// show.
const MOST_DEPTH_SD: f64 = 2.0;
/// Residuals, in pixels, of the number of pixels on a line across a silhouette beyond which the model is not
/// what the images show.
const MOST_SHOWN_SD_PX: f64 = 3.0;
/// Fraction of outliers beyond which the model is not what the images show.
const MOST_OUTLIERS: f64 = 0.3;
/// A link whose surface is farther from its model than so many times what is expected is another one.
const MOST_LINK_SD: f64 = 5.0;
/// Standard deviations above these, in metres and radians, say that a camera may be anywhere.
const MOST_SD_M: f64 = 0.02;
const MOST_SD_RAD: f64 = 0.02;

/// Estimates the poses of the cameras, which are believed to be near `guesses`, from what they saw of the arm
/// in a session.
pub fn calibrate(
    config: &Config,
    robot: &Robot,
    gripper: &Gripper,
    guesses: &[CameraModel],
    session: &Session,
) -> Calibration {
    let mut cameras = Vec::new();
    for (i, camera) in guesses.iter().enumerate() {
        let images: Vec<&AveragedImage> = session.images.iter().filter(|it| it.camera == i).collect();
        let resting: Vec<&AveragedImage> = images.iter().copied().filter(|it| it.is_still(&session.arm)).collect();
        let still = StillImage::of(camera, &resting, config.inverse_depth_sd_per_m);
        cameras.push(Observed { camera, images, still });
    }
    let coarse = |(i, it): (usize, &Observed<'_>)| {
        let still_images = it.images.iter().filter(|image| image.is_still(&session.arm));
        let points = still_images.filter_map(|image| {
            let arm = image.arm(&session.arm, 0.0)?;
            let X_WL = robot.link_poses(&arm.q);
            Some(PosedPoints::new((robot, gripper), (&X_WL, arm.width_m), it.camera, (image, &it.still)))
        });
        let points: Vec<PosedPoints> = points.collect();
        let X_WC = coarse::align(&points, &it.camera.X_WC, config.seed.wrapping_add(i as u64));
        CameraState { X_WC, nuisance: [0.0; OF_CAMERA - FIRST_NUISANCE] }
    };
    let coarse = cameras.iter().enumerate().map(coarse).collect();
    let problem = Problem { robot, gripper, arm: &session.arm, cameras, config };
    let estimate = problem.solve(coarse);
    let link_offset_m: Vec<f64> = (0..=robot.dof()).map(|link| estimate.shared.link_offset_m(link)).collect();
    let most_m = MOST_LINK_SD * FIRST_LINK_SD_M;
    let is_modelled = link_offset_m.iter().all(|offset_m| offset_m.abs() <= most_m);
    let of_camera = |i: usize| of_camera(i, &problem, &estimate, is_modelled);
    Calibration {
        cameras: (0..guesses.len()).map(of_camera).collect(),
        covariance: joint_covariance(&estimate),
        joint_zero_rad: estimate.shared.joint_zero_rad().iter().take(robot.dof()).copied().collect(),
        link_offset_m,
    }
}

/// Joint covariance of all cameras, as in [`Calibration::covariance`].
fn joint_covariance(estimate: &Estimate) -> DMatrix<f64> {
    let size = CAMERA_PARAMETERS * estimate.cameras.len();
    let Some(covariance) = &estimate.covariance else { return DMatrix::from_element(size, size, f64::INFINITY) };
    // Scale and time offset are the first of the nuisances, in standard deviations.
    let unit = |at: usize| match at % CAMERA_PARAMETERS {
        FIRST_NUISANCE => SCALE_SD,
        TIME_OFFSET => TIME_OFFSET_SD_S,
        _ => 1.0,
    };
    let place = |at: usize| OF_CAMERA * (at / CAMERA_PARAMETERS) + at % CAMERA_PARAMETERS;
    DMatrix::from_fn(size, size, |i, j| covariance[(place(i), place(j))] * unit(i) * unit(j))
}

fn of_camera(i: usize, problem: &Problem<'_>, estimate: &Estimate, is_modelled: bool) -> CameraCalibration {
    let Problem { arm, config, .. } = problem;
    let observed = &problem.cameras[i];
    let (state, residuals) = (&estimate.cameras[i], estimate.residuals[i]);
    let first = OF_CAMERA * i;
    let whole = estimate.covariance.as_ref();
    let entry = |row: usize, column: usize| whole.map_or(f64::INFINITY, |it| it[(first + row, first + column)]);
    let covariance = Matrix6::from_fn(entry);
    let time_sd_s = entry(TIME_OFFSET, TIME_OFFSET).sqrt() * TIME_OFFSET_SD_S;
    let moves = observed.images.iter().any(|it| !it.is_still(arm));
    let sd = |first: usize| covariance.fixed_view::<3, 3>(first, first).trace().sqrt();
    let step = estimate.last_step[i];
    let in_sd = || covariance.cholesky().map(|it| step.dot(&it.solve(&step)).sqrt());
    let ends = step.amax() < SMALL || in_sd().is_some_and(|it| it < LARGE_STEP_SD);
    let shows_the_arm =
        observed.images.iter().filter(|it| it.is_still(arm)).count() >= LEAST_IMAGES && residuals.depths > 0;
    let fits = is_modelled
        && residuals.inverse_depth_sd_per_m < MOST_DEPTH_SD * config.inverse_depth_sd_per_m
        && residuals.silhouette_sd_px < MOST_SHOWN_SD_PX
        && residuals.outlier_fraction < MOST_OUTLIERS;
    let status = if !shows_the_arm {
        CalibrationStatus::TooFewImages
    } else if !fits {
        CalibrationStatus::PoorFit
    } else if !(sd(0) < MOST_SD_RAD && sd(3) < MOST_SD_M) {
        CalibrationStatus::Uncertain
    } else if ends {
        CalibrationStatus::Converged
    } else {
        CalibrationStatus::NotConverged
    };
    CameraCalibration {
        status,
        X_WC: state.X_WC,
        covariance,
        depth_scale: state.nuisance[0] * SCALE_SD,
        time_offset_s: state.time_offset_s(),
        time_offset_sd_s: Some(time_sd_s).filter(|sd_s| moves && sd_s.is_finite()),
        residuals,
    }
}
