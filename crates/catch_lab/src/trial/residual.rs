//! A brain's motions with a learned policy's offsets upon them (residual policy learning, Silver et al. 2018;
//! Johannink et al. 2019).

use catch_body::{Gripper, JointVector, MAX_JOINTS, Robot};
use catch_cell::{ArmState, ArmTrajectory, BSpline, Command, Setpoint, TrajectoryId, executor::PeakRatios};

use super::steering::{Steering, least_clearance_m, spline};

/// Largest offset of a joint from the brain's motion that can be wanted, in radians. Where an acceleration
/// limit holds a joint back, it swings beyond.
pub const MOST_OFFSET_RAD: f64 = 0.1;
/// Natural frequency of the critically damped way to the wanted offset, in rad/s.
const FREQUENCY_RADPS: f64 = 20.0;
/// Ratio of the acceleration limits that it takes at most.
const ACCELERATION_FRACTION: f64 = 0.3;
/// Fractions of the offset that are tried in this order; then the offset's motion brakes.
const FRACTIONS: [f64; 4] = [1.0, 0.6, 0.3, 0.0];
/// The arm comes no nearer than this to itself and its surroundings, in metres, unless the brain's motion
/// does.
const CLEARANCE_M: f64 = 0.04;
/// Ratio of the velocity limits that an offset makes use of: an object that hits an arm that is not where the
/// brain wanted it makes joints faster, and the brain keeps room for the hits that it expects.
const VELOCITY_FRACTION: f64 = 0.95;
/// Trajectories that are remembered: more than are sent until one is told to be rejected.
const REMEMBERED: usize = 64;
/// Knots closer than this are the same, in seconds.
const SAME_TIME_S: f64 = 1e-9;

/// Adds offsets to the trajectories of a brain. Until the first offset the brain's commands pass unchanged.
/// From then on what is sent is the sum of the brain's spline and that of the offset, as far as it keeps the
/// arm's limits and distances, and the brain is told that its own motions are executed.
#[derive(Debug)]
pub struct ResidualMotion {
    steering: Steering,
    /// Model of the arm with the gripper.
    robot: Robot,
    max_width_m: f64,
    /// Trajectories that the brain believes to be executed, oldest first, with identifiers; the first holds
    /// the arm.
    planned: Vec<(Option<TrajectoryId>, BSpline)>,
    /// Trajectories that were sent instead.
    sent: Vec<(Option<TrajectoryId>, BSpline)>,
    last_id: u64,
    has_offset: bool,
}

impl ResidualMotion {
    /// Creates the motion of an arm that rests at `q`, with offsets that change every `period_s`.
    pub fn new(robot: &Robot, gripper: &Gripper, period_s: f64, q: &JointVector) -> Self {
        let held = vec![(None, BSpline::at_rest(0.0, *q))];
        Self {
            steering: Steering::new(robot, gripper, period_s),
            robot: robot.clone().carrying(gripper),
            max_width_m: gripper.max_width_m,
            planned: held.clone(),
            sent: held,
            last_id: 0,
            has_offset: false,
        }
    }

    /// Offset of what was sent last from the brain's motion at `time_s`: positions, velocities and
    /// accelerations.
    pub fn offset(&self, time_s: f64) -> Setpoint {
        let [sent, planned] = [&self.sent, &self.planned].map(|it| newest(it).setpoint(time_s));
        Setpoint { q: sent.q - planned.q, dq: sent.dq - planned.dq, ddq: sent.ddq - planned.ddq }
    }

    /// The arm as the brain is to see it: in the state `sensed`, but executing what the brain sent. `None` if
    /// that is so.
    pub fn arm_of_brain(&mut self, sensed: &ArmState) -> Option<ArmState> {
        let is_rejected = |id: &Option<TrajectoryId>| sensed.rejected.iter().any(|it| Some(it.id) == *id);
        self.sent.retain(|(id, _)| !is_rejected(id));
        if !self.has_offset {
            self.planned.retain(|(id, _)| !is_rejected(id));
            return None;
        }
        let started = self.planned.iter().rev().find(|(_, it)| it.start_s() <= sensed.time_s + SAME_TIME_S);
        let (executing, spline) = started.unwrap_or(&self.planned[0]);
        let commanded = spline.setpoint(sensed.time_s);
        Some(ArmState { commanded, executing: *executing, rejected: Vec::new(), ..sensed.clone() })
    }

