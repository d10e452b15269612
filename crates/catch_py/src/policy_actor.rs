//! Commands from a learned policy's actions: they keep the arm's limits.

use catch_body::JointVector;
use catch_cell::{ArmTrajectory, BSpline, Command, GripperMove, Observation, Setpoint, TrajectoryId};
use catch_lab::{scenario::setup::Setup, trial::steering::Steering};

use crate::arguments::joint_vector;
/// Trajectories that are remembered: more than are sent until one is told to be rejected.
const REMEMBERED: usize = 64;

/// Meaning of an action for each joint, as a fraction of a limit.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Action {
    /// The acceleration.
    Acceleration,
    /// The change of its position until the next action.
    Delta,
}

/// Time from one action to the next.
fn period_s(setup: &Setup) -> f64 {
    let arena = &setup.scenario.arena;
    arena.steps_per_frame() as f64 * arena.step_s
}

/// Steers arm and gripper by actions alone.
pub struct SteeredArm {
    steering: Steering,
    is_delta: bool,
    /// Trajectory that holds the arm at the beginning, and the newest trajectories that were sent and not
    /// rejected, with their identifiers.
    sent: Vec<(u64, BSpline)>,
    last_id: u64,
    closes: Option<bool>,
}

impl SteeredArm {
    /// An arm at rest at `now_s`.
    pub fn new(setup: &Setup, action: Action, now_s: f64) -> Self {
        Self {
            steering: Steering::new(&setup.robot, &setup.gripper, period_s(setup)),
            is_delta: action == Action::Delta,
            sent: vec![(0, BSpline::at_rest(now_s, setup.robot.ready_q))],
            last_id: 0,
            closes: None,
        }
    }

    /// Acts as far as the limits allow.
    pub fn command(&mut self, setup: &Setup, sensed: &Observation, start_s: f64, action: &[f64]) -> Command {
        let dof = setup.robot.dof();
        let wanted = joint_vector(&action[..dof]).map(|it| it.clamp(-1.0, 1.0));
        let closes = action[dof] > 0.0;
        self.sent.retain(|(id, _)| sensed.arm.rejected.iter().all(|it| it.id.0 != *id));
        let newest = self.sent.last().map(|(_, motion)| motion.setpoint(start_s));
        let start = newest.unwrap_or(Setpoint::at_rest(sensed.arm.commanded.q));
        let accelerations = if self.is_delta {
            // Half of what is missing within a period: faster swings.
            let dq = wanted.component_mul(&self.steering.max_velocity());
            (dq - start.dq) * (0.5 / period_s(setup))
        } else {
            wanted.component_mul(&self.steering.max_acceleration())
        };
        let mut command = Command::default();
        // An arm that rests and is to rest needs no new motion.
        let is_at_rest = [start.dq, start.ddq, accelerations].iter().all(|it| *it == JointVector::zeros());
        let motion = if is_at_rest { None } else { self.steering.motion(start_s, &start, &accelerations) };
        if let Some(motion) = motion {
            self.last_id += 1;
            self.sent.push((self.last_id, motion.clone()));
            self.sent.drain(..self.sent.len().saturating_sub(REMEMBERED));
            command.arm = Some(ArmTrajectory { id: TrajectoryId(self.last_id), spline: motion });
        }
        if self.closes.replace(closes) != Some(closes) {
            let gripper = &setup.gripper;
            let width_m = if closes { 0.0 } else { gripper.max_width_m };
            let (speed_mps, force_n) = (gripper.max_speed_mps, gripper.max_force_n);
            command.gripper = Some(vec![GripperMove { start_s, width_m, speed_mps, force_n }]);
        }
        command
    }
}
