//! Decides which trajectories are executed.

use catch_body::{JointVector, Robot as Arm, robot::LimitScale};
use catch_cell::{ArmState, ArmTrajectory, Executor, ExecutorConfig, Rejection, cell_file::SafeBox};

use crate::safe_box;

/// Time in seconds in which a plan reaches the thread that executes it.
const HANDOVER_S: f64 = 2e-3;

/// What bounds all motions of a cell.
#[derive(Debug, Clone)]
pub struct Bounds {
    /// The arm with its gripper and its maker's limits.
    pub arm: Arm,
    /// Fraction of these limits that motions may use, without the margin for lost packets.
    pub speed_scaling: f64,
    /// Box that the hand must not leave.
    pub safe_box: SafeBox,
    /// Fraction of the acceleration limit that plans may use on a link that loses up to so many answers in a
    /// row. None: no plan may be executed over such a link.
    pub margin: fn(u64) -> Option<f64>,
}

impl Bounds {
    /// Scale of the limits within which plans are accepted over a link that loses up to `longest_run` answers
    /// in a row. None: over such a link nothing may move.
    pub fn limit_scale(&self, longest_run: u64) -> Option<LimitScale> {
        let by = self.speed_scaling;
        let acceleration = by.min((self.margin)(longest_run)?);
        Some(LimitScale { velocity: by, acceleration, jerk: by })
    }
}

/// Decides which trajectories are executed.
#[derive(Debug)]
pub struct Checker {
    pub(crate) executor: Executor,
    safe_box: SafeBox,
    margin: fn(u64) -> Option<f64>,
    /// Answers lost in a row until now, and the most so far.
    run: u64,
    longest_run: u64,
}

impl Checker {
    /// A checker of plans for an arm that stands at `q`. None: nothing may move.
    pub fn new(bounds: &Bounds, q: JointVector, longest_run: u64) -> Option<Self> {
        let arm = bounds.arm.clone().with_limits_scaled(&bounds.limit_scale(longest_run)?);
        let executor = Executor::new(arm, q, ExecutorConfig::default());
        Some(Self { executor, safe_box: bounds.safe_box, margin: bounds.margin, run: 0, longest_run })
    }

    /// State of an arm that is exactly where its set-point is.
    pub fn imagined(&mut self, time_s: f64) -> ArmState {
        let now = self.executor.advance(time_s);
        self.executor.arm_state(time_s, now.q, now.dq)
    }

    /// Takes notice of the answers that were lost in a cycle.
    pub fn lost(&mut self, count: u64) {
        self.run = if count > 0 { self.run + count } else { 0 };
        self.longest_run = self.longest_run.max(self.run);
    }

    /// Checks a trajectory that arrives at `now_s`, against the box and the link's losses, too.
    ///
    /// # Errors
    /// The reason for the rejection, which the next arm state reports.
    pub fn receive(&mut self, plan: &ArmTrajectory, now_s: f64) -> Result<(), Rejection> {
        let link_is_bad = (self.margin)(self.longest_run).is_none();
        // A spline that is none is rejected below.
        let leaves_box =
            plan.spline.is_valid() && safe_box::leaves(&self.safe_box, self.executor.robot(), plan).is_some();
        if link_is_bad || leaves_box {
            return Err(self.executor.decline(plan.id));
        }
        self.executor.receive(plan, now_s + HANDOVER_S).map(drop)
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use crate::motion;
    use catch_body::robot_file::RobotFiles;
    use catch_cell::LimitKind;

    pub(crate) fn fr3() -> Arm {
        let files = RobotFiles {
            urdf_file: "robot.urdf",
            urdf: include_str!("../../../assets/robots/fr3/robot.urdf"),
            toml_file: "robot.toml",
            toml: include_str!("../../../assets/robots/fr3/robot.toml"),
        };
        Arm::from_files(&files).unwrap()
    }

    pub(crate) fn bounds() -> Bounds {
        let safe_box = SafeBox { low_m: [-2.0; 3], high_m: [2.0; 3] };
        Bounds { arm: fr3(), speed_scaling: 1.0, safe_box, margin: |longest_run| (longest_run <= 2).then_some(0.85) }
    }

    fn moved(bounds: &Bounds, id: u64, fraction: f64) -> ArmTrajectory {
        let from = bounds.arm.ready_q;
        motion::straight(id, 0.1, [from, from + JointVector::ith(1, 0.3)], &bounds.arm, fraction)
    }

    #[test]
    fn plans_beyond_the_margin_are_rejected() {
        let bounds = bounds();
        let mut checker = Checker::new(&bounds, bounds.arm.ready_q, 0).unwrap();
        let Err(Rejection::Limit(broken)) = checker.receive(&moved(&bounds, 1, 0.9), 0.0) else { panic!("taken") };
        assert_eq!(broken.kind, LimitKind::Acceleration);
        assert!((broken.ratio - 0.9 / 0.85).abs() < 0.01, "{}", broken.ratio);
        assert_eq!(checker.receive(&moved(&bounds, 2, 0.84), 0.0), Ok(()));
    }

    #[test]
    fn a_tenth_of_the_speed_is_a_tenth_of_the_limits() {
        let bounds = Bounds { speed_scaling: 0.1, ..bounds() };
        let mut checker = Checker::new(&bounds, bounds.arm.ready_q, 0).unwrap();
        assert!(matches!(checker.receive(&moved(&bounds, 1, 0.11), 0.0), Err(Rejection::Limit(_))));
        assert_eq!(checker.receive(&moved(&bounds, 2, 0.099), 0.0), Ok(()));
    }

    #[test]
    fn a_link_that_loses_more_than_the_margin_survives_gets_no_plan() {
        let bounds = bounds();
        let mut checker = Checker::new(&bounds, bounds.arm.ready_q, 0).unwrap();
        for _ in 0..5 {
            checker.lost(2);
            checker.lost(0);
        }
        assert_eq!(checker.receive(&moved(&bounds, 1, 0.3), 0.0), Ok(()));
        (0..3).for_each(|_| checker.lost(1));
        assert_eq!(checker.receive(&moved(&bounds, 2, 0.3), 0.0), Err(Rejection::Declined));
        assert_eq!(bounds.limit_scale(3), None);
    }

    #[test]
    fn a_plan_out_of_the_box_is_declined_and_told() {
        let mut bounds = bounds();
        bounds.safe_box.high_m[2] = 0.01;
        let mut checker = Checker::new(&bounds, bounds.arm.ready_q, 0).unwrap();
        assert_eq!(checker.receive(&moved(&bounds, 1, 0.3), 0.0), Err(Rejection::Declined));
        assert_eq!(checker.imagined(0.0).rejected.len(), 1);
    }

    #[test]
    fn a_plan_that_comes_too_late_for_the_handover_is_rejected() {
        let bounds = bounds();
        let mut checker = Checker::new(&bounds, bounds.arm.ready_q, 0).unwrap();
        assert!(matches!(checker.receive(&moved(&bounds, 1, 0.3), 0.099), Err(Rejection::Late { .. })));
    }
}
