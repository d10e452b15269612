//! Set-points at 1 kHz: by the plan, back to it after lost packets, and to a stop.
//!
//! A controller that misses an answer keeps the acceleration and integrates. It differences the set-points
//! that it executes: their second and third differences must stay within the limits of acceleration and
//! jerk. A set-point that jumps from the extrapolation back to the plan breaks them. So the deviation decays
//! by a polynomial, as fast as the limits allow.

use catch_body::{JointVector, Robot};
use catch_cell::{ArmTrajectory, Executor, ExecutorConfig, LimitCheck};
use catch_driver::braking::{CYCLE_S, Executed, brake};

/// Fraction of the limits that a way back to the plan may use: echoes are of single precision, which makes
/// up to 300 rad/s³ of jerk.
const REJOIN_RATIO: f64 = 0.94;
/// Numbers of cycles that a way back may take.
const REJOIN_CYCLES: [usize; 14] = [1, 2, 3, 4, 5, 6, 8, 10, 13, 18, 25, 35, 50, 70];
/// Deviations from the plan in radians that need no way back: rounding.
const ROUNDING_RAD: f64 = 1e-12;
/// Distance of an echo from what was executed in radians, beyond its rounding to single precision.
const ECHO_RAD: f64 = 1e-11;
/// Explanations of the echoes that are kept: two for each of the last three cycles.
const MOST_BELIEFS: usize = 8;

/// Set-point of the next cycle, and the number of cycles until the plan is met again.
///
/// `plan` gives the plan's set-point so many cycles after the newest of `executed`. The deviation e from it
/// decays by the polynomial of fifth degree through the last three deviations and three zeros, N, N + 1 and N
/// + 2 cycles ahead, with the least N that keeps the set-points within the limits of `robot`.
pub fn rejoin(executed: &Executed, plan: impl Fn(i32) -> JointVector, robot: &Robot) -> (JointVector, usize) {
    let deviations = [0, 1, 2].map(|i| executed.0[i as usize] - plan(-i));
    if deviations.iter().all(|it| it.amax() < ROUNDING_RAD) {
        return (plan(1), 0);
    }
    let mut ahead = Vec::with_capacity(REJOIN_CYCLES[REJOIN_CYCLES.len() - 1] + 2);
    let mut best = (f64::INFINITY, plan(1), 1);
    for cycles in REJOIN_CYCLES {
        while ahead.len() < cycles + 2 {
            ahead.push(plan(ahead.len() as i32 + 1));
        }
        let decay = Decay::new(&deviations, cycles);
        let (mut moved, mut ratio, mut first) = (*executed, 0.0_f64, ahead[0]);
        for (x, on_plan) in (1..).zip(&ahead) {
            let q = on_plan + decay.at(x);
            if x == 1 {
                first = q;
            }
            ratio = ratio.max(moved.ratio(&q, robot));
            moved = moved.then(q);
        }
        if ratio < best.0 {
            best = (ratio, first, cycles);
        }
        if ratio <= REJOIN_RATIO {
            break;
        }
    }
    (best.1, best.2)
}

/// Decay of a deviation: e(x) = w(x)·L(x), w(x) = (N − x)(N + 1 − x)(N + 2 − x), L the parabola through the
/// last three values of e/w.
struct Decay {
    cycles: f64,
    scaled: [JointVector; 3],
}

impl Decay {
    fn new(deviations: &[JointVector; 3], cycles: usize) -> Self {
        let cycles = cycles as f64;
        let scaled = [0, 1, 2].map(|i| deviations[i] / Self::weight(cycles, -(i as f64)));
        Self { cycles, scaled }
    }

    fn weight(cycles: f64, x: f64) -> f64 {
        (cycles - x) * (cycles + 1.0 - x) * (cycles + 2.0 - x)
    }

    fn at(&self, x: i32) -> JointVector {
        let x = f64::from(x);
        if x >= self.cycles {
            return JointVector::zeros();
        }
        let [newest, before, earlier] = self.scaled;
        let parabola =
            newest * ((x + 1.0) * (x + 2.0) / 2.0) - before * (x * (x + 2.0)) + earlier * (x * (x + 1.0) / 2.0);
        parabola * Self::weight(self.cycles, x)
    }
}

