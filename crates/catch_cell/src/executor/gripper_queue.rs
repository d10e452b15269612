//! Gripper moves that wait for their start.

use crate::GripperMove;

use super::SAME_TIME_S;

/// Moves that the fingers have not begun, soonest first.
#[derive(Debug, Clone, Default)]
pub struct GripperQueue {
    /// Moves, each with the time at which it starts: its own, or that of its arrival if that was later.
    pending: Vec<(f64, GripperMove)>,
    rejected: u32,
}

impl GripperQueue {
    /// Replaces all moves that have not started at `now_s`. One that should have started starts at once; one
    /// whose start or width is not finite, or whose speed or force is not above zero, is rejected.
    pub fn receive(&mut self, moves: &[GripperMove], now_s: f64) {
        self.pending.retain(|(start_s, _)| *start_s < now_s - SAME_TIME_S);
        for step in moves {
            // An infinite speed is a jump of the set-point, which an ideal gripper may be asked for.
            if step.start_s.is_finite() && step.width_m.is_finite() && step.speed_mps > 0.0 && step.force_n > 0.0 {
                self.pending.push((step.start_s.max(now_s), *step));
            } else {
                self.rejected += 1;
            }
        }
        // Of those that should have started already the last one wins.
        self.pending.sort_by(|a, b| a.0.total_cmp(&b.0).then_with(|| a.1.start_s.total_cmp(&b.1.start_s)));
    }

    /// Takes out the soonest move if it has started by `time_s`. `begins_s` is when the fingers begin a move
    /// that starts at a time, for a gripper that takes a while.
    pub fn take_due(&mut self, time_s: f64, begins_s: impl Fn(f64) -> f64) -> Option<GripperMove> {
        let (start_s, step) = *self.pending.first()?;
        if begins_s(start_s) > time_s + SAME_TIME_S {
            return None;
        }
        self.pending.remove(0);
        Some(step)
    }

    /// Moves that were rejected so far.
    pub fn rejected(&self) -> u32 {
        self.rejected
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn step(start_s: f64, width_m: f64) -> GripperMove {
        GripperMove { start_s, width_m, speed_mps: 0.4, force_n: 40.0 }
    }

    fn widths(queue: &mut GripperQueue, time_s: f64) -> Vec<f64> {
        std::iter::from_fn(|| queue.take_due(time_s, |start_s| start_s)).map(|step| step.width_m).collect()
    }

    #[test]
    fn moves_replace_those_that_have_not_started() {
        let mut queue = GripperQueue::default();
        queue.receive(&[step(0.3, 0.0), step(0.1, 0.1)], 0.0);
        assert_eq!(widths(&mut queue, 0.2), [0.1]);
        queue.receive(&[step(0.4, 0.02), step(f64::NAN, 0.0), step(0.5, f64::INFINITY)], 0.25);
        assert_eq!((widths(&mut queue, 0.35), queue.rejected()), (vec![], 2));
        assert_eq!(widths(&mut queue, 0.4), [0.02]);
        // A move that has started is executed, and the list that follows it as well; an empty list replaces
        // by nothing.
        queue.receive(&[step(0.5, 0.03)], 0.45);
        queue.receive(&[step(0.1, 0.05), step(0.6, 0.01)], 0.55);
        assert_eq!(widths(&mut queue, 0.56), [0.03, 0.05]);
        queue.receive(&[], 0.57);
        assert_eq!(widths(&mut queue, 1.0), Vec::<f64>::new());
    }

    #[test]
    fn a_gripper_may_take_a_while() {
        let mut queue = GripperQueue::default();
        queue.receive(&[step(0.1, 0.0)], 0.0);
        assert_eq!(queue.take_due(0.12, |start_s| start_s + 0.03), None);
        assert!(queue.take_due(0.13, |start_s| start_s + 0.03).is_some());
    }
}
