//! Calibration of the cameras of a simulated cell on its arm, and setups whose cameras are calibrated before
//! anything is thrown.

use std::{
    collections::BTreeMap,
    sync::{Arc, Mutex, PoisonError},
};

use catch_body::{InputError, JointVector, Pose};
use catch_bot::trajectory_optimization::MotionPlanner;
use catch_calibration::{
    Calibration, CalibrationRun, CalibrationStatus, CameraCalibration, Config, FlightRun, Session, calibrate,
    flights::Flight, pose_choice::choose_poses,
};
use catch_cell::{Brain, CameraModel, Cell, DepthFrame};
use catch_sim::{
    Arena, Release,
    cameras::DepthCameras,
    random_streams::{Draws, Stream},
};
use nalgebra::{Matrix3, Matrix3x6, Matrix6, Point3, UnitQuaternion, Vector3};

use super::{Knowledge, Setup};
use crate::scenario::CalibrationSettings;

/// No flight takes longer than this, in seconds.
const LONGEST_FLIGHT_S: f64 = 2.0;
/// No session takes longer than this, in seconds.
const LONGEST_S: f64 = 600.0;

/// Result of a calibration session in the arena.
#[derive(Debug, Clone)]
pub struct ArenaSession {
    /// Images and arm poses of the session.
    pub session: Session,
    /// The poses that were chosen.
    pub poses: Vec<JointVector>,
    /// Duration on the cell's clock.
    pub robot_time_s: f64,
    /// Commands that broke a limit.
    pub limit_violations: usize,
}

/// The settings of a calibration for the cameras of a cell that gives so many observations a second: what
/// their data sheet says.
pub fn config(knowledge: &Knowledge, observations_hz: f64, seed: u64) -> Config {
    let by_default = Config::default();
    let first = knowledge.cameras.first();
    let sheet = first.and_then(|it| it.sheet.clone()).unwrap_or_default();
    let quadratic_per_m = sheet.quadratic_per_m(first.map_or(1.0, |it| it.focal_px));
    // A camera may give fewer images than there are observations.
    let rates = knowledge.cameras.iter().filter_map(|it| it.rate_hz);
    let observations_per_image = observations_hz / rates.fold(observations_hz, f64::min);
    Config {
        images_per_pose: (by_default.images_per_pose as f64 * observations_per_image).ceil() as usize,
        inverse_depth_sd_per_m: (sheet.constant_m + quadratic_per_m).max(by_default.inverse_depth_sd_per_m / 10.0),
        common_fraction: sheet.common_fraction,
        expected_latency_s: knowledge.settings.control.expected_latency_s,
        seed,
        ..by_default
    }
}

/// Settings of the calibration before the throws of a seed.
pub(super) fn config_of(setup: &Setup, settings: &CalibrationSettings, seed: u64) -> Config {
    Config { poses: settings.poses, ..config(&setup.knowledge(), setup.scenario.arena.frame_rate_hz, seed) }
}

/// Memory that the images of a calibration take at most, in bytes.
const MOST_BYTES: u64 = 2 << 30;
/// Beyond its links' origins and where it holds things, the arm reaches no farther than this, in metres.
const AROUND_M: f64 = 0.3;

/// Checks that there is room for all images of a calibration. Where nothing stands behind the arm, they keep
/// what it can reach.
///
/// # Errors
/// If there is not; file and field are those of the number of poses.
pub fn check_memory(setup: &Setup, config: &Config, (file, field): (&str, &str)) -> Result<(), InputError> {
    let Setup { robot, gripper, .. } = setup;
    let base_W = Point3::from(robot.X_WB.translation.vector);
    let links_m: f64 = robot.joints.iter().map(|it| it.X_PL.translation.vector.norm()).sum();
    let reach_m = links_m + (robot.X_LG * gripper.grasp_centre()).coords.norm() + AROUND_M;
    let is_alone = !setup.scenario.arena.floor_visible && robot.obstacles.is_empty() && setup.room.is_empty();
    let window = |camera: &CameraModel| {
        let centre_C = camera.X_WC.inverse_transform_point(&base_W);
        if is_alone && centre_C.z > reach_m { camera.window_around(&centre_C, reach_m) } else { camera.full_window() }
    };
    let pixels: u64 = setup.cameras.iter().map(|it| window(it).area() as u64).sum();
    // 1/z and a count of the mean of the images at rest, and of that of those in motion.
    let bytes_per_pose = (pixels * 10).max(1);
    let most = MOST_BYTES / bytes_per_pose;
    if config.poses as u64 <= most {
        return Ok(());
    }
    let gib = (bytes_per_pose * config.poses as u64) as f64 / f64::from(1 << 30);
    let found = format!("{}, whose images take {gib:.1} GiB", config.poses);
    let expected = format!("at most {most} with these cameras: {} GiB of images", MOST_BYTES >> 30);
    Err(InputError::new(file, field, found, expected))
}