/// What the robot reports at the start of a cycle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sensed {
    /// The robot's clock in milliseconds.
    pub time_ms: u64,
    /// Set-point that it executed last.
    pub echo: JointVector,
}

/// The answer of one cycle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Answer {
    /// Set-point to send.
    pub q: JointVector,
    /// Answers that did not arrive since the last cycle.
    pub lost: u64,
    /// Cycles until the plan is met again: zero on the plan.
    pub rejoin_cycles: usize,
    /// True once the arm has braked to rest.
    pub has_stopped: bool,
}

/// An explanation of the echoes so far.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Belief {
    executed: Executed,
    /// Answers that have not arrived.
    lost: u64,
}

impl Belief {
    /// The next cycle and `missed` more whose states did not arrive. Without an answer the controller
    /// extrapolates.
    fn then(&self, answer: Option<JointVector>, missed: u64) -> Self {
        let first = self.executed.then(answer.unwrap_or_else(|| self.executed.extrapolated()));
        let executed = (0..missed).fold(first, |it, _| it.then(it.extrapolated()));
        Self { executed, lost: self.lost + missed + u64::from(answer.is_none()) }
    }

    /// Returns whether an echo is the newest set-point, rounded to single precision.
    fn explains(&self, echo: &JointVector) -> bool {
        self.executed.q().iter().zip(echo).all(|(q, echo)| {
            let rounding = f64::from((*echo as f32).abs().next_up() - (*echo as f32).abs()) / 2.0;
            (q - echo).abs() <= rounding + ECHO_RAD
        })
    }
}

/// The set-points of one motion, cycle by cycle.
#[derive(Debug, Clone)]
pub struct Cycle {
    /// The arm with its maker's limits.
    robot: Robot,
    plans: Executor,
    /// Explanations of the echoes, the likeliest first. An answer and the extrapolation that replaces it may
    /// round to the same echo; later echoes tell.
    beliefs: Vec<Belief>,
    sent: JointVector,
    origin_ms: u64,
    last_ms: u64,
    is_braking: bool,
}

impl Cycle {
    /// Holds the arm where its first state says. `origin_ms` is the robot's time at zero of the cell's clock.
    pub fn new(robot: Robot, first: &Sensed, origin_ms: u64) -> Self {
        // Whoever hands over a plan has checked it, and a splice that arrives late is joined like a loss.
        let unchecked = ExecutorConfig {
            continuous_start: false,
            continuous_inside: false,
            ends_at_rest: false,
            limit_check: LimitCheck::Off,
        };
        let plans = Executor::new(robot.clone(), first.echo, unchecked);
        let beliefs = vec![Belief { executed: Executed::at_rest(first.echo), lost: 0 }];
        Self { robot, plans, beliefs, sent: first.echo, origin_ms, last_ms: first.time_ms, is_braking: false }
    }

    /// Takes a plan that an [`Executor`] with checks has accepted.
    pub fn take(&mut self, plan: &ArmTrajectory) {
        // It can only be refused for a number that a checked plan has not.
        let _ = self.plans.receive(plan, plan.start_s());
    }

    /// From now on the arm brakes to rest.
    pub fn stop(&mut self) {
        self.is_braking = true;
    }

    /// Time of a state on the cell's clock.
    pub fn time_s(&self, time_ms: u64) -> f64 {
        time_ms.saturating_sub(self.origin_ms) as f64 * CYCLE_S
    }

    /// The set-points that the controller executed.
    pub fn executed(&self) -> &Executed {
        &self.beliefs[0].executed
    }

    /// Answers a state.
    pub fn answer(&mut self, sensed: &Sensed) -> Answer {
        let cycles = sensed.time_ms.saturating_sub(self.last_ms).max(1);
        let lost_before = self.beliefs[0].lost;
        self.follow_echo(&sensed.echo, cycles);
        let Belief { executed, lost } = self.beliefs[0];
        self.last_ms = sensed.time_ms;
        let time_s = self.time_s(sensed.time_ms);
        self.plans.advance(time_s - 3.0 * CYCLE_S);
        let (q, rejoin_cycles) = if self.is_braking {
            (brake(&executed, &self.robot), 0)
        } else {
            rejoin(&executed, |ahead| self.plans.setpoint(time_s + f64::from(ahead) * CYCLE_S).q, &self.robot)
        };
        self.sent = q;
        let lost = lost.saturating_sub(lost_before);
        Answer { q, lost, rejoin_cycles, has_stopped: self.is_braking && executed.is_at_rest() }
    }

