//! The brain in a cell of one's own, without the arena: `cargo run --release --example 06_own_cell`.
//!
//! A real cell's driver fills in the same [`Observation`] from its encoders, its gripper and its cameras, and
//! hands the same [`Command`]s to the same [`Executor`], which takes or rejects trajectories and samples the
//! set-point for the drives. Here the arm is exactly where its set-point is, commands arrive 4 ms late, and
//! the images are those of a ball on a parabola. The run is recorded: `catchingbot view`, `replay` and
//! `gripper-latency` open recordings of a real cell as well.

#![expect(clippy::print_stdout, reason = "examples speak to whoever runs them")]

use std::{
    io,
    ops::ControlFlow,
    path::{Path, PathBuf},
};

use catch_body::{Pose, TriangleMesh, robot::LimitScale};
use catch_bot::{CatchingBot, Config};
use catch_cell::{
    CameraModel, Cell, CellFault, Command, DataSheet, DepthFrame, Executor, ExecutorConfig, GraspState, GripperMove,
    GripperQueue, GripperState, KnownObject, ObjectFigures, Observation, reference_scan, rig_from_toml, run,
};
use catch_recording::{
    RecordedCell,
    cell_recorder::CellRecorder,
    sources::{Meshes, SourceNames, Sources},
};
use nalgebra::{Point3, Vector3};

const RADIUS_M: f64 = 0.0336;
const READY_RAD: [f64; 7] = [-1.482, 1.075, 1.562, -1.123, 0.910, 1.270, 1.473];
const FRAME_S: f64 = 0.01;
/// Time from an observation until the command that answers it arrives, and what the brain expects it to be.
const LATENCY_S: f64 = 0.004;
const EXPECTED_LATENCY_S: f64 = 0.005;

/// Cell of one's own: the clock, the drives' commands, and the cameras.
struct OwnCell {
    time_s: f64,
    arm: Executor,
    gripper: GripperQueue,
    fingers: GripperMove,
    /// Command under way, with its time of arrival.
    command: Option<(f64, Command)>,
    cameras: Vec<CameraModel>,
}

/// Position of the ball, thrown past the arm from 3.9 m.
fn ball(time_s: f64) -> Point3<f64> {
    Point3::new(2.517, 2.981, 0.401) + Vector3::new(-2.29, -3.82, 4.4) * time_s
        - Vector3::z() * (9.81 / 2.0 * time_s * time_s)
}

/// The part of an image that shows the ball, as a depth camera that can tell the ball from all else gives it.
fn image(camera: usize, model: &CameraModel, time_s: f64) -> DepthFrame {
    let centre_C = model.X_WC.inverse() * ball(time_s);
    let window = model.window_around(&centre_C, RADIUS_M);
    let depth_m = (0..window.area()).map(|pixel| {
        // The nearer point of the ray z·d on the sphere: z²·d·d − 2z·d·c + c·c = r².
        let d = model.back_project(&window.pixel_centre(pixel), 1.0).coords;
        let (dd, dc) = (d.norm_squared(), d.dot(&centre_C.coords));
        let root = dc * dc - dd * (centre_C.coords.norm_squared() - RADIUS_M * RADIUS_M);
        if root > 0.0 { ((dc - root.sqrt()) / dd) as f32 } else { f32::NAN }
    });
    let depth_m: Vec<f32> = depth_m.collect();
    let mask = Some(depth_m.iter().map(|depth| depth.is_finite()).collect());
    DepthFrame { camera, capture_s: time_s, window, depth_m, mask }
}

impl Cell for OwnCell {
    /// Error of a driver whose device does not answer; nothing fails here.
    type Error = CellFault;

    fn sense(&mut self) -> Result<Observation, CellFault> {
        if let Some((arrival_s, command)) = self.command.take() {
            if let Some(trajectory) = &command.arm
                && let Err(reason) = self.arm.receive(trajectory, arrival_s)
            {
                println!("{arrival_s:.3} s: trajectory {} is rejected, {reason}", trajectory.id);
            }
            if let Some(moves) = &command.gripper {
                self.gripper.receive(moves, arrival_s);
            }
            self.time_s += FRAME_S;
        }
        // Fingers that are at once where they are told to be.
        while let Some(step) = self.gripper.take_due(self.time_s, |start_s| start_s) {
            self.fingers = step;
        }
        let now = self.arm.advance(self.time_s);
        let frames = self.cameras.iter().enumerate().map(|(i, model)| image(i, model, self.time_s)).collect();
        let gripper =
            GripperState { width_m: self.fingers.width_m, speed_mps: 0.0, force_n: 0.0, grasp: GraspState::Idle };
        let arm = self.arm.arm_state(self.time_s, now.q, now.dq);
        Ok(Observation { time_s: self.time_s, arm, gripper, frames })
    }

