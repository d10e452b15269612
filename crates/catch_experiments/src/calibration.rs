//! Accuracy of near cameras that are calibrated on the arm that they see, and of the brain's perception.

mod correlated_noise;
mod flights;

use anyhow::Result;
use catch_body::{Pose, Robot};
use catch_calibration::{CalibrationStatus, CameraCalibration, calibrate};
use catch_cell::{CameraModel, DepthFrame};
use catch_lab::{
    parallel,
    scenario::setup::{
        Choice, Setup,
        calibration::{self, ArenaSession},
    },
};
use catch_sim::random_streams::{Draws, Stream};
use nalgebra::{UnitQuaternion, Vector6};

use crate::{
    Options, perception,
    results::{Entry, Table},
    spread::{median, percent, spread},
};

/// Error of each camera's believed position, in a random direction, and rotation about a random axis.
const OFF_M: f64 = 0.05;
const OFF_DEG: f64 = 5.0;
/// The part of the disparity's error of `near_stereo` that all pixels of an image have in common, 0.08 px·√½.
const COMMON_PX: f64 = 0.08 * std::f64::consts::FRAC_1_SQRT_2;
/// Largest error of a camera's clock, uniform to both sides.
const CLOCK_OFF_S: f64 = 0.01;
/// Errors of the arm's model in further cases, which the images have to show.
const SURFACE_SD_M: f64 = 0.001;
const ZERO_SD_DEG: f64 = 0.03;
/// Quantile of the squared Mahalanobis distance with six degrees of freedom that covers 95 %.
const COVERS_95: f64 = 12.592;

/// A condition: which rig, and what is wrong with it.
#[derive(Clone, Copy)]
struct Condition {
    cameras: usize,
    about: &'static str,
    wrong: Wrong,
}

#[derive(Clone, Copy, PartialEq)]
enum Wrong {
    Nothing,
    Covers,
    Zeros,
    Noise,
}

impl Condition {
    /// Returns whether flights refine the calibration, too.
    fn has_flights(self) -> bool {
        self.cameras != 3 && matches!(self.wrong, Wrong::Nothing | Wrong::Zeros)
    }
}

/// Condition in which the arm's surface is another one than in its model.
const COVERED: &str = "surfaces off by 1 mm, with covers";
/// Conditions; those in one list have the same sessions.
const CONDITIONS: [&[Condition]; 6] = [
    &[
        Condition { cameras: 2, about: "as modelled", wrong: Wrong::Nothing },
        Condition { cameras: 2, about: "joint zeros off by 0.03°", wrong: Wrong::Zeros },
    ],
    &[Condition { cameras: 2, about: COVERED, wrong: Wrong::Covers }],
    &[Condition { cameras: 2, about: "noise correlated over 7×7 pixels", wrong: Wrong::Noise }],
    &[Condition { cameras: 3, about: "as modelled", wrong: Wrong::Nothing }],
    &[Condition { cameras: 4, about: "as modelled", wrong: Wrong::Nothing }],
    &[Condition { cameras: 4, about: COVERED, wrong: Wrong::Covers }],
];

/// Result of one camera.
struct Outcome {
    status: CalibrationStatus,
    position_m: f64,
    rotation_deg: f64,
    time_s: f64,
    is_covered: bool,
    position_sd_m: f64,
    rotation_sd_deg: f64,
}

/// Result of one session: its time, and by condition the cameras, and their refinement by flights.
type Drawn = (f64, Vec<(Vec<Outcome>, Option<flights::Refined>)>);

/// Cameras by what is wrong.
pub fn run(options: &Options) -> Result<Vec<Table>> {
    let mut table = Table::new("Cameras calibrated on the arm", &[]);
    let mut refined = Table::new("Refined by 20 flights", &[]);
    for conditions in CONDITIONS {
        let setup = setup(conditions[0])?;
        setup.prepare();
        let drawn: Vec<Drawn> =
            parallel::map(options.trials as usize, |index| draw(&setup, conditions, options.seed, index as u64));
        for (i, condition) in conditions.iter().enumerate() {
            let times: Vec<f64> = drawn.iter().map(|it| it.0).collect();
            let cameras: Vec<&Outcome> = drawn.iter().flat_map(|it| &it.1[i].0).collect();
            table.add(row(*condition, &times, &cameras));
            let by_flights: Vec<&flights::Refined> = drawn.iter().filter_map(|it| it.1[i].1.as_ref()).collect();
            flights::rows(*condition, &by_flights).into_iter().for_each(|row| refined.add(row));
        }
    }
    table.rows.sort_by_key(|row| match row[0] {
        Entry::Count(cameras) => cameras,
        _ => 0,
    });
    Ok(vec![table, refined, perception::table(options)?])
}

