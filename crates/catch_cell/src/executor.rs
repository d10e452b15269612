//! The executor: takes commands as the contract says, for simulated arms and for drivers of real ones.
//!
//! [`Executor`] is the trajectory queue of an arm's driver. It checks what arrives, splices each trajectory
//! into the one before it at its start, samples the set-point, and tells the brain what became of its
//! trajectories. [`GripperQueue`] does the same for gripper moves. Neither knows a clock: all times come from
//! the caller.

mod gripper_queue;
mod limit_check;

pub use gripper_queue::GripperQueue;
pub use limit_check::PeakRatios;

use catch_body::{JointVector, MAX_JOINTS, Robot};

use crate::{
    ArmState, ArmTrajectory, BSpline, TrajectoryId,
    arm::{RejectedTrajectory, Setpoint},
    rejection::{LimitViolation, Rejection},
};

/// Largest jump of a set-point in radians, rad/s and rad/s²: rounding, of single precision too.
pub const CONTINUITY: f64 = 1e-6;
/// Times closer than this are the same.
const SAME_TIME_S: f64 = 1e-9;
/// A trajectory that takes longer or has more knots is rejected: checking it takes time.
const LONGEST_S: f64 = 100.0;
const MOST_KNOTS: usize = 1000;

/// Settings of an [`Executor`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ExecutorConfig {
    /// True if position, velocity and acceleration of a trajectory must equal those of the executing one at
    /// its start.
    pub continuous_start: bool,
    /// True if position, velocity and acceleration must be continuous along the trajectory, too.
    pub continuous_inside: bool,
    /// True if a trajectory must end at rest. Beyond its end the last point is held either way.
    pub ends_at_rest: bool,
    /// Treatment of trajectories that break a limit of the arm.
    pub limit_check: LimitCheck,
}

impl Default for ExecutorConfig {
    fn default() -> Self {
        Self { continuous_start: true, continuous_inside: true, ends_at_rest: true, limit_check: LimitCheck::Reject }
    }
}

/// Treatment by an [`Executor`] of a trajectory that breaks a limit of the arm.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum LimitCheck {
    /// The trajectory is rejected.
    Reject,
    /// The trajectory is taken, and the caller gets the limits that it breaks.
    Report,
    /// Limits are not checked.
    Off,
}

/// The trajectory queue of an arm.
#[derive(Debug, Clone)]
pub struct Executor {
    /// The arm with its gripper.
    robot: Robot,
    config: ExecutorConfig,
    /// The executing trajectory first, then those that take over later. What has no identifier holds the arm
    /// at the beginning.
    queue: Vec<(Option<TrajectoryId>, BSpline)>,
    /// The highest identifier that has arrived.
    last_id: Option<TrajectoryId>,
    /// Rejected trajectories that have not been reported yet.
    rejected: Vec<RejectedTrajectory>,
}

impl Executor {
    /// An executor that holds the arm at `q`. `robot` should carry its gripper, whose weight the torque
    /// limits count with.
    pub fn new(robot: Robot, q: JointVector, config: ExecutorConfig) -> Self {
        let queue = vec![(None, BSpline::at_rest(0.0, q))];
        Self { robot, config, queue, last_id: None, rejected: Vec::new() }
    }

    /// The arm with its gripper.
    pub fn robot(&self) -> &Robot {
        &self.robot
    }

    /// Takes a trajectory that arrives at `now_s`. It replaces from its start on all that was queued.
    ///
    /// Returns the limits that it breaks: none unless [`LimitCheck::Report`] is set.
    ///
    /// # Errors
    /// The reason for the rejection; the next [`arm_state`](Self::arm_state) reports it to the brain.
    pub fn receive(&mut self, trajectory: &ArmTrajectory, now_s: f64) -> Result<Vec<LimitViolation>, Rejection> {
        let ArmTrajectory { id, spline } = trajectory;
        let checked = self.check(*id, spline, now_s);
        self.last_id = self.last_id.max(Some(*id));
        match checked {
            Ok(violations) => {
                self.queue.retain(|(_, other)| other.start_s() < spline.start_s() - SAME_TIME_S);
                self.queue.push((Some(*id), spline.clone()));
                Ok(violations)
            }
            Err(reason) => {
                self.rejected.push(RejectedTrajectory { id: *id, reason });
                Err(reason)
            }
        }
    }