/// True cameras of a scene. No brain may see it.
pub fn true_cameras(setup: &Setup, seed: u64, index: u64) -> Vec<CameraModel> {
    DepthCameras::new(&setup.cameras, &setup.scenario.arena.depth, seed, index).cameras().to_vec()
}

/// Lets the arm go through poses chosen for cameras that are believed to stand as `guesses`, in the scene
/// (`seed`, `index`), whose images may be altered first.
pub fn run_session(
    setup: &Setup,
    config: &Config,
    guesses: &[CameraModel],
    (seed, index): (u64, u64),
    alter: &mut dyn FnMut(&mut DepthFrame),
) -> ArenaSession {
    let settings = setup.uncalibrated_config().config().trajectory_optimization;
    let planner = MotionPlanner::new(setup.robot.clone(), setup.gripper.clone(), settings);
    let poses = choose_poses(config, &planner, &setup.gripper, guesses);
    let mut run = CalibrationRun::new(config.clone(), planner, guesses, poses.clone());
    let waiting = (&setup.robot.ready_q, setup.gripper.max_width_m);
    let mut arena = Arena::new(setup.equipment(), &Release::out_of_sight(), waiting, seed, index);
    let mut now_s = 0.0;
    while !run.is_done() && now_s < LONGEST_S {
        let Ok(mut observation) = arena.sense();
        observation.frames.iter_mut().filter(|it| it.window.area() > 0).for_each(&mut *alter);
        now_s = observation.time_s;
        let command = run.tick(&observation, &mut ());
        arena.act_after(setup.scenario.clock.delay_s(0.0), &command);
    }
    let servo = &arena.truth().servo;
    let limit_violations = servo.command_violations.len();
    ArenaSession { session: run.into_session(), poses, robot_time_s: now_s, limit_violations }
}

/// The sightings of thrown objects, as the scenario has the throws, in the scene (`seed`, `index`) whose
/// cameras were believed to stand as `believed` before they were calibrated; none where no camera is. The arm
/// rests. No throw is one of the scenes of `seed`.
pub fn observe_flights(
    setup: &Setup,
    calibration: &Calibration,
    believed: &[CameraModel],
    flights: usize,
    (seed, index): (u64, u64),
) -> Vec<Flight> {
    let is_calibrated = calibration.cameras.iter().any(|it| it.status == CalibrationStatus::Converged);
    if flights == 0 || !is_calibrated {
        return Vec::new();
    }
    let cameras = calibrated_cameras(believed, &calibration.cameras);
    let known = Arc::new(setup.knowledge().preparation(&setup.uncalibrated_config(), cameras));
    let thrown = Draws::new(Stream::Calibration, seed, index).bits();
    let waiting = (&setup.robot.ready_q, setup.waiting_width_m());
    let mut arena = Arena::new(setup.equipment(), &setup.release(thrown, 0), waiting, seed, index);
    let observed = (0..flights as u64).map(|flight| {
        if flight > 0 {
            arena.throw_next(setup.equipment(), &setup.release(thrown, flight), thrown, flight);
        }
        arena.show_before(setup.scenario.brain.perception.background_images);
        let mut run = FlightRun::new(known.clone(), calibration, LONGEST_FLIGHT_S);
        while !run.is_done() {
            let Ok(observation) = arena.sense();
            let command = run.tick(&observation, &mut ());
            arena.act_after(setup.scenario.clock.delay_s(0.0), &command);
        }
        run.into_flight()
    });
    observed.collect()
}

/// Cameras as a calibration before all throws left them.
#[derive(Debug, Clone)]
pub struct CalibratedCameras {
    /// Cameras as the brain has them. One whose calibration did not converge is where it was believed to be
    /// before.
    pub cameras: Vec<CameraModel>,
    /// Result of the calibration of each camera, with its covariance.
    pub found: Vec<CameraCalibration>,
}

impl CalibratedCameras {
    /// The calibration before the throws of a seed.
    fn new(setup: &Setup, settings: &CalibrationSettings, seed: u64) -> Self {
        let mut draws = Draws::new(Stream::Calibration, seed, 0);
        let mut normal = |sd: f64| Vector3::from_fn(|_, _| sd * draws.normal());
        let believed = |camera: &CameraModel| {
            let (p, r) = (normal(settings.position_sd_m), normal(settings.rotation_sd_deg.to_radians()));
            let X_WC = camera.X_WC * Pose::from_parts(p.into(), UnitQuaternion::from_scaled_axis(r));
            CameraModel { X_WC, ..camera.clone() }
        };
        let believed: Vec<CameraModel> = setup.cameras.iter().map(believed).collect();
        let config = config_of(setup, settings, seed);
        let session = run_session(setup, &config, &believed, (seed, 0), &mut |_| ()).session;
        let found = calibrate(&config, &setup.robot, &setup.gripper, &believed, &session);
        let found: Vec<CameraCalibration> = found.cameras.into_iter().map(|it| claimed(it, settings)).collect();
        Self { cameras: calibrated_cameras(&believed, &found), found }
    }

