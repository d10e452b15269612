//! The controller: the plan that is being executed, and the commands that follow from decisions.

use catch_body::{Gripper, Robot, gripper::Fingers};
use catch_cell::{Command, GripperMove, Observation, TrajectoryId};

use super::{Config, Decision, GripperPlan, Progress, closest, gripper_moves, opening, sent_plans::SentPlans};
use crate::{
    grasp_selection::{self, Grasp},
    trajectory_optimization::{CatchPlan, Start},
    trajectory_prediction::FlightTrajectory,
};

/// Plans are not changed any more in the last seconds before the catch. The paper's code stops 0.2 s before;
/// corrections are small enough by then to go on.
const COMMIT_S: f64 = 0.05;

/// State of the running catch: its plan, the closing of the gripper, and the commands sent for them.
#[derive(Debug, Clone)]
pub struct Controller {
    config: Config,
    grasping: grasp_selection::Config,
    robot: Robot,
    gripper: Gripper,

    plan: Option<CatchPlan>,
    /// The closing of the gripper as commanded last.
    pub closing: Option<GripperPlan>,
    /// State of the planner that it wants back with the next image.
    pub progress: Progress,
    /// Gripper moves that replace those of a plan that was rejected or lost.
    amended: Option<Vec<GripperMove>>,
    /// The plans that the arm was sent and has not rejected.
    sent: SentPlans,
}

impl Controller {
    /// Creates the controller for an arm that waits with its gripper open.
    pub fn new(config: Config, grasping: grasp_selection::Config, robot: Robot, gripper: Gripper) -> Self {
        let (progress, sent) = (Progress::default(), SentPlans::default());
        Self { config, grasping, robot, gripper, plan: None, closing: None, progress, amended: None, sent }
    }

    /// The plan that is being executed.
    pub fn plan(&self) -> Option<&CatchPlan> {
        self.plan.as_ref()
    }

    /// Returns whether the catch is committed: too late to change anything.
    pub fn is_committed(&self, now_s: f64) -> bool {
        self.plan.as_ref().is_some_and(|plan| now_s > plan.catch_s - COMMIT_S)
    }

    /// Learns what became of the trajectories. If the running plan was rejected or lost, the one before it is
    /// running again, and the gripper closes for that one on `flight`. If there is none it does not close,
    /// and opens where it has begun to.
    pub fn acknowledge(&mut self, observation: &Observation, flight: Option<&FlightTrajectory>) {
        if !self.sent.acknowledge(&observation.arm) {
            return;
        }
        let now_s = observation.time_s;
        let is_over = self.plan.as_ref().is_some_and(|plan| now_s > plan.catch_s);
        let has_begun = self.closing.is_some_and(|closing| closing.start_s <= now_s);
        self.plan = self.sent.last().cloned();
        if is_over {
            // Caught or missed by now: what is in the hand stays there, whatever becomes of the motion.
            return;
        }
        let running = self.plan.as_ref().zip(flight);
        let timed = running.map(|(plan, flight)| (plan.aperture_m, self.closing_for(observation, plan, flight)));
        self.closing = timed.map(|(_, closing)| closing);
        self.amended = Some(match timed {
            Some((aperture_m, closing)) => gripper_moves(now_s, aperture_m, &closing, &self.gripper, &self.config),
            None if has_begun => vec![opening(now_s, self.gripper.max_width_m, &self.gripper)],
            None => Vec::new(),
        });
    }

    /// The command with what takes the place of a rejected plan's gripper moves, unless it has moves of its
    /// own.
    pub fn amended(&mut self, command: Command) -> Command {
        let amended = self.amended.take();
        Command { gripper: command.gripper.or(amended), ..command }
    }

    /// Plans the closing of the gripper: both fingers touch the object when its centre passes the grasp
    /// centre of the moving gripper, or shortly before.
    fn closing_for(&self, observation: &Observation, plan: &CatchPlan, flight: &FlightTrajectory) -> GripperPlan {
        let Self { config, grasping, robot, gripper, .. } = self;
        let (now_s, fingers) = (observation.time_s, &observation.gripper);
        let held = plan.grasp.X_OG * gripper.grasp_centre();
        let local_flight = flight.local_flight_at(plan.catch_s);
        let X_WG = |time_s: f64| robot.gripper_pose(&plan.trajectory.setpoint(time_s).q);
        let distance =
            |time_s: f64| (local_flight.pose_at(time_s) * held - X_WG(time_s) * gripper.grasp_centre()).norm();
        let closest_s = closest(plan.catch_s, distance);
        let contact_s = closest_s
            - grasping.contact_lead_s(&local_flight.velocity_in(X_WG, &held), &plan.grasp.centre_past_G(gripper));
        let CatchPlan { aperture_m, grasp: Grasp { object_width_m, .. }, .. } = *plan;
        let latency_s = config.gripper_latency_s.unwrap_or(gripper.drive.latency_s);
        let closing = grasping.closing(gripper);
        let close_s = contact_s - closing.duration_s(aperture_m - object_width_m);
        let stand_s = now_s + latency_s + closing.duration_s((aperture_m - fingers.width_m).abs());
        let close_s = if stand_s <= close_s {
            close_s
        } else {
            // The fingers may still be on their way to the aperture when they have to close.
            let fingers = Fingers { width_m: fingers.width_m, rate_mps: fingers.speed_mps };
            now_s + closing.wait_s(fingers, aperture_m, object_width_m, contact_s - now_s)
        };
        GripperPlan { start_s: close_s - latency_s, contact_s, speed_mps: closing.speed_mps }
    }

    /// Time and set-point at which a motion that is planned now takes over. They follow from the commands,
    /// which are known exactly, and not from the encoders, which are noisy and show a loaded arm that sags.
    pub fn start(&self, observation: &Observation) -> Start {
        let time_s = observation.time_s + self.config.expected_latency_s;
        Start { time_s, state: self.sent.setpoint(time_s, &observation.arm) }
    }

    /// An identifier for a motion that is no catch.
    pub fn next_id(&mut self) -> TrajectoryId {
        self.sent.next_id()
    }

    /// Forgets the catch. Identifiers of trajectories go on.
    pub fn reset(&mut self) {
        (self.plan, self.closing, self.progress) = (None, None, Progress::default());
        self.amended = None;
        self.sent.clear();
    }

    /// Takes over what was decided, and times the gripper by the newest flight.
    pub fn command(&mut self, observation: &Observation, decision: Decision, flight: &FlightTrajectory) -> Command {
        let now_s = observation.time_s;
        self.progress = decision.progress;
        let Some(plan) = decision.plan else { return Command::default() };
        let closing = self.closing_for(observation, &plan, flight);
        // Fingers that have started to close go on: a new list of moves would open them again.
        let is_closing = self.closing.is_some_and(|closing| closing.start_s <= now_s);
        let moves = gripper_moves(now_s, plan.aperture_m, &closing, &self.gripper, &self.config);
        let arm = decision.status.is_new_motion().then(|| self.sent.send(plan.clone()));
        if !is_closing {
            self.closing = Some(closing);
        }
        self.plan = Some(plan);
        Command { arm, gripper: (!is_closing).then_some(moves), windows: None }
    }
}