    /// Works out what was executed since the last state, `cycles` ago: the answer to it, or an extrapolation,
    /// and extrapolations in the cycles whose states did not arrive.
    fn follow_echo(&mut self, echo: &JointVector, cycles: u64) {
        // Beyond 20 lost answers the controller stops by itself.
        let missed = cycles.min(20) - 1;
        let of = |belief: &Belief| [Some(self.sent), None].map(|answer| belief.then(answer, missed));
        let mut beliefs: Vec<Belief> = self.beliefs.iter().flat_map(of).collect();
        beliefs.sort_by_key(|it| it.lost);
        let nearest = beliefs.iter().min_by(|a, b| a.distance(echo).total_cmp(&b.distance(echo))).copied();
        beliefs.retain(|it| it.explains(echo));
        beliefs.dedup_by_key(|it| it.executed);
        beliefs.truncate(MOST_BELIEFS);
        if let Some(nearest) = nearest.filter(|_| beliefs.is_empty()) {
            beliefs.push(Belief { executed: nearest.executed.moved_to(*echo), ..nearest });
        }
        self.beliefs = beliefs;
    }
}

impl Belief {
    fn distance(&self, echo: &JointVector) -> f64 {
        (self.executed.q() - echo).amax()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use catch_body::robot_file::RobotFiles;
    use catch_cell::{BSpline, LimitKind, TrajectoryId, executor::PeakRatios};
    use proptest::prelude::*;

    fn fr3() -> Robot {
        let files = RobotFiles {
            urdf_file: "robot.urdf",
            urdf: include_str!("../../../assets/robots/fr3/robot.urdf"),
            toml_file: "robot.toml",
            toml: include_str!("../../../assets/robots/fr3/robot.toml"),
        };
        Robot::from_files(&files).unwrap()
    }

    /// A plan through random points that uses `ratio` of the limits of velocity and acceleration and stays
    /// within that of the jerk.
    fn plan(robot: &Robot, values: &[f64], ratio: f64) -> ArmTrajectory {
        let offset = |k: usize| {
            let k = k.clamp(2, 7) - 2;
            JointVector::from_fn(|i, _| if i < 7 { 0.05 * values[7 * k + i] } else { 0.0 })
        };
        let over = |duration_s: f64| {
            let knots = (0..14).map(|i| 0.01 + duration_s * f64::from(i - 3).clamp(0.0, 7.0) / 7.0);
            let control_points = (0..10).map(|k| robot.ready_q + offset(k) - offset(0)).collect();
            BSpline { knots_s: knots.collect(), control_points }
        };
        let peaks = PeakRatios::of(robot, &over(1.0));
        let of = |kind| peaks.highest(kind) / ratio;
        let longest =
            of(LimitKind::Velocity).max(of(LimitKind::Acceleration).sqrt()).max(libm::cbrt(of(LimitKind::Jerk)));
        ArmTrajectory { id: TrajectoryId(1), spline: over(longest) }
    }

    /// A controller as the makers describe it, which loses some answers: it extrapolates, and its echo is of
    /// single precision.
    struct Controller {
        executed: Executed,
        jerk: f64,
        acceleration: f64,
    }

    impl Controller {
        fn execute(&mut self, robot: &Robot, answer: Option<JointVector>) {
            let q = answer.unwrap_or_else(|| self.executed.extrapolated());
            let next = self.executed.then(q);
            let jerks = (next.ddq() - self.executed.ddq()) / CYCLE_S;
            for (i, joint) in robot.joints.iter().enumerate() {
                self.jerk = self.jerk.max(jerks[i].abs() / joint.limits.jerk.unwrap());
                self.acceleration = self.acceleration.max(next.ddq()[i].abs() / joint.limits.acceleration);
            }
            self.executed = next;
        }

        fn echo(&self) -> JointVector {
            self.executed.q().map(|it| f64::from(it as f32))
        }
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(64))]

