//! `catchingbot calibrate`: where the cameras stand, from what they see of the arm.

mod places;

use std::{env, io, path::PathBuf, sync::Arc};

use catch_body::{
    InputError, Pose,
    quantity::{FLIGHTS, POSES},
};
use catch_calibration::{
    CalibrationStatus, CameraCalibration, Config, Residuals, calibrate,
    flights::{FlightStatus, Refinement, refine},
    overlay::overlays,
};
use catch_cell::{CameraModel, rig_to_toml};
use catch_import::ros_calibration::{read_camera_info, read_hand_eye};
use catch_lab::scenario::setup::{
    Choice, Setup,
    calibration::{self, ArenaSession, CalibratedCameras, calibrated_cameras},
};
use catch_recording::{
    name_of,
    whole_file::{self, COMMAND_LINE, check_new, unfinished_folder, write_new},
};
use catch_view::pages::calibration_page::{self, CameraSection};
use clap::Args;
use serde::Serialize;
use serde_json::json;

use self::places::Places;
use super::{ChoiceArguments, MOST, whole};
use crate::screen::{self, BAD, GOOD};

/// Images of each camera on the page.
const PAGE_IMAGES: usize = 2;

/// Calibrates the poses of the cameras from their images of the arm
///
/// The arm rests in poses that determine the cameras' poses best, and moves from one to the next. Each
/// camera finds its pose, the scale of its depths and the time between its clock and the arm's, from
/// its images of the arm. The rig that is written replaces the initial one:
///
///   catchingbot calibrate --scenario honest --rig d435_2 --out calibrated \
///       --set camera=d435 --set arena.depth.model=near_stereo --set arena.depth.calibration_sd_m=0.03
///   catchingbot --set flight_rig=calibrated/rig.toml
///
/// With --flights an object is thrown afterwards, the arm resting. Several cameras see one free flight,
/// which tells how they stand to each other, and gravity where the vertical is.
///
/// In the arena the cameras stand off by arena.depth.calibration_sd_m and calibration_sd_rad, and the story
/// tells what is left of that. With --camera-info and --hand-eye the first guess comes from files of ROS.
#[derive(Debug, Args)]
#[command(verbatim_doc_comment)]
pub struct CalibrateArguments {
    #[command(flatten)]
    choice: ChoiceArguments,
    /// Cameras as they are believed to stand: a built-in rig or a file [default: the scenario's]
    #[arg(long, value_name = "NAME|FILE")]
    rig: Option<String>,
    /// Intrinsics of a camera as ROS keeps them, camera_info YAML; once for each camera
    #[arg(long, value_name = "FILE", requires = "hand_eye", conflicts_with = "rig")]
    camera_info: Vec<PathBuf>,
    /// Believed pose of that camera: a result of easy_handeye2; once for each camera
    #[arg(long, value_name = "FILE", requires = "camera_info", conflicts_with = "rig")]
    hand_eye: Vec<PathBuf>,
    /// Poses of the arm
    #[arg(long, value_name = "N", default_value_t = Config::default().poses as u64, value_parser = whole(POSES.least as u64, POSES.most as u64))]
    poses: u64,
    /// Throws that refine the calibration afterwards: the cameras see one flight, whose law is known
    #[arg(long, value_name = "N", default_value_t = 0, value_parser = whole(FLIGHTS.least as u64, FLIGHTS.most as u64))]
    flights: u64,
    /// Object that is thrown: a built-in object or a file [default: the scenario's]
    #[arg(long, value_name = "NAME|FILE")]
    object: Option<String>,
    /// Seed of everything random
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = whole(0, MOST))]
    seed: u64,
    /// Folder for what is written
    #[arg(long, value_name = "DIR", default_value = "out")]
    out: PathBuf,
}

/// Result of a camera.
#[derive(Serialize)]
pub struct CameraDocument {
    status: CalibrationStatus,
    /// False if throws are caught without this camera: only others were calibrated.
    is_used: bool,
    /// Calibrated position in W.
    position_m: [f64; 3],
    rotation_xyzw: [f64; 4],
    /// Root of the sum of the variances along all axes.
    position_sd_m: f64,
    rotation_sd_deg: f64,
    depth_scale: f64,
    time_offset_s: f64,
    time_offset_sd_s: Option<f64>,
    #[serde(flatten)]
    residuals: Residuals,
    /// Error of the position, which only an arena has.
    position_error_m: f64,
    rotation_error_deg: f64,
}