fn row(condition: Condition, times: &[f64], cameras: &[&Outcome]) -> [(&'static str, Entry); 11] {
    let good: Vec<&Outcome> = cameras.iter().copied().filter(|it| it.status == CalibrationStatus::Converged).collect();
    let values = |of: fn(&Outcome) -> f64| good.iter().map(|it| of(it)).collect::<Vec<f64>>();
    [
        ("cameras", Entry::Count(condition.cameras)),
        ("condition", Entry::text(condition.about)),
        ("draws", Entry::Count(times.len())),
        ("converged, %", percent(good.len(), cameras.len())),
        ("position, mm", spread(&values(|it| it.position_m), 1e3)),
        ("rotation, °", spread(&values(|it| it.rotation_deg), 1.0)),
        ("time, ms", spread(&values(|it| it.time_s.abs()), 1e3)),
        ("coverage, %", percent(good.iter().filter(|it| it.is_covered).count(), good.len())),
        ("claimed, mm", median(&values(|it| it.position_sd_m), 1e3)),
        ("claimed, °", median(&values(|it| it.rotation_sd_deg), 1.0)),
        ("robot time, s", median(times, 1.0)),
    ]
}

fn setup(condition: Condition) -> Result<Setup> {
    let model = match condition.wrong {
        // The part that each pixel has by itself is added afterwards.
        Wrong::Noise => format!(
            "{{ stereo = {{ baseline_m = 0.05, subpixel_px = {COMMON_PX}, common_fraction = 1.0, dropout_fraction = 0.02, \
             grazing_rad = [1.2217304763960306, 1.4835298641951802], edge_px = 2, bleed_fraction = 0.25, flying_fraction = 0.1, \
             range_m = [0.2, 10.0] }} }}"
        ),
        _ => "\"near_stereo\"".to_owned(),
    };
    let surface_sd_m = if condition.wrong == Wrong::Covers { SURFACE_SD_M } else { 0.0 };
    let settings = [
        format!("arena.robot_errors.link_surface_sd_m={surface_sd_m}"),
        format!("flight_rig=\"d435_{}\"", condition.cameras),
        "camera=d435".to_owned(),
        format!("arena.depth.model={model}"),
        "arena.depth.calibration_sd_m=0".to_owned(),
        "arena.depth.calibration_sd_rad=0".to_owned(),
        "arena.frame_rate_hz=83.33333333333333".to_owned(),
    ];
    Ok(Setup::load(&Choice { scenario: Some("honest"), settings: &settings, ..Choice::default() })?)
}

/// One draw of where the cameras are believed to stand: a session, and what is found from it in each
/// condition.
fn draw(setup: &Setup, conditions: &[Condition], seed: u64, index: u64) -> Drawn {
    let mut draws = Draws::new(Stream::Calibration, seed, index);
    let guesses: Vec<CameraModel> = setup.cameras.iter().map(|camera| guess(camera, &mut draws)).collect();
    let config = calibration::config(&setup.knowledge(), setup.scenario.arena.frame_rate_hz, index);
    let mut alter = |frame: &mut DepthFrame| {
        if conditions[0].wrong == Wrong::Noise {
            let sd_per_m = config.inverse_depth_sd_per_m * (1.0 - config.common_fraction).sqrt();
            correlated_noise::add(frame, sd_per_m, &mut draws);
        }
    };
    let ArenaSession { mut session, robot_time_s, .. } =
        calibration::run_session(setup, &config, &guesses, (seed, index), &mut alter);
    let clocks: Vec<f64> = guesses.iter().map(|_| draws.between([-CLOCK_OFF_S, CLOCK_OFF_S])).collect();
    session.images.iter_mut().for_each(|image| image.capture_s -= clocks[image.camera]);
    let mut observed = None;
    let found = conditions.iter().map(|condition| {
        let robot = believed(&setup.robot, condition.wrong, &mut Draws::new(Stream::LinkMasses, seed, index));
        let found = calibrate(&config, &robot, &setup.gripper, &guesses, &session);
        let truth = setup.cameras.iter().zip(&clocks);
        let outcomes = found.cameras.iter().zip(truth).map(|(it, (camera, clock_s))| outcome(it, camera, *clock_s));
        let is_refined = index < flights::DRAWS && condition.has_flights();
        let refined =
            is_refined.then(|| flights::refined(setup, (found.clone(), &clocks), (seed, index), &mut observed));
        (outcomes.collect(), refined)
    });
    (robot_time_s, found.collect())
}

fn guess(camera: &CameraModel, draws: &mut Draws) -> CameraModel {
    let p = draws.direction().into_inner() * OFF_M;
    let R = UnitQuaternion::from_axis_angle(&draws.direction(), OFF_DEG.to_radians());
    CameraModel { X_WC: camera.X_WC * Pose::from_parts(p.into(), R), ..camera.clone() }
}

/// The arm as it is believed to be, where that is wrong.
fn believed(robot: &Robot, wrong: Wrong, draws: &mut Draws) -> Robot {
    let mut robot = robot.clone();
    for joint in robot.joints.iter_mut().filter(|_| wrong == Wrong::Zeros) {
        let off_rad = ZERO_SD_DEG.to_radians() * draws.normal();
        joint.X_PL.rotation *= UnitQuaternion::from_axis_angle(&joint.axis, off_rad);
    }
    robot
}

fn outcome(found: &CameraCalibration, truth: &CameraModel, clock_s: f64) -> Outcome {
    let off = found.X_WC.inv_mul(&truth.X_WC);
    let (turn, p) = (off.rotation.scaled_axis(), off.translation.vector);
    let error = Vector6::new(turn.x, turn.y, turn.z, p.x, p.y, p.z);
    let distance = found.covariance.cholesky().map(|factor| error.dot(&factor.solve(&error)));
    let sd = |first: usize| found.covariance.fixed_view::<3, 3>(first, first).trace().sqrt();
    Outcome {
        status: found.status,
        position_m: p.norm(),
        rotation_deg: turn.norm().to_degrees(),
        time_s: found.time_offset_s - clock_s,
        is_covered: distance.is_some_and(|it| it < COVERS_95),
        position_sd_m: sd(3),
        rotation_sd_deg: sd(0).to_degrees(),
    }
}