    /// Rejects a trajectory for a reason of the robot controller's own.
    pub fn decline(&mut self, id: TrajectoryId) -> Rejection {
        self.last_id = self.last_id.max(Some(id));
        self.rejected.push(RejectedTrajectory { id, reason: Rejection::Declined });
        Rejection::Declined
    }

    fn check(&self, id: TrajectoryId, spline: &BSpline, now_s: f64) -> Result<Vec<LimitViolation>, Rejection> {
        let dof = self.robot.dof();
        let is_bounded = |duration_s: f64| duration_s > 0.0 && duration_s <= LONGEST_S;
        if spline.knots_s.len() > MOST_KNOTS || !spline.is_valid() || !is_bounded(spline.end_s() - spline.start_s()) {
            return Err(Rejection::Malformed);
        }
        if let Some(joint) = (dof..MAX_JOINTS).find(|&i| spline.control_points.iter().any(|point| point[i] != 0.0)) {
            return Err(Rejection::UnknownJoint { joint, dof });
        }
        // Spans that are too short for their control points.
        let is_finite = |state: [JointVector; 3]| state.iter().all(|values| values.iter().all(|it| it.is_finite()));
        if !spline.knots_s.iter().all(|&knot_s| is_finite(spline.evaluate(knot_s))) {
            return Err(Rejection::Malformed);
        }
        let [_, dq, ddq] = spline.evaluate(spline.end_s());
        let moves =
            |i: &usize| dq[*i].abs() > CONTINUITY || (self.config.continuous_inside && ddq[*i].abs() > CONTINUITY);
        if let Some(joint) = (0..dof).find(moves).filter(|_| self.config.ends_at_rest) {
            return Err(Rejection::NotAtRest { joint });
        }
        let start_s = spline.start_s();
        if start_s < now_s - SAME_TIME_S {
            return Err(Rejection::Late { by_s: now_s - start_s });
        }
        if self.last_id.is_some_and(|last| id <= last) {
            return Err(Rejection::RepeatedId);
        }
        if self.config.continuous_start {
            self.check_jump(start_s, &self.setpoint(start_s), &spline.setpoint(start_s))?;
        }
        if self.config.continuous_inside {
            let spans: Vec<[f64; 2]> = spline.spans().collect();
            for pair in spans.windows(2) {
                let [before_s, after_s] = [pair[0][1], pair[1][0]];
                self.check_jump(after_s, &spline.setpoint(before_s), &spline.setpoint(after_s))?;
            }
        }
        if self.config.limit_check == LimitCheck::Off {
            return Ok(Vec::new());
        }
        let violations = PeakRatios::of(&self.robot, spline).violations();
        match violations.first() {
            Some(first) if self.config.limit_check == LimitCheck::Reject => Err(Rejection::Limit(*first)),
            _ => Ok(violations),
        }
    }

    fn check_jump(&self, time_s: f64, old: &Setpoint, new: &Setpoint) -> Result<(), Rejection> {
        let jumps = old.distance(new);
        let (joint, size) = jumps.argmax();
        if size <= CONTINUITY { Ok(()) } else { Err(Rejection::Discontinuous { joint, time_s, size }) }
    }

    /// Set-point of the arm at `time_s`.
    pub fn setpoint(&self, time_s: f64) -> Setpoint {
        self.queue[self.executing(time_s)].1.setpoint(time_s)
    }

    /// Index of the last trajectory that has started by `time_s`.
    fn executing(&self, time_s: f64) -> usize {
        self.queue.iter().rposition(|(_, spline)| spline.start_s() <= time_s + SAME_TIME_S).unwrap_or(0)
    }

    /// Set-point of the arm at `time_s`, after which no earlier time is asked for: trajectories that have
    /// been replaced by then are forgotten.
    pub fn advance(&mut self, time_s: f64) -> Setpoint {
        self.queue.drain(..self.executing(time_s));
        self.setpoint(time_s)
    }

