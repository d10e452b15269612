//! The loop in which a cell and a brain meet.

use std::ops::ControlFlow;

use thiserror::Error;

use crate::{Brain, Cell, Command, Observation};

/// Lets `brain` act in `cell` until the recorder or a failure of the cell ends it.
///
/// `recorder` is shown every observation with the command that answers it, before the cell is; it may look at
/// cell and brain as they are then. Where it breaks, that command is not passed on and its value is returned;
/// an adapter that must raise an error of its own afterwards breaks with it. However the loop ends the arm
/// comes to rest: every trajectory does.
///
/// # Errors
/// The cell's own, with the call that failed and how many commands had been passed on.
pub fn run<C: Cell, B: Brain + ?Sized, T>(
    cell: &mut C,
    brain: &mut B,
    mut recorder: impl FnMut(&mut C, &mut B, &Observation, &Command) -> ControlFlow<T>,
) -> Result<T, RunError<C::Error>> {
    let mut ticks = 0;
    let failed = |call, ticks| move |error: C::Error| RunError { call, ticks, error };
    loop {
        let observation = cell.sense().map_err(failed("sense", ticks))?;
        let command = brain.tick(&observation, &mut ());
        if let ControlFlow::Break(value) = recorder(cell, brain, &observation, &command) {
            return Ok(value);
        }
        cell.act(&command).map_err(failed("act", ticks))?;
        ticks += 1;
    }
}

/// A failure of a cell that ended [`run`].
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
#[error("the cell failed to {call} after {ticks} ticks: {error}")]
pub struct RunError<E> {
    /// Call that failed: `sense` or `act`.
    pub call: &'static str,
    /// Commands that had been passed on before.
    pub ticks: u64,
    /// Error that the cell reported.
    pub error: E,
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{ArmState, CellFault, GraspState, GripperState, Probe, Setpoint};
    use catch_body::JointVector;

    /// Fails at one of its calls, counted from zero.
    struct Failing {
        calls: usize,
        fails_at: usize,
    }

    impl Failing {
        fn called(&mut self) -> Result<(), CellFault> {
            self.calls += 1;
            if self.calls <= self.fails_at {
                return Ok(());
            }
            Err(CellFault::LostConnection { device: "arm".to_owned(), cause: "timeout".to_owned() })
        }
    }

    impl Cell for Failing {
        type Error = CellFault;

        fn sense(&mut self) -> Result<Observation, CellFault> {
            self.called()?;
            let q = JointVector::zeros();
            let arm = ArmState {
                time_s: 0.0,
                q,
                dq: q,
                commanded: Setpoint::at_rest(q),
                executing: None,
                rejected: Vec::new(),
            };
            let gripper = GripperState { width_m: 0.0, speed_mps: 0.0, force_n: 0.0, grasp: GraspState::Idle };
            Ok(Observation { time_s: self.calls as f64, arm, gripper, frames: Vec::new() })
        }

        fn act(&mut self, _: &Command) -> Result<(), CellFault> {
            self.called()
        }
    }

    struct Idle;

    impl Brain for Idle {
        fn tick(&mut self, _: &Observation, _: &mut dyn Probe) -> Command {
            Command::default()
        }

        fn reset(&mut self) {}
    }

    #[test]
    fn a_failure_is_told_with_the_call_and_the_tick() {
        for fails_at in 0..6 {
            let mut seen = 0;
            let ended = run(&mut Failing { calls: 0, fails_at }, &mut Idle, |_, _, _, _| {
                seen += 1;
                ControlFlow::<()>::Continue(())
            });
            let error = ended.unwrap_err();
            let call = if fails_at % 2 == 0 { "sense" } else { "act" };
            assert_eq!((error.call, error.ticks), (call, fails_at as u64 / 2));
            assert_eq!(seen, fails_at.div_ceil(2), "what was sensed is recorded, too, where acting on it fails");
            assert_eq!(
                error.to_string(),
                format!("the cell failed to {call} after {} ticks: lost connection to arm: timeout", fails_at / 2)
            );
        }
    }

    #[test]
    fn the_recorder_ends_the_run_with_a_value_of_its_own() {
        let mut cell = Failing { calls: 0, fails_at: usize::MAX };
        let brain: &mut dyn Brain = &mut Idle;
        let ended = run(&mut cell, brain, |_, _, observation, _| {
            if observation.time_s > 4.0 { ControlFlow::Break("enough") } else { ControlFlow::Continue(()) }
        });
        assert_eq!(ended, Ok("enough"));
        assert_eq!(cell.calls, 5, "the last command is not passed on");
    }
}