    /// The cameras that are used, with their calibrations.
    fn used(&self) -> impl Iterator<Item = (&CameraModel, &CameraCalibration)> {
        let left_out = left_out(&self.found);
        let all = self.cameras.iter().zip(&self.found).enumerate();
        all.filter(move |(i, _)| !left_out.contains(i)).map(|(_, it)| it)
    }

    /// Standard deviation along each axis of a place that all used cameras see.
    pub(super) fn position_sd_m(&self, p_W: &Point3<f64>) -> f64 {
        let variances: Vec<f64> = self.used().map(|it| place_covariance(it, p_W).0.trace() / 3.0).collect();
        variances.iter().sum::<f64>().sqrt() / variances.len().max(1) as f64
    }

    /// Standard deviation of the direction in which a used camera sees a place, about each axis across it,
    /// that of the worst. A rotation that the camera's position makes up for there does not count.
    pub(super) fn direction_sd_rad(&self, p_W: &Point3<f64>) -> f64 {
        let sd = |it| {
            let (covariance, p_C) = place_covariance(it, p_W);
            let along = p_C.normalize();
            let across = covariance.trace() - along.dot(&(covariance * along));
            (across / 2.0).sqrt() / p_C.norm()
        };
        self.used().map(sd).fold(0.0, f64::max)
    }
}

/// Covariance of a place as a calibrated camera sees it, and the place, in C.
fn place_covariance(
    (camera, found): (&CameraModel, &CameraCalibration),
    p_W: &Point3<f64>,
) -> (Matrix3<f64>, Vector3<f64>) {
    // p = X·exp(ω, v)·p_C: a displacement of v + ω × p_C in C.
    let p_C = camera.X_WC.inverse_transform_point(p_W).coords;
    let mut derivative = Matrix3x6::zeros();
    derivative.fixed_view_mut::<3, 3>(0, 0).copy_from(&-p_C.cross_matrix());
    derivative.fixed_view_mut::<3, 3>(0, 3).copy_from(&Matrix3::identity());
    (derivative * found.covariance * derivative.transpose(), p_C)
}

/// Indices of the cameras whose calibration did not converge, unless it is all of them: a brain with others
/// does without.
pub fn left_out(found: &[CameraCalibration]) -> Vec<usize> {
    let failed = |it: &CameraCalibration| it.status != CalibrationStatus::Converged;
    let failures: Vec<usize> = (0..found.len()).filter(|&i| failed(&found[i])).collect();
    if failures.len() == found.len() { Vec::new() } else { failures }
}

/// Cameras as a calibration leaves them: one whose calibration did not converge stays where it was believed
/// to stand.
pub fn calibrated_cameras(believed: &[CameraModel], found: &[CameraCalibration]) -> Vec<CameraModel> {
    let calibrated = |(camera, found): (&CameraModel, &CameraCalibration)| {
        let X_WC = if found.status == CalibrationStatus::Converged { found.X_WC } else { camera.X_WC };
        CameraModel { X_WC, ..camera.clone() }
    };
    believed.iter().zip(found).map(calibrated).collect()
}

/// Result for a camera, with the covariance believed before where the calibration did not converge.
fn claimed(found: CameraCalibration, settings: &CalibrationSettings) -> CameraCalibration {
    if found.status == CalibrationStatus::Converged {
        return found;
    }
    let (rotation, position) = (settings.rotation_sd_deg.to_radians().powi(2), settings.position_sd_m.powi(2));
    let variances = [rotation, rotation, rotation, position, position, position];
    CameraCalibration { covariance: Matrix6::from_diagonal(&variances.into()), ..found }
}

/// Values that are made once for each seed, and shared by clones.
pub(super) type BySeed<T> = Arc<Mutex<BTreeMap<u64, Arc<T>>>>;

/// The value of a seed; whoever comes second waits: to make it takes longer than a trial.
pub(super) fn of_seed<T>(made: &BySeed<T>, seed: u64, make: impl FnOnce() -> T) -> Arc<T> {
    let mut made = made.lock().unwrap_or_else(PoisonError::into_inner);
    made.entry(seed).or_insert_with(|| Arc::new(make())).clone()
}

impl Setup {
    /// The cameras as they were calibrated before the throws of `seed`; none where the scenario has no such
    /// calibration. It runs when it is first asked for, which takes tens of seconds.
    pub fn calibrated(&self, seed: u64) -> Option<Arc<CalibratedCameras>> {
        let settings = self.scenario.calibration.as_ref()?;
        Some(of_seed(&self.calibrations, seed, || CalibratedCameras::new(self, settings, seed)))
    }