    /// The command of the brain with the offset on its way to `wanted`, a fraction of [`MOST_OFFSET_RAD`] for
    /// each joint, from `start_s` on.
    pub fn shifted(&mut self, mut command: Command, start_s: f64, wanted: &JointVector) -> Command {
        if let Some(ArmTrajectory { id, spline }) = &command.arm {
            push(&mut self.planned, (Some(*id), spline.clone()));
            if !self.has_offset {
                push(&mut self.sent, (Some(*id), spline.clone()));
                self.last_id = self.last_id.max(id.0);
            }
        }
        self.has_offset |= wanted.iter().any(|it| *it != 0.0);
        if self.has_offset {
            command.arm = self.motion(start_s, wanted).map(|spline| {
                self.last_id += 1;
                push(&mut self.sent, (Some(TrajectoryId(self.last_id)), spline.clone()));
                ArmTrajectory { id: TrajectoryId(self.last_id), spline }
            });
        }
        command
    }

    /// The brain's motion with the offset on its way; `None` if that breaks a limit, and what was sent before
    /// goes on.
    fn motion(&self, start_s: f64, wanted: &JointVector) -> Option<BSpline> {
        let planned = newest(&self.planned);
        let start_s = start_s.max(planned.start_s());
        let (start, offset) = (newest(&self.sent).setpoint(start_s), self.offset(start_s));
        let most = self.steering.max_acceleration() * ACCELERATION_FRACTION;
        let target = wanted.map(|it| it.clamp(-1.0, 1.0) * MOST_OFFSET_RAD);
        let pull = (target - offset.q) * FREQUENCY_RADPS.powi(2) - offset.dq * (2.0 * FREQUENCY_RADPS);
        let of_joints = |of: &dyn Fn(usize) -> f64| {
            JointVector::from_iterator((0..MAX_JOINTS).map(|i| if i < self.robot.dof() { of(i) } else { 0.0 }))
        };
        FRACTIONS.into_iter().find_map(|fraction| {
            let ddq = of_joints(&|i| (pull[i] * fraction).clamp(-most[i], most[i]));
            let motion = sum(start_s, &start, [planned, &self.steering.braked(start_s, &offset, &ddq)]);
            let is_kept = PeakRatios::of(&self.robot, &motion).violations().is_empty();
            (is_kept && self.keeps_room(&motion, planned)).then_some(motion)
        })
    }

    /// Returns whether the arm keeps its distances and room for a hit until it is at rest, or as much as the
    /// brain's motion where that keeps less.
    fn keeps_room(&self, motion: &BSpline, planned: &BSpline) -> bool {
        let least_m = |it: &BSpline, time_s: f64| {
            least_clearance_m(&self.robot, self.steering.clearance(), self.max_width_m, &it.setpoint(time_s).q)
        };
        let period_s = self.steering.period_s();
        let looks = ((motion.end_s() - motion.start_s()) / period_s).ceil() as u32;
        (1..=looks).rev().map(|look| motion.start_s() + f64::from(look) * period_s).all(|time_s| {
            let speeds = [motion, planned].map(|it| it.setpoint(time_s).dq.abs());
            let is_slow = self
                .robot
                .joints
                .iter()
                .enumerate()
                .all(|(i, joint)| speeds[0][i] <= (joint.limits.velocity * VELOCITY_FRACTION).max(speeds[1][i]));
            let clear_m = least_m(motion, time_s);
            is_slow && (clear_m >= CLEARANCE_M || clear_m >= least_m(planned, time_s))
        })
    }
}

/// The one that was sent last. One is always there: what holds the arm at the beginning is never rejected.
fn newest(of: &[(Option<TrajectoryId>, BSpline)]) -> &BSpline {
    &of[of.len() - 1].1
}

fn push(to: &mut Vec<(Option<TrajectoryId>, BSpline)>, one: (Option<TrajectoryId>, BSpline)) {
    to.push(one);
    to.drain(..to.len().saturating_sub(REMEMBERED));
}

