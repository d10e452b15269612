//! The brain in a cell of one's own, without the arena: `cargo run --release --example 06_own_cell`.
//!
//! A real cell's driver fills in the same [`Observation`] from its encoders, its gripper and its cameras, and passes the same
//! [`Command`] on. Here the arm does exactly what it is told, and the images are those of a ball on a parabola.

#![expect(clippy::print_stdout, reason = "examples speak to whoever runs them")]

use catch_body::{Gripper, Pose, Robot, TriangleMesh, robot_file::RobotFiles};
use catch_bot::{CatchingBot, Config};
use catch_cell::{
    ArmState, ArmTrajectory, Brain, CameraModel, Cell, Command, DepthFrame, GraspState, GripperMove, GripperState,
    Observation,
};
use catch_sim::cameras;
use nalgebra::{Point3, Vector3};

const RADIUS_M: f64 = 0.0336;
const FRAME_S: f64 = 0.01;

/// What is known of the cell: the clock, the motion that the drives execute, and where the cameras are.
struct OwnCell {
    time_s: f64,
    motion: ArmTrajectory,
    fingers: Vec<GripperMove>,
    cameras: Vec<CameraModel>,
}

/// Where the ball is: thrown past the arm from 2.5 m.
fn ball(time_s: f64) -> Point3<f64> {
    Point3::new(1.66, 1.63, 0.3) + Vector3::new(-1.9, -1.3, 4.3) * time_s
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

impl OwnCell {
    /// Fingers that are at once where they are told to be.
    fn width_m(&self) -> f64 {
        let begun = self.fingers.iter().rev().find(|step| step.start_s <= self.time_s);
        begun.unwrap_or(&self.fingers[0]).width_m
    }
}

impl Cell for OwnCell {
    fn sense(&mut self) -> Observation {
        let now = self.motion.setpoint(self.time_s);
        let frames = self.cameras.iter().enumerate().map(|(i, model)| image(i, model, self.time_s));
        Observation {
            time_s: self.time_s,
            arm: ArmState { q: now.q, dq: now.dq, setpoint_q: now.q },
            gripper: GripperState { width_m: self.width_m(), speed_mps: 0.0, force_n: 0.0, grasp: GraspState::Idle },
            frames: frames.collect(),
        }
    }

    fn act(&mut self, command: Command) {
        // The new motion continues the old one at its start.
        self.motion = command.arm.unwrap_or_else(|| self.motion.clone());
        if let Some(moves) = command.gripper {
            // They replace those that have not begun.
            self.fingers.retain(|step| step.start_s <= self.time_s);
            self.fingers.extend(moves);
        }
        self.time_s += FRAME_S;
    }
}

fn main() -> anyhow::Result<()> {
    let robot = Robot::from_files(&RobotFiles {
        urdf_file: "robot.urdf",
        urdf: include_str!("../../../assets/robots/iiwa14/robot.urdf"),
        toml_file: "robot.toml",
        toml: include_str!("../../../assets/robots/iiwa14/robot.toml"),
    })?;
    let gripper = Gripper::from_toml("wsg50.toml", include_str!("../../../assets/grippers/wsg50.toml"))?;
    // Images of the object from all around, taken beforehand; a real cell takes its own.
    let scanners = cameras::rig_from_toml("reference.toml", include_str!("../../../assets/rigs/reference.toml"))?;
    let scan = cameras::reference_scan(&TriangleMesh::sphere(RADIUS_M, 4), &scanners);
    let looking = [[3.0, 0.0, 1.5], [0.0, 3.0, 1.5], [-2.0, 2.0, 2.0]].map(|eye| {
        let X_WC = Pose::face_towards(&eye.into(), &Point3::new(0.6, 0.6, 0.8), &-Vector3::z());
        CameraModel::with_field_of_view(X_WC, 640, 480, 1.2)
    });

    let open = GripperMove { start_s: 0.0, width_m: gripper.max_width_m, speed_mps: 0.4, force_n: 40.0 };
    let motion = ArmTrajectory::at_rest(0.0, robot.ready_q);
    let mut cell = OwnCell { time_s: 0.0, motion, fingers: vec![open], cameras: looking.to_vec() };
    let centre = gripper.grasp_centre();
    let mut brain = CatchingBot::new(Config::default(), robot.clone(), gripper, looking.to_vec(), &scan)?;
    let mut told = None;
    while cell.time_s < 1.0 {
        let observation = cell.sense();
        let command = brain.tick(&observation, &mut ());
        if told != Some(brain.report().status) {
            told = Some(brain.report().status);
            println!("{:.2} s: {:?}", cell.time_s, brain.report().status);
        }
        cell.act(command);
    }
    let plan = brain.report().plan.as_ref().ok_or_else(|| anyhow::anyhow!("no plan"))?;
    let hand = robot.gripper_in(&robot.link_poses(&cell.motion.setpoint(plan.catch_s).q)) * centre;
    let off_mm = (hand - ball(plan.catch_s)).norm() * 1e3;
    let closing_s = cell.fingers.last().map_or(f64::NAN, |step| step.start_s);
    println!(
        "the fingers close from {closing_s:.3} s on; at {:.3} s the hand is {off_mm:.1} mm from the ball",
        plan.catch_s
    );
    Ok(())
}