    /// Returns this setup with the calibrations of another one, which differs in object and throw at most.
    #[must_use]
    pub fn sharing_calibrations(mut self, other: &Self) -> Self {
        self.calibrations = other.calibrations.clone();
        self
    }

    /// The cameras whose images the brain uses in scenes of `seed`, as it believes them to stand.
    pub fn used_cameras(&self, seed: u64) -> Vec<CameraModel> {
        self.calibrated(seed)
            .map_or_else(|| self.cameras.clone(), |it| it.used().map(|(camera, _)| camera.clone()).collect())
    }

    /// The cameras as the brain believes them to stand, in scenes of `seed`.
    pub fn believed_cameras(&self, seed: u64) -> Vec<CameraModel> {
        self.calibrated(seed).map_or_else(|| self.cameras.clone(), |it| it.cameras.clone())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scenario::setup::Choice;

    fn covariance(sd_rad: f64, sd_m: f64) -> nalgebra::Matrix6<f64> {
        let variances = [sd_rad, sd_rad, sd_rad, sd_m, sd_m, sd_m].map(|it| it * it);
        nalgebra::Matrix6::from_diagonal(&variances.into())
    }

    #[test]
    fn what_is_claimed_of_a_place_adds_up() {
        let settings = ["flight_rig=d435_2".to_owned()];
        let setup = Setup::load(&Choice { scenario: Some("paper"), settings: &settings, ..Choice::default() }).unwrap();
        let found = |status| CameraCalibration {
            status,
            X_WC: Pose::identity(),
            covariance: covariance(1e-3, 2e-3),
            depth_scale: 0.0,
            time_offset_s: 0.0,
            time_offset_sd_s: None,
            residuals: Default::default(),
        };
        let settings = CalibrationSettings { position_sd_m: 5e-3, rotation_sd_deg: 0.3, ..Default::default() };
        let of = |status| CalibratedCameras {
            cameras: setup.cameras.clone(),
            found: [CalibrationStatus::Converged, status].map(|it| claimed(found(it), &settings)).to_vec(),
        };
        let both = of(CalibrationStatus::Converged);
        // 2 m in front of the first camera a rotation displaces along two axes, by 2 mm.
        let p_W = setup.cameras[0].X_WC * Point3::new(0.0, 0.0, 2.0);
        let first = CalibratedCameras { cameras: both.cameras[..1].to_vec(), found: both.found[..1].to_vec() };
        assert!((first.position_sd_m(&p_W) - (4e-6_f64 + 2.0 / 3.0 * 4e-6).sqrt()).abs() < 1e-12);
        // Across the line of sight both errors count: 2 mm, and 1 mrad of 2 m.
        assert!((first.direction_sd_rad(&p_W) - 8e-6_f64.sqrt() / 2.0).abs() < 1e-12);
        // A camera that moves as it turns sees what it was calibrated on where it is.
        let about = Matrix6::from_fn(|row, column| match (row, column) {
            (0, 0) | (1, 1) => 1e-6,
            (3, 3) | (4, 4) => 4e-6,
            (0, 4) | (4, 0) => 2e-6,
            (1, 3) | (3, 1) => -2e-6,
            _ => 0.0,
        });
        let mut turned = first.clone();
        turned.found[0].covariance = about;
        assert!(turned.direction_sd_rad(&p_W) < 1e-9);
        assert!(both.position_sd_m(&p_W) < first.position_sd_m(&p_W));
        // One that did not converge is left out, unless there is no other one. Then it is no better than it
        // was believed to be before.
        let failed = of(CalibrationStatus::PoorFit);
        assert_eq!((left_out(&both.found), left_out(&failed.found)), (vec![], vec![1]));
        assert!((failed.position_sd_m(&p_W) - first.position_sd_m(&p_W)).abs() < 1e-12);
        let alone = CalibratedCameras { cameras: both.cameras[1..].to_vec(), found: failed.found[1..].to_vec() };
        assert!(left_out(&alone.found).is_empty());
        let away_m = alone.cameras[0].X_WC.inverse_transform_point(&p_W).coords.norm();
        assert!((alone.direction_sd_rad(&p_W) - libm::hypot(0.3_f64.to_radians(), 5e-3 / away_m)).abs() < 1e-12);
        // Nor is it moved.
        let found = [CalibrationStatus::Converged, CalibrationStatus::PoorFit].map(found);
        let calibrated = calibrated_cameras(&setup.cameras, &found);
        assert_eq!(calibrated[0].X_WC, Pose::identity());
        assert_eq!(calibrated[1], setup.cameras[1]);
        assert!(setup.calibrated(1).is_none() && setup.believed_cameras(1) == setup.cameras);
    }
}