    /// State that is reported to the brain, with what was rejected since the last call: `q` and `dq` as the
    /// encoders have them at `time_s`.
    pub fn arm_state(&mut self, time_s: f64, q: JointVector, dq: JointVector) -> ArmState {
        let (executing, spline) = &self.queue[self.executing(time_s)];
        let commanded = spline.setpoint(time_s);
        ArmState {
            time_s,
            q,
            dq,
            // An arm that is held at the beginning stands still, whatever rounding makes of its derivatives.
            commanded: if executing.is_some() { commanded } else { Setpoint::at_rest(commanded.q) },
            executing: *executing,
            rejected: std::mem::take(&mut self.rejected),
        }
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use crate::LimitKind;
    use catch_body::robot_file::RobotFiles;

    pub(crate) fn robot() -> Robot {
        let files = RobotFiles {
            urdf_file: "robot.urdf",
            urdf: include_str!("../../../assets/robots/iiwa14/robot.urdf"),
            toml_file: "robot.toml",
            toml: include_str!("../../../assets/robots/iiwa14/robot.toml"),
        };
        Robot::from_files(&files).unwrap()
    }

    fn executor(config: ExecutorConfig) -> Executor {
        let robot = robot();
        let q = robot.ready_q;
        Executor::new(robot, q, config)
    }

    /// A motion from rest to rest with this change of the first joint's position, slow enough for all limits.
    fn motion(id: u64, start_s: f64, from: JointVector, by_rad: f64) -> ArmTrajectory {
        let steps = [0.0, 0.0, 0.0, 0.2, 0.5, 0.8, 1.0, 1.0, 1.0];
        let control_points: Vec<JointVector> =
            steps.iter().map(|step| from + JointVector::ith(0, step * by_rad)).collect();
        let inner = (1..control_points.len() - 3).map(|i| start_s + i as f64 / 6.0);
        let knots_s = [start_s; 4].into_iter().chain(inner).chain([start_s + 1.0; 4]).collect();
        ArmTrajectory { id: TrajectoryId(id), spline: BSpline { knots_s, control_points } }
    }

    #[test]
    fn trajectories_are_spliced_and_told() {
        let mut executor = executor(ExecutorConfig::default());
        let from = executor.robot().ready_q;
        let step = JointVector::ith(0, 0.1);
        assert_eq!(executor.arm_state(0.0, from, from).executing, None);
        assert_eq!(executor.receive(&motion(1, 0.1, from, 0.1), 0.0), Ok(vec![]));
        executor.receive(&motion(2, 1.2, from + step, 0.1), 0.0).unwrap();
        executor.receive(&motion(3, 2.3, from + step * 2.0, 0.1), 0.0).unwrap();
        // This one takes the place of the third.
        executor.receive(&motion(4, 2.3, from + step * 2.0, -0.2), 0.5).unwrap();
        let executing = |executor: &mut Executor, time_s: f64| {
            executor.advance(time_s);
            executor.arm_state(time_s, from, from).executing
        };
        assert_eq!(executing(&mut executor, 0.05), None);
        for (time_s, id, by_rad) in [(0.1, 1, 0.0), (1.15, 1, 0.1), (1.2, 2, 0.1), (2.3, 4, 0.2), (9.0, 4, 0.0)] {
            assert_eq!(executing(&mut executor, time_s), Some(TrajectoryId(id)), "at {time_s} s");
            assert!((executor.setpoint(time_s).q - from - JointVector::ith(0, by_rad)).amax() < 1e-12);
        }
    }

    /// Every kind of wrong trajectory, one after the other, is rejected with its reason, and the old one goes
    /// on.
    #[test]
    fn every_rejection_says_what_and_where() {
        let mut executor = executor(ExecutorConfig::default());
        let from = executor.robot().ready_q;
        executor.receive(&motion(1, 0.0, from, 0.1), 0.0).unwrap();
        let after = from + JointVector::ith(0, 0.1);
        let changed = |id: u64, change: &dyn Fn(&mut BSpline)| {
            let mut trajectory = motion(id, 2.0, after, 0.1);
            change(&mut trajectory.spline);
            trajectory
        };
        let sharp = changed(0, &|it| *it = it.clone().followed_by(&motion(0, 3.0, it.control_points[8], 0.1).spline));
        assert!(executor.check(TrajectoryId(2), &sharp.spline, 1.0).is_ok(), "joined at rest");
        let cases: [(ArmTrajectory, f64, Rejection); 14] = [
            (changed(2, &|it| it.control_points[4][0] = f64::NAN), 1.0, Rejection::Malformed),
            (changed(3, &|it| it.knots_s.clear()), 1.0, Rejection::Malformed),
            (changed(4, &|it| it.knots_s.swap(3, 6)), 1.0, Rejection::Malformed),
            (changed(4, &|it| *it.knots_s.last_mut().unwrap() += 1.0), 1.0, Rejection::Malformed),
            (changed(4, &|it| it.knots_s.iter_mut().rev().take(4).for_each(|it| *it = 1e9)), 1.0, Rejection::Malformed),
            (changed(5, &|it| it.control_points.truncate(5)), 1.0, Rejection::Malformed),
            (changed(6, &|it| it.control_points[4][7] = 0.1), 1.0, Rejection::UnknownJoint { joint: 7, dof: 7 }),
            (changed(6, &|_| {}), 1.0, Rejection::RepeatedId),
            (changed(7, &|it| it.control_points[8][2] += 0.1), 1.0, Rejection::NotAtRest { joint: 2 }),
            (changed(8, &|it| it.control_points[6][2] += 0.1), 1.0, Rejection::NotAtRest { joint: 2 }),
            (changed(9, &|_| {}), 2.5, Rejection::Late { by_s: 0.5 }),
            (
                motion(10, 2.0, after + JointVector::ith(3, 0.01), 0.1),
                1.0,
                Rejection::Discontinuous { joint: 3, time_s: 2.0, size: 0.01 },
            ),
            // A knot that is doubled lets the acceleration jump.
            (
                changed(11, &|it| it.knots_s[5] = it.knots_s[4]),
                1.0,
                Rejection::Discontinuous { joint: 0, time_s: 2.0 + 1.0 / 6.0, size: 0.0 },
            ),
            (
                motion(12, 2.0, after, 2.0),
                1.0,
                Rejection::Limit(LimitViolation { joint: 0, kind: LimitKind::Velocity, ratio: 0.0, time_s: 0.0 }),
            ),
        ];
        for (trajectory, now_s, expected) in cases {
            let Err(found) = executor.receive(&trajectory, now_s) else { panic!("taken instead of {expected}") };
            let state = executor.arm_state(now_s, from, from);
            assert_eq!(state.rejected, [RejectedTrajectory { id: trajectory.id, reason: found }]);
            assert_eq!(state.executing, Some(TrajectoryId(1)));
            match (found, expected) {
                (
                    Rejection::Discontinuous { joint, time_s, size },
                    Rejection::Discontinuous { joint: i, time_s: at_s, .. },
                ) => {
                    assert!(joint == i && (time_s - at_s).abs() < 1e-9 && size > 1e-3, "{found}");
                }
                (Rejection::Limit(found), Rejection::Limit(expected)) => {
                    assert_eq!((found.joint, found.kind), (expected.joint, expected.kind));
                    assert!(found.ratio > 1.0 && found.time_s > 2.0);
                }
                _ => assert_eq!(found, expected),
            }
        }
        assert_eq!(executor.decline(TrajectoryId(13)), Rejection::Declined);
        assert_eq!(executor.arm_state(1.0, from, from).rejected.len(), 1);
        assert_eq!(executor.arm_state(1.0, from, from).rejected, []);
    }

    #[test]
    fn checks_can_be_switched_off() {
        let off = ExecutorConfig {
            continuous_start: false,
            continuous_inside: false,
            ends_at_rest: false,
            limit_check: LimitCheck::Off,
        };
        let mut lenient = executor(off);
        let from = lenient.robot().ready_q;
        let away = from + JointVector::ith(3, 0.01);
        assert_eq!(lenient.receive(&motion(1, 0.0, away, 2.0), 0.0), Ok(vec![]));
        let mut moving = motion(2, 0.5, from, 0.1);
        moving.spline.control_points[8][2] += 0.1;
        assert_eq!(lenient.receive(&moving, 0.5), Ok(vec![]));
        assert_eq!(lenient.setpoint(2.0), Setpoint::at_rest(moving.spline.control_points[8]));
        let mut reporting = executor(ExecutorConfig { limit_check: LimitCheck::Report, ..ExecutorConfig::default() });
        let violations = reporting.receive(&motion(1, 0.0, from, 2.0), 0.0).unwrap();
        assert!(violations.iter().any(|it| it.joint == 0 && it.kind == LimitKind::Velocity), "{violations:?}");
    }

    /// The speed of the hand against differences of its positions; it counts where the robot states a limit.
    #[test]
    fn the_speed_of_the_hand_is_checked_where_it_is_stated() {
        let mut robot = robot();
        let trajectory = motion(1, 0.0, robot.ready_q, 0.2);
        let wrist_and_tool = |i: i32| {
            let X_WL = robot.link_poses(&trajectory.spline.setpoint(0.001 * f64::from(i)).q);
            [X_WL[robot.dof()], robot.gripper_in(&X_WL)].map(|it| it.translation.vector)
        };
        let speed = |i: i32| {
            let (before, after) = (wrist_and_tool(i), wrist_and_tool(i + 1));
            before.iter().zip(&after).map(|(a, b)| (b - a).norm() / 0.001).fold(0.0, f64::max)
        };
        let fastest_mps = (0..1000).map(speed).fold(0.0, f64::max);
        assert_eq!(PeakRatios::of(&robot, &trajectory.spline).highest(LimitKind::HandSpeed), 0.0);
        robot.max_hand_speed_mps = Some(fastest_mps / 1.1);
        let found = Executor::new(robot.clone(), robot.ready_q, ExecutorConfig::default()).receive(&trajectory, 0.0);
        let Err(Rejection::Limit(LimitViolation { joint: 6, kind: LimitKind::HandSpeed, ratio, .. })) = found else {
            panic!("{found:?}")
        };
        assert!((ratio - 1.1).abs() < 2e-3, "{ratio}");
        robot.max_hand_speed_mps = Some(fastest_mps * 1.01);
        assert_eq!(PeakRatios::of(&robot, &trajectory.spline).violations(), []);
    }

    /// The jerk of a cubic spline is constant between knots, and counts where the robot states a limit.
    #[test]
    fn jerk_is_checked_where_it_is_stated() {
        let mut robot = robot();
        let trajectory = motion(1, 0.0, robot.ready_q, 0.1);
        let spans: Vec<[f64; 2]> = trajectory.spline.spans().collect();
        let jerk = |[start_s, end_s]: &[f64; 2]| {
            let [one, two] = [start_s, end_s].map(|time_s| trajectory.spline.evaluate(*time_s)[2][0]);
            ((two - one) / (end_s - start_s)).abs()
        };
        let highest = spans.iter().map(jerk).fold(0.0, f64::max);
        assert_eq!(PeakRatios::of(&robot, &trajectory.spline).highest(LimitKind::Jerk), 0.0);
        robot.joints[0].limits.jerk = Some(highest * 0.99);
        let found = Executor::new(robot.clone(), robot.ready_q, ExecutorConfig::default()).receive(&trajectory, 0.0);
        let Err(Rejection::Limit(LimitViolation { joint: 0, kind: LimitKind::Jerk, ratio, .. })) = found else {
            panic!("{found:?}")
        };
        assert!((ratio - 1.0 / 0.99).abs() < 1e-9);
        robot.joints[0].limits.jerk = Some(highest);
        assert_eq!(PeakRatios::of(&robot, &trajectory.spline).violations(), []);
    }
}