        /// Lost answers, up to two together, break no limit, and the plan is met again.
        #[test]
        fn the_way_back_stays_within_the_limits(
            values in prop::collection::vec(-1.0f64..1.0, 42),
            first_lost in 20_u64..200,
            every in 40_u64..90,
            together in 1_u64..3,
        ) {
            let robot = fr3();
            let plan = plan(&robot, &values, 0.5);
            let start = Sensed { time_ms: 5000, echo: robot.ready_q.map(|it| f64::from(it as f32)) };
            let mut cycle = Cycle::new(robot.clone(), &start, 5000);
            let mut controller = Controller { executed: Executed::at_rest(start.echo), jerk: 0.0, acceleration: 0.0 };
            cycle.take(&plan);
            let end_ms = (plan.end_s() * 1e3) as u64 + 200;
            let (mut lost, mut told) = (0, 0);
            for k in 0..end_ms {
                let answer = cycle.answer(&Sensed { time_ms: 5000 + k, echo: controller.echo() });
                told += answer.lost;
                let is_lost = k >= first_lost && (k - first_lost) % every < together;
                lost += u64::from(is_lost);
                controller.execute(&robot, Some(answer.q).filter(|_| !is_lost));
            }
            prop_assert!(controller.jerk <= 1.0 && controller.acceleration <= 1.0, "{} {}", controller.jerk, controller.acceleration);
            prop_assert!((controller.executed.q() - plan.setpoint(1e3).q).amax() < 1e-9);
            prop_assert!(told <= lost, "{told} of {lost} lost answers are told");
        }

        /// From any motion within the limits the arm comes to rest within them.
        #[test]
        fn braking_stays_within_the_limits(values in prop::collection::vec(-1.0f64..1.0, 42), at_ms in 10_u64..600) {
            let robot = fr3();
            let plan = plan(&robot, &values, 0.85);
            let q = |ms: u64| plan.setpoint(ms as f64 * CYCLE_S).q;
            let executed = Executed([q(at_ms + 2), q(at_ms + 1), q(at_ms)]);
            let mut controller = Controller { executed, jerk: 0.0, acceleration: 0.0 };
            for _ in 0..1000 {
                let next = brake(&controller.executed, &robot);
                controller.execute(&robot, Some(next));
            }
            prop_assert!(controller.executed.is_at_rest());
            prop_assert!(controller.jerk <= 1.0 && controller.acceleration <= 1.0, "{} {}", controller.jerk, controller.acceleration);
        }
    }

    /// A jump back to the plan breaks the limit of the jerk where the way back does not.
    #[test]
    fn a_jump_would_break_a_limit() {
        let robot = fr3();
        // Half a rad/s² of deviation in the acceleration, extrapolated over eight cycles.
        let plan = |ahead: i32| robot.ready_q + JointVector::ith(0, 1e-5 * f64::from(ahead));
        let mut executed = Executed([plan(0), plan(-1), plan(-2)]);
        executed.0[0][0] += 4e-6;
        for _ in 0..7 {
            executed = executed.then(executed.extrapolated());
        }
        let ahead = |it: i32| plan(it + 7);
        let (q, cycles) = rejoin(&executed, ahead, &robot);
        assert!(executed.ratio(&ahead(1), &robot) > 1.0 && executed.ratio(&q, &robot) <= REJOIN_RATIO && cycles > 1);
    }

    /// A plan that is met costs no way back, and its set-points are the plan's.
    #[test]
    fn without_losses_set_points_are_those_of_the_plan() {
        let robot = fr3();
        let values: Vec<f64> = (0..42).map(|i| f64::from(i * 37 % 19) / 9.5 - 1.0).collect();
        let plan = plan(&robot, &values, 0.85);
        let start = Sensed { time_ms: 0, echo: robot.ready_q };
        let mut cycle = Cycle::new(robot.clone(), &start, 0);
        cycle.take(&plan);
        let mut echo = robot.ready_q;
        for time_ms in 0..1500 {
            let answer = cycle.answer(&Sensed { time_ms, echo: echo.map(|it| f64::from(it as f32)) });
            let on_plan = plan.setpoint((time_ms + 1) as f64 * CYCLE_S).q;
            assert!((answer.q - on_plan).amax() < 1e-6 && answer.lost == 0, "{time_ms}");
            echo = answer.q;
        }
    }
}
