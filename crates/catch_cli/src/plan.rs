//! `catchingbot plan`: plans for catches that are described in a file.

use std::{collections::BTreeMap, path::PathBuf, time::Instant};

use catch_body::statistics::{median, quantile, sorted};
use catch_body::{Gripper, JointVector, Robot};
use catch_bot::trajectory_optimization::{Config, MotionPlanner, PlanningFailure, Start};
use catch_cell::{LimitKind, arm::Setpoint, executor::PeakRatios};
use catch_lab::planner_cases::{self, PlannerCase};
use catch_paper::posed::{PosedCatch, PosedPlanner};
use catch_recording::whole_file::COMMAND_LINE;
use clap::Args;
use nalgebra::Point3;
use serde::Serialize;
use serde_json::Value;

use crate::screen::{self, FAINT, STRONG};

/// Each case is planned this often, for the time that it takes: a median is not disturbed by other programs.
const RUNS: usize = 7;

/// Plans motions for the catches that a file describes, with residuals and times
///
/// The file is one JSON document:
///   {"q_start": [..], "grasp_centre_y_m": 0.0833, "cases": [
///     {"id": 0, "time_remaining_s": 0.46, "object_p": [..], "object_v": [..],
///      "R_WG": [[..],[..],[..]], "p_WG": [..]}, ..]}
/// The grasp centre, grasp_centre_y_m along the gripper's y axis, is to be at object_p after
/// time_remaining_s, the gripper's axes being the columns of R_WG, and to move there at
/// s * object_v, 0 <= s <= 0.3. dq_start and robot may be given as well; q_start, dq_start and robot
/// also in a case of their own. s_max may be noted in a case; it changes nothing. Lengths in metres,
/// angles in radians, times in seconds.
#[derive(Debug, Args)]
#[command(verbatim_doc_comment)]
pub struct PlanArguments {
    /// JSON file of catches
    #[arg(long, value_name = "FILE")]
    cases: PathBuf,
    /// Arm: a built-in name, or a robot.toml with a robot.urdf beside it [default: the one that the
    /// file names, or that of the default scenario]
    #[arg(long, value_name = "NAME|FILE")]
    robot: Option<String>,
}

/// Result of one case.
#[derive(Serialize)]
struct Row {
    id: Value,
    status: &'static str,
    time_ms: f64,
    #[serde(flatten)]
    plan: Option<PlanFigures>,
}

/// A plan and what it does, recomputed from its spline.
#[derive(Serialize)]
struct PlanFigures {
    speed_fraction: f64,
    /// One list for all joints.
    knots: Vec<f64>,
    /// Joint by joint.
    control_points: Vec<Vec<f64>>,
    residual: Residual,
    limit_ratio: LimitRatio,
}

/// Distance of the spline's end from the target, and of its start from the arm's state.
#[derive(Serialize)]
struct Residual {
    position_m: f64,
    rotation_error_rad: f64,
    velocity_mps: f64,
    start_rad: f64,
    start_radps: f64,
}

/// Largest use of each limit.
#[derive(Serialize)]
struct LimitRatio {
    position: f64,
    velocity: f64,
    acceleration: f64,
    torque: f64,
}

/// Plans every case of a file.
///
/// # Errors
/// Faults in the file and in the robot's files.
pub fn run(arguments: &PlanArguments, json: bool) -> anyhow::Result<()> {
    let cases = planner_cases::read(&arguments.cases)?;
    let file = arguments.cases.display().to_string();
    let mut planners: Vec<(Option<&str>, f64, PosedPlanner)> = Vec::new();
    let mut rows = Vec::new();
    for case in &cases {
        let name = arguments.robot.as_deref().or(case.robot.as_deref());
        let centre = case.grasp_centre_y_m;
        if !planners.iter().any(|(known, y, _)| (*known, *y) == (name, centre)) {
            let asked_by = if arguments.robot.is_some() { (COMMAND_LINE, "--robot") } else { (file.as_str(), "robot") };
            let (robot, gripper) = planner_cases::arm(name, asked_by)?;
            planners.push((name, centre, planner(robot, gripper, centre)));
        }
        let planner = planners.iter().find(|(known, y, _)| (*known, *y) == (name, centre)).map(|it| &it.2);
        let planner = planner.expect("it was made just now");
        let (q, dq) = case.start(&file, &planner.motion.robot)?;
        let start = Start { time_s: 0.0, state: Setpoint { q, dq, ddq: JointVector::zeros() } };
        rows.push(row(planner, &start, case));
    }
    if json { screen::document(&BTreeMap::from([("cases", rows)])) } else { Ok(print(&rows)?) }
}

/// A planner that may use all of the limits: nothing is held back for replans here.
fn planner(robot: Robot, mut gripper: Gripper, grasp_centre_y_m: f64) -> PosedPlanner {
    gripper.grasp_centre_y_m = grasp_centre_y_m;
    let all = Config { position_margin_rad: 0.0, velocity_scaling: 1.0, torque_scaling: 1.0, ..Config::default() };
    PosedPlanner::new(MotionPlanner::new(robot, gripper, all))
}