/// Calibrates the cameras of a scenario's arena.
///
/// # Errors
/// Faults of the choice or the files, or of writing.
pub fn run(arguments: &CalibrateArguments, json: bool) -> anyhow::Result<()> {
    let setup = setup(arguments)?;
    let places = Places::of(&arguments.out, setup.cameras.len());
    check_new(places.all(), "--out")?;
    let config = Config {
        poses: arguments.poses as usize,
        ..calibration::config(&setup.knowledge(), setup.scenario.arena.frame_rate_hz, arguments.seed)
    };
    calibration::check_memory(&setup, &config, (COMMAND_LINE, "--poses"))?;
    let bar = screen::spinner("the arm goes through its poses");
    let session = calibration::run_session(&setup, &config, &setup.cameras, (arguments.seed, 0), &mut |_| ());
    bar.set_message(format!("comparing images of {} poses", session.poses.len()));
    let found = calibrate(&config, &setup.robot, &setup.gripper, &setup.cameras, &session.session);
    bar.set_message(format!("{} throws are seen", arguments.flights));
    let scene = (arguments.seed, 0);
    let flights = calibration::observe_flights(&setup, &found, &setup.cameras, arguments.flights as usize, scene);
    let refinement = refine(&found, &flights);
    bar.finish_and_clear();
    let found = &refinement.calibration;
    let calibrated = calibrated_cameras(&setup.cameras, &found.cameras);
    let cameras = camera_documents(&found.cameras, &calibrated, &calibration::true_cameras(&setup, arguments.seed, 0));
    let mut files = places.files(arguments, &setup, found, &calibrated);
    files.push((places.page.clone(), page_text(&setup, &session, &calibrated, &cameras).into_bytes()));
    write_new(&files, "--out")?;
    let refined = (arguments.flights > 0).then_some(&refinement);
    if !json {
        return Ok(tell(&session, refined, &cameras, &places)?);
    }
    let flights = |it: &Refinement| {
        json!({
            "status": it.status,
            "flights": it.flights,
            "sightings": it.sightings,
            "outlier_fraction": it.outlier_fraction,
            "variance_factor": it.variance_factor,
            "tilt_deg": it.tilt_rad.map(f64::to_degrees),
            "tilt_sd_deg": it.tilt_sd_rad.map(f64::to_degrees),
            "change_sd": it.change_sd,
        })
    };
    screen::document(&json!({
        "scenario": setup.scenario.name,
        "seed": arguments.seed,
        "rig": places.rig.to_string_lossy(),
        "page": places.page.to_string_lossy(),
        "poses": session.poses.len(),
        "robot_time_s": session.robot_time_s,
        "limit_violations": session.limit_violations,
        "flights": refined.map(flights),
        "cameras": cameras,
        "joint_zero_rad": found.joint_zero_rad,
        "link_offset_m": found.link_offset_m,
    }))
}

/// The cameras as they are calibrated before anything is thrown, where the scenario wants that. It tells that
/// this takes a while.
pub fn cameras(setup: &Setup, seed: u64) -> Option<Arc<CalibratedCameras>> {
    setup.scenario.calibration.as_ref()?;
    let bar = screen::spinner("calibrating the cameras");
    let calibrated = setup.calibrated(seed);
    bar.finish_and_clear();
    calibrated
}

/// Calibrates the cameras before anything is thrown, where the scenario wants that, and tells what remains if
/// it is told `aloud`.
///
/// # Errors
/// If standard output is closed.
pub fn before_throws(setup: &Setup, seed: u64, aloud: bool) -> io::Result<Vec<CameraDocument>> {
    let Some(calibrated) = cameras(setup, seed) else { return Ok(Vec::new()) };
    let documents = camera_documents(&calibrated.found, &calibrated.cameras, &setup.cameras);
    for (i, it) in documents.iter().enumerate().filter(|_| aloud) {
        let error_mm = it.position_error_m * 1e3;
        let off = format!("{error_mm:.2} mm and {:.4}° off, {}", it.rotation_error_deg, uncertainty(it));
        let left_out = if it.is_used { "" } else { ", left out" };
        screen::fact(&format!("camera {i}"), &format!("{}{left_out}, {off}", name_of(it.status)))?;
    }
    Ok(documents)
}

/// The scenario, with the cameras that are asked for.
fn setup(arguments: &CalibrateArguments) -> anyhow::Result<Setup> {
    let choice = arguments.choice.with(arguments.object.as_deref(), None);
    let mut rig = arguments.rig.clone();
    // It is needed until the scenario is loaded.
    let mut guess = None;
    let (infos, results) = (&arguments.camera_info, &arguments.hand_eye);
    if infos.len() != results.len() {
        let found = format!("{} files for {} of --camera-info", results.len(), infos.len());
        return Err(InputError::new(COMMAND_LINE, "--hand-eye", found, "as many of both").into());
    }
    if !infos.is_empty() {
        let robot = Setup::load(&choice)?.robot;
        let X_WB = robot.X_WB;
        let camera = |(info, result): (&PathBuf, &PathBuf)| -> Result<_, InputError> {
            let X_BC = read_hand_eye(result, &robot.base_link)?;
            Ok((CameraModel { X_WC: X_WB * X_BC, ..read_camera_info(info)? }, None))
        };
        let cameras: Vec<_> = infos.iter().zip(results).map(camera).collect::<Result<_, _>>()?;
        let folder = unfinished_folder(&env::temp_dir().join("rig.toml"))?;
        let path = folder.path().join("rig.toml");
        whole_file::write(&path, rig_to_toml("Cameras as files of ROS describe them.", &cameras))?;
        rig = Some(path.display().to_string());
        guess = Some(folder);
    }
    let mut settings = choice.settings.to_vec();
    settings.extend(rig.map(|rig| format!("flight_rig={}", toml_text(&rig))));
    let as_asked = |fault: InputError| match &*fault.field {
        "--set flight_rig" if arguments.rig.is_some() => InputError { field: "--rig".to_owned(), ..fault },
        _ => fault,
    };
    let setup = Setup::load(&Choice { settings: &settings, ..choice }).map_err(as_asked)?;
    drop(guess);
    Ok(setup)
}