    fn act(&mut self, command: &Command) -> Result<(), CellFault> {
        self.command = Some((self.time_s + LATENCY_S, command.clone()));
        Ok(())
    }
}

/// One throw in the cell; returns its recording in `folder`.
pub fn record(folder: &Path) -> anyhow::Result<PathBuf> {
    let sources = Sources {
        robot_urdf: include_str!("../../../assets/robots/iiwa14/robot.urdf").to_owned(),
        robot_toml: include_str!("../../../assets/robots/iiwa14/robot.toml").to_owned(),
        gripper_toml: include_str!("../../../assets/grippers/wsg50.toml").to_owned(),
        robot_meshes: Meshes::new(),
        gripper_meshes: Meshes::new(),
        workcell_toml: None,
        limit_scale: LimitScale::default(),
    };
    let names = SourceNames {
        robot_urdf: "robot.urdf",
        robot_toml: "robot.toml",
        gripper_toml: "wsg50.toml",
        workcell_toml: "",
    };
    let (mut robot, gripper) = sources.parse(&names)?;
    // Ready pose for throws from this side; `catchingbot ready` finds such poses.
    robot.ready_q = robot.checked_pose("the example", "READY_RAD", &READY_RAD)?;
    // Images of the object from all around, taken beforehand; a real cell takes its own.
    let scanners = rig_from_toml("reference.toml", include_str!("../../../assets/rigs/reference.toml"))?;
    let scan = reference_scan(&TriangleMesh::sphere(RADIUS_M, 4), &scanners);
    let looking = [[3.0, 0.0, 1.5], [0.0, 3.0, 1.5], [-2.0, 2.0, 2.0]].map(|eye| {
        let X_WC = Pose::face_towards(&eye.into(), &Point3::new(0.6, 0.6, 0.8), &-Vector3::z());
        CameraModel::with_field_of_view(X_WC, 640, 480, 1.2)
    });

    let mut cell = OwnCell {
        time_s: 0.0,
        arm: Executor::new(robot.clone().carrying(&gripper), robot.ready_q, ExecutorConfig::default()),
        gripper: GripperQueue::default(),
        fingers: GripperMove { start_s: 0.0, width_m: gripper.max_width_m, speed_mps: 0.4, force_n: 40.0 },
        command: None,
        cameras: looking.to_vec(),
    };
    let centre = gripper.grasp_centre();
    // Cameras without errors, as their data sheet says, and a ball that no air brakes.
    let looking = looking.map(|camera| CameraModel { sheet: Some(DataSheet::default()), ..camera });
    let figures = ObjectFigures { drag_per_m: 0.0, drag_sd_per_m: 0.0, mass_kg: Some(0.058), ..Default::default() };
    let object = KnownObject { scan, figures };
    let mut config = Config::default();
    config.control.expected_latency_s = EXPECTED_LATENCY_S;
    let mut brain = CatchingBot::new(config, robot.clone(), gripper, looking.to_vec(), &object)?;
    let known = RecordedCell {
        seed: 0,
        brain: brain.known.config.clone().into(),
        sources,
        ready_rad: robot.ready_q.as_slice()[..robot.dof()].to_vec(),
        cameras: looking.to_vec(),
        reference_scan: object.scan,
    };
    let mut recorder = CellRecorder::create(folder, "own_cell", known)?;
    let mut told = None;
    run(&mut cell, &mut brain, |_, brain, observation, command| {
        if let Err(fault) = recorder.tick(observation, command, Some(brain.report())) {
            return ControlFlow::Break(Err(fault));
        }
        let (now_s, status) = (observation.time_s, brain.report().status);
        if told.replace(status) != Some(status) {
            println!("{now_s:.2} s: {status:?}");
        }
        if now_s < 1.0 { ControlFlow::Continue(()) } else { ControlFlow::Break(io::Result::Ok(())) }
    })??;
    let plan = brain.report().plan.as_ref().ok_or_else(|| anyhow::anyhow!("no plan"))?;
    let hand = robot.gripper_in(&robot.link_poses(&cell.arm.setpoint(plan.catch_s).q)) * centre;
    let off_mm = (hand - ball(plan.catch_s)).norm() * 1e3;
    let closing_s = cell.fingers.start_s;
    println!(
        "the fingers close from {closing_s:.3} s on; at {:.3} s the hand is {off_mm:.1} mm from the ball",
        plan.catch_s
    );
    Ok(recorder.finish()?)
}

fn main() -> anyhow::Result<()> {
    let recording = record(Path::new("target/examples-out"))?;
    println!("catchingbot view {}", recording.display());
    Ok(())
}