fn row(planner: &PosedPlanner, start: &Start, case: &PlannerCase) -> Row {
    let (found, time_ms) = timed(|| planner.catch_at(start, &case.target));
    let status = match &found {
        Ok(_) => "solved",
        Err(PlanningFailure::OutOfReach) => "out_of_reach",
        Err(_) => "no_motion",
    };
    let plan = found.ok().map(|plan| figures(planner, start, case, &plan));
    Row { id: case.id.clone(), status, time_ms, plan }
}

/// Returns the result of a function and the median of its run times in milliseconds.
fn timed<T>(mut run: impl FnMut() -> T) -> (T, f64) {
    let mut measure = || {
        let before = Instant::now();
        let result = run();
        (result, before.elapsed().as_secs_f64() * 1e3)
    };
    let mut times: Vec<f64> = (1..RUNS).map(|_| measure().1).collect();
    let (result, last) = measure();
    times.push(last);
    (result, median(times).unwrap_or(last))
}

fn figures(planner: &PosedPlanner, start: &Start, case: &PlannerCase, plan: &PosedCatch) -> PlanFigures {
    let (robot, target, spline) = (&planner.motion.robot, &case.target, &plan.spline);
    let [q, dq, _] = spline.evaluate(target.catch_s);
    let X_WL = robot.link_poses(&q);
    let X_WG = robot.gripper_in(&X_WL);
    let centre = X_WG * Point3::new(0.0, case.grasp_centre_y_m, 0.0);
    let v_WC = robot.jacobian(&X_WL, &centre).fixed_rows::<3>(3) * dq;
    let [q_start, dq_start, _] = spline.evaluate(0.0);
    let residual = Residual {
        position_m: (centre - case.p_WO).norm(),
        rotation_error_rad: X_WG.rotation.angle_to(&target.X_WG.rotation),
        velocity_mps: (v_WC - target.v_WO * plan.speed_fraction).norm(),
        start_rad: (q_start - start.state.q).amax(),
        start_radps: (dq_start - start.state.dq).amax(),
    };
    let peaks = PeakRatios::of(robot, spline);
    let kinds = [LimitKind::Position, LimitKind::Velocity, LimitKind::Acceleration, LimitKind::Torque];
    let [position, velocity, acceleration, torque] = kinds.map(|kind| peaks.highest(kind));
    PlanFigures {
        speed_fraction: plan.speed_fraction,
        knots: spline.knots_s.clone(),
        control_points: (0..robot.dof())
            .map(|joint| spline.control_points.iter().map(|point| point[joint]).collect())
            .collect(),
        residual,
        limit_ratio: LimitRatio { position, velocity, acceleration, torque },
    }
}

fn print(rows: &[Row]) -> std::io::Result<()> {
    let headings =
        ["case", "status", "speed", "off by", "turned by", "m/s off", "velocity", "acceler.", "torque", "ms"];
    let mut table = screen::table(headings, 2..10);
    for row in rows {
        let figure = |show: fn(&PlanFigures) -> String| row.plan.as_ref().map_or("–".to_owned(), show);
        table.add_row([
            row.id.to_string(),
            row.status.replace('_', " "),
            figure(|it| format!("{:.3}", it.speed_fraction)),
            figure(|it| format!("{:.0e} m", it.residual.position_m)),
            figure(|it| format!("{:.0e} rad", it.residual.rotation_error_rad)),
            figure(|it| format!("{:.0e}", it.residual.velocity_mps)),
            figure(|it| format!("{:.4}", it.limit_ratio.velocity)),
            figure(|it| format!("{:.4}", it.limit_ratio.acceleration)),
            figure(|it| format!("{:.4}", it.limit_ratio.torque)),
            format!("{:.3}", row.time_ms),
        ]);
    }
    screen::line("")?;
    screen::line(&table.trim_fmt())?;
    let count = |status: &str| rows.iter().filter(|row| row.status == status).count();
    let (solved, out, none) = (count("solved"), count("out_of_reach"), count("no_motion"));
    screen::line(&format!(
        "  {STRONG}{solved} of {} solved{STRONG:#}, {out} out of reach, {none} without a motion",
        rows.len()
    ))?;
    let times = sorted(rows.iter().map(|row| row.time_ms).collect::<Vec<_>>());
    if let [Some(middle), Some(most)] = [0.5, 1.0].map(|fraction| quantile(&times, fraction)) {
        screen::fact("time", &format!("median {middle:.3} ms, max {most:.3} ms"))?;
    }
    screen::line(&format!(
        "  {FAINT}speed: fraction of the object's velocity; limits: largest ratio on the way{FAINT:#}"
    ))
}