/// A text as TOML writes it between quotes.
fn toml_text(text: &str) -> String {
    format!("\"{}\"", text.replace('\\', "\\\\").replace('"', "\\\""))
}

/// Describes the result of each camera: as `found`, as `calibrated`, and the `truth`.
fn camera_documents(
    found: &[CameraCalibration],
    calibrated: &[CameraModel],
    truth: &[CameraModel],
) -> Vec<CameraDocument> {
    let left_out = calibration::left_out(found);
    let poses = calibrated.iter().zip(truth).map(|(calibrated, truth)| [calibrated.X_WC, truth.X_WC]);
    let all = found.iter().zip(poses).enumerate();
    all.map(|(i, (found, poses))| camera_document(found, poses, !left_out.contains(&i))).collect()
}

/// `X_WC` is where the camera is believed to stand from then on, `X_WT` where it truly stands.
fn camera_document(found: &CameraCalibration, [X_WC, X_WT]: [Pose; 2], is_used: bool) -> CameraDocument {
    let X_CT = X_WC.inv_mul(&X_WT);
    let sd = |first: usize| found.covariance.fixed_view::<3, 3>(first, first).trace().sqrt();
    CameraDocument {
        status: found.status,
        is_used,
        position_m: X_WC.translation.vector.into(),
        rotation_xyzw: X_WC.rotation.coords.into(),
        position_sd_m: sd(3),
        rotation_sd_deg: sd(0).to_degrees(),
        depth_scale: found.depth_scale,
        time_offset_s: found.time_offset_s,
        time_offset_sd_s: found.time_offset_sd_s,
        residuals: found.residuals,
        position_error_m: X_CT.translation.vector.norm(),
        rotation_error_deg: X_CT.rotation.angle().to_degrees(),
    }
}

fn page_text(setup: &Setup, session: &ArenaSession, calibrated: &[CameraModel], found: &[CameraDocument]) -> String {
    let section = |(i, camera): (usize, &CameraModel)| CameraSection {
        summary: format!("Camera {i}: {}, {}", name_of(found[i].status), uncertainty(&found[i])),
        overlays: overlays(&setup.robot, &setup.gripper, (i, camera), &session.session, PAGE_IMAGES),
    };
    let sections: Vec<CameraSection> = calibrated.iter().enumerate().map(section).collect();
    calibration_page::page("Calibration", &sections)
}

fn uncertainty(it: &CameraDocument) -> String {
    match it.status {
        CalibrationStatus::Converged => {
            format!("claimed ± {:.2} mm and {:.4}°", it.position_sd_m * 1e3, it.rotation_sd_deg)
        }
        _ => "it stays where it was believed to stand".to_owned(),
    }
}

fn tell(
    session: &ArenaSession,
    refined: Option<&Refinement>,
    cameras: &[CameraDocument],
    places: &Places,
) -> io::Result<()> {
    let ArenaSession { poses, robot_time_s, limit_violations, .. } = session;
    let poses = poses.len();
    screen::line(&format!("{poses} poses in {robot_time_s:.1} s, {limit_violations} commands that broke a limit"))?;
    if let Some(it) = refined {
        let Refinement { status, flights, sightings, outlier_fraction, .. } = it;
        let colour = if *status == FlightStatus::Refined { GOOD } else { BAD };
        let outliers = format!("{:.1} % of them outliers", outlier_fraction * 1e2);
        let status = name_of(status);
        screen::line(&format!("{flights} flights, {sightings} sightings, {outliers}: {colour}{status}{colour:#}"))?;
        let of_axis =
            |i: usize| format!("{:+.3} ± {:.3}°", it.tilt_rad[i].to_degrees(), it.tilt_sd_rad[i].to_degrees());
        screen::fact("tilt", &format!("{} about x, {} about y", of_axis(0), of_axis(1)))?;
    }
    for (i, it) in cameras.iter().enumerate() {
        let colour = if it.status == CalibrationStatus::Converged { GOOD } else { BAD };
        screen::line(&format!("  camera {i}: {colour}{}{colour:#}, {}", name_of(it.status), uncertainty(it)))?;
        let time = it
            .time_offset_sd_s
            .map_or("unknown".to_owned(), |sd_s| format!("{:.2} ± {:.2} ms", it.time_offset_s * 1e3, sd_s * 1e3));
        screen::fact("time offset", &time)?;
        screen::fact("depth scale", &format!("{:+.4} %", it.depth_scale * 1e2))?;
        let error =
            format!("{:.2} mm and {:.4}°, as the arena knows", it.position_error_m * 1e3, it.rotation_error_deg);
        screen::fact("error", &error)?;
    }
    screen::line(&format!("{}  {}", places.rig.display(), places.page.display()))
}