/// The sum of two motions from `start_s` on, where it is in the state `start`: its accelerations are linear
/// between the knots of both.
fn sum(start_s: f64, start: &Setpoint, parts: [&BSpline; 2]) -> BSpline {
    let later = |it: &&f64| **it > start_s + SAME_TIME_S;
    let mut times_s: Vec<f64> = parts.iter().flat_map(|it| &it.knots_s).filter(later).copied().collect();
    times_s.push(start_s);
    times_s.sort_unstable_by(f64::total_cmp);
    times_s.dedup_by(|later, earlier| *later - *earlier <= SAME_TIME_S);
    let acceleration = |time_s: &f64| parts.map(|it| it.setpoint(*time_s).ddq).iter().sum();
    let mut accelerations: Vec<JointVector> = times_s.iter().map(acceleration).collect();
    accelerations[0] = start.ddq;
    spline(&times_s, start, &accelerations)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        referee,
        scenario::setup::{Choice, Setup},
        trial::{Episode, StateSnapshot, stopwatch::Stopwatch},
    };
    use catch_cell::Brain;

    /// A throw with a brain whose motions get the offsets `wanted`; whether it was caught, limits that were
    /// broken, and offsets that were seen.
    fn throw(setup: &Setup, wanted: &dyn Fn(usize) -> JointVector) -> (bool, u32, f64) {
        let (mut episode, mut brain) = (Episode::new(setup, 1, 0), setup.brain(1, 0));
        let mut residual = ResidualMotion::new(&setup.robot, &setup.gripper, 0.01, &setup.robot.ready_q);
        let mut farthest = 0.0_f64;
        for tick in 0.. {
            if episode.is_done() {
                break;
            }
            let mut sensed = episode.sense();
            if let Some(arm) = residual.arm_of_brain(&sensed.arm) {
                assert!(sensed.arm.rejected.is_empty(), "{:?}", sensed.arm.rejected);
                sensed.arm = arm;
            }
            let start_s = sensed.time_s + setup.scenario.brain.control.expected_latency_s;
            let command = residual.shifted(brain.tick(&sensed, &mut ()), start_s, &wanted(tick));
            farthest = farthest.max(residual.offset(start_s).q.amax());
            let report = Some(brain.report().clone());
            episode.act(&command, StateSnapshot { time_s: sensed.time_s, report, stage_ms: Vec::new() }, 0.0);
        }
        let verdict = referee::judge(setup, &episode.into_trial(Stopwatch::default()));
        (verdict.caught, verdict.limit_violations as u32, farthest)
    }

    fn setup() -> Setup {
        Setup::load(&Choice { scenario: Some("paper"), throw: Some("near_sampled"), ..Choice::default() }).unwrap()
    }

    #[test]
    fn without_offsets_the_brain_catches_as_it_does_alone() {
        assert_eq!(throw(&setup(), &|_| JointVector::zeros()), (true, 0, 0.0));
    }

    /// Steps from one end to the other, at three rates.
    #[test]
    fn no_offset_breaks_a_limit() {
        let setup = setup();
        for held in [1, 5, 20] {
            let side = |tick: usize| if (tick / held).is_multiple_of(2) { 1.0 } else { -1.0 };
            let wanted = |tick| JointVector::from_fn(|i, _| if i < setup.robot.dof() { side(tick + i) } else { 0.0 });
            let (_, violations, farthest) = throw(&setup, &wanted);
            assert_eq!(violations, 0);
            assert!(farthest > 0.005 && farthest < 2.0 * MOST_OFFSET_RAD, "{farthest}");
        }
    }

    #[test]
    fn a_sum_is_that_of_positions_velocities_and_accelerations() {
        let setup = setup();
        let steering = Steering::new(&setup.robot, &setup.gripper, 0.01);
        let start = |scale: f64| Setpoint {
            q: JointVector::repeat(scale),
            dq: JointVector::repeat(-scale),
            ddq: JointVector::repeat(0.5),
        };
        let parts = [(0.2, 0.1), (0.213, 0.03)]
            .map(|(start_s, scale)| steering.braked(start_s, &start(scale), &JointVector::repeat(1.0 - scale)));
        let of = |time_s: f64| {
            let [a, b] = [0, 1].map(|i| parts[i].setpoint(time_s));
            Setpoint { q: a.q + b.q, dq: a.dq + b.dq, ddq: a.ddq + b.ddq }
        };
        let whole = sum(0.213, &of(0.213), [&parts[0], &parts[1]]);
        assert!(whole.is_valid());
        for look in 0..100 {
            let time_s = 0.213 + 0.02 * f64::from(look);
            assert!(whole.setpoint(time_s).distance(&of(time_s)).amax() < 1e-9, "{time_s}");
        }
    }
}
