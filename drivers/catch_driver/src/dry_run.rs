//! A cell in which nothing moves: plans are checked and executed in imagination, images and clock are real.

use std::{fmt, sync::mpsc::Receiver};

use catch_body::JointVector;
use catch_cell::{Cell, CellFault, Command, GraspState, GripperState, Observation};

use crate::{
    camera_socket::Arrived,
    checker::{Bounds, Checker},
    clock::Clock,
};

/// Interval of the observations in seconds.
const TICK_S: f64 = 0.01;

/// Waits for the next state of an arm. An error says why there is none.
pub type NextState = Box<dyn FnMut() -> Result<(), String>>;

/// A robot whose states are read, and an imagined arm that waits in its pose.
pub struct DryCell {
    next_state: NextState,
    bounds: Bounds,
    q: JointVector,
    checker: Checker,
    images: Receiver<Arrived>,
    began_s: f64,
    time_s: f64,
}

impl DryCell {
    /// A cell whose imagined arm stands at `q`.
    ///
    /// # Errors
    /// If the robot sends no states.
    pub fn new(
        mut next_state: NextState,
        bounds: &Bounds,
        q: JointVector,
        images: Receiver<Arrived>,
    ) -> Result<Self, CellFault> {
        let checker = Checker::new(bounds, q, 0).ok_or_else(|| lost("no motion is allowed"))?;
        next_state().map_err(lost)?;
        Ok(Self { next_state, bounds: bounds.clone(), q, checker, images, began_s: Clock::Host.now_s(), time_s: 0.0 })
    }

    /// Puts the imagined arm back to where it stood, and the cell's clock to zero.
    ///
    /// # Errors
    /// As [`DryCell::new`].
    pub fn begin_again(&mut self) -> Result<(), CellFault> {
        self.checker = Checker::new(&self.bounds, self.q, 0).ok_or_else(|| lost("no motion is allowed"))?;
        (self.began_s, self.time_s) = (Clock::Host.now_s(), 0.0);
        Ok(())
    }
}

impl fmt::Debug for DryCell {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("DryCell").field("time_s", &self.time_s).finish_non_exhaustive()
    }
}

fn lost(cause: impl ToString) -> CellFault {
    CellFault::LostConnection { device: "arm".to_owned(), cause: cause.to_string() }
}

impl Cell for DryCell {
    type Error = CellFault;

    fn sense(&mut self) -> Result<Observation, CellFault> {
        let next_s = self.time_s + TICK_S;
        while self.time_s < next_s {
            (self.next_state)().map_err(lost)?;
            self.time_s = Clock::Host.now_s() - self.began_s;
        }
        let arm = self.checker.imagined(self.time_s);
        let on_cell = self.images.try_iter().map(|mut it| {
            it.frame.capture_s -= self.began_s;
            it.frame
        });
        let time_s = self.time_s;
        let frames = on_cell.filter(|it| (0.0..=time_s).contains(&it.capture_s)).collect();
        let gripper = GripperState { width_m: 0.0, speed_mps: 0.0, force_n: 0.0, grasp: GraspState::Idle };
        Ok(Observation { time_s, arm, gripper, frames })
    }

    fn act(&mut self, command: &Command) -> Result<(), CellFault> {
        if let Some(plan) = &command.arm {
            match self.checker.receive(plan, Clock::Host.now_s() - self.began_s) {
                Ok(()) => println!("{:.3} s: plan {} until {:.3} s", self.time_s, plan.id, plan.end_s()),
                Err(why) => println!("{:.3} s: plan {} is rejected: {why}", self.time_s, plan.id),
            }
        }
        Ok(())
    }
}
