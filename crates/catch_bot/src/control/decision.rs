//! Catch planning as a stage that can be exchanged: what it is asked, and what it answers.

use catch_body::JointVector;
use serde::{Deserialize, Serialize};

use super::GripperPlan;
use crate::{
    trajectory_optimization::{CatchPlan, Start},
    trajectory_prediction::FlightTrajectory,
};

/// Status of the brain in a tick: the last stage that succeeded, or what is missing.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Status {
    /// No candidate for the object is in the images.
    #[default]
    NoObject,
    /// Too few poses agree on a flight.
    NoTrajectory,
    /// The object does not pass where the arm could be in time.
    OutOfReach,
    /// The object passes within reach, but no way of holding it was found.
    NoGrasp,
    /// The object passes within reach, but would hit the open gripper on its approach, whatever the grasp.
    Blocked,
    /// A catch was chosen, but no motion to it that keeps all limits.
    NoPlan,
    /// The search for a catch was cut short by its bound on the work, and goes on with the next image.
    OutOfBudget,
    /// A plan is being executed; the newest flight gave no better one.
    PlanKept,
    /// The newest flight cannot be met exactly any more; the arm goes as near to it as it can.
    Approached,
    /// A new plan was made.
    Planned,
    /// The catch is committed, too late to change anything: the plan runs to its end.
    Committed,
}

impl Status {
    /// Returns whether the arm was sent a new motion.
    pub fn is_new_motion(self) -> bool {
        matches!(self, Self::Planned | Self::Approached)
    }

    /// The status of a tick after this one in which no image arrived, by whether there is a plan.
    pub(crate) fn without_images(self, has_plan: bool) -> Self {
        match self {
            _ if has_plan => Self::PlanKept,
            Self::Planned | Self::Approached | Self::PlanKept | Self::Committed => Self::NoPlan,
            before => before,
        }
    }
}

/// State of a planner that is handed back to it with the next image.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Progress {
    /// Search passes in a row that found no catch.
    pub passes: usize,
    /// Time at which the arm departed from its ready pose, in seconds on the cell's clock; `None` if it was
    /// elsewhere when the first catch was planned.
    pub departure_s: Option<f64>,
    /// Holding cost at which the running catch was chosen or last compared with others; `None` before there
    /// is one.
    pub reference_cost: Option<f64>,
}

/// Inputs from which a catch is planned.
#[derive(Debug, Clone, Copy)]
pub struct Situation<'a> {
    /// Times of this observation and, if there was one, of the one before that had images, on the cell's
    /// clock.
    pub observed_s: (f64, Option<f64>),
    /// Time at which the object was first seen, in seconds on the cell's clock.
    pub first_seen_s: f64,
    /// Time at which a motion that is planned now takes over, and the joints' set-point then: a new
    /// trajectory must start there.
    pub start: Start,
    /// Positions in radians and velocities in rad/s of the joints as they are sensed.
    pub sensed: (JointVector, JointVector),
    /// The flight as predicted now.
    pub flight: &'a FlightTrajectory,
    /// The plan that is being executed.
    pub running: Option<&'a CatchPlan>,
    /// The closing of the gripper as commanded last.
    pub closing: Option<GripperPlan>,
    /// State that the planner returned last time.
    pub progress: Progress,
}

impl Situation<'_> {
    /// Returns whether the fingers begin to close before a motion that is planned now could take over.
    pub fn is_closing(&self) -> bool {
        self.closing.is_some_and(|closing| closing.start_s <= self.start.time_s)
    }
}

/// Result of one call of a planner.
#[derive(Debug, Clone, PartialEq)]
pub struct Decision {
    /// Status of the planner.
    pub status: Status,
    /// The plan to be executed from now on: a new one if the [status](Status::is_new_motion) says so, else
    /// the running one, perhaps with another gripper aperture.
    pub plan: Option<CatchPlan>,
    /// State that the planner wants back with the next image.
    pub progress: Progress,
}

/// Chooses the catch and the arm's motion to it (paper, III-C and III-D).
pub trait CatchPlanner: Send {
    /// Plans the catch for the flight as it is predicted now.
    fn plan(&mut self, situation: &Situation<'_>) -> Decision;

    /// Distance between the fingers that wait for a throw, in metres; `None` leaves them where they stand.
    fn waiting_width_m(&self) -> Option<f64> {
        None
    }

    /// Returns the number of numerical failures in this throw; zero where the method does not count.
    fn numerical_failures(&self) -> u32 {
        0
    }

    /// Forgets all that it knows of the throw; the next one is another.
    fn reset(&mut self) {}
}
